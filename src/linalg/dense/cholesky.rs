//! Cholesky factors of whole matrices, and solves with them.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;
use crate::linalg::dense::kernels::{
    faer_matmul, solve_lower_triangular_in_place, solve_upper_triangular_in_place,
    triangular_matmul,
};
use crate::linalg::dense::layout::{part, transpose_into};
use crate::linalg::dense::panel::{blocks_from, factor_panel};
use crate::linalg::dense::product::TILE;
use crate::linalg::packed::Panel;
use crate::tasks;
use faer::linalg::matmul::triangular::BlockStructure;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};

/// Cholesky factor of a symmetric positive definite matrix, in place: the lower triangle of `a`
/// is read and becomes `L`; the strict upper one becomes zero.
///
/// Returns the index of the first pivot that is not positive, if there is one; then `a` is
/// invalid.
pub fn cholesky(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<Option<usize>, Error> {
    /// Columns between two updates of the rest: an update reads all memory, the panel stays in
    /// the cache.
    const WIDE: usize = 384;
    assert_eq!(a.len(), n * n);
    let mut panel = vec![0.0; n.min(WIDE) * n];
    for j in (0..n).step_by(WIDE) {
        let b = WIDE.min(n - j);
        let layout = Panel::new(b, n - j);
        let panel = &mut panel[..layout.len()];
        // Columns of the lower triangle are rows of the upper one, which fronts use.
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
    tasks::for_each(columns.chunks_mut(part(n) * n), |tile, columns| {
        let (from, width) = (tile * part(n), columns.len() / n);
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

/// `X ← L⁻¹ X` for `columns` right-hand sides of length `n`.
pub fn solve_lower(l: &[f64], n: usize, x: &mut [f64], columns: usize) {
    solve(l, n, x, columns, |l, x| {
        solve_lower_triangular_in_place(l, x, Par::Seq);
    });
}

/// `X ← L⁻ᵀ X` for `columns` right-hand sides of length `n`.
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
    /// Right-hand sides in one task.
    const COLUMNS: usize = 64;
    assert_eq!(l.len(), n * n);
    assert_eq!(x.len(), n * columns);
    if n == 0 {
        return;
    }
    let l = MatRef::from_column_major_slice(l, n, n);
    tasks::for_each(x.chunks_mut(COLUMNS * n), |_, x| {
        let width = x.len() / n;
        work(l, MatMut::from_column_major_slice_mut(x, n, width));
    });
}
