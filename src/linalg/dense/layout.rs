//! Strips for parallel work, transposes, and copies of one triangle to the other.

use faer::prelude::IntoConst;
use faer::{MatMut, MatRef};

use crate::tasks::join;

/// Rows of a strip: enough work for another thread, and its copies stay in the near caches.
const STRIP: usize = 256;

/// Strip width for a matrix of order `n`: the full width, or less if there would be too few
/// strips.
pub(super) fn part(n: usize) -> usize {
    (n / 8).next_multiple_of(64).clamp(64, STRIP)
}

/// Cuts `c` into strips of `size` rows, the first one at `at`, and works on them in parallel.
pub(super) fn strips(
    c: MatMut<'_, f64>,
    at: usize,
    size: usize,
    work: &(impl Fn(usize, MatMut<'_, f64>) + Sync),
) {
    let rows = c.nrows();
    if rows == 0 {
        return;
    }
    if rows <= size {
        work(at, c);
        return;
    }
    let half = rows.div_ceil(size).div_ceil(2) * size;
    let (first, second) = c.split_at_row_mut(half);
    join(
        || strips(first, at, size, work),
        || strips(second, at + half, size, work),
    );
}

/// Side of the tiles of a transposition: along whole columns, one of the two matrices would
/// miss the nearest cache at each step.
const SIDE: usize = 32;

/// `to ← aᵀ`.
pub(super) fn transpose_into(a: MatRef<'_, f64>, mut to: MatMut<'_, f64>) {
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

/// Copies the lower triangle over the upper one.
pub(crate) fn mirror_lower(a: &mut [f64], n: usize) {
    mirror(MatMut::from_column_major_slice_mut(a, n, n));
}

/// Copies the upper triangle over the lower one.
pub(crate) fn mirror_upper(a: &mut [f64], n: usize) {
    mirror(MatMut::from_column_major_slice_mut(a, n, n).transpose_mut());
}

/// Copies the part below the diagonal to the part above.
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
        strips(above, 0, STRIP, &|i, c: MatMut<'_, f64>| {
            transpose_into(below.subcols(i, c.nrows()), c);
        });
    };
    join(copy, || join(|| mirror(first), || mirror(second)));
}
