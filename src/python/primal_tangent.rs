//! Derivatives of the steps of a load path in the displacements.

use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;

use crate::error::check_length;
use crate::linalg::amg::following::Following;
use crate::primal::linearised::LinearisedStep;
use crate::python::arrays::{self, CsrOutput, Indices, Matrix, NewMatrix, NewVector, Vector};
use crate::python::contact_values::{diagonal, factors, laws, moved, offsets, scale, work};
use crate::python::dimension::{Dimension, for_either};
use crate::python::interrupt;
use crate::python::primal::{PrimalArrays, PyPrimal};
use crate::python::tangent::Free;

/// Linearised steps in the displacements, whose unknowns take the place of rigid motions.
#[pyclass(frozen, name = "PrimalTangent", module = "bipot_rs._core")]
pub(super) struct PyPrimalTangent {
    kind: Dimension<PrimalArrays<2>, PrimalArrays<3>>,
    /// `T` of all contacts, component by component.
    factors: Vec<f64>,
    /// The hierarchy of the last linear system.
    hierarchy: Mutex<Option<Following>>,
}

/// The arguments of a linear system: contacts, laws and right side.
type Given<'a, 'py> = (&'a [usize], (&'a Matrix<'py>, &'a Matrix<'py>), &'a [f64]);

#[pymethods]
impl PyPrimalTangent {
    #[new]
    fn new(problem: &PyPrimal) -> Self {
        let kind = problem.kind.clone();
        let factors = for_either!(&kind, inner => {
            let contacts = 0..inner.problem.contacts.count();
            factors(kind.count(), contacts, inner.elliptic.as_ref())
        });
        Self {
            kind,
            factors,
            hierarchy: Mutex::new(None),
        }
    }

    #[getter]
    fn diagonal<'py>(&self, py: Python<'py>) -> NewMatrix<'py> {
        let own = for_either!(&self.kind, inner => {
            diagonal(&inner.problem.contacts, &self.factors)
        });
        self.square(py, own)
    }

    #[getter]
    fn order(&self) -> usize {
        for_either!(&self.kind, inner => inner.problem.order())
    }

    fn stiffness<'py>(&self, py: Python<'py>) -> CsrOutput<'py> {
        let matrix = for_either!(&self.kind, inner => inner.problem.stiffness_by_rows());
        arrays::from_csr(py, matrix)
    }

    fn free_part<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<Free<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        let (q, e) = for_either!(&self.kind, inner => {
            let e = inner.problem.force(load, prescribed)?.values;
            (offsets(&inner.problem.contacts, &self.factors, prescribed), e)
        });
        Ok((self.square(py, q), arrays::from_vec(py, e)))
    }

    fn moved<'py>(&self, py: Python<'py>, y: Vector<'py>) -> PyResult<NewMatrix<'py>> {
        let y = arrays::numbers("y", &y, self.order())?;
        let v = for_either!(&self.kind, inner => moved(&inner.problem.contacts, &self.factors, y));
        Ok(self.square(py, v))
    }

    fn work<'py>(&self, py: Python<'py>, v: Matrix<'py>) -> PyResult<NewVector<'py>> {
        let y = for_either!(&self.kind, inner => {
            work(&inner.problem.contacts, &self.factors, &v, inner.problem.order())?
        });
        Ok(arrays::from_vec(py, y))
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
        closed: Indices<'py>,
        by_r: Matrix<'py>,
        by_v: Matrix<'py>,
        right: Vector<'py>,
        transposed: bool,
    ) -> PyResult<Option<NewVector<'py>>> {
        let closed = arrays::indices(&closed, "closed")?;
        let given = (&closed[..], (&by_r, &by_v), right.as_slice()?);
        let found = for_either!(&self.kind, inner => {
            self.solved(py, inner, given, transposed)?
        });
        Ok(found.map(|x| arrays::from_vec(py, x)))
    }
}

impl PyPrimalTangent {
    fn square<'py>(&self, py: Python<'py>, values: Vec<f64>) -> NewMatrix<'py> {
        arrays::of_contacts(py, values, self.kind.count())
    }

    fn solved<const D: usize>(
        &self,
        py: Python<'_>,
        arrays: &PrimalArrays<D>,
        (closed, law, right): Given<'_, '_>,
        transposed: bool,
    ) -> PyResult<Option<Vec<f64>>> {
        let problem = &arrays.problem;
        let m = D * closed.len();
        check_length("right", right.len(), m + problem.order())?;
        let (laws, factors) = laws(closed, law, &self.factors)?;
        let (mut own, mut rest) = (right[..m].to_vec(), right[m..].to_vec());
        let run = |stop: &AtomicBool| {
            let Some(mut system) = LinearisedStep::new(problem, &laws) else {
                return Ok(None);
            };
            let mut hierarchy = self
                .hierarchy
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            // r = T r̃.
            let reached = if transposed {
                scale(&mut own, &factors);
                let own = own.as_chunks_mut().0;
                system.solve_transposed(own, &mut rest, &mut hierarchy, stop)?
            } else {
                let rows = own.as_chunks_mut().0;
                let reached = system.solve(rows, &mut rest, &mut hierarchy, stop)?;
                scale(&mut own, &factors);
                reached
            };
            own.extend(rest);
            Ok(reached.then_some(own))
        };
        interrupt::run(py, arrays.num_threads, run)
    }
}
