//! The length of forces on rigid motions, as the residual η measures it.
//!
//! With the columns of `R = Q T` orthonormalised, forces `f` have the length `‖T⁻ᵀ f‖`. `Tᵀ T = Rᵀ R` is
//! sparse, and its Cholesky factor has this `T` up to rotations, which change no length.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::{Options, Symbolic};

/// The factor of `Rᵀ R`, with `row(i, add)` that calls `add(j, value)` for the entries of row `i`.
///
/// # Errors
/// [`Error::DependentMotion`] if the columns of `R` are dependent, [`Error::Interrupted`].
pub(super) fn factor_gram(
    rows: usize,
    motions: usize,
    row: impl Fn(usize, &mut dyn FnMut(usize, f64)),
    stop: &AtomicBool,
) -> Result<Factor, Error> {
    let mut of_motion: Vec<Vec<(usize, f64)>> = vec![Vec::new(); motions];
    let mut by_row: Vec<Vec<(usize, f64)>> = vec![Vec::new(); rows];
    for (i, of_row) in by_row.iter_mut().enumerate() {
        row(i, &mut |j, value| {
            of_motion[j].push((i, value));
            of_row.push((j, value));
        });
    }
    let (mut pointer, mut index, mut values) = (vec![0], Vec::new(), Vec::new());
    let mut sums = vec![0.0; motions];
    let mut touched = vec![false; motions];
    for entries in &of_motion {
        let mut column = Vec::new();
        for &(row, value) in entries {
            for &(other, factor) in &by_row[row] {
                if !std::mem::replace(&mut touched[other], true) {
                    column.push(other);
                }
                sums[other] += value * factor;
            }
        }
        column.sort_unstable();
        for &other in &column {
            index.push(other);
            values.push(std::mem::take(&mut sums[other]));
            touched[other] = false;
        }
        pointer.push(index.len());
    }
    let gram = Symmetric::of_checked(&pointer, &index, &values);
    let symbolic = Arc::new(Symbolic::analyse(&gram, &[], &Options::default())?);
    Factor::new(symbolic, &gram, stop).map_err(|error| match error {
        Error::Indefinite { dof, .. } | Error::FloatingBody { dof } => {
            Error::DependentMotion { mode: dof }
        }
        other => other,
    })
}
