//! LU of whole matrices and of the parts of fronts.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor as lu;
use faer::prelude::ReborrowMut;
use faer::{Accum, MatMut, MatRef, Par, Spec};

use crate::linalg::dense::kernels::{
    faer_matmul, leave_wide, solve_lower_triangular_in_place, solve_unit_lower_triangular_in_place,
    solve_unit_upper_triangular_in_place, solve_upper_triangular_in_place,
};

/// LU with partial pivoting of the rows `first..n` of a panel of columns of length `n`. Returns
/// the order of the rows, counted from `first`, and the number of exchanges.
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

/// Eliminates a factored panel, whose diagonal begins at row `first`, from columns to its
/// right: `U₁₂ = L₁₁⁻¹ A₁₂`, `A₂₂ ← A₂₂ − L₂₁ U₁₂`.
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

/// `b ← U⁻¹ L⁻¹ b` for the factors of an LU, `L` with a unit diagonal.
pub fn lu_solve(factors: &[f64], n: usize, b: &mut [f64]) {
    let factors = MatRef::from_column_major_slice(factors, n, n);
    let mut b = MatMut::from_column_major_slice_mut(b, n, 1);
    solve_unit_lower_triangular_in_place(factors, b.rb_mut(), Par::Seq);
    solve_upper_triangular_in_place(factors, b, Par::Seq);
}

/// `b ← L⁻ᵀ U⁻ᵀ b` for the factors of an LU, `L` with a unit diagonal.
pub fn lu_solve_transposed(factors: &[f64], n: usize, b: &mut [f64]) {
    let factors = MatRef::from_column_major_slice(factors, n, n);
    let mut b = MatMut::from_column_major_slice_mut(b, n, 1);
    solve_lower_triangular_in_place(factors.transpose(), b.rb_mut(), Par::Seq);
    solve_unit_upper_triangular_in_place(factors.transpose(), b, Par::Seq);
}

/// `U₁₂ = L₁₁⁻¹ F₁₂` for columns of a front with factored pivots and exchanged rows.
pub fn lu_upper(pivots: &[f64], np: usize, columns: &mut [f64]) {
    let pivots = MatRef::from_column_major_slice(pivots, np, np);
    let count = columns.len() / np;
    let columns = MatMut::from_column_major_slice_mut(columns, np, count);
    solve_unit_lower_triangular_in_place(pivots, columns, Par::Seq);
}

/// `L₂₁ᵀ = U₁₁⁻ᵀ F₂₁ᵀ` for columns of it.
pub fn lu_lower(pivots: &[f64], np: usize, columns: &mut [f64]) {
    let pivots = MatRef::from_column_major_slice(pivots, np, np);
    let count = columns.len() / np;
    let columns = MatMut::from_column_major_slice_mut(columns, np, count);
    solve_lower_triangular_in_place(pivots.transpose(), columns, Par::Seq);
}

/// `F₂₂ ← F₂₂ − L₂₁ U₁₂` for columns of `F₂₂` and of `U₁₂`.
pub fn lu_rest(lower: &[f64], upper: &[f64], np: usize, rest: &mut [f64]) {
    let (nu, count) = (lower.len() / np, upper.len() / np);
    let lower = MatRef::from_column_major_slice(lower, np, nu);
    let upper = MatRef::from_column_major_slice(upper, np, count);
    let rest = MatMut::from_column_major_slice_mut(rest, nu, count);
    faer_matmul(rest, Accum::Add, lower.transpose(), upper, -1.0, Par::Seq);
}

/// `b ← U⁻¹ b` for the factors of an LU.
pub fn lu_solve_upper(factors: &[f64], n: usize, b: &mut [f64]) {
    let factors = MatRef::from_column_major_slice(factors, n, n);
    let b = MatMut::from_column_major_slice_mut(b, n, 1);
    solve_upper_triangular_in_place(factors, b, Par::Seq);
}
