//! The matrix of a level for the smoother, in sixteen bits a number.
//!
//! The entries of a block are whole numbers times a power of two of its own. Their rounding is at
//! most 2⁻¹⁵ of the largest of the block, where a float of sixteen bits with the range of single
//! precision would have 2⁻⁹: the smoother sees rigid motions of a few nodes as stiff as the
//! rounding is, and soft supports need these digits. Mirror images are rounded alike.

use std::ops::Range;
use std::sync::Arc;

use crate::linalg::amg::block_matrix::{BlockMatrix, PADDING, ROWS, cut};
use crate::linalg::amg::block_rows::Blocks;
use crate::linalg::amg::single_rows::LevelMatrix;
use crate::linalg::pages::zeros;
use crate::tasks;

/// Bits of a number without its sign.
const BITS: i32 = 15;

/// Numbers of this size in single precision are whole.
const WHOLE: f32 = 12_582_912.0;

/// Bits of the significand of single precision, and the bias of its exponent.
const SIGNIFICAND: u32 = 23;
const BIAS: i32 = 127;

#[derive(Clone, Debug)]
pub(super) struct ScaledBlocks {
    pub(super) b: usize,
    start: Arc<Vec<u32>>,
    column: Arc<Vec<u32>>,
    /// Each block by columns, then [`PADDING`].
    values: Vec<i16>,
    /// A block is `2^exponent` times its values.
    pub(super) exponent: Vec<i8>,
}

impl ScaledBlocks {
    pub(super) fn new(matrix: LevelMatrix<'_>) -> Self {
        let mut made = Self::zeros(matrix);
        made.write_rows(matrix, 0..matrix.nodes());
        made
    }

    /// [`Self::new`], which gives back the memory of the matrix as it goes.
    pub(super) fn replace(mut matrix: BlockMatrix) -> Self {
        /// The matrix takes as much at the most beside this part of it.
        const PARTS: usize = 8;
        let mut made = Self::zeros(LevelMatrix::Whole(&matrix));
        let nodes = matrix.nodes();
        for part in (0..PARTS).rev() {
            let rows = nodes * part / PARTS..nodes * (part + 1) / PARTS;
            made.write_rows(LevelMatrix::Whole(&matrix), rows.clone());
            let left = matrix.start[rows.start] as usize * matrix.b * matrix.b;
            matrix.values.truncate(left);
            matrix.values.shrink_to_fit();
        }
        made
    }

    fn zeros(matrix: LevelMatrix<'_>) -> Self {
        let (b, (start, column)) = (matrix.b(), matrix.pattern());
        let blocks = column.len();
        Self {
            b,
            start: Arc::clone(start),
            column: Arc::clone(column),
            values: zeros(blocks * b * b + PADDING),
            exponent: zeros(blocks),
        }
    }

    fn write_rows(&mut self, matrix: LevelMatrix<'_>, rows: Range<usize>) {
        let (size, first) = (self.b * self.b, self.start[rows.start] as usize);
        let place = |i: usize| self.start[rows.start + i] as usize - first;
        let exponents = cut(&mut self.exponent[first..], rows.len(), place);
        let parts = cut(&mut self.values[first * size..], rows.len(), |i| {
            place(i) * size
        });
        tasks::for_each(parts.into_iter().zip(exponents), |task, (to, exponents)| {
            let own = rows.start + task * ROWS..rows.end.min(rows.start + (task + 1) * ROWS);
            let at = self.start[own.start] as usize;
            let (values, first) = matrix.load(own);
            let from = &values[(at - first) * size..][..to.len()];
            let blocks = to.chunks_exact_mut(size).zip(from.chunks_exact(size));
            for ((to, from), exponent) in blocks.zip(exponents) {
                *exponent = write(from, to);
            }
        });
    }

    /// Takes the row of a node from `matrix`, which has it.
    pub(super) fn copy_row(&mut self, node: usize, matrix: &BlockMatrix) {
        let size = self.b * self.b;
        let row = matrix.row(node);
        let from = &matrix.values[(row.start - matrix.skipped(node)) * size..];
        let to = &mut self.values[row.start * size..row.end * size];
        let blocks = to.chunks_exact_mut(size).zip(from.chunks_exact(size));
        for ((to, from), exponent) in blocks.zip(&mut self.exponent[row]) {
            *exponent = write(from, to);
        }
    }

    pub(super) fn nodes(&self) -> usize {
        self.start.len() - 1
    }

    /// Memory, but for the pattern, which K shares.
    pub(super) fn bytes(&self) -> usize {
        2 * self.values.len() + self.exponent.len()
    }
}

impl Blocks for ScaledBlocks {
    type Value = i16;

    fn size(&self) -> usize {
        self.b
    }

    fn start(&self) -> &[u32] {
        &self.start
    }

    fn column(&self) -> &[u32] {
        &self.column
    }

    fn values(&self) -> &[i16] {
        &self.values
    }

    #[inline(always)]
    fn scale(&self, at: usize) -> f32 {
        two_to(i32::from(self.exponent[at]))
    }

    fn scaled(&self) -> Option<&ScaledBlocks> {
        Some(self)
    }
}

/// `2^exponent`, of a normal number.
#[inline(always)]
pub fn two_to(exponent: i32) -> f32 {
    f32::from_bits(((exponent + BIAS) << SIGNIFICAND).cast_unsigned())
}

/// Writes a block, and returns its exponent.
pub fn write(from: &[f32], to: &mut [i16]) -> i8 {
    // Magnitudes have the order of their bits, and whole numbers are compared side by side.
    let bits = |value: f32| value.to_bits().cast_signed();
    let largest = from
        .iter()
        .fold(0, |most: i32, &value| most.max(bits(value.abs())));
    let of_largest = (largest >> SIGNIFICAND) - BIAS;
    // A block below the range becomes zero: the matrix is scaled to numbers about one.
    let exponent = (of_largest + 1 - BITS).clamp(1 - BIAS, BIAS - 1);
    let factor = two_to(-exponent);
    for (to, from) in to.iter_mut().zip(from) {
        // The sum has no digits for a fraction: it rounds, and its last digits are the number. Half
        // a unit above the largest number, this is taken.
        let value = bits(from * factor + WHOLE) - bits(WHOLE);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "no larger than the largest"
        )]
        let value = value.min(i32::from(i16::MAX)) as i16;
        *to = value;
    }
    #[expect(clippy::cast_possible_truncation, reason = "it is within the range")]
    let exponent = exponent as i8;
    exponent
}
