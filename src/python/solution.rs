//! What a solver and a load step return, as classes of Python. Arrays are in the variables of
//! the caller.

use std::borrow::Cow;

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::path::stepping::Step;
use crate::path::working_set::Set;
use crate::primal::load_step::Made;
use crate::primal::newton::Reason;
use crate::python::arrays;
use crate::reduced::elliptic_scaling::{EllipticScaling, over, times};
use crate::solver::Solution;
use crate::solver::paper::principles::minimising_sequence::Sequence;

/// The solution of one problem, or the best point that was reached.
#[pyclass(frozen, get_all, name = "ReducedSolution", module = "bipot_rs._core")]
pub(super) struct PySolution {
    reaction: Py<PyArray2<f64>>,
    relative_displacement: Py<PyArray2<f64>>,
    status: Py<PyArray1<i8>>,
    bipotential_gap: Py<PyArray1<f64>>,
    rigid_motion: Option<Py<PyArray1<f64>>>,
    free_motion: Option<Py<PyArray1<f64>>>,
    statuses_tried: u64,
    outcome: &'static str,
    residual: f64,
    tolerance: f64,
    iterations: usize,
    work: f64,
    history: Py<PyArray2<f64>>,
    minimising_sequence: Option<Py<PySequence>>,
    bytes_beside: usize,
    seconds: f64,
}

impl PySolution {
    pub(super) fn new<const D: usize>(
        py: Python<'_>,
        solution: &Solution<D>,
        elliptic: Option<&EllipticScaling>,
    ) -> PyResult<Self> {
        let reaction = times(elliptic, &solution.reaction);
        let relative_displacement = over(elliptic, &solution.relative_displacement);
        let numbers = reaction.iter().chain(&*relative_displacement);
        if !numbers.flatten().all(|c| c.is_finite()) || solution.residual.is_nan() {
            return Err(PyValueError::new_err(
                "W r + q is outside the range of doubles: the entries of W differ by too much; \
                 choose other units",
            ));
        }
        let amounts = |motion: &Vec<f64>| {
            (!motion.is_empty()).then(|| arrays::from_vec(py, motion.clone()).unbind())
        };
        let history = solution.history.iter();
        let history = history.map(|&(work, eta)| [work, eta]).collect::<Vec<_>>();
        let sequence = solution.sequence.as_ref();
        let sequence = sequence.map(|own| Py::new(py, PySequence::new(py, own, elliptic)));
        Ok(Self {
            reaction: arrays::from_rows(py, &reaction).unbind(),
            relative_displacement: arrays::from_rows(py, &relative_displacement).unbind(),
            status: arrays::from_status(py, &solution.status).unbind(),
            bipotential_gap: PyArray1::from_slice(py, &solution.bipotential_gap).unbind(),
            rigid_motion: amounts(&solution.rigid_motion),
            free_motion: amounts(&solution.free_motion),
            statuses_tried: solution.statuses_tried,
            outcome: solution.outcome.name(),
            residual: solution.residual,
            tolerance: solution.tolerance,
            iterations: solution.iterations,
            work: solution.work,
            history: arrays::from_rows(py, &history).unbind(),
            minimising_sequence: sequence.transpose()?,
            bytes_beside: solution.bytes_beside,
            seconds: solution.seconds,
        })
    }
}

/// The fields of a minimising sequence, a row of `d n_c` numbers for each.
#[pyclass(frozen, get_all, name = "SequenceFields", module = "bipot_rs._core")]
pub(super) struct PySequence {
    reaction: Py<PyArray2<f64>>,
    balanced_reaction: Py<PyArray2<f64>>,
    relative_displacement: Py<PyArray2<f64>>,
    bifunctional: Py<PyArray1<f64>>,
}

