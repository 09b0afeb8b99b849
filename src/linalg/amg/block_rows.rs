//! Products by rows of blocks, alone or fused with what follows them: a matrix is read from
//! memory once for each step.

use std::ops::Range;

use crate::linalg::amg::avx2;
use crate::linalg::amg::avx512;
use crate::linalg::amg::block_matrix::{BlockMatrix, PADDING, ROWS};
use crate::linalg::amg::scaled_blocks::ScaledBlocks;
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::real::Real as _;
use crate::tasks;

/// A matrix in blocks, in the form in which it is stored.
pub(super) trait Blocks: Sync {
    /// A number in memory; `scale` times it is the entry.
    type Value: Copy + Into<f32> + Sync;

    /// Unknowns of a node.
    fn size(&self) -> usize;
    /// Start of each row in `column`.
    fn start(&self) -> &[u32];
    fn column(&self) -> &[u32];
    /// Each block by columns, then as many numbers as a register has.
    fn values(&self) -> &[Self::Value];
    /// The factor of a block.
    fn scale(&self, at: usize) -> f32;

    /// Itself, if its numbers have sixteen bits.
    fn scaled(&self) -> Option<&ScaledBlocks> {
        None
    }

    /// The blocks of a row.
    #[inline(always)]
    fn row(&self, node: usize) -> Range<usize> {
        self.start()[node] as usize..self.start()[node + 1] as usize
    }
}

impl Blocks for BlockMatrix {
    type Value = f32;

    fn size(&self) -> usize {
        self.b
    }

    fn start(&self) -> &[u32] {
        &self.start
    }

    fn column(&self) -> &[u32] {
        &self.column
    }

    fn values(&self) -> &[f32] {
        &self.values
    }

    #[inline(always)]
    fn scale(&self, _: usize) -> f32 {
        1.0
    }
}

/// What becomes of the product `A x` in the rows of one task.
trait Finish: Send {
    /// `product` is row `i` of `A x`; `k` is its number in the task.
    fn finish<const FMA: bool>(&mut self, i: usize, k: usize, product: &[f32]);
}

struct KernelRows<'a, A, F, const B: usize, const L: usize> {
    matrix: &'a A,
    nodes: Range<usize>,
    x: &'a [f32],
    then: F,
}

impl<A: Blocks, F: Finish, const B: usize, const L: usize> WideWork for KernelRows<'_, A, F, B, L> {
    #[inline(always)]
    fn run<const FMA: bool>(mut self) {
        let matrix = self.matrix;
        for (k, i) in self.nodes.enumerate() {
            let row = matrix.row(i);
            // Two sums for each column, of every other block, in registers: one would wait for each
            // addition. Lanes after B are not used.
            let mut sums = [[[0.0_f32; L]; B]; 2];
            let values = &matrix.values()[row.start * B * B..];
            let columns = &matrix.column()[row.clone()];
            for (n, (&j, at)) in columns.iter().zip(row).enumerate() {
                let block = &values[n * B * B..][..B * B + L - B];
                let x = &self.x[j as usize * B..][..B];
                if n % 2 == 0 {
                    add::<A, FMA, B, L>(block, x, matrix.scale(at), &mut sums[0]);
                } else {
                    add::<A, FMA, B, L>(block, x, matrix.scale(at), &mut sums[1]);
                }
            }
            let mut sum = [0.0; L];
            for (even, odd) in sums[0].iter().zip(&sums[1]) {
                for l in 0..L {
                    sum[l] += even[l] + odd[l];
                }
            }
            self.then.finish::<FMA>(i, k, &sum[..B]);
        }
    }
}

/// Adds the products of the columns of a block.
#[inline(always)]
fn add<A: Blocks, const FMA: bool, const B: usize, const L: usize>(
    block: &[A::Value],
    x: &[f32],
    scale: f32,
    sums: &mut [[f32; L]; B],
) {
    for c in 0..B {
        let x = x[c] * scale;
        for l in 0..L {
            let value: f32 = block[c * B + l].into();
            sums[c][l] = value.times_plus::<FMA>(x, sums[c][l]);
        }
    }
}

/// Calls the kernel of the size of the blocks.
fn run<A: Blocks>(matrix: &A, x: &[f32], nodes: Range<usize>, then: impl Finish) {
    match matrix.size() {
        2 => run_of::<A, 2, 4, 1>(matrix, x, nodes, then),
        3 => run_of::<A, 3, 4, 1>(matrix, x, nodes, then),
        6 => run_of::<A, 6, 8, 3>(matrix, x, nodes, then),
        _ => unreachable!("blocks of 2, 3 or 6"),
    }
}

