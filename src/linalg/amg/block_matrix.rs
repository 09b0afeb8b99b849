//! A sparse matrix in square blocks, one row of blocks for each node, in single precision.

use std::sync::Arc;

use crate::linalg::amg::block_rows::Blocks as _;
use crate::linalg::power_of_two::times_two_to;
use crate::linalg::real::Real;
use crate::tasks;

/// The place of an unknown that no node has, and of a component that no unknown has.
pub const ABSENT: u32 = u32::MAX;

/// Rows of blocks in one task.
pub(super) const ROWS: usize = 512;

/// Numbers after the last block, so that a loop may read whole registers.
pub(super) const PADDING: usize = 12;

/// Square sparse matrix in `b × b` blocks, `b` = 2, 3 or 6. Columns ascend in each row, and each
/// row has its diagonal block.
#[derive(Clone, Debug)]
pub struct BlockMatrix {
    pub(super) b: usize,
    /// Start of each row in `column`.
    pub(super) start: Arc<Vec<u32>>,
    pub(super) column: Arc<Vec<u32>>,
    /// Each block by columns, then [`PADDING`].
    pub(super) values: Vec<f32>,
    /// If only some rows have values: the number of blocks before each row that have none.
    pub(super) missing: Vec<u32>,
    /// Unknowns whose row and column are those of the diagonal.
    pub(super) held: Vec<bool>,
    /// The matrix is `2^exponent` times the values: single precision has a small range.
    pub(super) exponent: i32,
}

impl BlockMatrix {
    /// Number of nodes, each with a row of blocks.
    pub fn nodes(&self) -> usize {
        self.start.len() - 1
    }

    /// Unknowns of a node.
    pub fn block_size(&self) -> usize {
        self.b
    }

    /// Memory of the matrix.
    pub fn bytes(&self) -> usize {
        4 * (self.start.len() + self.column.len() + self.values.len() + self.missing.len())
            + self.held.len()
    }

    /// Unknowns that have no degree of freedom, or that were held later.
    pub fn held(&self) -> &[bool] {
        &self.held
    }

    /// The diagonal block of a node, by columns, in units of `2^exponent`.
    pub fn diagonal_block(&self, node: usize) -> &[f32] {
        let at = (self.diagonal(node) - self.skipped(node)) * self.b * self.b;
        &self.values[at..at + self.b * self.b]
    }

    /// How many blocks earlier the values of a row stand than its columns.
    pub(super) fn skipped(&self, node: usize) -> usize {
        self.missing.get(node).map_or(0, |&blocks| blocks as usize)
    }

    /// The place of a diagonal block.
    pub(super) fn diagonal(&self, node: usize) -> usize {
        self.place(node, node)
    }

    /// The place of a block that the matrix has.
    pub(super) fn place(&self, node: usize, column: usize) -> usize {
        let row = self.row(node);
        let at = self.column[row.clone()].partition_point(|&j| (j as usize) < column);
        row.start + at
    }
}

impl BlockMatrix {
    /// Adds `block`, `b × b` and symmetric, in the units of the matrix, to a diagonal block.
    pub fn add_to_diagonal_block(&mut self, node: usize, block: &[f64]) {
        let size = self.b * self.b;
        assert_eq!(block.len(), size);
        let at = self.diagonal(node) * size;
        for (value, add) in self.values[at..at + size].iter_mut().zip(block) {
            *value += f32::rounded(times_two_to(*add, -self.exponent));
        }
    }

    /// Gives `held` unknowns the rows and columns of the diagonal, which stays.
    pub fn hold(&mut self, held: &[bool]) {
        let (b, nodes) = (self.b, self.nodes());
        assert_eq!(held.len(), b * nodes);
        for (known, &new) in self.held.iter_mut().zip(held) {
            *known |= new;
        }
        let (start, column) = (&self.start, &self.column);
        let parts = cut(&mut self.values, nodes, |i| start[i] as usize * b * b);
        tasks::for_each(parts, |task, part| {
            let rows = task * ROWS..nodes.min((task + 1) * ROWS);
            let mut blocks = part.chunks_exact_mut(b * b);
            for i in rows {
                let own = &held[b * i..b * (i + 1)];
                let any = own.contains(&true);
                for &j in &column[start[i] as usize..start[i + 1] as usize] {
                    let Some(block) = blocks.next() else { return };
                    let other = &held[b * j as usize..b * (j as usize + 1)];
                    if any || other.contains(&true) {
                        for (at, value) in block.iter_mut().enumerate() {
                            let (c, r) = (at / b, at % b);
                            if (own[r] || other[c]) && !(i == j as usize && r == c) {
                                *value = 0.0;
                            }
                        }
                    }
                }
            }
        });
    }
}

/// Gives variables without an unknown, which have no diagonal, the largest one of their node.
pub(super) fn fill_diagonal(block: &mut [f32], b: usize) {
    let largest = (0..b).fold(0.0_f32, |most, k| most.max(block[k * b + k]));
    for k in 0..b {
        if block[k * b + k] == 0.0 {
            block[k * b + k] = if largest > 0.0 { largest } else { 1.0 };
        }
    }
}

/// Cuts an array of all rows into those of tasks of [`ROWS`] rows; `start` is the place of a
/// row. What follows the last row stays outside.
pub(super) fn cut<T>(
    mut values: &mut [T],
    rows: usize,
    start: impl Fn(usize) -> usize,
) -> Vec<&mut [T]> {
    (0..rows)
        .step_by(ROWS)
        .map(|row| {
            let length = start(rows.min(row + ROWS)) - start(row);
            let (part, rest) = std::mem::take(&mut values).split_at_mut(length);
            values = rest;
            part
        })
        .collect()
}
