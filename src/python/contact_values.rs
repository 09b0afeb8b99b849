//! Values of contacts in the variables of the caller, and of the places of their nodes.
//!
//! `T` scales the variables of a problem with two friction coefficients: `r = T r̃`,
//! `v = T⁻¹ ṽ`. `factors` are `T` of contacts, component by component.

use pyo3::prelude::*;

use crate::error::Error;
use crate::linalg::small::Block;
use crate::python::arrays::{self, Matrix};
use crate::reduced::elliptic_scaling::EllipticScaling;
use crate::solver::derivatives::tangent_system::ClosedLaw;

/// `T` of some contacts in `d` dimensions.
pub(super) fn factors(
    d: usize,
    contacts: impl IntoIterator<Item = usize>,
    elliptic: Option<&EllipticScaling>,
) -> Vec<f64> {
    let of = |i| (0..d).map(move |k| elliptic.map_or(1.0, |s| s.factor(i, k)));
    contacts.into_iter().flat_map(of).collect()
}

/// `T⁻¹ x`.
pub(super) fn over(values: &[f64], factors: &[f64]) -> Vec<f64> {
    values.iter().zip(factors).map(|(x, t)| x / t).collect()
}

/// `T x`, in place.
pub(super) fn scale(values: &mut [f64], factors: &[f64]) {
    for (value, t) in values.iter_mut().zip(factors) {
        *value *= t;
    }
}

/// `r̃` of an array of the contacts of `factors`.
pub(super) fn read<const D: usize>(
    what: &'static str,
    array: &Matrix<'_>,
    factors: &[f64],
) -> PyResult<Vec<[f64; D]>> {
    let given = arrays::rows_of::<D>(what, array, factors.len() / D)?;
    Ok(over(given.as_flattened(), factors).as_chunks().0.to_vec())
}

/// Laws of some of the contacts of `factors`, in the variables `r̃`, `ṽ`, and `T` of these.
pub(super) fn laws<const D: usize>(
    closed: &[usize],
    (by_r, by_v): (&Matrix<'_>, &Matrix<'_>),
    factors: &[f64],
) -> PyResult<(Vec<ClosedLaw<D>>, Vec<f64>)> {
    let by_r = arrays::rows_of::<D>("by_r", by_r, D * closed.len())?;
    let by_v = arrays::rows_of::<D>("by_v", by_v, D * closed.len())?;
    let factors = factors.as_chunks::<D>().0;
    let (mut laws, mut own) = (Vec::new(), Vec::new());
    let blocks = by_r.chunks_exact(D).zip(by_v.chunks_exact(D));
    for (&position, (by_r, by_v)) in closed.iter().zip(blocks) {
        let t = factors.get(position).ok_or(Error::Shape {
            what: "closed",
            expected: factors.len(),
            found: position,
        })?;
        own.extend(t);
        laws.push(ClosedLaw {
            position,
            by_r: Block::from_fn(|k, l| by_r[k][l] * t[l]),
            by_v: Block::from_fn(|k, l| by_v[k][l] / t[l]),
        });
    }
    Ok((laws, own))
}
