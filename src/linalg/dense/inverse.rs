//! The inverse of a matrix from its Cholesky factor, in place.

use std::sync::atomic::AtomicBool;

use faer::linalg::matmul::triangular::BlockStructure;
use faer::prelude::{IntoConst, Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};

use crate::error::{Error, check_running};
use crate::linalg::dense::kernels::{
    faer_matmul, solve_lower_triangular_in_place, triangular_matmul,
};
use crate::linalg::dense::layout::{mirror_lower, part, strips, transpose_into};
use crate::linalg::packed::PIVOTS;
use crate::tasks::join;

/// The inverse `(L Lᵀ)⁻¹` in the memory of `L`, bitwise symmetric; only the lower triangle is
/// read. It needs no second matrix.
///
/// # Errors
/// [`Error::Interrupted`] if `stop` is set; then `a` is invalid.
pub fn invert_from_cholesky(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<(), Error> {
    assert_eq!(a.len(), n * n);
    invert_lower(a, n, stop)?;
    product_of_inverses(a, n, stop)?;
    mirror_lower(a, n);
    Ok(())
}

/// `M = L⁻¹` in the memory of `L`, the first rows first: for a block of rows `[L₂₁ L₂₂]` with a
/// known `M₁₁`, `M₂₁ = −L₂₂⁻¹ L₂₁ M₁₁`.
fn invert_lower(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<(), Error> {
    let mut turned = vec![0.0; n * n.min(PIVOTS)];
    let mut inverse = vec![0.0; n.min(PIVOTS).pow(2)];
    for i in (0..n).step_by(PIVOTS) {
        check_running(stop)?;
        let b = PIVOTS.min(n - i);
        let whole = MatMut::from_column_major_slice_mut(a, n, n);
        let (known, own) = whole.subcols_mut(0, i + b).split_at_row_mut(i);
        let known = known.into_const();
        let (mut left, mut square) = own.subrows_mut(0, b).split_at_col_mut(i);
        let diagonal = square.rb();
        strips(left.rb_mut().transpose_mut(), 0, part(n), &|_,
                                                            c: MatMut<
            '_,
            f64,
        >| {
            solve_lower_triangular_in_place(diagonal, c.transpose_mut(), Par::Seq);
        });
        let turned = &mut turned[..i * b];
        transpose_into(left.rb(), MatMut::from_column_major_slice_mut(turned, i, b));
        let lhs = MatRef::from_column_major_slice(turned, i, b).transpose();
        // Strips of columns, which are strips of rows of the transpose.
        strips(
            left.transpose_mut(),
            0,
            part(n),
            &|j, c: MatMut<'_, f64>| {
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
            },
        );
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

/// The lower triangle of `Mᵀ M` in the memory of a lower triangle `M`, the first rows first: a
/// block of rows of the product needs only itself and the rows below.
fn product_of_inverses(a: &mut [f64], n: usize, stop: &AtomicBool) -> Result<(), Error> {
    let mut corner = vec![0.0; n.min(PIVOTS).pow(2)];
    for i in (0..n).step_by(PIVOTS) {
        check_running(stop)?;
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
            strips(
                left.transpose_mut(),
                0,
                part(n),
                &|j, c: MatMut<'_, f64>| {
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
                },
            );
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
        join(rest, diagonal);
    }
    Ok(())
}
