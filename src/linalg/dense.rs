//! Dense kernels: the only file that names faer.
//!
//! All matrices are column-major slices. faer runs on one thread; the tiles are
//! ours, cut at fixed places, so that results have the same bits for any number
//! of threads.

use std::sync::atomic::{AtomicBool, Ordering};

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::lu::partial_pivoting::factor as lu;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::{matmul as product, triangular_solve};
use faer::prelude::{IntoConst, Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par, Spec};
use rayon::prelude::*;

use crate::error::Error;
use crate::linalg::packed::{BLOCK, PIVOTS, Panel};
use crate::linalg::small::dot_long;

/// Columns or rows of a tile: enough for faer's full rate, few enough that a
/// front of a thousand rows feeds two threads.
const TILE: usize = 512;

/// Products below this many multiplications are not worth sharing.
const SHARED: usize = 1 << 22;

/// Leaves the wide registers as narrow code wants them. faer's kernels do not: code of
/// ours that the same thread runs after them would be up to fifteen times slower, for
/// each of its instructions waits for the upper halves.
fn leave_wide() {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx") {
        // SAFETY: the processor has the instruction, and no value of ours lives in
        // the upper halves that it clears.
        unsafe { std::arch::x86_64::_mm256_zeroupper() }
    }
}

fn faer_matmul(
    c: MatMut<'_, f64>,
    add: Accum,
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
    alpha: f64,
    par: Par,
) {
    product::matmul(c, add, a, b, alpha, par);
    leave_wide();
}

#[expect(clippy::too_many_arguments, reason = "faer's")]
fn triangular_matmul(
    c: MatMut<'_, f64>,
    of_c: BlockStructure,
    add: Accum,
    a: MatRef<'_, f64>,
    of_a: BlockStructure,
    b: MatRef<'_, f64>,
    of_b: BlockStructure,
    alpha: f64,
    par: Par,
) {
    triangular::matmul(c, of_c, add, a, of_a, b, of_b, alpha, par);
    leave_wide();
}

/// faer's triangular solves of these names.
macro_rules! solves {
    ($($name:ident)+) => {$(
        fn $name(triangle: MatRef<'_, f64>, x: MatMut<'_, f64>, par: Par) {
            triangular_solve::$name(triangle, x, par);
            leave_wide();
        }
    )+};
}

solves! {
    solve_lower_triangular_in_place
    solve_upper_triangular_in_place
    solve_unit_lower_triangular_in_place
    solve_unit_upper_triangular_in_place
}

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
        rayon::join(
            || tiles(first, at, depth, work),
            || tiles(second, next, depth, work),
        );
    }
}

