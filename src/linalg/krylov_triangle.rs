//! The least-squares problem of GMRES: rotations make its Hessenberg matrix triangular.

use crate::linalg::small::add_scaled;

/// `min ‖β e₁ − H y‖` for a Hessenberg matrix that grows by columns.
pub(crate) struct KrylovTriangle {
    columns: Vec<Vec<f64>>,
    rotations: Vec<(f64, f64)>,
    /// `β e₁` after the rotations.
    right: Vec<f64>,
}

impl KrylovTriangle {
    /// Without columns: `β` is the norm of the residual.
    pub(crate) fn new(size: f64) -> Self {
        Self {
            columns: Vec::new(),
            rotations: Vec::new(),
            right: vec![size],
        }
    }

    /// The norm of the residual at the minimum.
    pub(crate) fn residual(&self) -> f64 {
        self.right[self.right.len() - 1].abs()
    }

    /// Adds a column, with `below` under its last entry. Returns whether the pivot is above
    /// `least` and finite; otherwise the matrix is singular or numbers are out of range, and
    /// nothing is added.
    pub(crate) fn extend(&mut self, mut column: Vec<f64>, below: f64, least: f64) -> bool {
        for (k, &(c, s)) in self.rotations.iter().enumerate() {
            let (x, y) = (column[k], column[k + 1]);
            (column[k], column[k + 1]) = (c * x + s * y, c * y - s * x);
        }
        let last = column.len() - 1;
        let pivot = column[last].hypot(below);
        if !(pivot > least && pivot.is_finite()) {
            return false;
        }
        let (c, s) = (column[last] / pivot, below / pivot);
        column[last] = pivot;
        let carried = self.right[last];
        self.right[last] = c * carried;
        self.right.push(-s * carried);
        self.rotations.push((c, s));
        self.columns.push(column);
        true
    }

    /// The minimiser `y`.
    pub(crate) fn solve(self) -> Vec<f64> {
        let Self {
            columns, mut right, ..
        } = self;
        right.truncate(columns.len());
        for (k, column) in columns.iter().enumerate().rev() {
            right[k] /= column[k];
            let solved = right[k];
            add_scaled(&mut right[..k], -solved, column);
        }
        right
    }
}
