//! Monotony of `r ↦ ṽ`, which proves that there is one answer, whatever the load.
//!
//! For `W` symmetric positive definite, with `M = diag μ`, in scaled variables:
//!
//! ```text
//! λ_max(M½ W_tt M½) · λ_max(M½ (W⁻¹)_nn M½) < 4
//! ```
//!
//! With `d = r − r'` and the norm `‖·‖` of `W`, `(ṽ − ṽ')·d ≥ ‖d‖² − Σ μ ‖(W d)_t‖ |d_n|`.
//! Young's inequality with one weight θ bounds the sum by
//! `½ (θ ‖M½ P_t W d‖² + ‖M½ P_n d‖²/θ)`, and since `P_t P_nᵀ = 0` the two quadratic
//! forms live on subspaces that are orthogonal in `‖·‖`: the larger of their norms
//! counts, not the sum. With the best θ what is left is positive under the condition.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::signs::signs;
use crate::linalg::small::{dot_long, norm};
use crate::problem::reduced::Reduced;

/// `W` is symmetric to rounding below this, beside its largest entry.
const SYMMETRIC: f64 = 1e-13;

/// The symmetric part of `Ŵ` on the components that friction can act on.
#[derive(Clone, Debug)]
pub struct Monotony {
    order: usize,
    /// Column by column.
    matrix: Vec<f64>,
    /// μ of the contact at normal components, and at tangential ones.
    normal: Vec<f64>,
    tangential: Vec<f64>,
    symmetric: bool,
    /// What rounding may have done to an eigenvalue.
    rounding: f64,
}

impl Monotony {
    /// `None` where a component that nothing moves is not determined.
    ///
    /// Left out are tangents without friction, whose reaction is zero, and what is
    /// prescribed: rows and columns of zeros, where the rest determines `r` if the
    /// contact stays open or slides by a given amount.
    #[must_use]
    pub fn new<const D: usize>(problem: &Reduced<D>, nodes: Range<usize>) -> Option<Self> {
        let mut components = Vec::new();
        for node in nodes.clone() {
            for k in 0..D {
                if k > 0 && problem.mu[node] == 0.0 {
                    continue;
                }
                let felt = |other: usize| {
                    let acts = problem.compliance.pair(node, other).row(k).amax() > 0.0;
                    acts || problem.compliance.pair(other, node).column(k).amax() > 0.0
                };
                if nodes.clone().any(felt) {
                    components.push((node, k));
                } else if problem.q[node][k] == 0.0 {
                    return None;
                }
            }
        }
        let order = components.len();
        let mut matrix = vec![0.0; order * order];
        let (mut skew, mut size) = (0.0_f64, 0.0_f64);
        let scaling = &problem.scaling;
        let entry = |(i, k): (usize, usize), (j, l): (usize, usize)| {
            problem.compliance.pair(i, j)[(k, l)] * (scaling.to_v[i] / scaling.to_r[j])
        };
        for (c, &column) in components.iter().enumerate() {
            for (l, &row) in components.iter().enumerate().skip(c) {
                let (below, above) = (entry(row, column), entry(column, row));
                skew = skew.max((below - above).abs());
                size = size.max(below.abs()).max(above.abs());
                matrix[c * order + l] = 0.5 * (below + above);
            }
        }
        let of_components = |wanted: bool| {
            let mu = |&(node, k): &(usize, usize)| {
                if (k == 0) == wanted {
                    problem.mu[node]
                } else {
                    0.0
                }
            };
            components.iter().map(mu).collect::<Vec<f64>>()
        };
        #[expect(clippy::cast_precision_loss, reason = "an order of a matrix")]
        let n = order as f64;
        let trace: f64 = (0..order).map(|i| matrix[i * (order + 1)].abs()).sum();
        Some(Self {
            order,
            normal: of_components(true),
            tangential: of_components(false),
            matrix,
            symmetric: skew <= SYMMETRIC * size,
            // Cholesky's backward error is below (n + 2) ε tr W in norm; then n
            // times what scaling, and taking the symmetric part, do to an entry.
            rounding: (n + 2.0) * f64::EPSILON * trace
                + n * (4.0 * f64::EPSILON * size + skew.min(SYMMETRIC * size)),
        })
    }

