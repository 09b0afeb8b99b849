//! Inverses of the diagonal blocks, which scale the smoother.

use crate::linalg::amg::block_matrix::ROWS;
use crate::linalg::amg::single_rows::LevelMatrix;
use crate::linalg::amg::tuning;
use crate::linalg::pages::zeros;
use crate::linalg::real::Real;
use crate::tasks;

/// The inverse of each diagonal block, by columns; `None` if a diagonal is not positive.
pub(super) fn inverse_diagonal(matrix: LevelMatrix<'_>) -> Option<Vec<f32>> {
    let b = matrix.b();
    let mut inverse = zeros(matrix.nodes() * b * b);
    let valid = tasks::map(inverse.chunks_mut(ROWS * b * b), |task, part| {
        let mut valid = true;
        let rows = task * ROWS..task * ROWS + part.len() / (b * b);
        let blocks = matrix.load_diagonal(rows);
        for (block, inverse) in blocks.chunks_exact(b * b).zip(part.chunks_exact_mut(b * b)) {
            valid &= invert_node(block, inverse);
        }
        valid
    });
    valid.iter().all(|&valid| valid).then_some(inverse)
}

/// Writes the inverse of a diagonal block; returns whether its diagonal is positive.
pub(super) fn invert_node(of: &[f32], inverse: &mut [f32]) -> bool {
    let mut block = [0.0; 36];
    for (to, from) in block.iter_mut().zip(of) {
        *to = from.double();
    }
    let valid = invert(&mut block[..of.len()], of.len().isqrt());
    for (to, &from) in inverse.iter_mut().zip(&block) {
        *to = f32::rounded(from);
    }
    valid
}

/// Inverts a symmetric positive semidefinite block in place, by Gauss and Jordan. Returns whether
/// its diagonal is positive.
///
/// A direction without stiffness would have an infinite inverse. A pivot is therefore at least
/// `tuning::least_pivot()` of its diagonal, some ten times the rounding of single precision: a larger pivot
/// makes the inverse smaller, so the bound of the spectrum remains valid.
fn invert(a: &mut [f64], b: usize) -> bool {
    let diagonal: [f64; 6] = std::array::from_fn(|k| if k < b { a[k * b + k] } else { 1.0 });
    if !diagonal.iter().all(|&d| d > 0.0 && d.is_finite()) {
        return false;
    }
    for k in 0..b {
        let pivot = a[k * b + k]
            .max(tuning::least_pivot() * diagonal[k])
            .recip();
        a[k * b + k] = 1.0;
        for j in 0..b {
            a[k * b + j] *= pivot;
        }
        for i in (0..b).filter(|&i| i != k) {
            let factor = std::mem::take(&mut a[i * b + k]);
            for j in 0..b {
                a[i * b + j] -= factor * a[k * b + j];
            }
        }
    }
    true
}
