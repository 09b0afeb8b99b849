//! The reduced problem.

use pyo3::prelude::*;

use crate::error::check_length;
use crate::proof::uniqueness;
use crate::python::arrays::{self, Csr, Indices, LawArrays, Matrix, Vector};
use crate::python::bound::{self, PyBound};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::estimate::{self, Estimate};
use crate::python::reduced_arrays::{Answers, IslandArrays, ReducedArrays};
use crate::python::solution::PySolution;
use crate::python::solver::PySettings;
use crate::python::tangent::{self, PyTangentSystem};
use crate::reduced::existence::is_contradiction;

/// A reduced problem `v = W r + R a + q` in the numbering of the caller.
#[pyclass(frozen, name = "Reduced", module = "bipot_rs._core")]
pub(super) struct PyReduced {
    kind: Dimension<ReducedArrays<2>, ReducedArrays<3>>,
}

#[pymethods]
impl PyReduced {
    /// `parts` has (contacts, values, pattern) for each island: a dense row-major matrix
    /// without a pattern, or blocks with (first block of a row, columns). `modes` is `R` by rows.
    #[new]
    fn new(
        py: Python<'_>,
        parts: Vec<IslandArrays>,
        q: Matrix<'_>,
        law: LawArrays<'_>,
        modes: Csr<'_>,
        load: Vector<'_>,
    ) -> PyResult<Self> {
        let kind = map_either!(Dimension::of(q.as_array().ncols()), () => {
            let problem = ReducedArrays::new(py, parts, &q, &law, &modes, &load)?;
            // The checks that only the core makes.
            problem.run(py, None, None, |_, _, _| Ok(()))?;
            problem
        });
        Ok(Self { kind })
    }

    #[getter]
    fn asymmetry(&self, py: Python<'_>) -> PyResult<f64> {
        for_either!(&self.kind, problem => {
            problem.with_compliance(py, None, None, |given, _, _| Ok(given.asymmetry()))
        })
    }

    #[pyo3(signature = (reaction, rigid=None))]
    fn residual(
        &self,
        py: Python<'_>,
        reaction: Matrix<'_>,
        rigid: Option<Vector<'_>>,
    ) -> PyResult<f64> {
        let rigid = rigid.as_ref().map(|a| a.as_slice()).transpose()?;
        for_either!(&self.kind, problem => problem.residual(py, &reaction, rigid))
    }

    fn is_contradiction(&self, py: Python<'_>, amounts: Vector<'_>) -> PyResult<bool> {
        let amounts = amounts.as_slice()?;
        for_either!(&self.kind, problem => {
            check_length("witness", amounts.len(), problem.contacts())?;
            problem.run(py, None, None, |problem, _, _| {
                Ok(is_contradiction(problem, &problem.compliance.gather(amounts)))
            })
        })
    }

    #[pyo3(signature = (settings, reaction, rigid, num_threads, callback=None))]
    fn solve(
        &self,
        py: Python<'_>,
        settings: &PySettings,
        reaction: Option<Matrix<'_>>,
        rigid: Option<Vector<'_>>,
        num_threads: Option<usize>,
        callback: Option<Py<PyAny>>,
    ) -> PyResult<PySolution> {
        let rigid = rigid.map_or(Ok(Vec::new()), |a| a.as_slice().map(<[f64]>::to_vec))?;
        let start = (reaction.as_ref(), rigid);
        let callback = callback.as_ref();
        for_either!(&self.kind, problem => {
            problem.solve(py, &settings.checked, start, num_threads, callback)
        })
    }

    fn answers(&self, py: Python<'_>) -> PyResult<Option<Answers>> {
        match &self.kind {
            Dimension::Plane(problem) => problem.answers(py),
            Dimension::Space(_) => Ok(None),
        }
    }

    #[pyo3(signature = (reaction, num_threads=None))]
    fn assess(
        &self,
        py: Python<'_>,
        reaction: Matrix<'_>,
        num_threads: Option<usize>,
    ) -> PyResult<&'static str> {
        let unique = match &self.kind {
            Dimension::Plane(problem) => {
                problem.assess(py, &reaction, num_threads, uniqueness::assess_plane)
            }
            Dimension::Space(problem) => {
                problem.assess(py, &reaction, num_threads, uniqueness::assess)
            }
        };
        Ok(unique?.name())
    }

    #[pyo3(signature = (reaction, rigid, num_threads=None))]
    fn forward_errors(
        &self,
        py: Python<'_>,
        reaction: Matrix<'_>,
        rigid: Vector<'_>,
        num_threads: Option<usize>,
    ) -> PyResult<Estimate> {
        let rigid = rigid.as_slice()?;
        for_either!(&self.kind, problem => {
            problem.check_motion(rigid)?;
            let reaction = problem.reaction(&reaction)?;
            problem.run(py, num_threads, None, |problem, stop, _| {
                estimate::of_reduced(problem, &reaction, rigid, stop)
            })
        })
    }

    #[pyo3(signature = (reactions, points, rigid, reported=None, num_threads=None))]
    fn error_bounds(
        &self,
        py: Python<'_>,
        reactions: Matrix<'_>,
        points: usize,
        rigid: Vector<'_>,
        reported: Option<Matrix<'_>>,
        num_threads: Option<usize>,
    ) -> PyResult<Vec<PyBound>> {
        let points = bound::Points {
            reactions: &reactions,
            count: points,
            rigid: rigid.as_slice()?,
            reported: reported.as_ref(),
        };
        for_either!(&self.kind, problem => bound::of_reduced(problem, py, &points, num_threads))
    }

    fn tangent(
        &self,
        py: Python<'_>,
        closed: Indices<'_>,
        by_r: Matrix<'_>,
        by_v: Matrix<'_>,
    ) -> PyResult<Option<PyTangentSystem>> {
        let closed = arrays::indices(&closed, "closed")?;
        for_either!(&self.kind, problem => tangent::of_reduced(problem, py, &closed, (&by_r, &by_v)))
    }
}
