//! Dense kernels: the only file that names faer.
//!
//! All matrices are column-major slices. faer runs on one thread; the tiles are
//! ours, cut at fixed places, so that results have the same bits for any number
//! of threads.

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul as faer_matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, MatMut, MatRef, Par, Spec};
use rayon::prelude::*;

use crate::linalg::packed::{BLOCK, Packed};

/// Pivots factored at a time.
const PIVOTS: usize = 128;

/// Columns or rows of a tile: enough for faer's full rate, few enough that a
/// front of a thousand rows feeds two threads.
const TILE: usize = 512;

/// Products below this many multiplications are not worth sharing.
const SHARED: usize = 1 << 22;

/// Whether an operand is taken as it is or transposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// The matrix itself.
    Plain,
    /// Its transpose.
    Transposed,
}

/// `C = α op(A) op(B) + β C`, with `C` `m × n` and `op(A)` `m × k`.
///
/// With `beta = 0`, what `C` holds is not read, NaN included.
///
/// # Panics
/// If a slice has not the length its matrix needs.
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
    let a = match op_a {
        Op::Plain => MatRef::from_column_major_slice(a, m, k),
        Op::Transposed => MatRef::from_row_major_slice(a, m, k),
    };
    let b = match op_b {
        Op::Plain => MatRef::from_column_major_slice(b, k, n),
        Op::Transposed => MatRef::from_row_major_slice(b, k, n),
    };
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
        rayon::join(
            || tiles(first, at, depth, work),
            || tiles(second, next, depth, work),
        );
    }
}

/// Cholesky factor of a symmetric positive definite matrix, in place: the lower
/// triangle of `a` is read, and becomes `L`; the strict upper one is zeroed.
///
/// # Errors
/// The index of the first pivot that is not positive; `a` is then spoilt.
///
/// # Panics
/// If `a` has not `n²` entries.
pub fn cholesky(a: &mut [f64], n: usize) -> Result<(), usize> {
    assert_eq!(a.len(), n * n);
    mirror_lower(a, n);
    factor_panel(a, n, n, true, &mut |k, pivot| {
        if pivot > 0.0 { Ok(()) } else { Err(k) }
    })?;
    // The factor is in the upper triangle, as `Lᵀ`.
    transpose_in_place(a, n);
    for j in 1..n {
        a[j * n..j * n + j].fill(0.0);
    }
    Ok(())
}

/// The inverse `(L Lᵀ)⁻¹` into `out`, symmetric to the bit; only the lower
/// triangle of `l` is read.
///
/// # Panics
/// If `l` or `out` has not `n²` entries.
pub fn inverse_from_cholesky(l: &[f64], n: usize, out: &mut [f64]) {
    /// Columns solved together.
    const COLUMNS: usize = 256;
    assert_eq!(l.len(), n * n);
    assert_eq!(out.len(), n * n);
    if n == 0 {
        return;
    }
    out.par_chunks_mut(COLUMNS * n)
        .enumerate()
        .for_each(|(tile, columns)| {
            // Column j of L⁻¹ begins in row j, and of the inverse only the lower
            // triangle is asked for: rows above the tile never enter.
            let j = tile * COLUMNS;
            let width = columns.len() / n;
            columns.fill(0.0);
            for k in 0..width {
                columns[k * n + j + k] = 1.0;
            }
            let l = MatRef::from_column_major_slice(l, n, n).submatrix(j, j, n - j, n - j);
            let mut x = MatMut::from_column_major_slice_mut(columns, n, width)
                .split_at_row_mut(j)
                .1;
            solve_lower_triangular_in_place(l, x.as_mut(), Par::Seq);
            solve_upper_triangular_in_place(l.transpose(), x, Par::Seq);
        });
    mirror_lower(out, n);
}