/// Cholesky factor of a symmetric positive definite matrix, in place: the lower
/// triangle of `a` is read, and becomes `L`; the strict upper one is zeroed.
///
/// Returns the index of the first pivot that is not positive, if there is one;
/// `a` is then spoilt.
///
/// # Errors
/// [`Error::Interrupted`] when `stop` is raised.
///
/// # Panics
/// If `a` has not `n²` entries.
pub fn cholesky(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<Option<usize>, Error> {
    /// Columns between two updates of the rest: these pass through memory, the
    /// panel stays in the cache.
    const WIDE: usize = 384;
    assert_eq!(a.len(), n * n);
    let mut panel = vec![0.0; n.min(WIDE) * n];
    for j in (0..n).step_by(WIDE) {
        let b = WIDE.min(n - j);
        let layout = Panel::new(b, n - j);
        let panel = &mut panel[..layout.len()];
        // Columns of the lower triangle are rows of the upper one, of which
        // fronts are made.
        let (own, later) = a[j * n..].split_at_mut(b * n);
        let own = MatMut::from_column_major_slice_mut(own, n, b);
        let mut own = own.split_at_row_mut(j).1;
        for (rows, range) in layout.blocks() {
            let block = own
                .rb()
                .submatrix(rows.start, rows.start, n - j - rows.start, rows.len());
            let (height, width) = (rows.len(), n - j - rows.start);
            let to = MatMut::from_column_major_slice_mut(&mut panel[range], height, width);
            transpose_into(block, to);
        }
        let factored = factor_panel(panel, layout, true, &mut |k, pivot| {
            if stop.load(Ordering::Relaxed) {
                Err(None)
            } else if pivot > 0.0 {
                Ok(())
            } else {
                Err(Some(j + k))
            }
        });
        match factored {
            Err(Some(k)) => return Ok(Some(k)),
            Err(None) => return Err(Error::Interrupted),
            Ok(()) => {}
        }
        for (rows, range) in layout.blocks() {
            let (row, width) = (rows.start, rows.len());
            let block = own.rb_mut().submatrix_mut(row, row, n - j - row, width);
            let from = MatRef::from_column_major_slice(&panel[range], width, n - j - row);
            transpose_into(from, block);
        }
        subtract_product(later, n, panel, layout);
    }
    for (r, column) in a.chunks_exact_mut(n.max(1)).enumerate() {
        column[..r].fill(0.0);
    }
    Ok(None)
}

/// Subtracts `U₁₂ᵀ U₁₂` of a factored panel from the lower triangle of the
/// last columns of a matrix of order `n`.
fn subtract_product(columns: &mut [f64], n: usize, panel: &[f64], layout: Panel) {
    let count = columns.len() / n;
    let blocks = blocks_from(panel, layout, layout.np);
    columns
        .par_chunks_mut(BLOCK * n)
        .enumerate()
        .for_each(|(tile, columns)| {
            let (from, width) = (tile * BLOCK, columns.len() / n);
            let columns = MatMut::from_column_major_slice_mut(columns, n, width);
            let (mut square, mut below) = columns
                .split_at_row_mut(n - count + from)
                .1
                .split_at_row_mut(width);
            for u in &blocks {
                let u = u.subcols(from, width);
                triangular_matmul(
                    square.rb_mut(),
                    BlockStructure::TriangularLower,
                    Accum::Add,
                    u.transpose(),
                    BlockStructure::Rectangular,
                    u,
                    BlockStructure::Rectangular,
                    -1.0,
                    Par::Seq,
                );
            }
            let rows = below.nrows();
            for i in (0..rows).step_by(TILE) {
                let height = TILE.min(rows - i);
                for u in &blocks {
                    let left = u.subcols(from + width + i, height).transpose();
                    let right = u.subcols(from, width);
                    let tile = below.rb_mut().subrows_mut(i, height);
                    faer_matmul(tile, Accum::Add, left, right, -1.0, Par::Seq);
                }
            }
        });
}

/// The inverse `(L Lᵀ)⁻¹` in the place of `L`, symmetric to the bit; only the
/// lower triangle is read. No second matrix is needed.
///
/// # Errors
/// [`Error::Interrupted`] when `stop` is raised; `a` is then spoilt.
///
/// # Panics
/// If `a` has not `n²` entries.
pub fn invert_from_cholesky(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<(), Error> {
    assert_eq!(a.len(), n * n);
    invert_lower(a, n, stop)?;
    product_of_inverses(a, n, stop)?;
    mirror_lower(a, n);
    Ok(())
}

/// `M = L⁻¹` in the place of `L`, the first rows first: of a block of rows
/// `[L₂₁ L₂₂]`, with `M₁₁` known, `M₂₁ = −L₂₂⁻¹ L₂₁ M₁₁`.
fn invert_lower(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<(), Error> {
    let mut turned = vec![0.0; n * n.min(PIVOTS)];
    let mut inverse = vec![0.0; n.min(PIVOTS).pow(2)];
    for i in (0..n).step_by(PIVOTS) {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let b = PIVOTS.min(n - i);
        let whole = MatMut::from_column_major_slice_mut(a, n, n);
        let (known, own) = whole.subcols_mut(0, i + b).split_at_row_mut(i);
        let known = known.into_const();
        let (mut left, mut square) = own.subrows_mut(0, b).split_at_col_mut(i);
        let diagonal = square.rb();
        strips(
            left.rb_mut().transpose_mut(),
            0,
            &|_, c: MatMut<'_, f64>| {
                solve_lower_triangular_in_place(diagonal, c.transpose_mut(), Par::Seq);
            },
        );
        let turned = &mut turned[..i * b];
        transpose_into(left.rb(), MatMut::from_column_major_slice_mut(turned, i, b));
        let lhs = MatRef::from_column_major_slice(turned, i, b).transpose();
        // Strips of columns, which are strips of rows of the transpose.
        strips(left.transpose_mut(), 0, &|j, c: MatMut<'_, f64>| {
            let mut c = c.transpose_mut();
            let width = c.ncols();
            triangular_matmul(
                c.rb_mut(),
                BlockStructure::Rectangular,
                Accum::Replace,
                lhs.subcols(j, width),
                BlockStructure::Rectangular,
                known.submatrix(j, j, width, width),
                BlockStructure::TriangularLower,
                -1.0,
                Par::Seq,
            );
            let rest = j + width;
            let right = known.submatrix(rest, j, i - rest, width);
            faer_matmul(
                c,
                Accum::Add,
                lhs.subcols(rest, i - rest),
                right,
                -1.0,
                Par::Seq,
            );
        });
        let inverse = &mut inverse[..b * b];
        inverse.fill(0.0);
        inverse.iter_mut().step_by(b + 1).for_each(|one| *one = 1.0);
        let mut x = MatMut::from_column_major_slice_mut(inverse, b, b);
        solve_lower_triangular_in_place(square.rb(), x.rb_mut(), Par::Seq);
        for c in 0..b {
            for r in c..b {
                square[(r, c)] = x[(r, c)];
            }
        }
    }
    Ok(())
}

/// The lower triangle of `Mᵀ M` in the place of a lower triangle `M`, the first
/// rows first: a block of rows of the product reads only itself and what is
/// below it.
fn product_of_inverses(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<(), Error> {
    let mut corner = vec![0.0; n.min(PIVOTS).pow(2)];
    for i in (0..n).step_by(PIVOTS) {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let b = PIVOTS.min(n - i);
        let whole = MatMut::from_column_major_slice_mut(a, n, n);
        let (own, below) = whole
            .subcols_mut(0, i + b)
            .split_at_row_mut(i)
            .1
            .split_at_row_mut(b);
        let below = below.into_const();
        let (left, mut square) = own.split_at_col_mut(i);
        for c in 0..b {
            for r in 0..b {
                corner[c * b + r] = if r < c { 0.0 } else { square[(r, c)] };
            }
        }
        let corner = MatRef::from_column_major_slice(&corner[..b * b], b, b);
        let mine = below.subcols(i, b).transpose();
        let rest = || {
            // Strips of columns, which are strips of rows of the transpose.
            strips(left.transpose_mut(), 0, &|j, c: MatMut<'_, f64>| {
                let mut c = c.transpose_mut();
                let width = c.ncols();
                let mut old = vec![0.0; b * width];
                for (k, column) in old.chunks_exact_mut(b).enumerate() {
                    for (r, value) in column.iter_mut().enumerate() {
                        *value = c[(r, k)];
                    }
                }
                triangular_matmul(
                    c.rb_mut(),
                    BlockStructure::Rectangular,
                    Accum::Replace,
                    corner.transpose(),
                    BlockStructure::TriangularUpper,
                    MatRef::from_column_major_slice(&old, b, width),
                    BlockStructure::Rectangular,
                    1.0,
                    Par::Seq,
                );
                let right = below.subcols(j, width);
                faer_matmul(c, Accum::Add, mine, right, 1.0, Par::Seq);
            });
        };
        let diagonal = || {
            for (add, u) in [(Accum::Replace, corner), (Accum::Add, below.subcols(i, b))] {
                triangular_matmul(
                    square.rb_mut(),
                    BlockStructure::TriangularLower,
                    add,
                    u.transpose(),
                    BlockStructure::Rectangular,
                    u,
                    BlockStructure::Rectangular,
                    1.0,
                    Par::Seq,
                );
            }
        };
        rayon::join(rest, diagonal);
    }
    Ok(())
}

/// Rows of a strip: the products of one are worth handing to another thread,
/// and what it copies stays in the nearer caches.
const STRIP: usize = 256;

/// Cuts `c` into strips of rows at multiples of [`STRIP`], the first at `at`,
/// and works on them in parallel.
fn strips(c: MatMut<'_, f64>, at: usize, work: &(impl Fn(usize, MatMut<'_, f64>) + Sync)) {
    let rows = c.nrows();
    if rows == 0 {
        return;
    }
    if rows <= STRIP {
        work(at, c);
        return;
    }
    let half = rows.div_ceil(STRIP).div_ceil(2) * STRIP;
    let (first, second) = c.split_at_row_mut(half);
    rayon::join(
        || strips(first, at, work),
        || strips(second, at + half, work),
    );
}

