//! A matrix that differs from another one in the rows and columns of some nodes.

use std::sync::Arc;

use crate::linalg::amg::aggregates::by_group;
use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix, PADDING, ROWS, fill_diagonal};
use crate::linalg::amg::symmetric_blocks::{StoredBlock, SymmetricBlocks};
use crate::linalg::parallel::largest;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::real::Real as _;
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
    pub fn bytes(&self) -> usize {
        8 * (self.start.len() + self.values.len()) + 4 * (self.nodes.len() + self.column.len())
    }
}

impl SymmetricBlocks {
    /// The matrix in single precision, with the rows and columns of `changed` instead of its
    /// own. `held` unknowns have the rows and columns of the diagonal, which is positive there.
    pub fn with_rows(&self, changed: &ChangedRows, held: &[bool]) -> BlockMatrix {
        let (b, nodes) = (self.block_size(), self.nodes());
        let size = b * b;
        assert_eq!(changed.b, b);
        assert_eq!(held.len(), b * nodes);
        let mut row_of = vec![ABSENT; nodes];
        for (row, &node) in changed.nodes.iter().enumerate() {
            row_of[node as usize] = narrow(row);
        }
        let (met_start, met) = by_group(&changed.column, nodes);
        let most = self.largest().max(largest(&changed.values));
        let shift = if most.is_finite() { exponent(most) } else { 0 };
        let block_of = |at: u32, mirrored: bool| {
            StoredBlock::new(&changed.values[at as usize * size..][..size], b, mirrored)
        };
        let parts = tasks::map(0..nodes.div_ceil(ROWS), |_, task| {
            let (mut counts, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
            let mut row: Vec<(u32, StoredBlock<'_>)> = Vec::new();
            for i in task * ROWS..nodes.min((task + 1) * ROWS) {
                row.clear();
                if row_of[i] == ABSENT {
                    row.extend(self.row(i).filter(|&(j, _)| row_of[j as usize] == ABSENT));
                    for &at in &met[met_start[i] as usize..met_start[i + 1] as usize] {
                        let other = changed.start.partition_point(|&start| start <= at as usize);
                        row.push((changed.nodes[other - 1], block_of(at, true)));
                    }
                    row.sort_unstable_by_key(|&(column, _)| column);
                } else {
                    let at = row_of[i] as usize;
                    let all = changed.start[at]..changed.start[at + 1];
                    row.extend(all.map(|at| (changed.column[at], block_of(narrow(at), false))));
                }
                counts.push(narrow(row.len()));
                for &(j, block) in &row {
                    columns.push(j);
                    block.for_each(b, |_, _, value| {
                        values.push(f32::rounded(times_two_to(value, -shift)));
                    });
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
        let mut known = self.held().to_vec();
        for &node in &changed.nodes {
            known[b * node as usize..b * (node as usize + 1)].fill(false);
        }
        let mut matrix = BlockMatrix {
            b,
            start: Arc::new(start),
            column: Arc::new(column),
            values,
            missing: Vec::new(),
            held: known,
            exponent: shift,
        };
        matrix.hold(held);
        for &node in &changed.nodes {
            let at = matrix.diagonal(node as usize) * size;
            fill_diagonal(&mut matrix.values[at..at + size], b);
        }
        matrix
    }
}
