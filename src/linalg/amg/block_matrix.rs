//! A sparse matrix in square blocks, one row of blocks for each node.

use crate::linalg::compensated::Sum;
use crate::linalg::pages::zeros;
use crate::linalg::parallel::largest;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::{Index, Symmetric, narrow};
use crate::tasks;

/// The place of an unknown that no node has, and of a component that no unknown has.
pub const ABSENT: u32 = u32::MAX;

/// Rows of blocks in one task.
pub(super) const ROWS: usize = 512;

/// Numbers after the last block, so that a loop may read whole registers.
pub(super) const PADDING: usize = 8;

/// Square sparse matrix in `b × b` blocks, `b` = 2, 3 or 6. Columns ascend in each row, and each
/// row has its diagonal block.
#[derive(Clone, Debug)]
pub struct BlockMatrix<T> {
    pub(super) b: usize,
    /// Start of each row in `column`.
    pub(super) start: Vec<u32>,
    pub(super) column: Vec<u32>,
    /// Each block by columns, then [`PADDING`].
    pub(super) values: Vec<T>,
    /// Unknowns whose row and column are those of the diagonal.
    pub(super) held: Vec<bool>,
    /// The matrix is `2^exponent` times the values: single precision has a small range.
    pub(super) exponent: i32,
}