/// Side of the squares in which matrices are transposed: along whole columns
/// one of the two would miss the nearest cache at each step.
const SIDE: usize = 32;

/// `to ← aᵀ`.
fn transpose_into(a: MatRef<'_, f64>, mut to: MatMut<'_, f64>) {
    let (rows, columns) = (a.nrows(), a.ncols());
    for i0 in (0..rows).step_by(SIDE) {
        for j0 in (0..columns).step_by(SIDE) {
            for i in i0..rows.min(i0 + SIDE) {
                for j in j0..columns.min(j0 + SIDE) {
                    to[(j, i)] = a[(i, j)];
                }
            }
        }
    }
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
    leave_wide();
}

/// Copies the lower triangle over the upper one.
pub(crate) fn mirror_lower(a: &mut [f64], n: usize) {
    mirror(MatMut::from_column_major_slice_mut(a, n, n));
}

/// Copies the upper triangle over the lower one.
pub(crate) fn mirror_upper(a: &mut [f64], n: usize) {
    mirror(MatMut::from_column_major_slice_mut(a, n, n).transpose_mut());
}

/// Copies what is below the diagonal above it.
fn mirror(a: MatMut<'_, f64>) {
    let n = a.nrows();
    let half = n / 2;
    let (top, bottom) = a.split_at_row_mut(half);
    let (mut first, mut above) = top.split_at_col_mut(half);
    let (below, mut second) = bottom.split_at_col_mut(half);
    let below = below.into_const();
    if n <= STRIP {
        above.copy_from(below.transpose());
        for square in [&mut first, &mut second] {
            for j in 0..square.ncols() {
                for i in 0..j {
                    square[(i, j)] = square[(j, i)];
                }
            }
        }
        return;
    }
    let copy = || {
        strips(above, 0, &|i, c: MatMut<'_, f64>| {
            transpose_into(below.subcols(i, c.nrows()), c);
        });
    };
    rayon::join(copy, || rayon::join(|| mirror(first), || mirror(second)));
}

