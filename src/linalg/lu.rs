use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::prelude::ReborrowMut;
use faer::{MatMut, Par, Spec};

/// Solves `A x = b`, `A` of order `n`, by LU with partial pivoting; `a` is
/// destroyed and `b` becomes `x`.
///
/// # Errors
/// The index of a pivot that is zero to rounding beside the largest entry.
pub fn solve_general(a: &mut [f64], n: usize, b: &mut [f64]) -> Result<(), usize> {
    let size = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let mut matrix = MatMut::from_column_major_slice_mut(a, n, n);
    let (mut forward, mut backward) = (vec![0_usize; n], vec![0_usize; n]);
    let need = factor::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Spec::default())
        .or(solve::solve_in_place_scratch::<usize, f64>(n, 1, Par::Seq));
    let mut memory = MemBuffer::new(need);
    let stack = MemStack::new(&mut memory);
    let (_, permutation) = factor::lu_in_place(
        matrix.rb_mut(),
        &mut forward,
        &mut backward,
        Par::Seq,
        stack,
        Spec::default(),
    );
    let lu = matrix.as_ref();
    if let Some(k) = (0..n).find(|&k| !(lu[(k, k)].abs() > f64::EPSILON * size)) {
        return Err(k);
    }
    let right = MatMut::from_column_major_slice_mut(b, n, 1);
    let stack = MemStack::new(&mut memory);
    solve::solve_in_place(lu, lu, permutation, right, Par::Seq, stack);
    Ok(())
}
