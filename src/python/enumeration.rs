//! The number of solutions, and all solutions.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::condensation::problem::Problem;
use crate::error::Error;
use crate::path::stepping::reduced_step;
use crate::proof::uniqueness;
use crate::python::arrays::{Matrix, Vector};
use crate::python::interrupt;
use crate::python::solver::solution_dict;
use crate::python::{problem, solver};
use crate::solver::enumerate;
use crate::solver::{Settings, certified};

/// The solutions, and whether there are no others.
type Answers<'py> = (Vec<Bound<'py, PyDict>>, bool);

/// All solutions of a small plane problem, found by trying all statuses.
#[pyfunction]
pub(super) fn answers<'py>(
    py: Python<'py>,
    problem: &solver::PyReduced,
) -> PyResult<Option<Answers<'py>>> {
    let solver::AnyReduced::Two(owned) = &problem.kind else {
        return Ok(None);
    };
    if owned.contacts() > enumerate::MOST_CONTACTS {
        return Ok(None);
    }
    let (all, complete) = owned.run(py, Some(1), None, |reduced, stop, _| {
        let found = enumerate::answers(reduced, stop)?;
        let as_solution =
            |(r, a): &(Vec<_>, Vec<_>)| certified(reduced, &Settings::default(), r, a, stop);
        let all: Result<Vec<_>, Error> = found.answers.iter().map(as_solution).collect();
        Ok((all?, found.complete))
    })?;
    let dicts = all.iter().map(|solution| solution_dict(py, solution, None));
    Ok(Some((dicts.collect::<PyResult<_>>()?, complete)))
}

/// What one solution implies for the number of solutions.
#[pyfunction]
#[pyo3(signature = (problem, reaction, num_threads=None))]
pub(super) fn assess(
    py: Python<'_>,
    problem: &solver::PyReduced,
    reaction: Matrix<'_>,
    num_threads: Option<usize>,
) -> PyResult<&'static str> {
    let verdict = match &problem.kind {
        solver::AnyReduced::Two(owned) => {
            let r = owned.reaction(&reaction)?;
            owned.run(py, num_threads, None, |problem, stop, _| {
                uniqueness::assess_plane(problem, &problem.compliance.gather(&r), stop)
            })?
        }
        solver::AnyReduced::Three(owned) => {
            let r = owned.reaction(&reaction)?;
            owned.run(py, num_threads, None, |problem, stop, _| {
                uniqueness::assess(problem, &problem.compliance.gather(&r), stop)
            })?
        }
    };
    Ok(verdict.name())
}

/// The same for a step of a load path, from the total loads and the total relative displacement
/// after the step before.
#[pyfunction]
#[pyo3(signature = (problem, load, prescribed, before, reaction))]
pub(super) fn assess_step(
    py: Python<'_>,
    problem: &problem::PyCondensed,
    load: Vector<'_>,
    prescribed: Vector<'_>,
    before: Option<Matrix<'_>>,
    reaction: Matrix<'_>,
) -> PyResult<&'static str> {
    let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
    macro_rules! of {
        ($inner:expr, $assess:path) => {{
            let contacts = $inner.contacts();
            let state = problem.left(before.as_ref(), contacts)?;
            let reaction = problem.reaction(&reaction, contacts)?;
            let Problem::Whole(whole) = &**$inner else {
                // Contacts outside a working set are only known to be open in this solution.
                return Ok(uniqueness::Unique::Unknown.name());
            };
            let r = whole.compliance().gather(&reaction);
            interrupt::run(py, problem.num_threads, |stop| {
                let reduced = reduced_step(whole, load, prescribed, state.as_ref())?;
                $assess(&reduced, &r, stop)
            })?
        }};
    }
    let verdict = match &problem.kind {
        problem::AnyProblem::Two(inner) => of!(inner, uniqueness::assess_plane),
        problem::AnyProblem::Three(inner) => of!(inner, uniqueness::assess),
    };
    Ok(verdict.name())
}
