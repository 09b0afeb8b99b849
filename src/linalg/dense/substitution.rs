//! Triangular solves with the panel of a front.

use faer::{Accum, MatMut, MatRef, Par};

use crate::linalg::dense::kernels::{
    faer_matmul, solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use crate::linalg::packed::Panel;
use crate::linalg::small::{add_scaled, dot_long};

/// Up to this many entries of a block, columns are solved one by one: the block stays in the
/// nearest caches, and a call of a product would take longer.
const ONE_BY_ONE: usize = 1 << 12;

/// Up to this many columns, larger blocks are also solved column by column.
const FEW_COLUMNS: usize = 4;

/// `X₁ ← U₁₁⁻ᵀ X₁`, `X₂ ← X₂ − U₁₂ᵀ X₁` for a front gathered in `x`, with `nf` rows and
/// `columns` columns.
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

/// Columns that only fill a group are zero.
fn is_zero(x: &[f64]) -> bool {
    x.iter().all(|&x| x == 0.0)
}

/// One column: each entry of the factor is read once, by columns, at the rate of memory.
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

/// `X₁ ← U₁₁⁻¹ (X₁ − U₁₂ X₂)`, the backward solve for [`forward`].
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
        add_scaled(first, -x, column);
    }
    for j in (0..b).rev() {
        let column = &block[j * b..][..=j];
        let x = first[j] / column[j];
        first[j] = x;
        add_scaled(&mut first[..j], -x, column);
    }
}

/// The diagonal block of a block of `b` rows, and the part to its right.
pub(super) fn halves(block: &[f64], b: usize) -> (MatRef<'_, f64>, MatRef<'_, f64>) {
    MatRef::from_column_major_slice(block, b, block.len() / b).split_at_col(b)
}
