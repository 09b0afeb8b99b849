//! Products with `P` and `Pᵀ`.

use crate::linalg::amg::block_matrix::ROWS;
use crate::linalg::amg::galerkin::with_sizes;
use crate::linalg::amg::prolongation::{Part, Prolongation};
use crate::linalg::amg::tentative::LANES;
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::pages::zeros;
use crate::linalg::real::Real;
use crate::tasks;

/// Coarse nodes in one task.
const COARSE_ROWS: usize = 512;

impl Prolongation {
    /// `coarse = Pᵀ r`. Fine rows are read in their order, because those of a coarse node stand
    /// far from each other; what a part adds to the coarse nodes stands apart and is added in the
    /// order of the parts.
    pub(super) fn restrict(&self, r: &[f32], coarse: &mut [f32]) {
        let memory = |part: &Part| zeros::<f32>(LANES * part.reached.len());
        let mut sums: Vec<_> = self.parts.iter().map(memory).collect();
        tasks::for_each(self.parts.iter().zip(&mut sums), |_, (part, to)| {
            let rows = Restrict {
                p: self,
                part,
                from: r,
                to,
            };
            with_sizes!(self, SizedRestrict, rows);
        });
        tasks::for_each(coarse.chunks_mut(COARSE_ROWS * self.m), |task, to| {
            let first = task * COARSE_ROWS;
            let own = first..first + to.len() / self.m;
            to.fill(0.0);
            for (part, sums) in self.parts.iter().zip(&sums) {
                for g in own.start.max(part.reached.start)..own.end.min(part.reached.end) {
                    let to = &mut to[(g - first) * self.m..][..self.m];
                    let from = &sums[(g - part.reached.start) * LANES..];
                    to.iter_mut().zip(from).for_each(|(to, add)| *to += add);
                }
            }
        });
    }

    /// `x ← x + P e`.
    pub(super) fn add_prolonged(&self, e: &[f32], x: &mut [f32]) {
        tasks::for_each(x.chunks_mut(ROWS * self.b), |task, to| {
            let rows = Transfer {
                p: self,
                first: task * ROWS,
                from: e,
                to,
            };
            with_sizes!(self, Prolong, rows);
        });
    }
}

/// The rows of one task.
struct Transfer<'a> {
    p: &'a Prolongation,
    first: usize,
    from: &'a [f32],
    to: &'a mut [f32],
}

/// What one part adds to coarse nodes.
struct Restrict<'a> {
    p: &'a Prolongation,
    part: &'a Part,
    from: &'a [f32],
    to: &'a mut [f32],
}

struct SizedRestrict<'a, const B: usize, const M: usize, const L: usize>(Restrict<'a>);

impl<const B: usize, const M: usize, const L: usize> WideWork for SizedRestrict<'_, B, M, L> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Restrict { p, part, from, to } = self.0;
        let (to, _) = to.as_chunks_mut::<LANES>();
        for i in part.rows.clone() {
            let x = &from[i * B..][..B];
            for q in p.row(i) {
                let block = &p.values[q * B * M..][..B * M + LANES - M];
                let mut sum = [0.0_f32; LANES];
                for r in 0..B {
                    for e in 0..LANES {
                        sum[e] = block[r * M + e].times_plus::<FMA>(x[r], sum[e]);
                    }
                }
                let to = &mut to[p.column[q] as usize - part.reached.start];
                for e in 0..LANES {
                    to[e] += sum[e];
                }
            }
        }
    }
}

struct Prolong<'a, const B: usize, const M: usize, const L: usize>(Transfer<'a>);

impl<const B: usize, const M: usize, const L: usize> WideWork for Prolong<'_, B, M, L> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Transfer { p, first, from, to } = self.0;
        for (k, to) in to.chunks_exact_mut(B).enumerate() {
            let mut sums = [[0.0_f32; M]; B];
            for q in p.row(first + k) {
                let block = &p.values[q * B * M..][..B * M];
                let x = &from[p.column[q] as usize * M..][..M];
                for r in 0..B {
                    for e in 0..M {
                        sums[r][e] = block[r * M + e].times_plus::<FMA>(x[e], sums[r][e]);
                    }
                }
            }
            for (to, sum) in to.iter_mut().zip(&sums) {
                *to += sum.iter().sum::<f32>();
            }
        }
    }
}