/// `X ← L⁻¹ X` for `columns` right-hand sides of length `n`.
///
/// # Panics
/// If a slice has not the length its matrix needs.
pub fn solve_lower(l: &[f64], n: usize, x: &mut [f64], columns: usize) {
    solve(l, n, x, columns, |l, x| {
        solve_lower_triangular_in_place(l, x, Par::Seq);
    });
}

/// `X ← L⁻ᵀ X` for `columns` right-hand sides of length `n`.
///
/// # Panics
/// If a slice has not the length its matrix needs.
pub fn solve_lower_transpose(l: &[f64], n: usize, x: &mut [f64], columns: usize) {
    solve(l, n, x, columns, |l, x| {
        solve_upper_triangular_in_place(l.transpose(), x, Par::Seq);
    });
}

fn solve(
    l: &[f64],
    n: usize,
    x: &mut [f64],
    columns: usize,
    work: impl Fn(MatRef<'_, f64>, MatMut<'_, f64>) + Sync,
) {
    /// Right-hand sides that a thread takes together.
    const COLUMNS: usize = 64;
    assert_eq!(l.len(), n * n);
    assert_eq!(x.len(), n * columns);
    if n == 0 {
        return;
    }
    let l = MatRef::from_column_major_slice(l, n, n);
    x.par_chunks_mut(COLUMNS * n).for_each(|x| {
        let width = x.len() / n;
        work(l, MatMut::from_column_major_slice_mut(x, n, width));
    });
}

/// Eigenvalues, ascending, and eigenvectors, by columns, of a symmetric matrix
/// of which the lower triangle is read; the vectors replace `a`.
///
/// # Panics
/// If a slice has not the length its matrix needs, or an entry is not finite.
pub fn symmetric_eigen(a: &mut [f64], n: usize, values: &mut [f64]) {
    assert_eq!(a.len(), n * n);
    assert_eq!(values.len(), n);
    if n == 0 {
        return;
    }
    let matrix = a.to_vec();
    let scratch =
        self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Spec::default());
    self_adjoint_evd(
        MatRef::from_column_major_slice(&matrix, n, n),
        DiagMut::from_slice_mut(values),
        Some(MatMut::from_column_major_slice_mut(a, n, n)),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Spec::default(),
    )
    .expect("eigenvalues of a finite symmetric matrix");
}

/// Copies the lower triangle over the upper one.
pub(crate) fn mirror_lower(a: &mut [f64], n: usize) {
    blocks(n, |i, j| a[i * n + j] = a[j * n + i]);
}

/// Copies the upper triangle over the lower one.
pub(crate) fn mirror_upper(a: &mut [f64], n: usize) {
    blocks(n, |i, j| a[j * n + i] = a[i * n + j]);
}

fn transpose_in_place(a: &mut [f64], n: usize) {
    blocks(n, |i, j| a.swap(i * n + j, j * n + i));
}

/// Visits all `(i, j)`, `i > j`, in blocks that fit the nearest cache: along
/// whole rows, each step of `n` numbers would miss it.
fn blocks(n: usize, mut visit: impl FnMut(usize, usize)) {
    const SIDE: usize = 32;
    for j0 in (0..n).step_by(SIDE) {
        for i0 in (j0..n).step_by(SIDE) {
            for j in j0..n.min(j0 + SIDE) {
                for i in i0.max(j + 1)..n.min(i0 + SIDE) {
                    visit(i, j);
                }
            }
        }
    }
}

