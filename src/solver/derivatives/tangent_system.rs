//! The linearised contact laws of one step together with (5): the system of the derivatives of
//! a solution, and its transpose, (33) and (34).
//!
//! At each closed contact `by_r dr + by_v dv = s`, with `dv = W dr + R da + dq` and
//! `Rᵀ dr = −de`. The unknowns are `dr` of the closed contacts and `da`:
//!
//! ```text
//! ⎡ by_r + by_v W   by_v R ⎤ ⎡ dr ⎤   ⎡ s − by_v dq ⎤
//! ⎣ Rᵀ              0      ⎦ ⎣ da ⎦ = ⎣ −de         ⎦
//! ```

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::lu::Lu;
use crate::linalg::pages;
use crate::linalg::small::{Block, Vector};
use crate::reduced::memory;
use crate::reduced::reduced::Reduced;
use crate::tasks;

/// The law of one closed contact, in the variables of the problem.
#[derive(Clone, Copy, Debug)]
pub struct ClosedLaw<const D: usize> {
    /// Position of the contact.
    pub position: usize,
    pub by_r: Block<D>,
    pub by_v: Block<D>,
}

/// The factored system of one step, in one form or another.
pub trait FactoredTangent: Send + Sync {
    /// Number of unknowns.
    fn order(&self) -> usize;

    /// `x ← M⁻¹ x`.
    fn solve(&self, x: &mut [f64]);

    /// `x ← M⁻ᵀ x`.
    fn solve_transposed(&self, x: &mut [f64]);

    /// Estimate of the reciprocal condition of the matrix that was factored, independent of units.
    fn reciprocal_condition(&self) -> f64;
}

/// A factored matrix whose rows and columns are scaled, so that its entries are independent of
/// units.
#[derive(Debug)]
pub(super) struct Conditioned {
    lu: Lu,
    rows: Vec<f64>,
    columns: Vec<f64>,
    /// Largest sum of absolute values of a row of the scaled matrix.
    norm: f64,
}

impl Conditioned {
    /// Factors a matrix given by rows, with the sizes of its rows and the scales of its columns;
    /// `None` if it is singular.
    pub(super) fn new(
        mut matrix: Vec<f64>,
        sizes: Vec<f64>,
        columns: Vec<f64>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let n = columns.len();
        let rows: Vec<f64> = sizes.into_iter().map(inverse).collect();
        for (row, scale) in matrix.chunks_exact_mut(n.max(1)).zip(&rows) {
            for (value, column) in row.iter_mut().zip(&columns) {
                *value *= scale * column;
            }
        }
        let sums = matrix.chunks_exact(n.max(1));
        let norm = sums.map(|row| row.iter().map(|x| x.abs()).sum::<f64>());
        let norm = norm.fold(0.0_f64, f64::max);
        Ok(Lu::new(matrix, n, stop)?.map(|lu| Self {
            lu,
            rows,
            columns,
            norm,
        }))
    }

    /// `x ← M⁻¹ x`.
    pub(super) fn solve(&self, x: &mut [f64]) {
        multiply(x, &self.rows);
        self.lu.solve(x);
        multiply(x, &self.columns);
    }

    /// `x ← M⁻ᵀ x`.
    pub(super) fn solve_transposed(&self, x: &mut [f64]) {
        multiply(x, &self.columns);
        self.lu.solve_transposed(x);
        multiply(x, &self.rows);
    }

    /// Estimate of the reciprocal condition of the scaled matrix in the largest norm of rows,
    /// by the power method of Hager (1984).
    pub(super) fn reciprocal_condition(&self) -> f64 {
        /// The estimate is rarely more than three times too small then.
        const STEPS: usize = 2;
        let n = self.lu.order();
        if n == 0 {
            return 1.0;
        }
        #[expect(clippy::cast_precision_loss, reason = "an order")]
        let mut x = vec![1.0 / n as f64; n];
        let mut largest = 0.0_f64;
        for _ in 0..STEPS {
            // The 1-norm of M⁻ᵀ is the norm of rows of M⁻¹.
            self.lu.solve_transposed(&mut x);
            let sum: f64 = x.iter().map(|x| x.abs()).sum();
            if !sum.is_finite() {
                return 0.0;
            }
            if sum <= largest {
                break;
            }
            largest = sum;
            let mut signs: Vec<f64> = x.iter().map(|x| 1.0_f64.copysign(*x)).collect();
            self.lu.solve(&mut signs);
            let at = (0..n).max_by(|&i, &j| signs[i].abs().total_cmp(&signs[j].abs()));
            x.fill(0.0);
            x[at.unwrap_or_default()] = 1.0;
        }
        1.0 / (self.norm * largest)
    }
}