impl<T: Real> BlockMatrix<T> {
    /// Number of nodes, each with a row of blocks.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.start.len() - 1
    }

    /// Unknowns of a node.
    #[must_use]
    pub fn block_size(&self) -> usize {
        self.b
    }

    /// Memory of the matrix.
    #[must_use]
    pub fn bytes(&self) -> usize {
        4 * (self.start.len() + self.column.len())
            + size_of::<T>() * self.values.len()
            + self.held.len()
    }

    /// Unknowns that have no degree of freedom, or that were held later.
    #[must_use]
    pub fn held(&self) -> &[bool] {
        &self.held
    }

    /// The diagonal block of a node, by columns, in units of `2^exponent`.
    #[must_use]
    pub fn diagonal_block(&self, node: usize) -> &[T] {
        let at = self.diagonal(node) * self.b * self.b;
        &self.values[at..at + self.b * self.b]
    }

    /// The blocks of a row.
    pub(super) fn row(&self, node: usize) -> std::ops::Range<usize> {
        self.start[node] as usize..self.start[node + 1] as usize
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

impl BlockMatrix<f64> {
    /// The matrix of a symmetric `k` whose degree of freedom `i` is component `place[i] % b` of
    /// node `place[i] / b`, or is left out if `place[i]` is [`ABSENT`].
    ///
    /// A component that no degree of freedom has is held: its row is that of the diagonal, with
    /// a number of the size of the other diagonals.
    ///
    /// # Panics
    /// If `place` has not one entry for each row of `k`, or names a node that does not exist.
    #[must_use]
    pub fn new<I: Index>(k: &Symmetric<'_, I>, place: &[u32], nodes: usize, b: usize) -> Self {
        assert_eq!(place.len(), k.n());
        let mut dof = vec![ABSENT; nodes * b];
        for (i, &at) in place.iter().enumerate() {
            if at != ABSENT {
                dof[at as usize] = narrow(i);
            }
        }
        let (start, column, values) = match b {
            2 => blocks::<2, I>(k, place, &dof),
            3 => blocks::<3, I>(k, place, &dof),
            _ => blocks::<6, I>(k, place, &dof),
        };
        let held = dof.iter().map(|&dof| dof == ABSENT).collect();
        let mut matrix = Self {
            b,
            start,
            column,
            values,
            held,
            exponent: 0,
        };
        matrix.fill_absent(k);
        matrix
    }

    /// Gives absent unknowns the mean diagonal of their node, else of the whole matrix.
    fn fill_absent<I: Index>(&mut self, k: &Symmetric<'_, I>) {
        let b = self.b;
        if !self.held.contains(&true) {
            return;
        }
        let diagonal = k.diagonal();
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let mean = diagonal.iter().sum::<f64>() / diagonal.len().max(1) as f64;
        let mean = if mean > 0.0 { mean } else { 1.0 };
        for i in 0..self.nodes() {
            let absent = &self.held[b * i..b * (i + 1)];
            if !absent.contains(&true) {
                continue;
            }
            let at = self.diagonal(i) * b * b;
            let block = &mut self.values[at..at + b * b];
            let (mut sum, mut count) = (0.0, 0.0);
            for l in (0..b).filter(|&l| !absent[l]) {
                sum += block[l * b + l];
                count += 1.0;
            }
            for l in (0..b).filter(|&l| absent[l]) {
                block[l * b + l] = if sum > 0.0 { sum / count } else { mean };
            }
        }
    }

    /// The matrix in single precision, divided by a power of two near its largest diagonal.
    #[must_use]
    pub fn to_single(&self) -> BlockMatrix<f32> {
        let largest = largest(&self.values);
        let exponent = self.exponent
            + if largest.is_finite() {
                exponent(largest)
            } else {
                0
            };
        let factor = times_two_to(1.0, self.exponent - exponent);
        let mut values = zeros(self.values.len());
        crate::linalg::parallel::map2(&mut values, &self.values, |_, value: f64| {
            f32::rounded(value * factor)
        });
        BlockMatrix {
            b: self.b,
            start: self.start.clone(),
            column: self.column.clone(),
            values,
            held: self.held.clone(),
            exponent,
        }
    }
}

impl BlockMatrix<f64> {
    /// `A x` with sums in twice the precision: the values, and the digits below their rounding.
    ///
    /// # Panics
    /// If `x` has not an entry for each unknown.
    #[must_use]
    pub fn product_in_two(&self, x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (size, n) = (self.b, self.b * self.nodes());
        assert_eq!(x.len(), n);
        let (mut high_parts, mut low_parts) = (zeros(n), zeros(n));
        let parts = high_parts.chunks_mut(ROWS * size);
        let parts = parts.zip(low_parts.chunks_mut(ROWS * size));
        tasks::for_each(parts, |task, (high_parts, low_parts)| {
            for (k, high_part) in high_parts.iter_mut().enumerate() {
                let at = task * ROWS * size + k;
                let mut sum = Sum::default();
                for (node, block) in self.blocks_of_row(at / size) {
                    for c in 0..size {
                        sum.add_product(block[c * size + at % size], x[size * node + c]);
                    }
                }
                (*high_part, low_parts[k]) = sum.parts();
            }
        });
        (high_parts, low_parts)
    }
}

impl BlockMatrix<f32> {
    /// Adds `block`, `b × b` and symmetric, in the units of the matrix, to a diagonal block.
    ///
    /// # Panics
    /// If there is no such node, or the block has not `b²` entries.
    pub fn add_to_diagonal_block(&mut self, node: usize, block: &[f64]) {
        let size = self.b * self.b;
        assert_eq!(block.len(), size);
        let at = self.diagonal(node) * size;
        for (value, add) in self.values[at..at + size].iter_mut().zip(block) {
            *value += f32::rounded(times_two_to(*add, -self.exponent));
        }
    }

    /// Gives `held` unknowns the rows and columns of the diagonal, which stays.
    ///
    /// # Panics
    /// If `held` has not `b` entries for each node.
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

/// Starts, columns and values of the rows of blocks.
fn blocks<const B: usize, I: Index>(
    k: &Symmetric<'_, I>,
    place: &[u32],
    dof: &[u32],
) -> (Vec<u32>, Vec<u32>, Vec<f64>) {
    let (nodes, size) = (dof.len() / B, B * B);
    let (start, column) = pattern::<B, I>(k, place, dof);
    let mut values = zeros(column.len() * size + PADDING);
    let parts = cut(&mut values, nodes, |i| start[i] as usize * size);
    tasks::for_each(parts, |task, part| {
        for i in task * ROWS..nodes.min((task + 1) * ROWS) {
            let row = start[i] as usize..start[i + 1] as usize;
            let from = (row.start - start[task * ROWS] as usize) * size;
            let columns = &column[row];
            for (r, &dof) in dof[B * i..B * (i + 1)].iter().enumerate() {
                if dof == ABSENT {
                    continue;
                }
                // Columns come in the order of the nodes in most matrices.
                let mut at = 0;
                for (j, value) in k.column(dof as usize) {
                    if place[j] == ABSENT {
                        continue;
                    }
                    let (node, c) = (place[j] / narrow(B), place[j] as usize % B);
                    if columns.get(at) != Some(&node) {
                        at += 1;
                    }
                    if columns.get(at) != Some(&node) {
                        at = columns.partition_point(|&j| j < node);
                    }
                    part[from + at * size + c * B + r] = value;
                }
            }
        }
    });
    (start, column, values)
}

/// Starts and columns of the rows of blocks.
fn pattern<const B: usize, I: Index>(
    k: &Symmetric<'_, I>,
    place: &[u32],
    dof: &[u32],
) -> (Vec<u32>, Vec<u32>) {
    let nodes = dof.len() / B;
    let parts = tasks::map(0..nodes.div_ceil(ROWS), |_, task| {
        let (mut counts, mut columns, mut row) = (Vec::new(), Vec::new(), Vec::new());
        for i in task * ROWS..nodes.min((task + 1) * ROWS) {
            row.clear();
            row.push(narrow(i));
            for &dof in &dof[B * i..B * (i + 1)] {
                if dof == ABSENT {
                    continue;
                }
                for (j, _) in k.column(dof as usize) {
                    let node = place[j] / narrow(B);
                    // The components of a node usually follow one another.
                    if place[j] != ABSENT && row.last() != Some(&node) {
                        row.push(node);
                    }
                }
            }
            row.sort_unstable();
            row.dedup();
            counts.push(narrow(row.len()));
            columns.extend_from_slice(&row);
        }
        (counts, columns)
    });
    let mut start = vec![0];
    let mut column = Vec::with_capacity(parts.iter().map(|(_, columns)| columns.len()).sum());
    let mut sum = 0;
    for (counts, columns) in parts {
        for count in counts {
            sum += count;
            start.push(sum);
        }
        column.extend(columns);
    }
    (start, column)
}
