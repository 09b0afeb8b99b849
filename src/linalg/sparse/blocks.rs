//! Sparse matrices of `D × D` blocks, with one row and one column of blocks for each contact.
//!
//! The pattern is symmetric and contains the diagonal. Missing blocks are stored as zeros, so
//! that rows give access to columns without a second copy.

use std::ops::Range;

use crate::error::{Error, check_length};
use crate::linalg::small::{Block, Vector};

/// A square matrix of blocks, row by row, columns increasing in each row.
#[derive(Clone, Debug)]
pub struct Blocks<const D: usize> {
    start: Vec<usize>,
    column: Vec<usize>,
    /// Position of the block `(j, i)` for each block `(i, j)`.
    mirror: Vec<usize>,
    values: Vec<Block<D>>,
}

impl<const D: usize> Blocks<D> {
    /// Makes it from the blocks of each row, row-major: row `i` has the columns
    /// `column[start[i]..start[i + 1]]`. A pair that occurs twice is summed.
    pub fn new(start: &[usize], column: &[usize], values: &[f64]) -> Result<Self, Error> {
        let n = start.len().saturating_sub(1);
        check(start, column, values.len() / (D * D))?;
        let (of_rows, _) = values.as_chunks::<D>();
        for (row, values) in of_rows.iter().enumerate() {
            if let Some(k) = values.iter().position(|w| !w.is_finite()) {
                let at = row / D;
                return Err(Error::EntryNotFinite {
                    what: "W",
                    row: D * start[1..].partition_point(|&end| end <= at) + row % D,
                    column: D * column[at] + k,
                    value: values[k],
                });
            }
        }
        let block = |at: usize| Block::from_fn(|k, l| of_rows[D * at + k][l]);
        Ok(Self::from_rows(n, |i, add| {
            for (&j, at) in column[start[i]..start[i + 1]].iter().zip(start[i]..) {
                add(j, block(at));
            }
        }))
    }

    /// Makes it from `n` rows of blocks: `row(i, add)` calls `add(j, block)` for the blocks of
    /// row `i`. It is called twice and must give the same blocks.
    pub fn from_rows(n: usize, row: impl Fn(usize, &mut dyn FnMut(usize, Block<D>))) -> Self {
        let mut pattern: Vec<Vec<usize>> = (0..n).map(|i| vec![i]).collect();
        for i in 0..n {
            row(i, &mut |j, _| {
                pattern[i].push(j);
                pattern[j].push(i);
            });
        }
        let mut this = Self {
            start: vec![0],
            column: Vec::new(),
            mirror: Vec::new(),
            values: Vec::new(),
        };
        for mut columns in pattern {
            columns.sort_unstable();
            columns.dedup();
            this.column.extend(columns);
            this.start.push(this.column.len());
        }
        // Rows are visited in order, so the partners of a row occur in its order.
        let mut cursor = this.start.clone();
        for i in 0..n {
            for at in this.row(i) {
                let j = this.column[at];
                this.mirror.push(cursor[j]);
                cursor[j] += 1;
            }
        }
        this.values = vec![Block::zeros(); this.column.len()];
        for i in 0..n {
            row(i, &mut |j, block| {
                if let Some(at) = this.position(i, j) {
                    this.values[at] += block;
                }
            });
        }
        this
    }

    /// The same pattern with other values, `of(i, j, W_ij)`.
    pub fn map(&self, of: impl Fn(usize, usize, &Block<D>) -> Block<D>) -> Self {
        let mut other = self.clone();
        for i in 0..self.rows() {
            for at in self.row(i) {
                other.values[at] = of(i, self.column[at], &self.values[at]);
            }
        }
        other
    }

    /// Number of rows of blocks.
    pub fn rows(&self) -> usize {
        self.start.len() - 1
    }

    /// Blocks stored, including those that make the pattern symmetric.
    pub fn stored(&self) -> usize {
        self.values.len()
    }

    fn row(&self, i: usize) -> Range<usize> {
        self.start[i]..self.start[i + 1]
    }

    fn position(&self, i: usize, j: usize) -> Option<usize> {
        let row = self.row(i);
        let found = self.column[row.clone()].binary_search(&j);
        found.ok().map(|at| row.start + at)
    }

    /// The block `(i, j)`, zero if it is not stored.
    pub fn at(&self, i: usize, j: usize) -> Block<D> {
        self.position(i, j)
            .map_or_else(Block::zeros, |at| self.values[at])
    }

    /// Columns and blocks of row `i`.
    pub fn in_row(&self, i: usize) -> impl Iterator<Item = (usize, &Block<D>)> {
        self.row(i).map(|at| (self.column[at], &self.values[at]))
    }

    /// Rows and blocks of column `i`.
    pub fn in_column(&self, i: usize) -> impl Iterator<Item = (usize, &Block<D>)> {
        self.row(i)
            .map(|at| (self.column[at], &self.values[self.mirror[at]]))
    }

    /// Row `i` of the product with `x`.
    pub fn row_product(&self, i: usize, x: &[[f64; D]]) -> [f64; D] {
        let terms = self.in_row(i).map(|(j, block)| block * Vector::from(x[j]));
        terms.sum::<Vector<D>>().into()
    }

    /// Whether the matrix is bitwise symmetric.
    pub fn is_symmetric(&self) -> bool {
        let same = |at: usize| self.values[at] == self.values[self.mirror[at]].transpose();
        (0..self.values.len()).all(same)
    }

    /// Largest difference between an entry and its mirror image.
    pub fn asymmetry(&self) -> f64 {
        let of = |at: usize| (self.values[at] - self.values[self.mirror[at]].transpose()).amax();
        (0..self.values.len()).map(of).fold(0.0, f64::max)
    }

    /// Largest entry.
    pub fn largest(&self) -> f64 {
        self.values.iter().map(Block::amax).fold(0.0, f64::max)
    }
}

fn check(start: &[usize], column: &[usize], blocks: usize) -> Result<(), Error> {
    let n = start.len().saturating_sub(1);
    check_length("blocks of W", blocks, column.len())?;
    let last = start.last().copied().unwrap_or_default();
    if start.first().is_some_and(|&first| first != 0) || last != column.len() {
        return Err(Error::SparseStructure { what: "W", row: 0 });
    }
    if let Some(row) = (0..n).find(|&i| start[i] > start[i + 1]) {
        return Err(Error::SparseStructure { what: "W", row });
    }
    match column.iter().position(|&j| j >= n) {
        Some(position) => Err(Error::IndexRange {
            what: "column indices of W",
            position,
            found: column[position],
            limit: n,
        }),
        None => Ok(()),
    }
}
