//! A matrix that differs from another one in the rows and columns of some nodes.

use crate::linalg::amg::aggregates::by_group;
use crate::linalg::amg::block_matrix::ROWS;
use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix, PADDING};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;
use crate::tasks;

/// Whole rows of blocks of a symmetric matrix at some nodes.
#[derive(Clone, Debug)]
pub struct ChangedRows {
    b: usize,
    /// The node of each row, ascending.
    pub nodes: Vec<u32>,
    /// Start of each row in `column`.
    pub start: Vec<usize>,
    /// Columns ascend in each row.
    pub column: Vec<u32>,
    /// Each block by columns.
    pub values: Vec<f64>,
}

impl ChangedRows {
    /// Without a row, of `b × b` blocks.
    #[must_use]
    pub fn new(b: usize) -> Self {
        Self {
            b,
            nodes: Vec::new(),
            start: vec![0],
            column: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Appends the rows of `other`, whose nodes come later.
    pub fn extend(&mut self, other: Self) {
        let before = self.column.len();
        self.nodes.extend(other.nodes);
        self.start
            .extend(other.start[1..].iter().map(|at| before + at));
        self.column.extend(other.column);
        self.values.extend(other.values);
    }

    /// Blocks of a row: the node of its column, and the block by columns.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, &[f64])> {
        let size = self.b * self.b;
        let blocks = self.start[row]..self.start[row + 1];
        blocks.map(move |at| {
            (
                self.column[at] as usize,
                &self.values[at * size..(at + 1) * size],
            )
        })
    }

    /// Memory of the rows.
    #[must_use]
    pub fn bytes(&self) -> usize {
        8 * (self.start.len() + self.values.len()) + 4 * (self.nodes.len() + self.column.len())
    }
}

impl<T: Real> BlockMatrix<T> {
    /// The blocks of a row: the node of each column, and the block by columns, in units of
    /// `2^`[`Self::exponent`].
    pub fn blocks_of_row(&self, node: usize) -> impl Iterator<Item = (usize, &[T])> {
        let size = self.b * self.b;
        let row = self.row(node);
        row.map(move |at| {
            (
                self.column[at] as usize,
                &self.values[at * size..(at + 1) * size],
            )
        })
    }
}

/// Where a block of the new matrix comes from.
#[derive(Clone, Copy)]
enum BlockSource {
    Old(usize),
    Changed(usize),
    /// The mirror image of a block of the changed rows.
    Mirror(usize),
}

impl BlockMatrix<f64> {
    /// The matrix in single precision, with the rows and columns of `changed` instead of its
    /// own. `held` unknowns have the rows and columns of the diagonal, which is positive there.
    ///
    /// # Panics
    /// If the blocks have not the same size, or `held` has not an entry for each unknown.
    #[must_use]
    pub fn with_rows(&self, changed: &ChangedRows, held: &[bool]) -> BlockMatrix<f32> {
        let (b, nodes) = (self.b, self.nodes());
        let size = b * b;
        assert_eq!(changed.b, b);
        assert_eq!(held.len(), b * nodes);
        let mut row_of = vec![ABSENT; nodes];
        for (row, &node) in changed.nodes.iter().enumerate() {
            row_of[node as usize] = narrow(row);
        }
        let (met_start, met) = by_group(&changed.column, nodes);
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let most =
            largest(&self.values).max(times_two_to(largest(&changed.values), -self.exponent));
        let shift = self.exponent + if most.is_finite() { exponent(most) } else { 0 };
        let single =
            |value: f64, exponent: i32| f32::rounded(times_two_to(value, exponent - shift));
        let sources = |i: usize, row: &mut Vec<(u32, BlockSource)>| {
            row.clear();
            if row_of[i] != ABSENT {
                let at = row_of[i] as usize;
                let all = changed.start[at]..changed.start[at + 1];
                row.extend(all.map(|at| (changed.column[at], BlockSource::Changed(at))));
                return;
            }
            let old = self
                .row(i)
                .filter(|&at| row_of[self.column[at] as usize] == ABSENT);
            row.extend(old.map(|at| (self.column[at], BlockSource::Old(at))));
            for &at in &met[met_start[i] as usize..met_start[i + 1] as usize] {
                let other = changed.start.partition_point(|&start| start <= at as usize) - 1;
                row.push((changed.nodes[other], BlockSource::Mirror(at as usize)));
            }
            row.sort_unstable_by_key(|&(column, _)| column);
        };
        let parts = tasks::map(0..nodes.div_ceil(ROWS), |_, task| {
            let (mut counts, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
            let mut row = Vec::new();
            for i in task * ROWS..nodes.min((task + 1) * ROWS) {
                sources(i, &mut row);
                counts.push(narrow(row.len()));
                for &(j, source) in &row {
                    columns.push(j);
                    for at in 0..size {
                        let mirror = at % b * b + at / b;
                        let value = match source {
                            BlockSource::Old(block) => {
                                single(self.values[block * size + at], self.exponent)
                            }
                            BlockSource::Changed(block) => {
                                single(changed.values[block * size + at], 0)
                            }
                            BlockSource::Mirror(block) => {
                                single(changed.values[block * size + mirror], 0)
                            }
                        };
                        values.push(value);
                    }
                }
            }
            (counts, columns, values)
        });
        let blocks = parts.iter().map(|(_, columns, _)| columns.len()).sum();
        let (mut start, mut column) = (vec![0], Vec::with_capacity(blocks));
        let mut values = Vec::with_capacity(blocks * size + PADDING);
        let mut sum = 0;
        for (counts, columns, part) in parts {
            for count in counts {
                sum += count;
                start.push(sum);
            }
            column.extend(columns);
            values.extend(part);
        }
        values.resize(blocks * size + PADDING, 0.0);
        let mut known = self.held.clone();
        for &node in &changed.nodes {
            known[b * node as usize..b * (node as usize + 1)].fill(false);
        }
        let mut matrix = BlockMatrix {
            b,
            start,
            column,
            values,
            held: known,
            exponent: shift,
        };
        matrix.hold(held);
        for &node in &changed.nodes {
            matrix.fill_diagonal(node as usize);
        }
        matrix
    }
}

impl BlockMatrix<f32> {
    /// Gives variables without an unknown, which have no diagonal, the largest one of their node.
    pub(super) fn fill_diagonal(&mut self, node: usize) {
        let b = self.b;
        let at = self.diagonal(node) * b * b;
        let block = &mut self.values[at..at + b * b];
        let largest = (0..b).fold(0.0_f32, |most, k| most.max(block[k * b + k]));
        for k in 0..b {
            if block[k * b + k] == 0.0 {
                block[k * b + k] = if largest > 0.0 { largest } else { 1.0 };
            }
        }
    }
}
