//! Derivatives of the steps of a load path in the displacements.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::check_length;
use crate::linalg::amg::following::Following;
use crate::primal::linearised::LinearisedStep;
use crate::primal::linearised_laws::LinearisedLaws;
use crate::python::arrays::{self, CsrOutput, NewVector, Vector};
use crate::python::contact_values::scale;
use crate::python::dimension::{Dimension, for_either};
use crate::python::interrupt;
use crate::python::linearised_laws::PyLinearisedLaws;
use crate::python::primal::{PrimalArrays, PyPrimal};
use crate::tasks::lock;

/// Linearised steps in the displacements, whose unknowns take the place of rigid motions.
#[pyclass(frozen, name = "PrimalTangent", module = "bipot_rs._core")]
pub(super) struct PyPrimalTangent {
    kind: Dimension<PrimalArrays<2>, PrimalArrays<3>>,
    /// The hierarchy of the last linear system.
    hierarchy: Mutex<Option<Following>>,
}

#[pymethods]
impl PyPrimalTangent {
    #[new]
    fn new(problem: &PyPrimal) -> Self {
        Self {
            kind: problem.kind.clone(),
            hierarchy: Mutex::new(None),
        }
    }

    #[getter]
    fn order(&self) -> usize {
        for_either!(&self.kind, inner => inner.problem.order())
    }

    fn stiffness<'py>(&self, py: Python<'py>) -> CsrOutput<'py> {
        let matrix = for_either!(&self.kind, inner => inner.problem.stiffness_by_rows());
        arrays::from_csr(py, matrix)
    }

    fn force<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<NewVector<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        let force = for_either!(&self.kind, inner => inner.problem.force(load, prescribed)?);
        Ok(arrays::from_vec(py, force.values))
    }

    fn displacement<'py>(
        &self,
        py: Python<'py>,
        y: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<NewVector<'py>> {
        let prescribed = prescribed.as_slice()?;
        let y = arrays::numbers("y", &y, self.order())?;
        let u = for_either!(&self.kind, inner => inner.problem.displacement(y, prescribed));
        Ok(arrays::from_vec(py, u))
    }

    fn solve<'py>(
        &self,
        py: Python<'py>,
        laws: &PyLinearisedLaws,
        right: Vector<'py>,
        transposed: bool,
    ) -> PyResult<Option<NewVector<'py>>> {
        check_length("places of laws", laws.places, self.order())?;
        let (factors, right) = (&laws.factors, right.as_slice()?);
        let found = match (&self.kind, &laws.kind) {
            (Dimension::Plane(inner), Dimension::Plane(own)) => {
                self.solved(py, inner, (&own.laws, factors), right, transposed)?
            }
            (Dimension::Space(inner), Dimension::Space(own)) => {
                self.solved(py, inner, (&own.laws, factors), right, transposed)?
            }
            _ => return Err(PyValueError::new_err("laws are of another dimension")),
        };
        Ok(found.map(|x| arrays::from_vec(py, x)))
    }
}

impl PyPrimalTangent {
    fn solved<const D: usize>(
        &self,
        py: Python<'_>,
        arrays: &PrimalArrays<D>,
        (laws, factors): (&LinearisedLaws<D>, &[f64]),
        right: &[f64],
        transposed: bool,
    ) -> PyResult<Option<Vec<f64>>> {
        let problem = &arrays.problem;
        let m = factors.len();
        check_length("right", right.len(), m + problem.order())?;
        let (mut own, mut rest) = (right[..m].to_vec(), right[m..].to_vec());
        let run = |stop: &AtomicBool| {
            let mut system = LinearisedStep::new(problem, laws.clone());
            let mut hierarchy = lock(&self.hierarchy);
            // r = T r̃.
            let reached = if transposed {
                scale(&mut own, factors);
                let own = own.as_chunks_mut().0;
                system.solve_transposed(own, &mut rest, &mut hierarchy, stop)?
            } else {
                let rows = own.as_chunks_mut().0;
                let reached = system.solve(rows, &mut rest, &mut hierarchy, stop)?;
                scale(&mut own, factors);
                reached
            };
            own.extend(rest);
            Ok(reached.then_some(own))
        };
        interrupt::run(py, arrays.num_threads, run)
    }
}
