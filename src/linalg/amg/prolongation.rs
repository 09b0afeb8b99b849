//! The smoothed prolongation `P = (I − ω D⁻¹ A') T` between two levels.
//!
//! `A'` is `A` without the blocks of weakly coupled nodes `j`. In their place, node `i` takes
//! what its own aggregate would move there, `A_ij B_j C⁻¹` for `A_ij T_j`, so that `A'` leaves the
//! near-null vectors `B = T C` without force as `A` does. `P` then has few blocks along long
//! cells, where its smoothing would gain nothing.

use rayon::prelude::*;

use crate::linalg::amg::aggregates::{Aggregates, by_group};
use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix, PADDING, ROWS, cut};
use crate::linalg::amg::nodes::Nodes;
use crate::linalg::amg::slots::Slots;
use crate::linalg::amg::tentative::{LANES, Tentative};
use crate::linalg::amg::wide::{Work, widest};
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;

/// Blocks `b × m`, by rows of fine nodes, and their places by coarse nodes.
#[derive(Clone, Debug)]
pub(super) struct Prolongation {
    pub(super) b: usize,
    pub(super) m: usize,
    pub(super) start: Vec<u32>,
    /// The coarse node of each block.
    pub(super) column: Vec<u32>,
    /// Each block by rows, then padding.
    pub(super) values: Vec<f32>,
    /// For each coarse node the fine node and the place of its blocks.
    pub(super) coarse_start: Vec<u32>,
    pub(super) coarse_blocks: Vec<[u32; 2]>,
}

impl Prolongation {
    pub(super) fn bytes(&self) -> usize {
        4 * (self.start.len() + self.column.len() + self.values.len() + self.coarse_start.len())
            + 8 * self.coarse_blocks.len()
    }

    pub(super) fn row(&self, node: usize) -> std::ops::Range<usize> {
        self.start[node] as usize..self.start[node + 1] as usize
    }

    pub(super) fn coarse_row(&self, node: usize) -> &[[u32; 2]] {
        let range = self.coarse_start[node] as usize..self.coarse_start[node + 1] as usize;
        &self.coarse_blocks[range]
    }

    pub(super) fn coarse_nodes(&self) -> usize {
        self.coarse_start.len() - 1
    }

    /// Smooths `T` once, with `omega` relative to the diagonal blocks. `about` are the nodes of
    /// the fine level.
    pub(super) fn new(
        matrix: &BlockMatrix<f32>,
        inverse: &[f32],
        aggregates: &Aggregates,
        tentative: &Tentative,
        about: &Nodes,
        omega: f64,
        m: usize,
    ) -> Self {
        let (b, nodes) = (matrix.b, matrix.nodes());
        let start = starts(matrix, aggregates);
        let blocks = start[nodes] as usize;
        let mut column = vec![0; blocks];
        let mut values = vec![0.0; blocks * b * m + PADDING];
        // The row of T of each node.
        let mut place = vec![ABSENT; nodes];
        for (k, &i) in aggregates.members.iter().enumerate() {
            place[i as usize] = narrow(k);
        }
        let columns = cut(&mut column, nodes, |i| start[i] as usize);
        let parts = cut(&mut values, nodes, |i| start[i] as usize * b * m);
        let tasks = columns.into_par_iter().zip(parts).enumerate();
        tasks.for_each_init(
            || Slots::new(aggregates.count()),
            |slots, (task, (columns, values))| {
                let smooth = Smooth {
                    matrix,
                    inverse,
                    aggregates,
                    place: &place,
                    tentative,
                    about,
                    omega: f32::rounded(omega),
                    m,
                    task,
                    slots,
                    columns,
                    values,
                };
                match b {
                    2 => widest(Sized::<2>(smooth)),
                    3 => widest(Sized::<3>(smooth)),
                    _ => widest(Sized::<6>(smooth)),
                }
            },
        );
        let fine: Vec<u32> = (0..nodes)
            .flat_map(|i| std::iter::repeat_n(narrow(i), (start[i + 1] - start[i]) as usize))
            .collect();
        let (coarse_start, places) = by_group(&column, aggregates.count());
        let coarse_blocks = places.iter().map(|&at| [fine[at as usize], at]).collect();
        Self {
            b,
            m,
            start,
            column,
            values,
            coarse_start,
            coarse_blocks,
        }
    }
}

