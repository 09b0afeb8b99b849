//! The length of an imbalance of forces, as the residual η measures it.
//!
//! With the columns of `R = Q T` orthonormalised, the imbalance of `Rᵀ r + e` has the length
//! `‖T⁻ᵀ (Rᵀ r + e)‖`. `Tᵀ T = Rᵀ R` is sparse, and its Cholesky factor has this `T` up to
//! rotations, which change no length.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::equilibrium::statics::Statics;
use crate::error::Error;
use crate::linalg::small::norm;
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::{Options, Symbolic};

/// `‖T⁻ᵀ (Rᵀ r + e)‖/‖T⁻ᵀ e‖`, zero without an imbalance, and its rounding floor: the imbalance
/// that rounding of `r` leaves.
///
/// # Errors
/// [`Error::DependentMotion`] if the columns of `R` are dependent, [`Error::Interrupted`].
pub fn measure_imbalance(
    statics: &Statics,
    reaction: &[f64],
    load: &[f64],
    stop: &AtomicBool,
) -> Result<(f64, f64), Error> {
    let lengths = statics.column_lengths();
    // Circular cones, and columns of length 1.
    let mut factors = Vec::with_capacity(statics.rows());
    for contact in 0..statics.contacts() {
        let mu = statics.largest_friction(contact);
        let rows = statics.first[contact]..statics.first[contact + 1];
        factors.extend(rows.clone().map(|row| {
            let plain = row == rows.start || mu == 0.0;
            if plain {
                1.0
            } else {
                statics.friction[row] / mu
            }
        }));
    }
    let rows = |row: usize, add: &mut dyn FnMut(usize, f64)| {
        for (j, value) in statics.row(row) {
            add(j, factors[row] * value / lengths[j]);
        }
    };
    let factor = factor_gram(statics.rows(), lengths.len(), rows, stop)?;
    let size = |force: &[f64]| {
        let mut scaled: Vec<f64> = force.iter().zip(&lengths).map(|(f, l)| f / l).collect();
        factor.condense(&mut scaled, 1);
        norm(&scaled)
    };
    let mut squares: Vec<f64> = load.iter().map(|e| e * e).collect();
    for (row, &r) in reaction.iter().enumerate() {
        for (j, value) in statics.row(row) {
            squares[j] += (value * r).powi(2);
        }
    }
    let rounding: Vec<f64> = squares.iter().map(|s| f64::EPSILON * s.sqrt()).collect();
    let left = size(&statics.imbalance(reaction, load));
    Ok(if left == 0.0 {
        (0.0, 0.0)
    } else {
        (left / size(load), size(&rounding) / size(load))
    })
}

/// The factor of `Rᵀ R`, with `row(i, add)` that calls `add(j, value)` for the entries of row `i`.
///
/// # Errors
/// [`Error::DependentMotion`] if the columns of `R` are dependent, [`Error::Interrupted`].
pub fn factor_gram(
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
