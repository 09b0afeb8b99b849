//! The linearised laws of contacts whose stiffness is held elsewhere, by the places of the
//! nodes of the interface.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::law::cone::Status;
use crate::primal::linearised_laws::LinearisedLaws;
use crate::primal::tangent::Tangent;
use crate::python::arrays::{self, Indices, Matrix, Vector};
use crate::python::contact_variables::{
    AnyInterface, Changed, Interface, PyContactTangent, PyContactVariables,
};
use crate::python::tangent::{factors, laws};
use crate::reduced::elliptic_scaling::EllipticScaling;

/// The laws of either dimension. Values of laws are flat, component by component.
trait Laws: Send + Sync {
    fn dimension(&self) -> usize;
    fn statuses(&self) -> &[Status];
    fn tangent(&self) -> PyContactTangent;
    fn aim(&mut self, s: &mut [f64], g: &[f64]);
    fn reactions(&self, s: &mut [f64], g: &[f64], moved: (&[f64], &[f64]));
    fn pulled(&self, rho: &[f64], e: &mut [f64]) -> Vec<f64>;
    fn multipliers(&self, rho: &mut [f64], e: &[f64], z: &[f64], moved: &mut [f64]);
}

struct Own<const D: usize> {
    laws: LinearisedLaws<D>,
    interface: Arc<Interface<D>>,
}

impl<const D: usize> Laws for Own<D>
where
    PyContactTangent: From<Tangent<D>>,
{
    fn dimension(&self) -> usize {
        D
    }

    fn statuses(&self) -> &[Status] {
        &self.laws.statuses
    }

    fn tangent(&self) -> PyContactTangent {
        self.laws.tangent.clone().into()
    }

    fn aim(&mut self, s: &mut [f64], g: &[f64]) {
        self.laws.aim(s.as_chunks_mut::<D>().0, g);
    }

    fn reactions(&self, s: &mut [f64], g: &[f64], moved: (&[f64], &[f64])) {
        let frames = &self.interface.contacts.frames;
        self.laws
            .reactions(frames, s.as_chunks_mut::<D>().0, g, moved);
    }

    fn pulled(&self, rho: &[f64], e: &mut [f64]) -> Vec<f64> {
        self.laws.pulled(rho.as_chunks::<D>().0, e)
    }

    fn multipliers(&self, rho: &mut [f64], e: &[f64], z: &[f64], moved: &mut [f64]) {
        let rho = rho.as_chunks_mut::<D>().0;
        self.laws.multipliers(rho, e, z, moved);
    }
}

/// The linearised laws of one step in the form of a Newton step.
#[pyclass(name = "LinearisedLaws", module = "bipot_rs._core")]
pub(super) struct PyLinearisedLaws {
    laws: Box<dyn Laws>,
    /// `T` of the contacts of the laws, component by component: `r = T r̃`.
    factors: Vec<f64>,
    places: usize,
}

/// A tangent, and right sides of laws.
type Aimed<'py> = (PyContactTangent, Bound<'py, PyArray2<f64>>);

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
        fn made<const D: usize>(
            interface: &Arc<Interface<D>>,
            elliptic: Option<&EllipticScaling>,
            (closed, by_r, by_v): (&[usize], &Matrix<'_>, &Matrix<'_>),
        ) -> PyResult<Option<PyLinearisedLaws>>
        where
            PyContactTangent: From<Tangent<D>>,
        {
            let by_r = arrays::rows_of::<D>("by_r", by_r, D * closed.len())?;
            let by_v = arrays::rows_of::<D>("by_v", by_v, D * closed.len())?;
            let order: Vec<usize> = (0..interface.contacts.count()).collect();
            let factor = |i: usize, k: usize| elliptic.map_or(1.0, |s| s.factor(i, k));
            let given = laws(closed, &order, (by_r, by_v), factor)?;
            let own = LinearisedLaws::new(&interface.contacts, &interface.free, &given);
            Ok(own.map(|laws| PyLinearisedLaws {
                laws: Box::new(Own {
                    laws,
                    interface: Arc::clone(interface),
                }),
                factors: factors::<D>(closed, elliptic),
                places: interface.free.len(),
            }))
        }
        let closed = arrays::indices(&closed, "closed")?;
        let given = (&closed[..], &by_r, &by_v);
        let elliptic = variables.elliptic.as_ref();
        match &variables.kind {
            AnyInterface::Two(inner) => made(inner, elliptic, given),
            AnyInterface::Three(inner) => made(inner, elliptic, given),
        }
    }

    /// The `Status` of each contact, whose preconditioner fits.
    #[getter]
    fn statuses<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i8>> {
        let numbers = self.laws.statuses().iter().map(|&status| status as i8);
        PyArray1::from_vec(py, numbers.collect())
    }

    /// The tangent without right sides.
    #[getter]
    fn tangent(&self) -> PyContactTangent {
        self.laws.tangent()
    }

    /// The tangent for right sides `s` of the laws and `g` of the places, and `s` multiplied.
    fn aim<'py>(
        &mut self,
        py: Python<'py>,
        s: Matrix<'py>,
        g: Vector<'py>,
    ) -> PyResult<Aimed<'py>> {
        let mut s = self.values("s", &s)?;
        self.laws.aim(&mut s, self.at_places("g", &g)?);
        Ok((
            self.laws.tangent(),
            arrays::of_contacts(py, s, self.laws.dimension())?,
        ))
    }

    /// `dr` of the laws, from their multiplied right sides, `g`, `dy` and `A dy`.
    fn reactions<'py>(
        &self,
        py: Python<'py>,
        s: Matrix<'py>,
        g: Vector<'py>,
        dy: Vector<'py>,
        moved: Vector<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut s = self.values("s", &s)?;
        let dy = self.at_places("dy", &dy)?;
        let moved = self.at_places("moved", &moved)?;
        let g = self.at_places("g", &g)?;
        self.laws.reactions(&mut s, g, (dy, moved));
        self.scale(&mut s);
        arrays::of_contacts(py, s, self.laws.dimension())
    }

    /// `b` of the places in the transposed system with right sides `rho` of the laws and `e` of
    /// the places, which this changes.
    fn pulled<'py>(
        &self,
        py: Python<'py>,
        rho: Matrix<'py>,
        mut e: Changed<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mut rho = self.values("rho", &rho)?;
        self.scale(&mut rho);
        let e = e.as_slice_mut()?;
        arrays::length("e", e.len(), self.places)?;
        Ok(arrays::from_vec(py, self.laws.pulled(&rho, e)))
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
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut rho = self.values("rho", &rho)?;
        self.scale(&mut rho);
        let (e, z) = (self.at_places("e", &e)?, self.at_places("z", &z)?);
        let mut moved = self.at_places("moved", &moved)?.to_vec();
        self.laws.multipliers(&mut rho, e, z, &mut moved);
        arrays::of_contacts(py, rho, self.laws.dimension())
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
