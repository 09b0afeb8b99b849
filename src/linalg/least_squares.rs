//! A small dense least-squares problem with columns that may be dependent.

use crate::linalg::small::{dot_long, norm};

/// A column whose remainder, after the columns before it are removed, is below this share of
/// its length is rounding.
const DEPENDENT: f64 = 1e-10;

/// `x` that minimises `‖b − Σ x_j a_j‖`, by Gram–Schmidt over the columns in their order. A
/// column that depends on those before it gets `x_j = 0`.
pub fn solve(columns: &[&[f64]], b: &[f64]) -> Vec<f64> {
    let mut basis: Vec<(usize, Vec<f64>, Vec<f64>)> = Vec::with_capacity(columns.len());
    for (index, column) in columns.iter().enumerate() {
        let mut column = column.to_vec();
        let before = norm(&column);
        let mut coefficients = take_out(&mut column, &basis);
        let length = norm(&column);
        if length <= DEPENDENT * before || length == 0.0 {
            continue;
        }
        for value in &mut column {
            *value /= length;
        }
        coefficients.push(length);
        basis.push((index, column, coefficients));
    }
    let mut rest = b.to_vec();
    let mut right = take_out(&mut rest, &basis);
    let mut x = vec![0.0; columns.len()];
    for (k, (index, _, coefficients)) in basis.iter().enumerate().rev() {
        let value = right[k] / coefficients[k];
        x[*index] = value;
        for (y, c) in right[..k].iter_mut().zip(&coefficients[..k]) {
            *y -= value * c;
        }
    }
    x
}

/// Removes the span of the basis from `a`; returns the coefficients.
fn take_out(a: &mut [f64], basis: &[(usize, Vec<f64>, Vec<f64>)]) -> Vec<f64> {
    let remove = |(_, q, _): &(usize, Vec<f64>, Vec<f64>)| {
        let along = dot_long(q, a);
        for (value, q) in a.iter_mut().zip(q) {
            *value -= along * q;
        }
        along
    };
    basis.iter().map(remove).collect()
}
