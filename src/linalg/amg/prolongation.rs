//! The smoothed prolongation `P = (I − ω D⁻¹ A') T` between two levels.
//!
//! `A'` is `A` without the blocks of weakly coupled nodes `j`. In their place, node `i` takes
//! what its own aggregate would move there, `A_ij B_j C⁻¹` for `A_ij T_j`, so that `A'` leaves the
//! near-null vectors `B = T C` without force as `A` does. `P` then has few blocks along long
//! cells, where its smoothing would gain nothing.

use std::ops::Range;

use crate::linalg::amg::aggregates::{Aggregates, by_group};
use crate::linalg::amg::block_matrix::{ABSENT, PADDING, ROWS, cut};
use crate::linalg::amg::single_rows::LevelMatrix;
use crate::linalg::amg::slots::Slots;
use crate::linalg::amg::symmetric_blocks::part_rows;
use crate::linalg::amg::tentative::{LANES, Tentative};
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::pages::zeros;
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;
use crate::tasks;

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
    pub(super) parts: Vec<Part>,
}

/// Rows of a product with `Pᵀ` that one task computes.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) rows: Range<usize>,
    /// From the first to the last coarse node of these rows.
    pub(super) reached: Range<usize>,
}

impl Prolongation {
    pub(super) fn bytes(&self) -> usize {
        4 * (self.start.len() + self.column.len() + self.values.len() + self.coarse_start.len())
            + 8 * self.coarse_blocks.len()
    }

    pub(super) fn row(&self, node: usize) -> Range<usize> {
        self.start[node] as usize..self.start[node + 1] as usize
    }

    pub(super) fn coarse_row(&self, node: usize) -> &[[u32; 2]] {
        let range = self.coarse_start[node] as usize..self.coarse_start[node + 1] as usize;
        &self.coarse_blocks[range]
    }

    pub(super) fn coarse_nodes(&self) -> usize {
        self.coarse_start.len() - 1
    }

    /// Smooths `T` once.
    pub(super) fn new(of: &Smoothed<'_>, m: usize) -> Self {
        let (matrix, aggregates) = (of.matrix, of.aggregates);
        let (b, nodes) = (matrix.b(), matrix.nodes());
        let start = starts(matrix, aggregates);
        let blocks = start[nodes] as usize;
        let mut made = Self {
            b,
            m,
            column: zeros(blocks),
            values: zeros(blocks * b * m + PADDING),
            coarse_start: Vec::new(),
            coarse_blocks: Vec::new(),
            parts: Vec::new(),
            start,
        };
        made.smooth(of, None);
        let fine: Vec<u32> = (0..nodes)
            .flat_map(|i| std::iter::repeat_n(narrow(i), made.row(i).len()))
            .collect();
        let (coarse_start, places) = by_group(&made.column, aggregates.count());
        made.coarse_start = coarse_start;
        made.coarse_blocks = places.iter().map(|&at| [fine[at as usize], at]).collect();
        made.parts = part_rows(nodes)
            .map(|rows| {
                let own = made.start[rows.start] as usize..made.start[rows.end] as usize;
                let columns = made.column[own].iter().map(|&g| g as usize);
                let first = columns.clone().min().unwrap_or(0);
                let reached = first..columns.max().map_or(first, |last| last + 1);
                Part { rows, reached }
            })
            .collect();
        made
    }

    /// Computes the rows of `needed` nodes, or all.
    pub(super) fn smooth(&mut self, of: &Smoothed<'_>, needed: Option<&[bool]>) {
        let (b, m, nodes) = (self.b, self.m, of.matrix.nodes());
        let start = &self.start;
        let columns = cut(&mut self.column, nodes, |i| start[i] as usize);
        let parts = cut(&mut self.values, nodes, |i| start[i] as usize * b * m);
        tasks::for_each_with(
            choose_tasks(columns.into_iter().zip(parts), ROWS, needed),
            || Slots::new(of.aggregates.count()),
            |slots, _, (task, (columns, values))| {
                let rows = ProlongationRows {
                    of,
                    omega: f32::rounded(of.omega),
                    start,
                    needed,
                    m,
                    task,
                    slots,
                    columns,
                    values,
                };
                match b {
                    2 => widest(SizedProlongationRows::<2>(rows)),
                    3 => widest(SizedProlongationRows::<3>(rows)),
                    _ => widest(SizedProlongationRows::<6>(rows)),
                }
            },
        );
    }
}

