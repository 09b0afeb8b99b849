//! The linearised laws of contacts whose stiffness is held elsewhere, by the places of the
//! nodes of the interface.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::primal::linearised_laws::LinearisedLaws;
use crate::python::arrays::{self, Indices, Matrix, NewMatrix, NewVector, Vector};
use crate::python::contact_variables::{
    Changed, Interface, InterfaceVariables, PyContactTangent, PyContactVariables,
};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::tangent::{factors, laws};

/// Laws, and the interface of their contacts.
struct InterfaceLaws<const D: usize> {
    laws: LinearisedLaws<D>,
    interface: Arc<Interface<D>>,
}

impl<const D: usize> InterfaceLaws<D> {
    /// Nothing if a contact determines nothing.
    fn new(
        variables: &InterfaceVariables<D>,
        closed: &[usize],
        (by_r, by_v): (&Matrix<'_>, &Matrix<'_>),
    ) -> PyResult<Option<Self>> {
        let by_r = arrays::rows_of::<D>("by_r", by_r, D * closed.len())?;
        let by_v = arrays::rows_of::<D>("by_v", by_v, D * closed.len())?;
        let (interface, elliptic) = (&variables.interface, variables.elliptic.as_ref());
        let order: Vec<usize> = (0..interface.contacts.count()).collect();
        let factor = |i: usize, k: usize| elliptic.map_or(1.0, |s| s.factor(i, k));
        let laws = laws(closed, &order, (by_r, by_v), factor)?;
        let laws = LinearisedLaws::new(&interface.contacts, &interface.free, &laws);
        Ok(laws.map(|laws| Self {
            laws,
            interface: Arc::clone(interface),
        }))
    }
}

/// The linearised laws of one step in the form of a Newton step.
#[pyclass(name = "LinearisedLaws", module = "bipot_rs._core")]
pub(super) struct PyLinearisedLaws {
    kind: Dimension<InterfaceLaws<2>, InterfaceLaws<3>>,
    /// `T` of the contacts of the laws, component by component: `r = T r̃`.
    factors: Vec<f64>,
    places: usize,
}

/// A tangent, and right sides of laws.
type Aimed<'py> = (PyContactTangent, NewMatrix<'py>);

#[pymethods]
impl PyLinearisedLaws {
    /// The laws of some contacts; nothing if one of them determines nothing. `by_r` and `by_v`
    /// have `d` rows for each of them.
    #[staticmethod]
    fn of(
        variables: &PyContactVariables,
        closed: Indices<'_>,
        by_r: Matrix<'_>,
        by_v: Matrix<'_>,
    ) -> PyResult<Option<Self>> {
        let closed = arrays::indices(&closed, "closed")?;
        let (factors, places) = for_either!(&variables.kind, variables => (
            factors_of(variables, &closed),
            variables.interface.free.len(),
        ));
        let kind = map_either!(&variables.kind, variables => {
            match InterfaceLaws::new(variables, &closed, (&by_r, &by_v))? {
                Some(laws) => laws,
                None => return Ok(None),
            }
        });
        Ok(Some(Self {
            kind,
            factors,
            places,
        }))
    }

    #[getter]
    fn statuses<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i8>> {
        for_either!(&self.kind, inner => arrays::from_status(py, &inner.laws.statuses))
    }

    #[getter]
    fn tangent(&self) -> PyContactTangent {
        for_either!(&self.kind, inner => inner.laws.tangent.clone().into())
    }

    fn aim<'py>(
        &mut self,
        py: Python<'py>,
        s: Matrix<'py>,
        g: Vector<'py>,
    ) -> PyResult<Aimed<'py>> {
        let mut s = self.values("s", &s)?;
        let g = self.at_places("g", &g)?;
        for_either!(&mut self.kind, inner => {
            let rows = s.as_chunks_mut().0;
            inner.laws.aim(rows, g);
            Ok((inner.laws.tangent.clone().into(), arrays::from_rows(py, rows)))
        })
    }

    fn reactions<'py>(
        &self,
        py: Python<'py>,
        s: Matrix<'py>,
        g: Vector<'py>,
        dy: Vector<'py>,
        moved: Vector<'py>,
    ) -> PyResult<NewMatrix<'py>> {
        let mut s = self.values("s", &s)?;
        let dy = self.at_places("dy", &dy)?;
        let moved = self.at_places("moved", &moved)?;
        let g = self.at_places("g", &g)?;
        for_either!(&self.kind, inner => {
            let frames = &inner.interface.contacts.frames;
            inner.laws.reactions(frames, s.as_chunks_mut().0, g, (dy, moved));
            self.scale(&mut s);
            Ok(rows_of_laws(py, inner, &s))
        })
    }

    /// `b` of the places in the transposed system with right sides `rho` of the laws and `e` of
    /// the places, which this changes.
    fn pulled<'py>(
        &self,
        py: Python<'py>,
        rho: Matrix<'py>,
        mut e: Changed<'py>,
    ) -> PyResult<NewVector<'py>> {
        let mut rho = self.values("rho", &rho)?;
        self.scale(&mut rho);
        let e = e.as_slice_mut()?;
        arrays::length("e", e.len(), self.places)?;
        let b = for_either!(&self.kind, inner => inner.laws.pulled(rho.as_chunks().0, e));
        Ok(arrays::from_vec(py, b))
    }

    /// The multipliers of the laws, from `rho`, the right side `e` of the linear system, its
    /// solution `z`, and `A` times the pulled `z`.
    fn multipliers<'py>(
        &self,
        py: Python<'py>,
        rho: Matrix<'py>,
        e: Vector<'py>,
        z: Vector<'py>,
        moved: Vector<'py>,
    ) -> PyResult<NewMatrix<'py>> {
        let mut rho = self.values("rho", &rho)?;
        self.scale(&mut rho);
        let (e, z) = (self.at_places("e", &e)?, self.at_places("z", &z)?);
        let mut moved = self.at_places("moved", &moved)?.to_vec();
        for_either!(&self.kind, inner => {
            inner.laws.multipliers(rho.as_chunks_mut().0, e, z, &mut moved);
            Ok(rows_of_laws(py, inner, &rho))
        })
    }
}

impl PyLinearisedLaws {
    fn values(&self, what: &'static str, given: &Matrix<'_>) -> PyResult<Vec<f64>> {
        let flat = given.as_slice()?;
        arrays::length(what, flat.len(), self.factors.len())?;
        Ok(flat.to_vec())
    }

    fn at_places<'a>(&self, what: &'static str, given: &'a Vector<'_>) -> PyResult<&'a [f64]> {
        let values = given.as_slice()?;
        arrays::length(what, values.len(), self.places)?;
        Ok(values)
    }

    fn scale(&self, values: &mut [f64]) {
        for (value, t) in values.iter_mut().zip(&self.factors) {
            *value *= t;
        }
    }
}

fn factors_of<const D: usize>(variables: &InterfaceVariables<D>, closed: &[usize]) -> Vec<f64> {
    factors::<D>(closed, variables.elliptic.as_ref())
}

fn rows_of_laws<'py, const D: usize>(
    py: Python<'py>,
    _: &InterfaceLaws<D>,
    values: &[f64],
) -> NewMatrix<'py> {
    arrays::from_rows(py, values.as_chunks::<D>().0)
}