impl PySequence {
    fn new<const D: usize>(
        py: Python<'_>,
        sequence: &Sequence<D>,
        elliptic: Option<&EllipticScaling>,
    ) -> Self {
        fn stack<'a, const D: usize>(
            py: Python<'_>,
            fields: &'a [Vec<[f64; D]>],
            scale: impl Fn(&'a [[f64; D]]) -> Cow<'a, [[f64; D]]>,
        ) -> Py<PyArray2<f64>> {
            let columns = fields.first().map_or(0, |field| D * field.len());
            let rows = fields.iter();
            let flat = rows.flat_map(|field| scale(field).as_flattened().to_vec());
            arrays::square(py, flat.collect(), fields.len(), columns).unbind()
        }
        let force = |field| times(elliptic, field);
        let displacement = |field| over(elliptic, field);
        Self {
            reaction: stack(py, &sequence.reaction, force),
            balanced_reaction: stack(py, &sequence.balanced, force),
            relative_displacement: stack(py, &sequence.relative_displacement, displacement),
            bifunctional: arrays::from_vec(py, sequence.bifunctional.clone()).unbind(),
        }
    }
}

/// A step of a condensed problem.
#[pyclass(frozen, get_all, name = "LoadStep", module = "bipot_rs._core")]
pub(super) struct PyLoadStep {
    solution: Py<PySolution>,
    slip: Py<PyArray2<f64>>,
    opened: Py<PyArray1<bool>>,
    working_set: Option<Py<PyArray1<i64>>>,
    working_motion: Option<Py<PyArray1<f64>>>,
}

impl PyLoadStep {
    pub(super) fn new<const D: usize>(
        py: Python<'_>,
        step: &Step<D>,
        elliptic: Option<&EllipticScaling>,
        set: Option<Set>,
    ) -> PyResult<Self> {
        let (members, motion) = set.map(|set| (set.members, set.motion)).unzip();
        let motion = motion.filter(|motion| !motion.is_empty());
        Ok(Self {
            solution: Py::new(py, PySolution::new(py, &step.solution, elliptic)?)?,
            slip: slip(py, step, elliptic),
            opened: PyArray1::from_slice(py, &step.solution.opened).unbind(),
            working_set: members.map(|members| arrays::from_indices(py, members).unbind()),
            working_motion: motion.map(|motion| arrays::from_vec(py, motion).unbind()),
        })
    }
}

/// A step that Newton made in the displacements.
#[pyclass(frozen, get_all, name = "NewtonStep", module = "bipot_rs._core")]
pub(super) struct PyNewtonStep {
    solution: Py<PySolution>,
    slip: Py<PyArray2<f64>>,
    opened: Py<PyArray1<bool>>,
    newton: usize,
    krylov: usize,
    reason: Option<&'static str>,
    error_estimate: Option<(f64, f64)>,
    bytes_multigrid: usize,
}

impl PyNewtonStep {
    pub(super) fn new<V, const D: usize>(
        py: Python<'_>,
        made: &Made<V, D>,
        bytes_multigrid: usize,
        elliptic: Option<&EllipticScaling>,
    ) -> PyResult<Self> {
        let errors = made.errors;
        Ok(Self {
            solution: Py::new(py, PySolution::new(py, &made.step.solution, elliptic)?)?,
            slip: slip(py, &made.step, elliptic),
            opened: PyArray1::from_slice(py, &made.step.solution.opened).unbind(),
            newton: made.newton,
            krylov: made.krylov,
            reason: made.reason.map(Reason::text),
            error_estimate: errors.map(|by| (by.reaction, by.relative_displacement)),
            bytes_multigrid,
        })
    }
}

/// The tangential parts of the slip of a step.
fn slip<const D: usize>(
    py: Python<'_>,
    step: &Step<D>,
    elliptic: Option<&EllipticScaling>,
) -> Py<PyArray2<f64>> {
    let slip = over(elliptic, &step.slip);
    let flat = slip.iter().flat_map(|s| s[1..].to_vec()).collect();
    arrays::square(py, flat, step.slip.len(), D - 1).unbind()
}