/// Partial Cholesky of a front: `panel` holds its first `np` rows, `np × nf`,
/// by columns, upper triangle; it becomes `U = Lᵀ`.
///
/// Fronts are stored upper so that updates read `Uᵀ U`, both factors along
/// contiguous columns; with `L Lᵀ` the product packs one of them across pages
/// and loses up to half its rate. `check(k, pivot)` sees each pivot in order,
/// before its root is taken.
///
/// # Errors
/// What `check` returns; it must refuse pivots that are not positive.
pub(crate) fn factor_panel<E: Send>(
    panel: &mut [f64],
    np: usize,
    nf: usize,
    shared: bool,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    debug_assert_eq!(panel.len(), np * nf);
    let size = np.min(PIVOTS);
    let mut block = vec![0.0; size * size];
    let mut memory = MemBuffer::new(cholesky_in_place_scratch::<f64>(
        size,
        Par::Seq,
        Spec::default(),
    ));
    for k in (0..np).step_by(PIVOTS) {
        let b = PIVOTS.min(np - k);
        let (head, tail) = panel.split_at_mut(np * (k + b));
        let own = &mut head[np * k..];
        if k > 0 {
            let (above, diagonal) =
                MatMut::from_column_major_slice_mut(own, np, b).split_at_row_mut(k);
            triangular::matmul(
                diagonal.split_at_row_mut(b).0,
                BlockStructure::TriangularUpper,
                Accum::Add,
                above.as_ref().transpose(),
                BlockStructure::Rectangular,
                above.as_ref(),
                BlockStructure::Rectangular,
                -1.0,
                Par::Seq,
            );
        }
        // faer's Cholesky is scalar on a transposed view: factor a copy.
        let lower = &mut block[..b * b];
        for i in 0..b {
            for j in 0..=i {
                lower[j * b + i] = own[i * np + k + j];
            }
        }
        let factored = cholesky_in_place(
            MatMut::from_column_major_slice_mut(lower, b, b),
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Spec::default(),
        );
        if factored.is_err() {
            // Once more, slowly, to see the pivots.
            for i in 0..b {
                for j in 0..=i {
                    lower[j * b + i] = own[i * np + k + j];
                }
            }
            pivots_one_by_one(lower, b, &mut |i, pivot| check(k + i, pivot))?;
            check(k + b - 1, 0.0)?;
        }
        for i in 0..b {
            check(k + i, lower[i * b + i] * lower[i * b + i])?;
            for j in 0..=i {
                own[i * np + k + j] = lower[j * b + i];
            }
        }
        let lower = MatRef::from_column_major_slice(lower, b, b);
        let above = MatRef::from_column_major_slice(own, np, b)
            .split_at_row(k)
            .0;
        let work = |columns: &mut [f64]| {
            let width = columns.len() / np;
            let columns = MatMut::from_column_major_slice_mut(columns, np, width);
            let (done, rest) = columns.split_at_row_mut(k);
            let mut rows = rest.split_at_row_mut(b).0;
            if k > 0 {
                let (left, right) = (above.transpose(), done.as_ref());
                faer_matmul(rows.as_mut(), Accum::Add, left, right, -1.0, Par::Seq);
            }
            solve_lower_triangular_in_place(lower, rows, Par::Seq);
        };
        if shared {
            tail.par_chunks_mut(np * TILE).for_each(work);
        } else {
            tail.chunks_mut(np * TILE).for_each(work);
        }
    }
    Ok(())
}

/// Plain Cholesky of a lower triangle that stops where `check` does.
fn pivots_one_by_one<E>(
    a: &mut [f64],
    n: usize,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    for k in 0..n {
        check(k, a[k * n + k])?;
        let root = a[k * n + k].sqrt();
        for i in k..n {
            a[k * n + i] /= root;
        }
        for j in k + 1..n {
            for i in j..n {
                a[j * n + i] -= a[k * n + i] * a[k * n + j];
            }
        }
    }
    Ok(())
}

