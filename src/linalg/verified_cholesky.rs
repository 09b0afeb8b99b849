//! Matrices `L Lᵀ` that are proved to be below a symmetric one in the order of quadratic forms.
//! Rounding is bounded: conclusions hold for the exact matrix.
//!
//! If Cholesky's algorithm ends on `M` of order n, with sums in any order, its factor satisfies
//! `L Lᵀ = M + E` with `‖E‖ ≤ (n + 1) u tr M / (1 − (n + 1) u)`, where `u` is half of
//! `f64::EPSILON` [Rump 2006]. So for `M = A − s 1` with `s` above this bound, `L Lᵀ ≼ A`.

use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_running};
use crate::linalg::dense;
use crate::linalg::small::norm;

/// Relative rounding error of a sum of `n` products: twice `(n + 8) u`, which includes its own
/// rounding.
pub fn gamma(n: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "an order of a matrix")]
    let terms = (n + 8) as f64;
    terms * f64::EPSILON
}

/// `L` with `L Lᵀ ≼ A`.
#[derive(Clone, Debug)]
pub struct Lower {
    n: usize,
    /// Lower triangle, by columns.
    factor: Vec<f64>,
    /// `‖A − L Lᵀ‖`, rounded up.
    lowered: f64,
}

/// `L` with `L Lᵀ ≼ A`, and its inverse for bounds of solves with it.
#[derive(Clone, Debug)]
pub struct VerifiedCholesky {
    lower: Lower,
    /// Columns of the inverse, rounded.
    inverse: Vec<f64>,
    /// `‖L⁻¹‖`, rounded up.
    inverse_norm: f64,
    /// `‖1 − L Y‖` for the computed inverse `Y`, rounded up.
    miss: f64,
}

/// A point `c` and a radius, see [`VerifiedCholesky::ellipsoid`].
#[derive(Clone, Debug)]
pub struct Ellipsoid {
    pub centre: Vec<f64>,
    pub radius: f64,
}

impl Lower {
    /// Makes it from the lower triangle, by columns, of a symmetric matrix that differs from
    /// `A` by at most `error` in norm. `None` if `A` is not positive definite beyond rounding.
    pub fn new(
        mut a: Vec<f64>,
        n: usize,
        error: f64,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        check_running(stop)?;
        let trace: f64 = (0..n).map(|i| a[i * (n + 1)].abs()).sum();
        let shift = error + gamma(n) * trace;
        if !shift.is_finite() || !a.iter().all(|x| x.is_finite()) {
            return Ok(None);
        }
        for i in 0..n {
            a[i * (n + 1)] -= shift;
        }
        let refused = dense::cholesky(&mut a, n, stop)?;
        Ok(refused.is_none().then_some(Self {
            n,
            factor: a,
            lowered: 2.0 * shift,
        }))
    }

    pub fn order(&self) -> usize {
        self.n
    }

    /// `‖A − L Lᵀ‖`, rounded up.
    pub fn lowered(&self) -> f64 {
        self.lowered
    }

    /// `x ← L⁻¹ x`, rounded.
    pub fn forward(&self, x: &mut [f64]) {
        dense::solve_lower(&self.factor, self.n, x, 1);
    }

    /// `x ← L⁻ᵀ x`, rounded.
    pub fn backward(&self, x: &mut [f64]) {
        dense::solve_lower_transpose(&self.factor, self.n, x, 1);
    }
}

impl VerifiedCholesky {
    /// As [`Lower::new`]; also `None` if the factor is so nearly singular that solves with it
    /// have no bound.
    pub fn new(
        a: Vec<f64>,
        n: usize,
        error: f64,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let Some(lower) = Lower::new(a, n, error, stop)? else {
            return Ok(None);
        };
        let mut inverse = vec![0.0; n * n];
        for k in 0..n {
            inverse[k * (n + 1)] = 1.0;
        }
        dense::solve_lower(&lower.factor, n, &mut inverse, n);
        let room = 1.0 + gamma(n);
        let (size, of_inverse) = (room * norm(&lower.factor), room * norm(&inverse));
        // (L + ΔL) y = e_j with |ΔL| ≤ γ |L|, for each column.
        let miss = gamma(n) * size * of_inverse;
        if !(miss < 0.1) {
            return Ok(None);
        }
        Ok(Some(Self {
            lower,
            inverse,
            inverse_norm: of_inverse / (1.0 - miss) * room,
            miss,
        }))
    }