/// The tasks of `rows` rows each that have a `needed` one, with their numbers; without a choice
/// all.
pub(super) fn choose_tasks<T: Send>(
    tasks: impl Iterator<Item = T>,
    rows: usize,
    needed: Option<&[bool]>,
) -> Vec<(usize, T)> {
    let wanted = |task: usize| {
        needed.is_none_or(|needed| {
            needed[task * rows..needed.len().min((task + 1) * rows)].contains(&true)
        })
    };
    tasks.enumerate().filter(|(k, _)| wanted(*k)).collect()
}

/// What `P` is made of.
pub(super) struct Smoothed<'a> {
    pub(super) matrix: LevelMatrix<'a>,
    /// Inverses of the diagonal blocks.
    pub(super) inverse: &'a [f32],
    pub(super) aggregates: &'a Aggregates,
    pub(super) tentative: &'a Tentative,
    /// The near-null vectors of the fine level.
    pub(super) motions: &'a [f64],
    /// `ω`, relative to the diagonal blocks.
    pub(super) omega: f64,
}

/// Start of each row of `P`: the aggregates of the neighbours of each node.
fn starts(matrix: LevelMatrix<'_>, aggregates: &Aggregates) -> Vec<u32> {
    let nodes = matrix.nodes();
    let mut start = vec![0; nodes + 1];
    tasks::for_each_with(
        start[1..].chunks_mut(ROWS),
        || Slots::new(aggregates.count()),
        |slots, task, counts| {
            for (k, count) in counts.iter_mut().enumerate() {
                let i = task * ROWS + k;
                for (at, &j) in matrix.row(i).zip(matrix.columns(i)) {
                    let j = j as usize;
                    let aggregate = aggregates.of_node[j];
                    let counts = j == i || aggregates.coupled[at];
                    if counts && aggregate != ABSENT {
                        let _ = slots.slot(aggregate);
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
struct ProlongationRows<'a> {
    of: &'a Smoothed<'a>,
    omega: f32,
    start: &'a [u32],
    needed: Option<&'a [bool]>,
    m: usize,
    task: usize,
    slots: &'a mut Slots,
    columns: &'a mut [u32],
    values: &'a mut [f32],
}

struct SizedProlongationRows<'a, const B: usize>(ProlongationRows<'a>);

impl<const B: usize> WideWork for SizedProlongationRows<'_, B> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let ProlongationRows {
            of,
            omega,
            start,
            needed,
            m,
            task,
            slots,
            mut columns,
            mut values,
        } = self.0;
        let (matrix, tentative) = (of.matrix, of.tentative);
        let (of_node, place) = (&of.aggregates.of_node, &of.aggregates.place);
        let (of_members, _) = tentative.rows.as_chunks::<B>();
        let mut sums: Vec<[[f32; LANES]; B]> = Vec::new();
        let rows = task * ROWS..matrix.nodes().min((task + 1) * ROWS);
        let (loaded, first) = matrix.load(rows.clone());
        for i in rows {
            if needed.is_some_and(|needed| !needed[i]) {
                let blocks = (start[i + 1] - start[i]) as usize;
                columns = &mut columns[blocks..];
                values = &mut values[blocks * B * m..];
                continue;
            }
            sums.clear();
            // A T, a row of blocks.
            let skipped = first + matrix.skipped(i);
            for (at, &j) in matrix.row(i).zip(matrix.columns(i)) {
                let j = j as usize;
                let weak = j != i && !of.aggregates.coupled[at];
                let aggregate = of_node[if weak { i } else { j }];
                if aggregate == ABSENT {
                    continue;
                }
                let (slot, new) = slots.slot(aggregate);
                if new {
                    sums.push([[0.0; LANES]; B]);
                }
                let block = &loaded[(at - skipped) * B * B..][..B * B];
                let rows = if weak {
                    &tentative.extended(aggregate, j, of.motions)
                } else {
                    &of_members[place[j] as usize]
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
            let inverse = &of.inverse[i * B * B..][..B * B];
            let (own, later) = columns.split_at_mut(slots.columns.len());
            own.copy_from_slice(&slots.columns);
            columns = later;
            for (&aggregate, sum) in slots.columns.iter().zip(&sums) {
                let (block, later) = values.split_at_mut(B * m);
                values = later;
                for l in 0..B {
                    let mut row = [0.0; LANES];
                    if aggregate == of_node[i] {
                        row = of_members[place[i] as usize][l];
                    }
                    for c in 0..B {
                        let factor = -(omega * inverse[c * B + l]);
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
