//! Statics: whether reactions balance the loads.

use std::sync::atomic::AtomicBool;

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::equilibrium::decide::{Decision, decide};
use crate::equilibrium::minimise::ConeSet;
use crate::equilibrium::multiplier::find_limit;
use crate::equilibrium::programme::Limits;
use crate::equilibrium::statics::Statics;
use crate::error::{Error, check_length};
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::python::arrays::{
    Csr, CsrArrays, Indices, NewVector, Vector, from_vec, indices, numbers,
};
use crate::python::interrupt;

/// The contacts of a question of statics.
#[pyclass(frozen, name = "Statics", module = "bipot_rs._core")]
pub(super) struct PyStatics {
    statics: Statics,
}

#[pymethods]
impl PyStatics {
    /// `R` by rows, its number of columns, the number of rows of each contact, the friction
    /// coefficient of each row, and the cohesion of each contact.
    #[new]
    fn new(
        rows: Csr<'_>,
        motions: usize,
        sizes: Indices<'_>,
        friction: Vector<'_>,
        cohesion: Vector<'_>,
    ) -> PyResult<Self> {
        let csr = CsrArrays::new(&rows, "R", None)?;
        let (friction, cohesion) = (friction.as_slice()?, cohesion.as_slice()?);
        let sizes = indices(&sizes, "sizes")?;
        let statics = Statics::new(
            csr.rows(),
            motions,
            &sizes,
            friction.to_vec(),
            cohesion.to_vec(),
        )?;
        Ok(Self { statics })
    }

    #[pyo3(signature = (load, max_seconds=None))]
    fn decide(
        &self,
        py: Python<'_>,
        load: Vector<'_>,
        max_seconds: Option<f64>,
    ) -> PyResult<PyDecision> {
        let load = load.as_slice()?;
        let decision = run(py, max_seconds, |limits| {
            decide(&self.statics, load, limits)
        })?;
        Ok(PyDecision::new(py, decision))
    }

    fn find_limit(
        &self,
        py: Python<'_>,
        dead: Vector<'_>,
        live: Vector<'_>,
    ) -> PyResult<PyLimitLoad> {
        let (dead, live) = (dead.as_slice()?, live.as_slice()?);
        let limit = run(py, None, |limits| {
            find_limit(&self.statics, dead, live, limits)
        })?;
        let (reached, reaction) = limit.reached.unzip();
        Ok(PyLimitLoad {
            upper: limit.upper,
            mechanism: from_vec(py, limit.mechanism).unbind(),
            excluded: limit.excluded,
            reached,
            reaction: reaction.map(|r| from_vec(py, r).unbind()),
            dead: Py::new(py, PyDecision::new(py, limit.dead))?,
        })
    }
}

fn run<T: Send>(
    py: Python<'_>,
    max_seconds: Option<f64>,
    work: impl FnOnce(Limits) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let seconds = max_seconds.unwrap_or(f64::INFINITY);
    interrupt::run(py, None, |stop: &AtomicBool| {
        work(Limits::new(stop, seconds))
    })
}

/// A product of circular cones over which linear functions are minimised.
#[pyclass(frozen, name = "ConeSet", module = "bipot_rs._core")]
pub(super) struct PyConeSet {
    set: ConeSet,
}

#[pymethods]
impl PyConeSet {
    #[new]
    fn new(
        rows: Csr<'_>,
        offset: Vector<'_>,
        sizes: Indices<'_>,
        equations: Csr<'_>,
        right: Vector<'_>,
        unknowns: usize,
    ) -> PyResult<Self> {
        let own = |csr: &Csr<'_>, rows: usize| -> PyResult<OwnedMatrix> {
            let csr = CsrArrays::new(csr, "cones", None)?;
            let view = csr.rows();
            view.check("cones", rows, unknowns)?;
            Ok(view.select(Some))
        };
        let (offset, right) = (offset.as_slice()?.to_vec(), right.as_slice()?.to_vec());
        let sizes = indices(&sizes, "sizes")?;
        let count = sizes.iter().fold(0, |sum: usize, &n| sum.saturating_add(n));
        check_length("sizes", count, offset.len())?;
        let set = ConeSet {
            rows: own(&rows, offset.len())?,
            equations: own(&equations, right.len())?,
            offset,
            sizes,
            right,
            unknowns,
            ..ConeSet::default()
        };
        Ok(Self { set })
    }

    fn minimise<'py>(
        &self,
        py: Python<'py>,
        cost: Vector<'py>,
    ) -> PyResult<(NewVector<'py>, bool, f64)> {
        let cost = numbers("cost", &cost, self.set.unknowns)?;
        let optimum = run(py, None, |limits| self.set.minimise(cost, limits))?;
        Ok((from_vec(py, optimum.y), optimum.bounded, optimum.gap))
    }
}

/// Whether reactions balance the loads, with the proof.
#[pyclass(frozen, get_all, name = "Decision", module = "bipot_rs._core")]
pub(super) struct PyDecision {
    verdict: &'static str,
    reaction: Py<PyArray1<f64>>,
    motion: Py<PyArray1<f64>>,
    margin: f64,
    relative_margin: f64,
    inside: bool,
    excluded: f64,
    imbalance: f64,
}

impl PyDecision {
    fn new(py: Python<'_>, decision: Decision) -> Self {
        Self {
            verdict: decision.verdict.name(),
            inside: decision.inside(),
            reaction: from_vec(py, decision.reaction).unbind(),
            motion: from_vec(py, decision.motion).unbind(),
            margin: decision.margin,
            relative_margin: decision.relative_margin,
            excluded: decision.excluded,
            imbalance: decision.imbalance,
        }
    }
}

/// The largest multiple of a load, from both sides.
#[pyclass(frozen, get_all, name = "LimitLoad", module = "bipot_rs._core")]
pub(super) struct PyLimitLoad {
    upper: f64,
    mechanism: Py<PyArray1<f64>>,
    excluded: f64,
    reached: Option<f64>,
    reaction: Option<Py<PyArray1<f64>>>,
    dead: Py<PyDecision>,
}
