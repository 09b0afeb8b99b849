//! LU factorisation with pivoting of a general dense matrix, in tiles.
//!
//! The matrix is given by rows, as Newton systems are made. Its transpose is factored, by
//! columns, so that pivoting chooses among columns of the matrix. Panels are factored on one
//! thread, the columns to their right in tiles cut at fixed places: the bits do not depend on
//! threads.

use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_running};
use crate::linalg::dense;
use crate::linalg::small::amax;
use crate::tasks;

/// Columns of a panel.
const PANEL: usize = 64;

/// Columns in one task.
const TILE: usize = 64;

/// `Aᵀ = P L U`.
#[derive(Debug)]
pub struct Lu {
    n: usize,
    /// `L` below the diagonal, without its unit diagonal, and `U`, by columns.
    factors: Vec<f64>,
    /// The row of `Aᵀ` at each place.
    order: Vec<usize>,
    /// Whether the number of row exchanges is odd.
    odd: bool,
}

impl Lu {
    /// Factors the matrix of order `n` with the rows `a`; `None` if a pivot is below the
    /// rounding of the largest entry.
    pub fn new(a: Vec<f64>, n: usize, stop: &AtomicBool) -> Result<Option<Self>, Error> {
        assert_eq!(a.len(), n * n);
        // A pivot is a sum of up to n terms as large as the largest entry.
        #[expect(clippy::cast_precision_loss, reason = "an order")]
        let rounding = n as f64 * f64::EPSILON * amax(&a);
        let mut factors = a;
        let found = factor(&mut factors, n, rounding, stop)?;
        Ok(found.map(|(order, odd)| Self {
            n,
            factors,
            order,
            odd,
        }))
    }

    /// Order of the matrix.
    pub fn order(&self) -> usize {
        self.n
    }

    /// The sign of the determinant, 1 or −1.
    pub fn sign(&self) -> f64 {
        let negative = (0..self.n)
            .filter(|k| self.factors[k * (self.n + 1)] < 0.0)
            .count();
        if (negative % 2 == 1) == self.odd {
            1.0
        } else {
            -1.0
        }
    }

    /// `b ← A⁻¹ b`.
    pub fn solve(&self, b: &mut [f64]) {
        assert_eq!(b.len(), self.n);
        // A = Uᵀ Lᵀ Pᵀ.
        dense::lu_solve_transposed(&self.factors, self.n, b);
        let solved = b.to_vec();
        for (&row, value) in self.order.iter().zip(solved) {
            b[row] = value;
        }
    }

    /// `b ← A⁻ᵀ b`.
    pub fn solve_transposed(&self, b: &mut [f64]) {
        assert_eq!(b.len(), self.n);
        let mut exchanged: Vec<f64> = self.order.iter().map(|&row| b[row]).collect();
        dense::lu_solve(&self.factors, self.n, &mut exchanged);
        b.copy_from_slice(&exchanged);
    }
}

/// The order of the rows, and whether it needs an odd number of exchanges.
type Exchanges = (Vec<usize>, bool);

/// Factors a matrix of order `n` by columns, in place; `None` if a pivot is at most `rounding`.
pub(crate) fn factor(
    columns: &mut [f64],
    n: usize,
    rounding: f64,
    stop: &AtomicBool,
) -> Result<Option<Exchanges>, Error> {
    let mut order: Vec<usize> = (0..n).collect();
    let mut odd = false;
    for first in (0..n).step_by(PANEL) {
        check_running(stop)?;
        let width = PANEL.min(n - first);
        let (left, right) = columns.split_at_mut((first + width) * n);
        let (done, panel) = left.split_at_mut(first * n);
        let (rows, exchanges) = dense::lu_panel(panel, n, first);
        odd ^= exchanges % 2 == 1;
        let moved = |column: &mut [f64]| reorder(&mut column[first..], &rows);
        if rows.iter().enumerate().any(|(k, &row)| k != row) {
            tasks::for_each(done.chunks_mut(TILE * n), |_, tile| {
                tile.chunks_exact_mut(n).for_each(moved);
            });
            reorder(&mut order[first..], &rows);
        }
        let panel = &*panel;
        tasks::for_each(right.chunks_mut(TILE * n), |_, tile| {
            tile.chunks_exact_mut(n).for_each(moved);
            dense::lu_update(tile, panel, n, first);
        });
        let flat = |k: usize| !(panel[(k - first) * n + k].abs() > rounding);
        if (first..first + width).any(flat) {
            return Ok(None);
        }
    }
    Ok(Some((order, odd)))
}

/// Sorts values into the order of rows from [`factor`].
pub(crate) fn reorder<T: Copy>(values: &mut [T], rows: &[usize]) {
    let old = values.to_vec();
    for (value, &row) in values.iter_mut().zip(rows) {
        *value = old[row];
    }
}