    /// Whether `W − c Mₙ` is positive definite, rounding subtracted.
    fn less(&self, c: f64, stop: &AtomicBool) -> Result<bool, Error> {
        let mut shifted = self.matrix.clone();
        for (i, mu) in self.normal.iter().enumerate() {
            shifted[i * (self.order + 1)] -= c * mu + self.rounding;
        }
        has_cholesky(shifted, self.order, stop)
    }

    /// Whether `W` is positive definite, rounding subtracted.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn definite(&self, stop: &AtomicBool) -> Result<bool, Error> {
        self.less(0.0, stop)
    }

    /// The criterion: with `α ≥ λ_max(M½ W_tt M½)`, `(α/4) λ_max(M½ (W⁻¹)_nn M½) < 1`
    /// if and only if `W − (α/4) Mₙ` is positive definite.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn holds(&self, stop: &AtomicBool) -> Result<bool, Error> {
        if !self.symmetric {
            return Ok(false);
        }
        match self.largest_tangential(stop)? {
            Some(alpha) => self.less(0.25 * alpha, stop),
            None => Ok(false),
        }
    }

    /// An upper bound of `λ_max(M½ W_tt M½)` that is certain: a power iteration
    /// gives a lower one, and `c I − M½ W_tt M½` is shown to be definite for a `c`
    /// above it.
    fn largest_tangential(&self, stop: &AtomicBool) -> Result<Option<f64>, Error> {
        /// Products of the power iteration.
        const PRODUCTS: usize = 20;
        /// Tried above its result; the last ones for clustered eigenvalues.
        const ABOVE: [f64; 3] = [1.02, 1.1, 1.5];
        let rough: Vec<usize> = (0..self.order)
            .filter(|&i| self.tangential[i] > 0.0)
            .collect();
        let n = rough.len();
        if n == 0 {
            return Ok(Some(0.0));
        }
        let mut matrix = vec![0.0; n * n];
        for (c, &j) in rough.iter().enumerate() {
            for (l, &i) in rough.iter().enumerate().skip(c) {
                let entry = (self.tangential[i] * self.tangential[j]).sqrt()
                    * self.matrix[j * self.order + i];
                matrix[c * n + l] = entry;
                matrix[l * n + c] = entry;
            }
        }
        let mut x = signs(n, 0);
        let mut reached = 0.0;
        for _ in 0..PRODUCTS {
            let y: Vec<f64> = matrix
                .chunks_exact(n)
                .map(|row| dot_long(row, &x))
                .collect();
            let length = norm(&y);
            reached = length / norm(&x);
            x = y.iter().map(|value| value / length).collect();
        }
        let greatest = self.tangential.iter().fold(0.0_f64, |m, &mu| m.max(mu));
        for bound in ABOVE.map(|factor| factor * reached) {
            let mut below: Vec<f64> = matrix.iter().map(|x| -x).collect();
            for i in 0..n {
                // (n + 2) ε tr(c I) besides what W itself brings.
                #[expect(clippy::cast_precision_loss, reason = "an order of a matrix")]
                let own = (n * (n + 2)) as f64 * f64::EPSILON * bound;
                below[i * (n + 1)] += bound - greatest * self.rounding - own;
            }
            if has_cholesky(below, n, stop)? {
                return Ok(Some(bound));
            }
        }
        Ok(None)
    }
}

/// Whether a symmetric matrix has a Cholesky factor.
fn has_cholesky(mut matrix: Vec<f64>, n: usize, stop: &AtomicBool) -> Result<bool, Error> {
    if stop.load(Ordering::Relaxed) {
        return Err(Error::Interrupted);
    }
    Ok(dense::cholesky(&mut matrix, n, stop)?.is_none())
}
