//! A load path in progress.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::condensation::problem::Problem;
use crate::error::Error;
use crate::law::cone::Status;
use crate::path::stepping::{State, Step};
use crate::path::working_set;
use crate::primal::newton::{Errors, Reason};
use crate::python::arrays::{self, Indices, Matrix, Vector};
use crate::python::interrupt;
use crate::python::problem::{AnyProblem, PyCondensed, moved};
use crate::python::solver::{settings, solution_dict};
use crate::reduced::elliptic_scaling::{EllipticScaling, over, times};
use crate::solver::{Outcome, Settings};
use crate::tasks;
use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

enum AnyPath {
    Two(Arc<Problem<2>>, working_set::WorkingSetPath<2>),
    Three(Arc<Problem<3>>, working_set::WorkingSetPath<3>),
}

/// A load path in progress. Without a state it starts from the unloaded bodies.
#[pyclass(name = "Path", module = "bipot_rs._core")]
pub(super) struct PyPath {
    progress: AnyPath,
    elliptic: Option<EllipticScaling>,
    num_threads: Option<usize>,
}

/// Reaction, total relative displacement, status and rigid motion of a step.
type StartArrays<'py> = (Matrix<'py>, Matrix<'py>, Statuses<'py>, Vector<'py>);

/// Status of each contact.
type Statuses<'py> = numpy::PyReadonlyArray1<'py, i8>;

/// The same without rigid motions, of a path in the displacements.
pub(super) type ContactArrays<'py> = (Matrix<'py>, Matrix<'py>, Statuses<'py>);

/// The state of `count` contacts after a step, without rigid motions.
pub(super) fn state_of_contacts<const D: usize>(
    count: usize,
    elliptic: Option<&EllipticScaling>,
    (reaction, displacement, status): (&Matrix<'_>, &Matrix<'_>, &Statuses<'_>),
) -> PyResult<State<D>> {
    let status = status.as_slice()?.iter().map(|s| match s {
        1 => Status::Slip,
        2 => Status::Stick,
        _ => Status::Open,
    });
    let reaction = arrays::rows_of("start", reaction, count)?;
    let displacement = arrays::rows_of("start", displacement, count)?;
    let state = State {
        reaction: over(elliptic, reaction).into_owned(),
        relative_displacement: times(elliptic, displacement).into_owned(),
        status: status.collect(),
        rigid: Vec::new(),
    };
    arrays::length("start", state.status.len(), count)?;
    Ok(state)
}

fn state<const D: usize>(
    problem: &Problem<D>,
    elliptic: Option<&EllipticScaling>,
    (reaction, displacement, status, rigid): &StartArrays<'_>,
) -> PyResult<State<D>> {
    let contacts = (reaction, displacement, status);
    let mut state = state_of_contacts(problem.contacts(), elliptic, contacts)?;
    state.rigid = rigid.as_slice()?.to_vec();
    let motions = problem.bodies().motions().len();
    arrays::length("start", state.rigid.len(), motions)?;
    Ok(state)
}

/// Contacts of a working set, rigid motions of the bodies condensed onto all contacts, and
/// whether the inverse of its `W` has been made.
type SetArrays<'py> = (Indices<'py>, Vector<'py>, bool);

fn set<const D: usize>(
    problem: &Problem<D>,
    (members, motion, inverse): &SetArrays<'_>,
) -> PyResult<working_set::Set> {
    let members = arrays::indices(members, "working_set of start")?;
    let ascending = members.is_sorted_by(|a, b| a < b);
    if !ascending || members.last().is_some_and(|&i| i >= problem.contacts()) {
        return Err(PyValueError::new_err(format!(
            "working_set of start must hold ascending contact numbers below {}",
            problem.contacts()
        )));
    }
    Ok(working_set::Set {
        members,
        motion: motion.as_slice()?.to_vec(),
        inverse: *inverse,
    })
}

/// The tangential parts of the slip of a step.
pub(super) fn slip_array<'py, const D: usize>(
    py: Python<'py>,
    step: &Step<D>,
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let slip = over(elliptic, &step.slip);
    let flat = slip.iter().flat_map(|s| s[1..].to_vec()).collect();
    arrays::square(py, flat, step.slip.len(), D - 1)
}

fn step_dict<'py, const D: usize>(
    py: Python<'py>,
    step: &Step<D>,
    elliptic: Option<&EllipticScaling>,
    set: Option<working_set::Set>,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = solution_dict(py, &step.solution, elliptic)?;
    dict.set_item("slip", slip_array(py, step, elliptic)?)?;
    let set = set.map(|set| {
        let members = arrays::from_indices(py, set.members)?;
        PyResult::Ok((members, arrays::from_vec(py, set.motion)))
    });
    dict.set_item("working_set", set.transpose()?)?;
    Ok(dict)
}

