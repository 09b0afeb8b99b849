//! A small dense least-squares problem with columns that may be dependent.

use crate::linalg::small::{add_scaled, norm, take_out};

/// A column whose remainder, after the columns before it are removed, is below this share of
/// its length is rounding.
const DEPENDENT: f64 = 1e-10;

/// `x` that minimises `‖b − Σ x_j a_j‖`, by Gram–Schmidt over the columns in their order. A
/// column that depends on those before it gets `x_j = 0`.
pub fn solve<'a>(columns: impl ExactSizeIterator<Item = &'a [f64]>, b: &[f64]) -> Vec<f64> {
    let (n, count) = (b.len(), columns.len());
    // The orthonormal columns, the rows of the triangle, and the columns that were kept.
    let mut basis = Vec::with_capacity(n * count);
    let mut triangle = vec![0.0; count * count];
    let mut kept = Vec::with_capacity(count);
    for (index, column) in columns.enumerate() {
        let before = norm(column);
        basis.extend_from_slice(column);
        let (done, column) = basis.split_at_mut(n * kept.len());
        let row = &mut triangle[kept.len() * count..][..=kept.len()];
        take_out_all(column, done, row);
        let length = norm(column);
        if length <= DEPENDENT * before || length == 0.0 {
            basis.truncate(n * kept.len());
            continue;
        }
        for value in column {
            *value /= length;
        }
        row[kept.len()] = length;
        kept.push(index);
    }
    let mut rest = b.to_vec();
    let mut right = vec![0.0; kept.len()];
    take_out_all(&mut rest, &basis, &mut right);
    let mut x = vec![0.0; count];
    for (k, &index) in kept.iter().enumerate().rev() {
        let row = &triangle[k * count..][..=k];
        let value = right[k] / row[k];
        x[index] = value;
        add_scaled(&mut right[..k], -value, row);
    }
    x
}

/// Removes the span of the basis from `a`; gives the coefficients.
fn take_out_all(a: &mut [f64], basis: &[f64], coefficients: &mut [f64]) {
    let basis = basis.chunks_exact(a.len().max(1));
    for (along, q) in coefficients.iter_mut().zip(basis) {
        *along = take_out(a, q);
    }
}