/// Start of each row of `P`: the aggregates of the neighbours of each node.
fn starts(matrix: &BlockMatrix<f32>, aggregates: &Aggregates) -> Vec<u32> {
    let nodes = matrix.nodes();
    let mut start = vec![0; nodes + 1];
    start[1..].par_chunks_mut(ROWS).enumerate().for_each_init(
        || Slots::new(aggregates.count()),
        |slots, (task, counts)| {
            for (k, count) in counts.iter_mut().enumerate() {
                let i = task * ROWS + k;
                for at in matrix.row(i) {
                    let j = matrix.column[at] as usize;
                    let aggregate = aggregates.of_node[j];
                    let counts = j == i || aggregates.coupled[at];
                    if counts && aggregate != ABSENT {
                        slots.slot(aggregate);
                    }
                }
                *count = narrow(slots.columns.len());
                slots.clear();
            }
        },
    );
    for i in 0..nodes {
        start[i + 1] += start[i];
    }
    start
}

/// The rows of one task.
struct Smooth<'a> {
    matrix: &'a BlockMatrix<f32>,
    inverse: &'a [f32],
    aggregates: &'a Aggregates,
    place: &'a [u32],
    tentative: &'a Tentative,
    about: &'a Nodes,
    omega: f32,
    m: usize,
    task: usize,
    slots: &'a mut Slots,
    columns: &'a mut [u32],
    values: &'a mut [f32],
}

struct Sized<'a, const B: usize>(Smooth<'a>);

impl<const B: usize> Work for Sized<'_, B> {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "must take the caller's instructions")]
    fn run<const FMA: bool>(self) {
        let Smooth { matrix, m, .. } = self.0;
        let (mut columns, mut values) = (self.0.columns, self.0.values);
        let slots = self.0.slots;
        let of_node = &self.0.aggregates.of_node;
        let motions = &self.0.about.motions;
        let (of_members, _) = self.0.tentative.rows.as_chunks::<B>();
        let mut sums: Vec<[[f32; LANES]; B]> = Vec::new();
        for i in self.0.task * ROWS..matrix.nodes().min((self.0.task + 1) * ROWS) {
            sums.clear();
            // A T, a row of blocks.
            for at in matrix.row(i) {
                let j = matrix.column[at] as usize;
                let weak = j != i && !self.0.aggregates.coupled[at];
                let aggregate = of_node[if weak { i } else { j }];
                if aggregate == ABSENT {
                    continue;
                }
                let (slot, new) = slots.slot(aggregate);
                if new {
                    sums.push([[0.0; LANES]; B]);
                }
                let block = &matrix.values[at * B * B..][..B * B];
                let rows = if weak {
                    &self.0.tentative.extended(aggregate, j, motions)
                } else {
                    &of_members[self.0.place[j] as usize]
                };
                let mut sum = sums[slot];
                for l in 0..B {
                    for c in 0..B {
                        for e in 0..LANES {
                            sum[l][e] = rows[c][e].times_plus::<FMA>(block[c * B + l], sum[l][e]);
                        }
                    }
                }
                sums[slot] = sum;
            }
            // T − ω D⁻¹ (A T).
            let inverse = &self.0.inverse[i * B * B..][..B * B];
            let (own, later) = columns.split_at_mut(slots.columns.len());
            own.copy_from_slice(&slots.columns);
            columns = later;
            for (&aggregate, sum) in slots.columns.iter().zip(&sums) {
                let (block, later) = values.split_at_mut(B * m);
                values = later;
                for l in 0..B {
                    let mut row = [0.0; LANES];
                    if aggregate == of_node[i] {
                        row = of_members[self.0.place[i] as usize][l];
                    }
                    for c in 0..B {
                        let factor = -(self.0.omega * inverse[c * B + l]);
                        for e in 0..LANES {
                            row[e] = sum[c][e].times_plus::<FMA>(factor, row[e]);
                        }
                    }
                    block[l * m..(l + 1) * m].copy_from_slice(&row[..m]);
                }
            }
            slots.clear();
        }
    }
}
