//! Singular values of a matrix of a few columns, with the same relative accuracy for small and
//! large ones: one-sided Jacobi rotations [Demmel and Veselić 1992]. The product `Aᵀ A` would
//! lose all values below the square root of rounding.

use crate::linalg::small::{add_scaled, dot_long, norm};

/// Largest number of sweeps over all pairs of columns; six suffice in practice.
const SWEEPS: usize = 30;

/// Rotates `columns` until they are orthogonal, and returns the amounts: column `j` becomes
/// `Σ_i amounts[j][i] column_i`. The norms of the columns are then the singular values;
/// `amounts` is orthogonal.
pub fn orthogonalise(columns: &mut [Vec<f64>]) -> Vec<Vec<f64>> {
    let count = columns.len();
    let mut amounts: Vec<Vec<f64>> = (0..count)
        .map(|j| (0..count).map(|i| f64::from(u8::from(i == j))).collect())
        .collect();
    for _ in 0..SWEEPS {
        let mut rotated = false;
        for i in 0..count {
            for j in i + 1..count {
                let (a, b) = (norm(&columns[i]), norm(&columns[j]));
                let along = dot_long(&columns[i], &columns[j]);
                if along.abs() <= 2.0 * f64::EPSILON * a * b {
                    continue;
                }
                rotated = true;
                let zeta = (b - a) * (b + a) / (2.0 * along);
                let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                rotate(columns, (i, j), cosine, cosine * tangent);
                rotate(&mut amounts, (i, j), cosine, cosine * tangent);
            }
        }
        if !rotated {
            break;
        }
    }
    amounts
}

fn rotate(columns: &mut [Vec<f64>], (i, j): (usize, usize), cosine: f64, sine: f64) {
    let (left, right) = columns.split_at_mut(j);
    for (x, y) in left[i].iter_mut().zip(&mut right[0]) {
        (*x, *y) = (cosine * *x - sine * *y, sine * *x + cosine * *y);
    }
}

/// `Σ_i amounts[i] column_i`.
pub fn combine(columns: &[Vec<f64>], amounts: &[f64]) -> Vec<f64> {
    let mut sum = vec![0.0; columns.first().map_or(0, Vec::len)];
    for (column, amount) in columns.iter().zip(amounts) {
        add_scaled(&mut sum, *amount, column);
    }
    sum
}