    pub fn lower(&self) -> &Lower {
        &self.lower
    }

    fn order(&self) -> usize {
        self.lower.n
    }

    /// Contains all `d` with `dᵀ L Lᵀ d + e·d ≤ 0` for any `e` within `error` of the given one:
    /// `d = −c + L⁻ᵀ x` with `‖x‖` at most the radius.
    ///
    /// With `f = L⁻¹ e` the condition is `‖Lᵀ d + ½ f‖ ≤ ½ ‖f‖`. For the computed `f̃` and
    /// `c = ½ L⁻ᵀ f̃`, whose solves have backward errors `γ |L|`,
    ///
    /// ```text
    /// ‖f − f̃‖ ≤ φ = ‖L⁻¹ δe‖ + κ ‖f̃‖,   ‖Lᵀ c − ½ f‖ ≤ ½ φ + γ ‖L‖ ‖c‖
    /// ```
    pub fn ellipsoid(&self, e: &[f64], error: &[f64]) -> Ellipsoid {
        let room = 1.0 + gamma(self.order());
        let mut f = e.to_vec();
        self.lower.forward(&mut f);
        let mut centre: Vec<f64> = f.iter().map(|x| 0.5 * x).collect();
        self.lower.backward(&mut centre);
        let length = room * norm(&f);
        let wander = self.reach(error) + self.kappa() * length;
        let radius = 0.5 * (length + wander)
            + 0.5 * wander
            + gamma(self.order()) * self.size() * (room * norm(&centre));
        Ellipsoid {
            centre,
            radius: room * radius,
        }
    }

    /// `‖L⁻¹ e‖`, rounded up.
    pub fn length(&self, e: &[f64]) -> f64 {
        let mut f = e.to_vec();
        self.lower.forward(&mut f);
        (1.0 + gamma(self.order())) * (1.0 + self.kappa()) * norm(&f)
    }

    /// `‖L⁻¹ e_j‖` for every `j`, rounded up: half the widths of the unit ellipsoid of `L Lᵀ`
    /// along the axes.
    pub fn widths(&self) -> Vec<f64> {
        let room = (1.0 + gamma(self.order())) * (1.0 + self.kappa());
        let columns = self.inverse.chunks_exact(self.order().max(1));
        columns.map(|column| room * norm(column)).collect()
    }

    /// `‖L⁻¹ a‖` for each row `a` of a matrix, rounded up; `rows` have the length n and errors of
    /// at most `errors` in norm.
    pub fn widths_along(&self, rows: &[f64], errors: &[f64]) -> Vec<f64> {
        let room = (1.0 + gamma(self.order())) * (1.0 + self.kappa());
        let mut solved = rows.to_vec();
        let count = rows.len() / self.order().max(1);
        dense::solve_lower(&self.lower.factor, self.order(), &mut solved, count);
        let columns = solved.chunks_exact(self.order().max(1)).zip(errors);
        columns
            .map(|(column, error)| room * (norm(column) + self.inverse_norm * error))
            .collect()
    }

    /// Relative error of `‖L⁻¹ e‖` by the rounding of a solve.
    fn kappa(&self) -> f64 {
        gamma(self.order()) * self.size() * self.inverse_norm
    }

    /// `‖L‖`, rounded up.
    fn size(&self) -> f64 {
        (1.0 + gamma(self.order())) * norm(&self.lower.factor)
    }

    /// `max ‖L⁻¹ x‖` over `|x| ≤ error`, rounded up.
    fn reach(&self, error: &[f64]) -> f64 {
        let mut sums = vec![0.0; self.order()];
        for (column, &x) in self.inverse.chunks_exact(self.order().max(1)).zip(error) {
            for (sum, y) in sums.iter_mut().zip(column) {
                *sum += y.abs() * x;
            }
        }
        let room = 1.0 + gamma(self.order());
        // L⁻¹ = Y + L⁻¹ (1 − L Y).
        room * (norm(&sums) + self.inverse_norm * self.miss * norm(error))
    }
}

/// Whether every matrix that differs from a symmetric one, given as in [`Lower::new`], by at
/// most `error` is positive definite.
pub fn is_definite(a: Vec<f64>, n: usize, error: f64, stop: &AtomicBool) -> Result<bool, Error> {
    Ok(Lower::new(a, n, error, stop)?.is_some())
}
