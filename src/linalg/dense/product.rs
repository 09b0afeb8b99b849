//! Products of whole matrices.

use faer::{Accum, MatMut, MatRef, Par};

use crate::linalg::dense::kernels::faer_matmul;
use crate::tasks::join;

/// Columns or rows of a tile: enough for faer's full rate, and few enough for two threads at a
/// front of a thousand rows.
pub(super) const TILE: usize = 512;

/// With fewer multiplications, a product uses one thread.
const SHARED: usize = 1 << 22;

/// Whether an operand is transposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// The matrix itself.
    Plain,
    /// Its transpose.
    Transposed,
}

/// `C = α op(A) op(B) + β C`, with `C` `m × n` and `op(A)` `m × k`.
///
/// With `beta = 0`, `C` is not read, even if it contains NaN.
#[expect(
    clippy::too_many_arguments,
    clippy::many_single_char_names,
    reason = "the arguments of GEMM"
)]
pub fn matmul(
    c: &mut [f64],
    (m, n, k): (usize, usize, usize),
    alpha: f64,
    a: &[f64],
    op_a: Op,
    b: &[f64],
    op_b: Op,
    beta: f64,
) {
    let (a, b) = (operand(a, op_a, m, k), operand(b, op_b, k, n));
    let add = if beta == 0.0 {
        Accum::Replace
    } else {
        Accum::Add
    };
    if add == Accum::Add && beta.to_bits() != 1.0_f64.to_bits() {
        for c in c.iter_mut() {
            *c *= beta;
        }
    }
    let c = MatMut::from_column_major_slice_mut(c, m, n);
    tiles(c, (0, 0), k, &|(i, j), c: MatMut<'_, f64>| {
        let a = a.submatrix(i, 0, c.nrows(), k);
        let b = b.submatrix(0, j, k, c.ncols());
        faer_matmul(c, add, a, b, alpha, Par::Seq);
    });
}

fn operand(values: &[f64], op: Op, rows: usize, columns: usize) -> MatRef<'_, f64> {
    match op {
        Op::Plain => MatRef::from_column_major_slice(values, rows, columns),
        Op::Transposed => MatRef::from_row_major_slice(values, rows, columns),
    }
}

/// Cuts `c` into tiles at multiples of [`TILE`] and works on them in parallel.
fn tiles(
    c: MatMut<'_, f64>,
    at: (usize, usize),
    depth: usize,
    work: &(impl Fn((usize, usize), MatMut<'_, f64>) + Sync),
) {
    let (m, n) = (c.nrows(), c.ncols());
    if m.max(n) <= TILE {
        work(at, c);
        return;
    }
    let half = |size: usize| size.div_ceil(TILE).div_ceil(2) * TILE;
    let ((first, second), next) = if n >= m {
        (c.split_at_col_mut(half(n)), (at.0, at.1 + half(n)))
    } else {
        (c.split_at_row_mut(half(m)), (at.0 + half(m), at.1))
    };
    if m * n * depth < SHARED {
        tiles(first, at, depth, work);
        tiles(second, next, depth, work);
    } else {
        join(
            || tiles(first, at, depth, work),
            || tiles(second, next, depth, work),
        );
    }
}
