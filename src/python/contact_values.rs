//! Values of contacts in the variables of the caller, and of the places of their nodes.
//!
//! `T` scales the variables of a problem with two friction coefficients: `r = T r̃`,
//! `v = T⁻¹ ṽ`. `factors` are `T` of all contacts, component by component.

use pyo3::prelude::*;

use crate::primal::contacts::Contacts;
use crate::primal::linearised::spread;
use crate::python::arrays::{self, Matrix};
use crate::python::tangent::{factors, over};
use crate::reduced::elliptic_scaling::EllipticScaling;

/// `T` of all contacts.
pub(super) fn all_factors<const D: usize>(
    contacts: &Contacts<D>,
    elliptic: Option<&EllipticScaling>,
) -> Vec<f64> {
    let all: Vec<usize> = (0..contacts.count()).collect();
    factors::<D>(&all, elliptic)
}

/// Estimate of the diagonal of `W = T⁻¹ W̃ T⁻¹`; zero at components without an unknown.
pub(super) fn diagonal<const D: usize>(contacts: &Contacts<D>, factors: &[f64]) -> Vec<f64> {
    let mut found = Vec::with_capacity(D * contacts.count());
    for (i, frame) in contacts.frames.list.iter().enumerate() {
        let own = contacts.compliance.block(i).diagonal();
        found.extend((0..D).map(|k| if frame.free[k] { own[k] } else { 0.0 }));
    }
    over(&over(&found, factors), factors)
}

/// Relative displacements `B_f u_f` of prescribed ones.
pub(super) fn offsets<const D: usize>(
    contacts: &Contacts<D>,
    factors: &[f64],
    prescribed: &[f64],
) -> Vec<f64> {
    let none = vec![[0.0; D]; contacts.count()];
    let v = contacts.frames.offsets(&none, prescribed);
    over(v.as_flattened(), factors)
}

/// Relative displacements `R y` of values of the places.
pub(super) fn moved<const D: usize>(
    contacts: &Contacts<D>,
    factors: &[f64],
    y: &[f64],
) -> Vec<f64> {
    over(contacts.frames.at_contacts(y).as_flattened(), factors)
}

/// `Rᵀ v` of relative displacements, by places.
pub(super) fn work<const D: usize>(
    contacts: &Contacts<D>,
    factors: &[f64],
    v: &Matrix<'_>,
    places: usize,
) -> PyResult<Vec<f64>> {
    let given = arrays::rows_of::<D>("v", v, contacts.count())?;
    let own = over(given.as_flattened(), factors);
    Ok(spread(&contacts.frames, own.as_chunks::<D>().0, places))
}