/// Partial Cholesky of a front: its first rows, upper triangle, become
/// `U = Lᵀ`, block by block of rows.
///
/// Fronts are stored upper so that products are `Uᵀ U`, both factors along
/// contiguous columns; with `L Lᵀ` one of them is packed across pages, at up to
/// half the rate. `check(k, pivot)` sees each pivot in order, before its root is
/// taken.
///
/// # Errors
/// What `check` returns; it must refuse pivots that are not positive.
pub(crate) fn factor_panel<E: Send>(
    panel: &mut [f64],
    layout: Panel,
    shared: bool,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    let Panel { np, nf } = layout;
    let mut square = vec![0.0; np.min(PIVOTS).pow(2)];
    let mut memory = MemBuffer::new(cholesky_in_place_scratch::<f64>(
        np.min(PIVOTS),
        Par::Seq,
        Spec::default(),
    ));
    for (rows, range) in layout.blocks() {
        let (above, rest) = panel.split_at_mut(range.start);
        let above = blocks_from(above, layout, rows.start);
        let b = rows.len();
        let (own, tail) = rest[..range.len()].split_at_mut(b * b);
        for u in &above {
            let u = u.subcols(0, b);
            triangular_matmul(
                MatMut::from_column_major_slice_mut(own, b, b),
                BlockStructure::TriangularUpper,
                Accum::Add,
                u.transpose(),
                BlockStructure::Rectangular,
                u,
                BlockStructure::Rectangular,
                -1.0,
                Par::Seq,
            );
        }
        let lower = &mut square[..b * b];
        factor_square(own, lower, b, &mut memory, &mut |k, pivot| {
            check(rows.start + k, pivot)
        })?;
        let lower = MatRef::from_column_major_slice(lower, b, b);
        let work = |(tile, columns): (usize, &mut [f64])| {
            let first = b + tile * TILE;
            let width = columns.len() / b;
            let mut columns = MatMut::from_column_major_slice_mut(columns, b, width);
            for u in &above {
                let (left, right) = (u.subcols(0, b).transpose(), u.subcols(first, width));
                faer_matmul(columns.as_mut(), Accum::Add, left, right, -1.0, Par::Seq);
            }
            solve_lower_triangular_in_place(lower, columns, Par::Seq);
        };
        debug_assert_eq!(tail.len(), b * (nf - rows.end));
        if shared {
            tail.par_chunks_mut(b * TILE).enumerate().for_each(work);
        } else {
            tail.chunks_mut(b * TILE).enumerate().for_each(work);
        }
    }
    Ok(())
}