/// A column of a block fills `L` lanes, a block `R` registers of AVX-512.
fn run_of<A: Blocks, const B: usize, const L: usize, const R: usize>(
    matrix: &A,
    x: &[f32],
    nodes: Range<usize>,
    mut then: impl Finish,
) {
    let first = nodes.start;
    if let Some(scaled) = matrix.scaled() {
        let finish = |i, product: &[f32; B]| then.finish::<true>(i, i - first, product);
        if avx512::rows::<B, R>(scaled, x, nodes.clone(), finish) {
            return;
        }
        let finish = |i, product: &[f32; B]| then.finish::<true>(i, i - first, product);
        if avx2::rows(scaled, x, nodes.clone(), finish) {
            return;
        }
    }
    widest(KernelRows::<_, _, B, L> {
        matrix,
        nodes,
        x,
        then,
    });
}

/// The product with a matrix in sixteen bits by the portable loop, then by the registers of AVX-512
/// and of AVX2 if this processor has them. All have the same bits.
///
/// Row `i` has the blocks `start[i]..start[i + 1]` of `b` unknowns, each by columns.
pub fn products_in_registers(
    b: usize,
    start: Vec<u32>,
    column: Vec<u32>,
    mut values: Vec<f32>,
    x: &[f32],
) -> Vec<Vec<f32>> {
    values.resize(values.len() + PADDING, 0.0);
    let matrix = ScaledBlocks::replace(BlockMatrix {
        b,
        start: start.into(),
        column: column.into(),
        values,
        missing: Vec::new(),
        held: Vec::new(),
        exponent: 0,
    });
    match b {
        2 => products_of::<2, 4, 1>(&matrix, x),
        3 => products_of::<3, 4, 1>(&matrix, x),
        6 => products_of::<6, 8, 3>(&matrix, x),
        _ => unreachable!("blocks of 2, 3 or 6"),
    }
}

fn products_of<const B: usize, const L: usize, const R: usize>(
    matrix: &ScaledBlocks,
    x: &[f32],
) -> Vec<Vec<f32>> {
    let nodes = 0..matrix.nodes();
    let mut products = vec![vec![0.0; x.len()]];
    widest(KernelRows::<_, _, B, L> {
        matrix,
        nodes: nodes.clone(),
        x,
        then: Store {
            y: &mut products[0],
        },
    });
    let mut y = vec![0.0; x.len()];
    let store = |i: usize, product: &[f32; B]| y[B * i..][..B].copy_from_slice(product);
    if avx512::rows::<B, R>(matrix, x, nodes.clone(), store) {
        products.push(y);
    }
    let mut y = vec![0.0; x.len()];
    let store = |i: usize, product: &[f32; B]| y[B * i..][..B].copy_from_slice(product);
    if avx2::rows(matrix, x, nodes, store) {
        products.push(y);
    }
    products
}

struct Store<'a> {
    y: &'a mut [f32],
}

impl Finish for Store<'_> {
    #[inline(always)]
    fn finish<const FMA: bool>(&mut self, _: usize, k: usize, product: &[f32]) {
        self.y[k * product.len()..][..product.len()].copy_from_slice(product);
    }
}

impl BlockMatrix {
    /// `y = A x`, for vectors of `b` entries for each node, in units of `2^`[`Self::exponent`].
    pub fn product(&self, x: &[f32], y: &mut [f32]) {
        assert_eq!(x.len(), self.b * self.nodes());
        assert_eq!(y.len(), x.len());
        tasks::for_each(y.chunks_mut(ROWS * self.b), |task, y| {
            let rows = task * ROWS..task * ROWS + y.len() / self.b;
            run(self, x, rows, Store { y });
        });
    }
}

struct Subtract<'a> {
    b: &'a [f32],
    y: &'a mut [f32],
}

impl Finish for Subtract<'_> {
    #[inline(always)]
    fn finish<const FMA: bool>(&mut self, _: usize, k: usize, product: &[f32]) {
        let n = product.len();
        let (b, y) = (&self.b[k * n..][..n], &mut self.y[k * n..][..n]);
        for l in 0..n {
            y[l] = b[l] - product[l];
        }
    }
}