/// Makes a step. Its state is then rounded as if the caller had stored and returned it in the
/// caller's variables.
fn advance<const D: usize>(
    path: &mut working_set::WorkingSetPath<D>,
    problem: &Problem<D>,
    (load, prescribed): (&[f64], &[f64]),
    elliptic: Option<&EllipticScaling>,
    settings: &Settings,
    stop: &AtomicBool,
) -> Result<Step<D>, Error> {
    let step = path.advance(problem, load, prescribed, settings, stop)?;
    if let (Some(elliptic), Outcome::Converged) = (elliptic, step.solution.outcome) {
        path.restate(|state| {
            state.reaction = elliptic.over(&elliptic.times(&state.reaction));
            let v = elliptic.over(&state.relative_displacement);
            state.relative_displacement = elliptic.times(&v);
        });
    }
    Ok(step)
}

/// What every step in the displacements has: its solution, Newton steps and Krylov iterations,
/// why it stalled, and the estimated errors.
pub(super) fn newton_dict<'py, const D: usize>(
    py: Python<'py>,
    step: &Step<D>,
    (newton, krylov): (usize, usize),
    (reason, errors): (Option<Reason>, Option<Errors>),
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = solution_dict(py, &step.solution, elliptic)?;
    dict.set_item("slip", slip_array(py, step, elliptic)?)?;
    dict.set_item("newton", newton)?;
    dict.set_item("krylov", krylov)?;
    dict.set_item("reason", reason.map(Reason::text))?;
    let errors = errors.map(|by| (by.reaction, by.relative_displacement));
    dict.set_item("error_estimate", errors)?;
    Ok(dict)
}

#[pymethods]
impl PyPath {
    #[new]
    #[pyo3(signature = (problem, start=None, working_set=None))]
    fn new(
        problem: &PyCondensed,
        start: Option<StartArrays<'_>>,
        working_set: Option<SetArrays<'_>>,
    ) -> PyResult<Self> {
        let elliptic = problem.elliptic.as_ref();
        let progress = match &problem.kind {
            AnyProblem::Two(inner) => {
                let state = start.as_ref().map(|arrays| state(inner, elliptic, arrays));
                let set = working_set.as_ref().map(|arrays| set(inner, arrays));
                let path = working_set::WorkingSetPath::new(state.transpose()?, set.transpose()?);
                AnyPath::Two(Arc::clone(inner), path)
            }
            AnyProblem::Three(inner) => {
                let state = start.as_ref().map(|arrays| state(inner, elliptic, arrays));
                let set = working_set.as_ref().map(|arrays| set(inner, arrays));
                let path = working_set::WorkingSetPath::new(state.transpose()?, set.transpose()?);
                AnyPath::Three(Arc::clone(inner), path)
            }
        };
        Ok(Self {
            progress,
            elliptic: problem.elliptic.clone(),
            num_threads: problem.num_threads,
        })
    }

    /// A step to the total loads, with the gaps of the problem unless others are given. The
    /// state changes only if the step converges.
    #[pyo3(signature = (load, prescribed, gap, method, tol, max_iterations, max_seconds))]
    #[expect(
        clippy::too_many_arguments,
        reason = "the settings of one call from Python"
    )]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
        gap: Option<Matrix<'py>>,
        method: &str,
        tol: f64,
        max_iterations: Option<usize>,
        max_seconds: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = settings(method, tol, max_iterations, max_seconds)?;
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        let gap = gap.as_ref();
        match &mut self.progress {
            AnyPath::Two(inner, path) => {
                let gap = gap.map(arrays::rows).transpose()?;
                let inner = &moved(inner, self.elliptic.as_ref(), gap)?;
                let elliptic = self.elliptic.as_ref();
                let step = interrupt::run(py, self.num_threads, |stop| {
                    advance(path, inner, (load, prescribed), elliptic, &settings, stop)
                })?;
                step_dict(py, &step, self.elliptic.as_ref(), path.set())
            }
            AnyPath::Three(inner, path) => {
                let gap = gap.map(arrays::rows).transpose()?;
                let inner = &moved(inner, self.elliptic.as_ref(), gap)?;
                let elliptic = self.elliptic.as_ref();
                let step = interrupt::run(py, self.num_threads, |stop| {
                    advance(path, inner, (load, prescribed), elliptic, &settings, stop)
                })?;
                step_dict(py, &step, self.elliptic.as_ref(), path.set())
            }
        }
    }
}

/// The steps of a path, and the exception that ended it.
type Followed<'py> = (Vec<Bound<'py, PyDict>>, Option<Py<PyAny>>);

/// Loads of one step: total forces, prescribed displacements, and gaps if they differ from
/// those of the problem.
type StepArrays<'py> = (Vector<'py>, Vector<'py>, Option<Matrix<'py>>);