/// The update `−U₁₂ᵀ U₁₂` of a factored panel; what `update` holds is not read.
pub(crate) fn rank_update(
    panel: &[f64],
    np: usize,
    update: &mut [f64],
    layout: Packed,
    shared: bool,
) {
    let u = MatRef::from_column_major_slice(&panel[panel.len() - np * layout.n..], np, layout.n);
    let mut blocks = Vec::with_capacity(layout.n.div_ceil(BLOCK));
    let mut rest = update;
    for j in (0..layout.n).step_by(BLOCK) {
        let width = BLOCK.min(layout.n - j);
        let (block, next) = rest.split_at_mut(width * (j + width));
        blocks.push((j, width, block));
        rest = next;
    }
    let work = |(j, width, block): (usize, usize, &mut [f64])| {
        let block = MatMut::from_column_major_slice_mut(block, j + width, width);
        let (above, diagonal) = block.split_at_row_mut(j);
        let right = u.submatrix(0, j, np, width);
        if j > 0 {
            let left = u.submatrix(0, 0, np, j).transpose();
            faer_matmul(above, Accum::Replace, left, right, -1.0, Par::Seq);
        }
        triangular::matmul(
            diagonal,
            BlockStructure::TriangularUpper,
            Accum::Replace,
            right.transpose(),
            BlockStructure::Rectangular,
            right,
            BlockStructure::Rectangular,
            -1.0,
            Par::Seq,
        );
    };
    if shared {
        blocks.into_par_iter().rev().for_each(work);
    } else {
        blocks.into_iter().for_each(work);
    }
}

/// `X₁ ← U₁₁⁻ᵀ X₁`, `X₂ ← X₂ − U₁₂ᵀ X₁` for a front gathered into `x`, `nf`
/// rows and `columns` columns.
pub(crate) fn forward(panel: &[f64], np: usize, nf: usize, x: &mut [f64], columns: usize) {
    if columns == 1 {
        // Each entry of the factor is read once: products of columns, at the
        // rate of memory.
        let (first, second) = x.split_at_mut(np);
        for j in 0..np {
            let column = &panel[j * np..][..=j];
            first[j] = (first[j] - dot(&column[..j], &first[..j])) / column[j];
        }
        for (x, column) in second.iter_mut().zip(panel[np * np..].chunks_exact(np)) {
            *x -= dot(column, first);
        }
        return;
    }
    let u = MatRef::from_column_major_slice(panel, np, nf);
    let x = MatMut::from_column_major_slice_mut(x, nf, columns);
    let (mut first, second) = x.split_at_row_mut(np);
    let (u11, u12) = u.split_at_col(np);
    solve_lower_triangular_in_place(u11.transpose(), first.as_mut(), Par::Seq);
    faer_matmul(
        second,
        Accum::Add,
        u12.transpose(),
        first.as_ref(),
        -1.0,
        Par::Seq,
    );
}

/// `X₁ ← U₁₁⁻¹ (X₁ − U₁₂ X₂)`, the way back of [`forward`].
pub(crate) fn backward(panel: &[f64], np: usize, nf: usize, x: &mut [f64], columns: usize) {
    if columns == 1 {
        let (first, second) = x.split_at_mut(np);
        for (x, column) in second.iter().zip(panel[np * np..].chunks_exact(np)) {
            first.iter_mut().zip(column).for_each(|(f, u)| *f -= u * x);
        }
        for j in (0..np).rev() {
            let column = &panel[j * np..][..=j];
            let x = first[j] / column[j];
            first[j] = x;
            first[..j]
                .iter_mut()
                .zip(column)
                .for_each(|(f, u)| *f -= u * x);
        }
        return;
    }
    let u = MatRef::from_column_major_slice(panel, np, nf);
    let x = MatMut::from_column_major_slice_mut(x, nf, columns);
    let (mut first, second) = x.split_at_row_mut(np);
    let (u11, u12) = u.split_at_col(np);
    faer_matmul(
        first.as_mut(),
        Accum::Add,
        u12,
        second.as_ref(),
        -1.0,
        Par::Seq,
    );
    solve_upper_triangular_in_place(u11, first, Par::Seq);
}

/// `a · b` in eight partial sums, which the compiler keeps in vectors.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a_tail, b_tail) = (a.chunks_exact(8).remainder(), b.chunks_exact(8).remainder());
    for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let tail: f64 = a_tail.iter().zip(b_tail).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + tail
}