/// The factored system. Unknowns are the components of `dr`, contact by contact, then `da`.
#[derive(Debug)]
pub struct TangentSystem {
    conditioned: Conditioned,
}

impl TangentSystem {
    /// Factors the system of some closed contacts; `None` if it is singular.
    pub fn new<const D: usize>(
        problem: &Reduced<D>,
        laws: &[ClosedLaw<D>],
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let modes = problem.rigid.modes.columns();
        let n = D * laws.len() + modes.len();
        memory::check("the tangent system", 8 * (n as u128).pow(2))?;
        let scaling = &problem.scaling;
        let (mut sizes, mut columns) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for law in laws {
            let (to_v, to_r) = (scaling.to_v[law.position], scaling.to_r[law.position]);
            for k in 0..D {
                let of = |block: &Block<D>, scale: f64| block.row(k).amax() / scale;
                sizes.push(of(&law.by_r, to_r).max(of(&law.by_v, to_v)));
                columns.push(1.0 / to_r);
            }
        }
        for mode in &modes {
            let terms = |to: &[f64]| {
                let of_law = |law: &ClosedLaw<D>| {
                    let motion = Vector::from(mode[law.position]);
                    motion.amax() * to[law.position]
                };
                laws.iter().map(of_law).fold(0.0_f64, f64::max)
            };
            columns.push(inverse(terms(&scaling.to_v)));
            let over_r: Vec<f64> = scaling.to_r.iter().map(|s| 1.0 / s).collect();
            sizes.push(terms(&over_r));
        }
        let made = Conditioned::new(matrix(problem, laws), sizes, columns, stop)?;
        Ok(made.map(|conditioned| Self { conditioned }))
    }
}

impl FactoredTangent for TangentSystem {
    fn order(&self) -> usize {
        self.conditioned.lu.order()
    }

    fn solve(&self, x: &mut [f64]) {
        self.conditioned.solve(x);
    }

    fn solve_transposed(&self, x: &mut [f64]) {
        self.conditioned.solve_transposed(x);
    }

    fn reciprocal_condition(&self) -> f64 {
        self.conditioned.reciprocal_condition()
    }
}

fn inverse(size: f64) -> f64 {
    if size > 0.0 { 1.0 / size } else { 1.0 }
}

fn multiply(x: &mut [f64], factors: &[f64]) {
    for (value, factor) in x.iter_mut().zip(factors) {
        *value *= factor;
    }
}

/// Rows of the matrix.
fn matrix<const D: usize>(problem: &Reduced<D>, laws: &[ClosedLaw<D>]) -> Vec<f64> {
    let modes = problem.rigid.modes.columns();
    let contact = D * laws.len();
    let n = contact + modes.len();
    let mut matrix = pages::zeros(n * n);
    if n == 0 {
        return matrix;
    }
    let (of_laws, balance) = matrix.split_at_mut(contact * n);
    let of_contact = |i: usize, out: &mut [f64]| {
        let law = &laws[i];
        for (j, other) in laws.iter().enumerate() {
            let w = problem.compliance.pair(law.position, other.position);
            let mut block = law.by_v * w;
            if i == j {
                block += law.by_r;
            }
            for k in 0..D {
                for l in 0..D {
                    out[k * n + D * j + l] = block[(k, l)];
                }
            }
        }
        for (c, mode) in modes.iter().enumerate() {
            let motion = law.by_v * Vector::from(mode[law.position]);
            for k in 0..D {
                out[k * n + contact + c] = motion[k];
            }
        }
    };
    tasks::for_each_together(of_laws.chunks_mut(D * n), 16, of_contact);
    for (mode, out) in modes.iter().zip(balance.chunks_exact_mut(n)) {
        for (j, law) in laws.iter().enumerate() {
            for l in 0..D {
                out[D * j + l] = mode[law.position][l];
            }
        }
    }
    matrix
}