/// `y = b − A x`.
pub(super) fn residual(matrix: &impl Blocks, x: &[f32], b: &[f32], y: &mut [f32]) {
    let size = ROWS * matrix.size();
    let parts = y.chunks_mut(size).zip(b.chunks(size));
    tasks::for_each(parts, |task, (y, b)| {
        let rows = task * ROWS..task * ROWS + y.len() / matrix.size();
        run(matrix, x, rows, Subtract { b, y });
    });
}

/// The numbers of one step of a Chebyshev iteration, see [`step`].
#[derive(Clone, Copy, Debug)]
pub(super) struct StepCoefficients {
    pub(super) direction: f32,
    pub(super) residual: f32,
    pub(super) update: f32,
}

struct SmootherStep<'a> {
    inverse: &'a [f32],
    b: &'a [f32],
    x: &'a [f32],
    d: &'a mut [f32],
    y: &'a mut [f32],
    with: StepCoefficients,
}

impl Finish for SmootherStep<'_> {
    #[inline(always)]
    fn finish<const FMA: bool>(&mut self, i: usize, k: usize, product: &[f32]) {
        let n = product.len();
        let inverse = &self.inverse[k * n * n..][..n * n];
        let (b, x) = (&self.b[k * n..][..n], &self.x[i * n..][..n]);
        let (d, y) = (&mut self.d[k * n..][..n], &mut self.y[k * n..][..n]);
        let mut z = [0.0; 8];
        for c in 0..n {
            let r = b[c] - product[c];
            for l in 0..n {
                z[l] = inverse[c * n + l].times_plus::<FMA>(r, z[l]);
            }
        }
        for l in 0..n {
            d[l] = self.with.direction * d[l] + self.with.residual * z[l];
            y[l] = x[l] + self.with.update * d[l];
        }
    }
}

/// `d ← c₁ d + c₂ D⁻¹ (b − A x)`, `y = x + c₃ d`.
pub(super) fn step(
    matrix: &impl Blocks,
    inverse: &[f32],
    x: &[f32],
    b: &[f32],
    d: &mut [f32],
    y: &mut [f32],
    with: StepCoefficients,
) {
    let size = ROWS * matrix.size();
    let changed = y.chunks_mut(size).zip(d.chunks_mut(size));
    let read = b.chunks(size).zip(inverse.chunks(size * matrix.size()));
    tasks::for_each(changed.zip(read), |task, ((y, d), (b, inverse))| {
        let rows = task * ROWS..task * ROWS + y.len() / matrix.size();
        let then = SmootherStep {
            inverse,
            b,
            x,
            d,
            y,
            with,
        };
        run(matrix, x, rows, then);
    });
}

struct FirstStep<'a, const B: usize> {
    inverse: &'a [f32],
    b: &'a [f32],
    d: &'a mut [f32],
    y: &'a mut [f32],
    with: StepCoefficients,
}

impl<const B: usize> WideWork for FirstStep<'_, B> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let rows = self.d.chunks_exact_mut(B).zip(self.y.chunks_exact_mut(B));
        let given = self.b.chunks_exact(B).zip(self.inverse.chunks_exact(B * B));
        for ((d, y), (b, inverse)) in rows.zip(given) {
            let mut z = [0.0; B];
            for c in 0..B {
                for l in 0..B {
                    z[l] = inverse[c * B + l].times_plus::<FMA>(b[c], z[l]);
                }
            }
            for l in 0..B {
                d[l] = self.with.residual * z[l];
                y[l] = self.with.update * d[l];
            }
        }
    }
}

/// As [`step`], from `x = 0`, `d = 0`.
pub(super) fn first_step(
    size: usize,
    inverse: &[f32],
    b: &[f32],
    d: &mut [f32],
    y: &mut [f32],
    with: StepCoefficients,
) {
    let rows = ROWS * size;
    let changed = y.chunks_mut(rows).zip(d.chunks_mut(rows));
    let read = b.chunks(rows).zip(inverse.chunks(rows * size));
    tasks::for_each(changed.zip(read), |_, ((y, d), (b, inverse))| match size {
        2 => widest(FirstStep::<2> {
            inverse,
            b,
            d,
            y,
            with,
        }),
        3 => widest(FirstStep::<3> {
            inverse,
            b,
            d,
            y,
            with,
        }),
        _ => widest(FirstStep::<6> {
            inverse,
            b,
            d,
            y,
            with,
        }),
    });
}
