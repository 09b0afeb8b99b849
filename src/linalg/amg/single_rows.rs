//! The rows of a symmetric matrix in single precision, made when they are read: a whole copy would
//! be the largest array of a set-up.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix, PADDING, ROWS, fill_diagonal};
use crate::linalg::amg::inverse_diagonal::inverse_diagonal;
use crate::linalg::amg::spectrum::bound;
use crate::linalg::amg::symmetric_blocks::{StoredBlock, SymmetricBlocks};
use crate::linalg::parallel::map2;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::real::Real as _;
use crate::tasks;

/// `Tᵀ A T` in single precision, divided by a power of two near its largest entry. `T` is the
/// identity but for a few nodes.
#[derive(Clone, Debug)]
pub struct SingleRows<'a> {
    matrix: &'a SymmetricBlocks,
    pub(super) exponent: i32,
    factor: f64,
    /// The number of the block of `T` of each node, [`ABSENT`] without one.
    which: Vec<u32>,
    /// Each block of `T` by columns.
    changes: Vec<f32>,
}

impl<'a> SingleRows<'a> {
    /// `changes` are nodes with their block of `T`, `b × b` by columns.
    pub fn new<'b>(
        matrix: &'a SymmetricBlocks,
        changes: impl Iterator<Item = (usize, &'b [f64])>,
    ) -> Self {
        let (b, largest) = (matrix.block_size(), matrix.largest());
        let exponent = if largest.is_finite() {
            exponent(largest)
        } else {
            0
        };
        let mut made = Self {
            matrix,
            exponent,
            factor: times_two_to(1.0, -exponent),
            which: vec![ABSENT; matrix.nodes()],
            changes: Vec::new(),
        };
        for (number, (node, block)) in (0..).zip(changes) {
            assert_eq!(block.len(), b * b);
            made.which[node] = number;
            made.changes
                .extend(block.iter().map(|&value| f32::rounded(value)));
        }
        made
    }

    pub(super) fn matrix(&self) -> &SymmetricBlocks {
        self.matrix
    }

    fn change(&self, node: usize) -> Option<&[f32]> {
        let (number, size) = (self.which[node], self.matrix.block_size().pow(2));
        (number != ABSENT).then(|| &self.changes[number as usize * size..][..size])
    }

    /// The values of some rows, each block by columns, then padding. With `hold`, unknowns without a
    /// degree of freedom have the rows and columns of the diagonal at nodes that change.
    pub(super) fn load(&self, rows: Range<usize>, hold: bool) -> Vec<f32> {
        let start = &self.matrix.pattern().0;
        let count = start[rows.end] - start[rows.start];
        let row = |i| {
            self.matrix
                .row(i)
                .map(move |(j, block)| (i, j as usize, block))
        };
        self.write(count as usize, hold, rows.flat_map(row))
    }

    fn write<'b>(
        &self,
        count: usize,
        hold: bool,
        blocks: impl Iterator<Item = (usize, usize, StoredBlock<'b>)>,
    ) -> Vec<f32> {
        match self.matrix.block_size() {
            2 => self.write_of::<2>(count, hold, blocks),
            _ => self.write_of::<3>(count, hold, blocks),
        }
    }

    fn write_of<'b, const B: usize>(
        &self,
        count: usize,
        hold: bool,
        blocks: impl Iterator<Item = (usize, usize, StoredBlock<'b>)>,
    ) -> Vec<f32> {
        let mut values = vec![0.0; count * B * B + PADDING];
        let held = self.matrix.held();
        let to = values.chunks_exact_mut(B * B);
        blocks.zip(to).for_each(|((i, j, block), to)| {
            block.write_single::<B>(self.factor, to);
            if self.which[i] == ABSENT && self.which[j] == ABSENT {
                return;
            }
            self.transform::<B>(i, j, to);
            if i == j {
                // A variable without an unknown has lost its diagonal.
                fill_diagonal(to, B);
            }
            for (at, value) in to.iter_mut().enumerate() {
                let (c, r) = (at / B, at % B);
                if hold && (held[B * i + r] || held[B * j + c]) && !(i == j && r == c) {
                    *value = 0.0;
                }
            }
        });
        values
    }

    /// `T_iᵀ A_ij T_j`. Of two mirror images, which may differ by rounding if both nodes change,
    /// both rows take that of the lower one.
    fn transform<const B: usize>(&self, i: usize, j: usize, block: &mut [f32]) {
        let (left, right) = (self.change(i), self.change(j));
        let transpose = |block: &mut [f32]| {
            for c in 0..B {
                for r in 0..c {
                    block.swap(c * B + r, r * B + c);
                }
            }
        };
        let mut old = [0.0; 9];
        let (old, block) = (&mut old[..B * B], &mut block[..B * B]);
        let mut multiply = |block: &mut [f32], left: Option<&[f32]>, right: Option<&[f32]>| {
            if let Some(left) = left {
                old.copy_from_slice(block);
                for (c, r) in (0..B * B).map(|at| (at / B, at % B)) {
                    block[c * B + r] = (0..B).map(|l| left[r * B + l] * old[c * B + l]).sum();
                }
            }
            if let Some(right) = right {
                old.copy_from_slice(block);
                for (c, r) in (0..B * B).map(|at| (at / B, at % B)) {
                    block[c * B + r] = (0..B).map(|l| old[l * B + r] * right[c * B + l]).sum();
                }
            }
        };
        if j < i && left.is_some() && right.is_some() {
            transpose(block);
            multiply(block, right, left);
            transpose(block);
        } else {
            multiply(block, left, right);
        }
    }