/// The same as vectors; gaps row by row.
type OwnStep = (Vec<f64>, Vec<f64>, Option<Vec<f64>>);

fn own<const D: usize>(steps: &[StepArrays<'_>]) -> PyResult<Vec<OwnStep>> {
    let step = |(f, u, gap): &StepArrays<'_>| {
        let gap = gap.as_ref().map(arrays::rows::<D>).transpose()?;
        let gap = gap.map(|rows| rows.as_flattened().to_vec());
        Ok((f.as_slice()?.to_vec(), u.as_slice()?.to_vec(), gap))
    };
    steps.iter().map(step).collect()
}

/// Runs several paths in parallel. Returns the steps of each, of which the last may not have
/// converged, and the exception that ended it.
#[pyfunction]
pub(super) fn follow<'py>(
    py: Python<'py>,
    mut paths: Vec<PyRefMut<'py, PyPath>>,
    cases: Vec<Vec<StepArrays<'py>>>,
    method: &str,
    tol: f64,
    max_iterations: Option<usize>,
    max_seconds: Option<f64>,
) -> PyResult<Vec<Followed<'py>>> {
    let settings = settings(method, tol, max_iterations, max_seconds)?;
    let num_threads = paths.first().and_then(|path| path.num_threads);
    let asked = paths
        .iter()
        .zip(&cases)
        .map(|(path, steps)| match path.progress {
            AnyPath::Two(..) => own::<2>(steps),
            AnyPath::Three(..) => own::<3>(steps),
        });
    let asked = asked.collect::<PyResult<Vec<_>>>()?;
    let scalings: Vec<_> = paths.iter().map(|path| path.elliptic.clone()).collect();
    let all: Vec<&mut PyPath> = paths.iter_mut().map(|path| &mut **path).collect();
    let followed = interrupt::run(py, num_threads, |stop| {
        let results = tasks::map(all.into_iter().zip(&asked), |_, (path, steps)| {
            path.follow(steps, &settings, stop)
        });
        results.into_iter().collect::<Result<Vec<_>, Error>>()
    })?;
    let mut out = Vec::with_capacity(followed.len());
    for ((steps, error), elliptic) in followed.into_iter().zip(&scalings) {
        let elliptic = elliptic.as_ref();
        let dicts: PyResult<Vec<_>> = match steps {
            Steps::Two(steps) => dicts_of(py, steps, elliptic),
            Steps::Three(steps) => dicts_of(py, steps, elliptic),
        };
        let error = error.map(|error| PyErr::from(error).into_value(py).into_any());
        out.push((dicts?, error));
    }
    Ok(out)
}

/// Steps with their working sets.
type Taken<const D: usize> = Vec<(Step<D>, Option<working_set::Set>)>;

enum Steps {
    Two(Taken<2>),
    Three(Taken<3>),
}

fn dicts_of<'py, const D: usize>(
    py: Python<'py>,
    steps: Taken<D>,
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let dict = |(step, set)| step_dict(py, &step, elliptic, set);
    steps.into_iter().map(dict).collect()
}

impl PyPath {
    /// Makes all steps, up to one that does not converge or fails.
    fn follow(
        &mut self,
        asked: &[OwnStep],
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<(Steps, Option<Error>), Error> {
        fn through<const D: usize>(
            (problem, elliptic): (&Arc<Problem<D>>, Option<&EllipticScaling>),
            path: &mut working_set::WorkingSetPath<D>,
            asked: &[OwnStep],
            settings: &Settings,
            stop: &AtomicBool,
        ) -> Result<(Taken<D>, Option<Error>), Error> {
            let mut done = Vec::with_capacity(asked.len());
            for (load, prescribed, gap) in asked {
                let gap = gap.as_ref().map(|rows| rows.as_chunks::<D>().0);
                let loads = (&load[..], &prescribed[..]);
                let taken = moved(problem, elliptic, gap)
                    .and_then(|own| advance(path, &own, loads, elliptic, settings, stop));
                match taken {
                    Ok(step) => {
                        let converged = step.solution.outcome == Outcome::Converged;
                        done.push((step, path.set()));
                        if !converged {
                            break;
                        }
                    }
                    Err(Error::Interrupted) => return Err(Error::Interrupted),
                    Err(error) => return Ok((done, Some(error))),
                }
            }
            Ok((done, None))
        }
        let elliptic = self.elliptic.as_ref();
        Ok(match &mut self.progress {
            AnyPath::Two(problem, path) => {
                let (steps, error) = through((problem, elliptic), path, asked, settings, stop)?;
                (Steps::Two(steps), error)
            }
            AnyPath::Three(problem, path) => {
                let (steps, error) = through((problem, elliptic), path, asked, settings, stop)?;
                (Steps::Three(steps), error)
            }
        })
    }
}
