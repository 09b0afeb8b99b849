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
use crate::linalg::sparse::blocks::Blocks;
use crate::linalg::sparse::sparse_lu::{Analysis, SparseLu};
use crate::reduced::memory;
use crate::reduced::reduced::Reduced;
use crate::reduced::rigid_motions::border_block;
use crate::solver::bordered::Factors;
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

/// A factored system whose rows and columns are scaled, so that its entries are independent of
/// units. Unknowns are the components of `dr`, contact by contact, then `da`.
#[derive(Debug)]
pub struct TangentSystem {
    factors: Factors<Analysis>,
    rows: Vec<f64>,
    columns: Vec<f64>,
    /// Largest sum of absolute values of a row of the scaled matrix.
    norm: f64,
}

impl TangentSystem {
    /// As [`TangentSystem::dense`], of a matrix in blocks.
    fn sparse<const D: usize>(
        matrix: &Blocks<D>,
        sizes: Vec<f64>,
        columns: Vec<f64>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let rows: Vec<f64> = sizes.into_iter().map(inverse).collect();
        let scale = |of: &[f64], at: usize| of.get(at).copied().unwrap_or(1.0);
        let scaled = matrix.map(|i, j, block| {
            Block::from_fn(|k, l| {
                block[(k, l)] * scale(&rows, D * i + k) * scale(&columns, D * j + l)
            })
        });
        let sum = |at: usize| -> f64 {
            let blocks = scaled.in_row(at / D);
            blocks
                .map(|(_, block)| block.row(at % D).iter().map(|x| x.abs()).sum::<f64>())
                .sum()
        };
        let norm = (0..columns.len()).map(sum).fold(0.0_f64, f64::max);
        let factors = SparseLu::new(Analysis::new(&scaled)?, &scaled, stop)?;
        Ok(factors.map(|lu| Self {
            factors: Factors::Sparse(lu),
            rows,
            columns,
            norm,
        }))
    }

    /// Factors a matrix given by rows, with the sizes of its rows and the scales of its columns;
    /// `None` if it is singular.
    pub(super) fn dense(
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
            factors: Factors::Dense(lu),
            rows,
            columns,
            norm,
        }))
    }

    /// Factors the system of some closed contacts; `None` if it is singular.
    pub fn new<const D: usize>(
        problem: &Reduced<D>,
        laws: &[ClosedLaw<D>],
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let modes = &problem.rigid.modes;
        let n = D * laws.len() + modes.len();
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
        let mut largest = vec![[0.0_f64; 2]; modes.len()];
        for law in laws {
            let i = law.position;
            for (c, motion) in modes.at(i) {
                let size = Vector::from(*motion).amax();
                let [over_v, over_r] = largest[c];
                largest[c] = [
                    over_v.max(size * scaling.to_v[i]),
                    over_r.max(size / scaling.to_r[i]),
                ];
            }
        }
        columns.extend(largest.iter().map(|[over_v, _]| inverse(*over_v)));
        sizes.extend(largest.iter().map(|[_, over_r]| over_r));
        let row = block_rows(problem, laws);
        if n > 0 && problem.compliance.is_sparse() {
            let blocks = Blocks::from_rows(laws.len() + modes.len().div_ceil(D), &row);
            // Rows are exchanged within fronts only: singular may mean that others are needed.
            let made = Self::sparse(&blocks, sizes.clone(), columns.clone(), stop)?;
            if made.is_some() {
                return Ok(made);
            }
        }
        memory::check("the tangent system", 8 * (n as u128).pow(2))?;
        let mut matrix = pages::zeros(n * n);
        let fill = |i: usize, out: &mut [f64]| {
            row(i, &mut |j, block| {
                for (k, out) in out.chunks_exact_mut(n).enumerate() {
                    for l in 0..D.min(n - D * j) {
                        out[D * j + l] += block[(k, l)];
                    }
                }
            });
        };
        tasks::for_each_together(matrix.chunks_mut((D * n).max(1)), 16, fill);
        Self::dense(matrix, sizes, columns, stop)
    }
}

impl FactoredTangent for TangentSystem {
    fn order(&self) -> usize {
        self.columns.len()
    }

    fn solve(&self, x: &mut [f64]) {
        multiply(x, &self.rows);
        self.factors.solve(x, false);
        multiply(x, &self.columns);
    }

    fn solve_transposed(&self, x: &mut [f64]) {
        multiply(x, &self.columns);
        self.factors.solve(x, true);
        multiply(x, &self.rows);
    }

    /// In the largest norm of rows of the scaled matrix, by the power method of Hager (1984).
    fn reciprocal_condition(&self) -> f64 {
        /// The estimate is rarely more than three times too small then.
        const STEPS: usize = 2;
        let n = self.columns.len();
        if n == 0 {
            return 1.0;
        }
        #[expect(clippy::cast_precision_loss, reason = "an order")]
        let mut x = vec![1.0 / n as f64; n];
        let mut largest = 0.0_f64;
        for _ in 0..STEPS {
            // The 1-norm of M⁻ᵀ is the norm of rows of M⁻¹.
            self.factors.solve(&mut x, true);
            let sum: f64 = x.iter().map(|x| x.abs()).sum();
            if !sum.is_finite() {
                return 0.0;
            }
            if sum <= largest {
                break;
            }
            largest = sum;
            let mut signs: Vec<f64> = x.iter().map(|x| 1.0_f64.copysign(*x)).collect();
            self.factors.solve(&mut signs, false);
            let at = (0..n).max_by(|&i, &j| signs[i].abs().total_cmp(&signs[j].abs()));
            x.fill(0.0);
            x[at.unwrap_or_default()] = 1.0;
        }
        1.0 / (self.norm * largest)
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

/// The matrix by rows of blocks, `row(i, add)`: closed contacts, then the rigid motions in blocks of `D`,
/// the last filled with ones on the diagonal.
fn block_rows<'a, const D: usize>(
    problem: &'a Reduced<D>,
    laws: &'a [ClosedLaw<D>],
) -> impl Fn(usize, &mut dyn FnMut(usize, Block<D>)) + Sync + 'a {
    let (modes, closed) = (&problem.rigid.modes, laws.len());
    let mut place = vec![None; problem.contacts()];
    let mut moved = vec![Vec::new(); modes.len().div_ceil(D)];
    for (i, law) in laws.iter().enumerate() {
        place[law.position] = Some(i);
        for (c, motion) in modes.at(law.position) {
            moved[c / D].push((i, border_block(c, motion).transpose()));
        }
    }
    move |i, add| {
        if let Some(block) = i.checked_sub(closed) {
            moved[block].iter().for_each(|(j, b)| add(*j, *b));
            let beyond = |k: usize| D * block + k >= modes.len();
            add(
                i,
                Block::from_fn(|k, l| if k == l && beyond(k) { 1.0 } else { 0.0 }),
            );
            return;
        }
        let law = &laws[i];
        problem.compliance.row_blocks(law.position, &mut |j, w| {
            if let Some(j) = place[j] {
                add(j, law.by_v * w);
            }
        });
        add(i, law.by_r);
        for (c, motion) in modes.at(law.position) {
            let motion = law.by_v * Vector::from(*motion);
            add(closed + c / D, border_block(c, &motion.into()));
        }
    }
}