/// The blocks of a panel that `values` holds, each from column `from` on.
fn blocks_from(values: &[f64], layout: Panel, from: usize) -> Vec<MatRef<'_, f64>> {
    let whole = layout
        .blocks()
        .take_while(|(_, range)| range.end <= values.len());
    whole
        .map(|(rows, range)| {
            let width = layout.nf - rows.start;
            MatRef::from_column_major_slice(&values[range], rows.len(), width)
                .subcols(from - rows.start, layout.nf - from)
        })
        .collect()
}

/// Factors a diagonal block, upper triangle, in place; `lower` becomes its
/// transpose, on which faer's Cholesky is not scalar.
fn factor_square<E>(
    own: &mut [f64],
    lower: &mut [f64],
    n: usize,
    memory: &mut MemBuffer,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    let copy = |own: &[f64], lower: &mut [f64]| {
        for i in 0..n {
            for j in 0..=i {
                lower[j * n + i] = own[i * n + j];
            }
        }
    };
    copy(own, lower);
    let factored = cholesky_in_place(
        MatMut::from_column_major_slice_mut(lower, n, n),
        LltRegularization::default(),
        Par::Seq,
        MemStack::new(memory),
        Spec::default(),
    );
    leave_wide();
    if factored.is_err() {
        // Once more, slowly, to see the pivots.
        copy(own, lower);
        pivots_one_by_one(lower, n, check)?;
        // Rounding let them pass this time: the last is at fault.
        return check(n - 1, 0.0);
    }
    for i in 0..n {
        check(i, lower[i * n + i] * lower[i * n + i])?;
        for j in 0..=i {
            own[i * n + j] = lower[j * n + i];
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
pub(crate) fn rank_update(panel: &[f64], layout: Panel, update: &mut [f64], shared: bool) {
    let Panel { np, nf } = layout;
    let nu = nf - np;
    let panel = blocks_from(panel, layout, np);
    let mut blocks = Vec::with_capacity(nu.div_ceil(BLOCK));
    let mut rest = update;
    for j in (0..nu).step_by(BLOCK) {
        let width = BLOCK.min(nu - j);
        let (block, next) = rest.split_at_mut(width * (j + width));
        blocks.push((j, width, block));
        rest = next;
    }
    let work = |(j, width, block): (usize, usize, &mut [f64])| {
        let mut block = MatMut::from_column_major_slice_mut(block, j + width, width);
        // A tile stays in the cache while all blocks of the panel pass.
        for i in (0..j).step_by(TILE) {
            let height = TILE.min(j - i);
            let mut add = Accum::Replace;
            for u in &panel {
                let tile = block.as_mut().subrows_mut(i, height);
                let (left, right) = (u.subcols(i, height).transpose(), u.subcols(j, width));
                faer_matmul(tile, add, left, right, -1.0, Par::Seq);
                add = Accum::Add;
            }
        }
        let mut add = Accum::Replace;
        for u in &panel {
            let u = u.subcols(j, width);
            triangular_matmul(
                block.as_mut().subrows_mut(j, width),
                BlockStructure::TriangularUpper,
                add,
                u.transpose(),
                BlockStructure::Rectangular,
                u,
                BlockStructure::Rectangular,
                -1.0,
                Par::Seq,
            );
            add = Accum::Add;
        }
    };
    if shared {
        blocks.into_par_iter().rev().for_each(work);
    } else {
        blocks.into_iter().for_each(work);
    }
}

/// Entries of a block up to which columns pass it one by one: it stays in the
/// nearest caches meanwhile, and to call a product for it would take longer.
const ONE_BY_ONE: usize = 1 << 12;

/// So many columns pass a larger block one by one, too.
const FEW_COLUMNS: usize = 4;

/// `X₁ ← U₁₁⁻ᵀ X₁`, `X₂ ← X₂ − U₁₂ᵀ X₁` for a front gathered into `x`, `nf`
/// rows and `columns` columns.
pub(crate) fn forward(panel: &[f64], layout: Panel, x: &mut [f64], columns: usize) {
    for (rows, range) in layout.blocks() {
        let (b, block) = (rows.len(), &panel[range]);
        if columns < FEW_COLUMNS || block.len() <= ONE_BY_ONE {
            for x in x.chunks_exact_mut(layout.nf).take(columns) {
                if !is_zero(x) {
                    forward_one(block, b, &mut x[rows.start..]);
                }
            }
            continue;
        }
        let (u11, u12) = halves(block, b);
        let x = MatMut::from_column_major_slice_mut(x, layout.nf, columns);
        let (mut first, second) = x.split_at_row_mut(rows.start).1.split_at_row_mut(b);
        solve_lower_triangular_in_place(u11.transpose(), first.as_mut(), Par::Seq);
        let left = u12.transpose();
        faer_matmul(second, Accum::Add, left, first.as_ref(), -1.0, Par::Seq);
    }
}

/// Columns that only fill a group are zero throughout.
fn is_zero(x: &[f64]) -> bool {
    x.iter().all(|&x| x == 0.0)
}

/// One column: each entry of the factor is read once, by columns, at the rate of
/// memory.
fn forward_one(block: &[f64], b: usize, x: &mut [f64]) {
    let (first, second) = x.split_at_mut(b);
    for j in 0..b {
        let column = &block[j * b..][..=j];
        first[j] = (first[j] - dot_long(&column[..j], &first[..j])) / column[j];
    }
    for (x, column) in second.iter_mut().zip(block[b * b..].chunks_exact(b)) {
        *x -= dot_long(column, first);
    }
}

/// `X₁ ← U₁₁⁻¹ (X₁ − U₁₂ X₂)`, the way back of [`forward`].
pub(crate) fn backward(panel: &[f64], layout: Panel, x: &mut [f64], columns: usize) {
    for (rows, range) in layout.blocks().rev() {
        let (b, block) = (rows.len(), &panel[range]);
        if columns < FEW_COLUMNS || block.len() <= ONE_BY_ONE {
            for x in x.chunks_exact_mut(layout.nf).take(columns) {
                if !is_zero(x) {
                    backward_one(block, b, &mut x[rows.start..]);
                }
            }
            continue;
        }
        let (u11, u12) = halves(block, b);
        let x = MatMut::from_column_major_slice_mut(x, layout.nf, columns);
        let (mut first, second) = x.split_at_row_mut(rows.start).1.split_at_row_mut(b);
        let right = second.as_ref();
        faer_matmul(first.as_mut(), Accum::Add, u12, right, -1.0, Par::Seq);
        solve_upper_triangular_in_place(u11, first, Par::Seq);
    }
}

/// One column of [`backward`].
fn backward_one(block: &[f64], b: usize, x: &mut [f64]) {
    let (first, second) = x.split_at_mut(b);
    for (x, column) in second.iter().zip(block[b * b..].chunks_exact(b)) {
        subtract(first, *x, column);
    }
    for j in (0..b).rev() {
        let column = &block[j * b..][..=j];
        let x = first[j] / column[j];
        first[j] = x;
        subtract(&mut first[..j], x, column);
    }
}

/// The diagonal block of a block of `b` rows, and what is right of it.
fn halves(block: &[f64], b: usize) -> (MatRef<'_, f64>, MatRef<'_, f64>) {
    MatRef::from_column_major_slice(block, b, block.len() / b).split_at_col(b)
}

/// LU with partial pivoting of the rows `first..n` of a panel of columns of
/// length `n`: the rows as they now stand, counted from `first`, and the number
/// of exchanges that led there.
///
/// # Panics
/// If the panel does not consist of whole columns.
pub fn lu_panel(panel: &mut [f64], n: usize, first: usize) -> (Vec<usize>, usize) {
    let width = panel.len() / n;
    let rows = n - first;
    let mut matrix = MatMut::from_column_major_slice_mut(panel, n, width)
        .split_at_row_mut(first)
        .1;
    let (mut forward, mut backward) = (vec![0_usize; rows], vec![0_usize; rows]);
    let need = lu::lu_in_place_scratch::<usize, f64>(rows, width, Par::Seq, Spec::default());
    let mut memory = MemBuffer::new(need);
    let (info, _) = lu::lu_in_place(
        matrix.rb_mut(),
        &mut forward,
        &mut backward,
        Par::Seq,
        MemStack::new(&mut memory),
        Spec::default(),
    );
    leave_wide();
    (forward, info.transposition_count)
}

/// Eliminates a factored panel, whose diagonal begins at row `first`, from
/// columns right of it: `U₁₂ = L₁₁⁻¹ A₁₂`, `A₂₂ ← A₂₂ − L₂₁ U₁₂`.
///
/// # Panics
/// If a slice does not consist of whole columns.
pub fn lu_update(columns: &mut [f64], panel: &[f64], n: usize, first: usize) {
    let width = panel.len() / n;
    let count = columns.len() / n;
    let (upper, lower) = MatRef::from_column_major_slice(panel, n, width)
        .split_at_row(first)
        .1
        .split_at_row(width);
    let (mut top, bottom) = MatMut::from_column_major_slice_mut(columns, n, count)
        .split_at_row_mut(first)
        .1
        .split_at_row_mut(width);
    solve_unit_lower_triangular_in_place(upper, top.rb_mut(), Par::Seq);
    faer_matmul(bottom, Accum::Add, lower, top.as_ref(), -1.0, Par::Seq);
}

/// `b ← L⁻ᵀ U⁻ᵀ b` for the factors of an LU, `L` with a unit diagonal.
///
/// # Panics
/// If a slice has not the length its matrix needs.
pub fn lu_solve_transposed(factors: &[f64], n: usize, b: &mut [f64]) {
    let factors = MatRef::from_column_major_slice(factors, n, n);
    let mut b = MatMut::from_column_major_slice_mut(b, n, 1);
    solve_lower_triangular_in_place(factors.transpose(), b.rb_mut(), Par::Seq);
    solve_unit_upper_triangular_in_place(factors.transpose(), b, Par::Seq);
}

/// `U₁₂ = L₁₁⁻¹ F₁₂` for columns of a front whose pivots are factored, its rows
/// exchanged.
///
/// # Panics
/// If a slice does not consist of whole columns.
pub fn lu_upper(pivots: &[f64], np: usize, columns: &mut [f64]) {
    let pivots = MatRef::from_column_major_slice(pivots, np, np);
    let count = columns.len() / np;
    let columns = MatMut::from_column_major_slice_mut(columns, np, count);
    solve_unit_lower_triangular_in_place(pivots, columns, Par::Seq);
}

/// `L₂₁ᵀ = U₁₁⁻ᵀ F₂₁ᵀ` for columns of it.
///
/// # Panics
/// If a slice does not consist of whole columns.
pub fn lu_lower(pivots: &[f64], np: usize, columns: &mut [f64]) {
    let pivots = MatRef::from_column_major_slice(pivots, np, np);
    let count = columns.len() / np;
    let columns = MatMut::from_column_major_slice_mut(columns, np, count);
    solve_lower_triangular_in_place(pivots.transpose(), columns, Par::Seq);
}

/// `F₂₂ ← F₂₂ − L₂₁ U₁₂` for columns of `F₂₂` and of `U₁₂`.
///
/// # Panics
/// If a slice does not consist of whole columns.
pub fn lu_rest(lower: &[f64], upper: &[f64], np: usize, rest: &mut [f64]) {
    let (nu, count) = (lower.len() / np, upper.len() / np);
    let lower = MatRef::from_column_major_slice(lower, np, nu);
    let upper = MatRef::from_column_major_slice(upper, np, count);
    let rest = MatMut::from_column_major_slice_mut(rest, nu, count);
    faer_matmul(rest, Accum::Add, lower.transpose(), upper, -1.0, Par::Seq);
}

/// `b ← U⁻¹ b` for the factors of an LU.
///
/// # Panics
/// If a slice has not the length its matrix needs.
pub fn lu_solve_upper(factors: &[f64], n: usize, b: &mut [f64]) {
    let factors = MatRef::from_column_major_slice(factors, n, n);
    let b = MatMut::from_column_major_slice_mut(b, n, 1);
    solve_upper_triangular_in_place(factors, b, Par::Seq);
}

/// `a ← a − s b`, as far as `a` goes.
fn subtract(a: &mut [f64], s: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= s * b;
    }
}
