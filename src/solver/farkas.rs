//! Decides whether linear inequalities contradict each other, and gives the shares that prove
//! it.

use crate::linalg::small::{add_scaled, amax};

/// A coefficient below this share of the largest of its row is not used as a pivot.
const SMALLEST_PIVOT: f64 = 1e-9;

/// A value above minus this share of the largest initial one satisfies its inequality: then the
/// search ends without a proof.
const MET: f64 = 1e-12;

/// The system `c + T x ≥ 0`, `x ≥ 0`; its memory is used again.
#[derive(Clone, Debug, Default)]
pub struct Inequalities {
    columns: usize,
    /// By rows: the constant, then the coefficients.
    entries: Vec<f64>,
    /// The variable of each row: an `x` below `columns`, or the value of an inequality.
    given: Vec<usize>,
    /// The variable of each column.
    free: Vec<usize>,
    shares: Vec<f64>,
    pivots: Vec<f64>,
}

impl Inequalities {
    pub fn clear(&mut self, columns: usize) {
        self.columns = columns;
        self.entries.clear();
    }

    /// Adds an inequality, its constant first.
    pub fn push(&mut self, row: impl IntoIterator<Item = f64>) {
        self.entries.extend(row);
    }

    /// Shares `y ≥ 0` of the inequalities with `y·c < 0` and `yᵀ T ≤ 0` up to rounding: no `x`
    /// satisfies all of them. `None` if some `x` does, or if this was not decided.
    ///
    /// It is the dual simplex method without an objective. Any order of pivots is correct. This
    /// one, the worst row with its largest coefficient, may not terminate, so that the number
    /// of pivots is limited.
    pub fn contradiction(&mut self) -> Option<&[f64]> {
        let width = self.columns + 1;
        let rows = self.entries.len() / width;
        self.given.clear();
        self.given.extend(self.columns..self.columns + rows);
        self.free.clear();
        self.free.extend(0..self.columns);
        let constants = self.entries.iter().step_by(width);
        let met = -MET * constants.fold(0.0_f64, |m, c| m.max(c.abs()));
        for _ in 0..2 * (rows + width) {
            let value = |row: usize| self.entries[row * width];
            let worst = (0..rows).min_by(|&i, &j| value(i).total_cmp(&value(j)))?;
            if value(worst) >= met {
                return None;
            }
            let row = &self.entries[worst * width + 1..(worst + 1) * width];
            let size = amax(row);
            let best = (0..self.columns).max_by(|&k, &l| row[k].total_cmp(&row[l]));
            match best.filter(|&k| row[k] > SMALLEST_PIVOT * size) {
                Some(column) => self.pivot(worst, column),
                None => return Some(self.shares(worst, rows)),
            }
        }
        None
    }

    /// Solves the equation of the row for the variable of the column.
    fn pivot(&mut self, row: usize, column: usize) {
        let width = self.columns + 1;
        self.pivots.clear();
        let own = &mut self.entries[row * width..(row + 1) * width];
        let inverse = 1.0 / own[column + 1];
        for value in own.iter_mut() {
            *value *= -inverse;
        }
        own[column + 1] = inverse;
        self.pivots.extend_from_slice(own);
        for (i, other) in self.entries.chunks_exact_mut(width).enumerate() {
            let factor = other[column + 1];
            if i == row || factor == 0.0 {
                continue;
            }
            other[column + 1] = 0.0;
            add_scaled(other, factor, &self.pivots);
        }
        std::mem::swap(&mut self.given[row], &mut self.free[column]);
    }

    /// Shares of the inequalities whose sum is a row that cannot be satisfied.
    fn shares(&mut self, row: usize, rows: usize) -> &[f64] {
        self.shares.clear();
        self.shares.resize(rows, 0.0);
        if let Some(own) = self.given[row].checked_sub(self.columns) {
            self.shares[own] = 1.0;
        }
        let coefficients = &self.entries[row * (self.columns + 1) + 1..];
        for (stands, t) in self.free.iter().zip(coefficients) {
            if let Some(inequality) = stands.checked_sub(self.columns) {
                self.shares[inequality] = (-t).max(0.0);
            }
        }
        &self.shares
    }
}
