//! Products with `P` and `Pᵀ`.

use crate::linalg::amg::block_matrix::ROWS;
use crate::linalg::amg::galerkin::with_sizes;
use crate::linalg::amg::prolongation::Prolongation;
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::real::Real;
use crate::tasks;

/// Coarse nodes in one task.
const COARSE_ROWS: usize = 64;

impl Prolongation {
    /// `coarse = Pᵀ r`, by rows of `Pᵀ`, so that each sum has one order.
    pub(super) fn restrict(&self, r: &[f32], coarse: &mut [f32]) {
        let parts = coarse.chunks_mut(COARSE_ROWS * self.m);
        tasks::for_each(parts, |task, to| {
            let rows = Transfer {
                p: self,
                first: task * COARSE_ROWS,
                from: r,
                to,
            };
            with_sizes!(self, Restrict, rows);
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

struct Restrict<'a, const B: usize, const M: usize, const L: usize>(Transfer<'a>);

impl<const B: usize, const M: usize, const L: usize> WideWork for Restrict<'_, B, M, L> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Transfer { p, first, from, to } = self.0;
        for (k, to) in to.chunks_exact_mut(M).enumerate() {
            let mut sums = [[0.0_f32; L]; B];
            for &[i, q] in p.coarse_row(first + k) {
                let block = &p.values[q as usize * B * M..][..B * M + L - M];
                let x = &from[i as usize * B..][..B];
                for r in 0..B {
                    for e in 0..L {
                        sums[r][e] = block[r * M + e].times_plus::<FMA>(x[r], sums[r][e]);
                    }
                }
            }
            for (e, to) in to.iter_mut().enumerate() {
                *to = sums.iter().map(|sum| sum[e]).sum();
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
