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
    if rows <= SMALL {
        return lu_small(panel, n, first);
    }
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

/// Of this order, the blocks of faer take as long as the arithmetic without them.
const SMALL: usize = 32;

/// [`lu_panel`], column by column.
fn lu_small(panel: &mut [f64], n: usize, first: usize) -> (Vec<usize>, usize) {
    let (mut order, mut exchanges): (Vec<usize>, _) = ((0..n - first).collect(), 0);
    for k in 0..panel.len() / n {
        let column = &panel[k * n + first..][..n - first];
        let larger = |p: usize, i: usize| {
            if column[i].abs() > column[p].abs() {
                i
            } else {
                p
            }
        };
        let pivot = (k + 1..column.len()).fold(k, larger);
        if pivot != k {
            let swap = |column: &mut [f64]| column.swap(first + k, first + pivot);
            panel.chunks_exact_mut(n).for_each(swap);
            order.swap(k, pivot);
            exchanges += 1;
        }
        let (done, right) = panel.split_at_mut((k + 1) * n);
        let (head, below) = done[k * n + first..].split_at_mut(k + 1);
        for l in below.iter_mut() {
            *l /= head[k];
        }
        for column in right.chunks_exact_mut(n) {
            let (head, rest) = column[first..].split_at_mut(k + 1);
            for (x, l) in rest.iter_mut().zip(&*below) {
                *x -= head[k] * l;
            }
        }
    }
    (order, exchanges)
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
    if n <= SMALL {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        for (k, column) in factors.chunks_exact(n.max(1)).enumerate() {
            b[k] = (b[k] - dot(&column[..k], b)) / column[k];
        }
        for (k, column) in factors.chunks_exact(n.max(1)).enumerate().rev() {
            b[k] -= dot(&column[k + 1..], &b[k + 1..]);
        }
        return;
    }
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

/// `b ← L⁻ᵀ b` for the factors of an LU, `L` with a unit diagonal.
pub fn lu_solve_lower_transposed(factors: &[f64], n: usize, b: &mut [f64]) {
    let factors = MatRef::from_column_major_slice(factors, n, n);
    let b = MatMut::from_column_major_slice_mut(b, n, 1);
    solve_unit_upper_triangular_in_place(factors.transpose(), b, Par::Seq);
}