    /// A bound of the eigenvalues of `D⁻¹ A`, without `T`; `None` if a diagonal is not positive, or
    /// numbers are not finite. It holds for every matrix that holds more unknowns, or adds
    /// positive semidefinite diagonal blocks: both restrict the Rayleigh quotient or move it
    /// towards one.
    pub fn spectrum(&self) -> Option<f64> {
        let own = Self::new(self.matrix, std::iter::empty());
        let inverse = inverse_diagonal(LevelMatrix::Made(&own))?;
        let b = self.matrix.block_size();
        let (mut x, mut y) = (
            vec![0.0; b * self.matrix.nodes()],
            vec![0.0; b * self.matrix.nodes()],
        );
        let bound = bound(b, &inverse, |p, q| {
            map2(&mut x, p, |_, p: f32| p.double());
            self.matrix.product(&x, &mut y);
            map2(q, &y, |_, y: f64| f32::rounded(y * self.factor));
        });
        bound.filter(|bound| *bound > 0.0 && bound.is_finite())
    }

    /// All rows.
    pub fn whole(&self) -> BlockMatrix {
        self.only(&vec![true; self.matrix.nodes()])
    }

    /// The rows of some nodes.
    pub(super) fn only(&self, wanted: &[bool]) -> BlockMatrix {
        let ((start, column), b) = (self.matrix.pattern(), self.matrix.block_size());
        let parts = tasks::map(wanted.chunks(ROWS), |task, wanted| {
            let mut values = Vec::new();
            for i in (0..wanted.len())
                .filter(|&k| wanted[k])
                .map(|k| task * ROWS + k)
            {
                values.extend(self.load(i..i + 1, true));
                values.truncate(values.len() - PADDING);
            }
            values
        });
        let mut values = Vec::with_capacity(parts.iter().map(Vec::len).sum::<usize>() + PADDING);
        for part in parts {
            values.extend(part);
        }
        values.resize(values.len() + PADDING, 0.0);
        let mut sum = 0;
        let missing = wanted.iter().enumerate().map(|(i, &wanted)| {
            let before = sum;
            sum += if wanted { 0 } else { start[i + 1] - start[i] };
            before
        });
        BlockMatrix {
            b,
            missing: if wanted.contains(&false) {
                missing.collect()
            } else {
                Vec::new()
            },
            start: Arc::clone(start),
            column: Arc::clone(column),
            values,
            held: self.matrix.held().to_vec(),
            exponent: self.exponent,
        }
    }
}

/// The matrix of a level.
#[derive(Clone, Copy, Debug)]
pub(super) enum LevelMatrix<'a> {
    Whole(&'a BlockMatrix),
    Made(&'a SingleRows<'a>),
}

impl LevelMatrix<'_> {
    /// Unknowns of a node.
    pub(super) fn b(&self) -> usize {
        match self {
            Self::Whole(matrix) => matrix.b,
            Self::Made(rows) => rows.matrix.block_size(),
        }
    }

    /// Starts of rows, and columns of blocks.
    pub(super) fn pattern(&self) -> (&Arc<Vec<u32>>, &Arc<Vec<u32>>) {
        match self {
            Self::Whole(matrix) => (&matrix.start, &matrix.column),
            Self::Made(rows) => rows.matrix.pattern(),
        }
    }

    pub(super) fn nodes(&self) -> usize {
        self.pattern().0.len() - 1
    }

    /// The places of the blocks of a row.
    pub(super) fn row(&self, node: usize) -> Range<usize> {
        let start = self.pattern().0;
        start[node] as usize..start[node + 1] as usize
    }

    /// The columns of a row.
    pub(super) fn columns(&self, node: usize) -> &[u32] {
        &self.pattern().1[self.row(node)]
    }

    /// The matrix is `2^exponent` times the values.
    pub(super) fn exponent(&self) -> i32 {
        match self {
            Self::Whole(matrix) => matrix.exponent,
            Self::Made(rows) => rows.exponent,
        }
    }

    /// Values with those of some rows, and the place of the first of them.
    pub(super) fn load(&self, rows: Range<usize>) -> (Cow<'_, [f32]>, usize) {
        match self {
            Self::Whole(matrix) => (Cow::Borrowed(&matrix.values), 0),
            Self::Made(made) => {
                let first = self.row(rows.start).start;
                (Cow::Owned(made.load(rows, true)), first)
            }
        }
    }

    /// The diagonal blocks of some rows.
    pub(super) fn load_diagonal(&self, rows: Range<usize>) -> Vec<f32> {
        match self {
            Self::Whole(matrix) => rows
                .flat_map(|i| matrix.diagonal_block(i))
                .copied()
                .collect(),
            Self::Made(made) => {
                let block = |i| StoredBlock::new(made.matrix.diagonal_block(i), self.b(), false);
                made.write(rows.len(), true, rows.map(|i| (i, i, block(i))))
            }
        }
    }

    /// How many blocks earlier the values of a row stand than its columns.
    pub(super) fn skipped(&self, node: usize) -> usize {
        match self {
            Self::Whole(matrix) => matrix.skipped(node),
            Self::Made(_) => 0,
        }
    }
}
