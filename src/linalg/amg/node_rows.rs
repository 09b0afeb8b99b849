//! Rows of a few nodes, which unknowns that are held, and springs, change.

use crate::linalg::amg::block_matrix::{BlockMatrix, PADDING};
use crate::linalg::amg::block_rows::Blocks as _;
use crate::linalg::amg::single_rows::{LevelMatrix, SingleRows};
use crate::linalg::power_of_two::times_two_to;
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;

/// The rows of some nodes while nothing is held.
#[derive(Clone, Debug)]
pub(super) struct NodeRows {
    pub(super) nodes: Vec<u32>,
    /// Start of each row in `mirror`.
    start: Vec<usize>,
    /// Place of the mirror image of each block in the matrix.
    mirror: Vec<u32>,
    /// Each block by columns.
    values: Vec<f32>,
}

impl NodeRows {
    pub(super) fn new(rows: &SingleRows<'_>, nodes: Vec<u32>) -> Self {
        let matrix = LevelMatrix::Made(rows);
        let (mut start, mut mirror, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in nodes.iter().map(|&i| i as usize) {
            for &j in matrix.columns(i) {
                let left = matrix
                    .columns(j as usize)
                    .partition_point(|&k| (k as usize) < i);
                mirror.push(narrow(matrix.row(j as usize).start + left));
            }
            values.extend(rows.load(i..i + 1, false));
            values.truncate(values.len() - PADDING);
            start.push(mirror.len());
        }
        Self {
            nodes,
            start,
            mirror,
            values,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        4 * (self.nodes.len() + self.mirror.len() + self.values.len()) + 8 * self.start.len()
    }

    /// Writes row `k` and its mirror image: with `spring`, by columns and in the units of the
    /// matrix, and with the diagonal alone at `held` unknowns.
    pub(super) fn write(&self, k: usize, matrix: &mut BlockMatrix, held: &[bool], spring: &[f64]) {
        let (b, size) = (matrix.b, matrix.b * matrix.b);
        let i = self.nodes[k] as usize;
        let skipped = matrix.skipped(i);
        for (n, at) in (self.start[k]..self.start[k + 1]).zip(matrix.row(i)) {
            let j = matrix.column[at] as usize;
            let (at, mirror) = (at - skipped, self.mirror[n] as usize - matrix.skipped(j));
            for (entry, &base) in self.values[n * size..(n + 1) * size].iter().enumerate() {
                let (c, r) = (entry / b, entry % b);
                let mut value = base;
                if i == j {
                    let add = times_two_to(spring[entry], -matrix.exponent);
                    value += f32::rounded(add);
                }
                if (held[b * i + r] || held[b * j + c]) && !(i == j && r == c) {
                    value = 0.0;
                }
                matrix.values[at * size + entry] = value;
                if i != j {
                    matrix.values[mirror * size + r * b + c] = value;
                }
            }
        }
    }
}
