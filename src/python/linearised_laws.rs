//! The linearised laws of contacts whose stiffness is held elsewhere, by the places of the
//! nodes of the interface.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::primal::linearised_laws::LinearisedLaws;
use crate::python::arrays::{self, Changed, Indices, Matrix, NewMatrix, NewVector, Vector};
use crate::python::contact_values::{laws, scale};
use crate::python::contact_variables::{Interface, PyContactTangent, PyContactVariables};
use crate::python::dimension::{Dimension, for_either, map_either};

/// Laws, and the interface of their contacts.
pub(super) struct InterfaceLaws<const D: usize> {
    pub(super) laws: LinearisedLaws<D>,
    interface: Arc<Interface<D>>,
}

/// The linearised laws of one step in the form of a Newton step.
#[pyclass(name = "LinearisedLaws", module = "bipot_rs._core")]
pub(super) struct PyLinearisedLaws {
    pub(super) kind: Dimension<InterfaceLaws<2>, InterfaceLaws<3>>,
    /// `T` of the contacts of the laws, component by component: `r = T r̃`.
    pub(super) factors: Vec<f64>,
    pub(super) places: usize,
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
        let own;
        let kind = map_either!(&variables.kind, variables => {
            let (given, factors) = laws(&closed, (&by_r, &by_v), &variables.factors())?;
            let interface = Arc::clone(&variables.interface);
            own = factors;
            match LinearisedLaws::new(&interface.contacts, &interface.free, &given) {
                Some(laws) => InterfaceLaws { laws, interface },
                None => return Ok(None),
            }
        });
        Ok(Some(Self {
            kind,
            factors: own,
            places: variables.places(),
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
        let mut s = arrays::numbers("s", &s, self.factors.len())?.to_vec();
        let g = arrays::numbers("g", &g, self.places)?;
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
        let mut s = arrays::numbers("s", &s, self.factors.len())?.to_vec();
        let dy = arrays::numbers("dy", &dy, self.places)?;
        let moved = arrays::numbers("moved", &moved, self.places)?;
        let g = arrays::numbers("g", &g, self.places)?;
        for_either!(&self.kind, inner => {
            let frames = &inner.interface.contacts.frames;
            inner.laws.reactions(frames, s.as_chunks_mut().0, g, (dy, moved));
        });
        scale(&mut s, &self.factors);
        Ok(arrays::of_contacts(py, s, self.kind.count()))
    }

    /// `b` of the places in the transposed system with right sides `rho` of the laws and `e` of
    /// the places, which this changes.
    fn pulled<'py>(
        &self,
        py: Python<'py>,
        rho: Matrix<'py>,
        mut e: Changed<'py>,
    ) -> PyResult<NewVector<'py>> {
        let rho = self.scaled(&rho)?;
        let e = arrays::changed("e", &mut e, self.places)?;
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
        let mut rho = self.scaled(&rho)?;
        let e = arrays::numbers("e", &e, self.places)?;
        let z = arrays::numbers("z", &z, self.places)?;
        let mut moved = arrays::numbers("moved", &moved, self.places)?.to_vec();
        for_either!(&self.kind, inner => {
            inner.laws.multipliers(rho.as_chunks_mut().0, e, z, &mut moved);
        });
        Ok(arrays::of_contacts(py, rho, self.kind.count()))
    }
}

impl PyLinearisedLaws {
    /// `T ρ`.
    fn scaled(&self, rho: &Matrix<'_>) -> PyResult<Vec<f64>> {
        let mut rho = arrays::numbers("rho", rho, self.factors.len())?.to_vec();
        scale(&mut rho, &self.factors);
        Ok(rho)
    }
}
