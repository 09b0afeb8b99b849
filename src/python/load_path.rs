//! A load path in progress.

use std::sync::atomic::AtomicBool;

use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{Error, check_length};
use crate::law::cone::Status;
use crate::path::stepping::{State, Step};
use crate::path::working_set::{Set, WorkingSetPath};
use crate::python::arrays::{self, Indices, Matrix, Vector};
use crate::python::condensed_arrays::{CondensedArrays, Loads};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::interrupt;
use crate::python::problem::PyCondensed;
use crate::python::solution::PyLoadStep;
use crate::python::solver::PySettings;
use crate::reduced::elliptic_scaling::{EllipticScaling, over, times};
use crate::solver::{Outcome, Settings};
use crate::tasks;

/// Status of each contact.
type Statuses<'py> = PyReadonlyArray1<'py, i8>;

/// Reaction, total relative displacement, status and rigid motion of a step.
type StartArrays<'py> = (Matrix<'py>, Matrix<'py>, Statuses<'py>, Vector<'py>);

/// Reaction, total relative displacement and status of a step, of a path in the displacements.
pub(super) type ContactArrays<'py> = (Matrix<'py>, Matrix<'py>, Statuses<'py>);

/// Contacts of a working set, rigid motions of the bodies condensed onto all contacts, and
/// whether the inverse of its `W` has been made.
type SetArrays<'py> = (Indices<'py>, Vector<'py>, bool);

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
    check_length("start", state.status.len(), count)?;
    Ok(state)
}

/// A path and its problem.
struct Progress<const D: usize> {
    problem: CondensedArrays<D>,
    path: WorkingSetPath<D>,
}

/// Steps with their working sets, and the error that ended them.
type Followed<const D: usize> = (Vec<(Step<D>, Option<Set>)>, Option<Error>);

impl<const D: usize> Progress<D> {
    fn new(
        problem: &CondensedArrays<D>,
        start: Option<&StartArrays<'_>>,
        working_set: Option<&SetArrays<'_>>,
    ) -> PyResult<Self> {
        let read_state = |(reaction, displacement, status, rigid): &StartArrays<'_>| {
            let contacts = (reaction, displacement, status);
            let elliptic = problem.elliptic.as_ref();
            let mut state = state_of_contacts(problem.contacts(), elliptic, contacts)?;
            let motions = problem.problem.bodies().motions().len();
            state.rigid = arrays::numbers("start", rigid, motions)?.to_vec();
            PyResult::Ok(state)
        };
        let read_set = |(members, motion, inverse): &SetArrays<'_>| {
            let members = arrays::indices(members, "working_set of start")?;
            let ascending = members.is_sorted_by(|a, b| a < b);
            if !ascending || members.last().is_some_and(|&i| i >= problem.contacts()) {
                return Err(PyValueError::new_err(format!(
                    "working_set of start must hold ascending contact numbers below {}",
                    problem.contacts()
                )));
            }
            Ok(Set {
                members,
                motion: motion.as_slice()?.to_vec(),
                inverse: *inverse,
            })
        };
        let state = start.map(read_state).transpose()?;
        let set = working_set.map(read_set).transpose()?;
        Ok(Self {
            problem: problem.clone(),
            path: WorkingSetPath::new(state, set),
        })
    }

    /// Makes a step. Its state is then rounded as if the caller had stored and returned it in
    /// the caller's variables.
    fn advance(
        &mut self,
        (load, prescribed): Loads<'_>,
        gap: Option<&[[f64; D]]>,
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Step<D>, Error> {
        let moved = self.problem.moved(gap)?;
        let path = &mut self.path;
        let step = path.advance(&moved.problem, load, prescribed, settings, stop)?;
        if let (Some(elliptic), Outcome::Converged) = (&moved.elliptic, step.solution.outcome) {
            path.restate(|state| {
                state.reaction = elliptic.over(&elliptic.times(&state.reaction));
                let v = elliptic.over(&state.relative_displacement);
                state.relative_displacement = elliptic.times(&v);
            });
        }
        Ok(step)
    }

    fn step(
        &mut self,
        py: Python<'_>,
        loads: Loads<'_>,
        gap: Option<&Matrix<'_>>,
        settings: &Settings,
    ) -> PyResult<PyLoadStep> {
        let gap = gap.map(arrays::rows).transpose()?;
        let threads = self.problem.num_threads;
        let step = interrupt::run(py, threads, |stop| self.advance(loads, gap, settings, stop))?;
        PyLoadStep::new(py, &step, self.problem.elliptic.as_ref(), self.path.set())
    }

    /// Makes all steps, up to one that does not converge or fails.
    fn follow(
        &mut self,
        steps: &[OwnStep],
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Followed<D>, Error> {
        let mut done = Vec::with_capacity(steps.len());
        for (load, prescribed, gap) in steps {
            let gap = gap.as_ref().map(|rows| rows.as_chunks().0);
            match self.advance((load, prescribed), gap, settings, stop) {
                Ok(step) => {
                    let converged = step.solution.outcome == Outcome::Converged;
                    done.push((step, self.path.set()));
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
}

/// A load path in progress. Without a state it starts from the unloaded bodies.
#[pyclass(name = "Path", module = "bipot_rs._core")]
pub(super) struct PyPath {
    progress: Dimension<Progress<2>, Progress<3>>,
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
        let progress = map_either!(&problem.kind, problem => {
            Progress::new(problem, start.as_ref(), working_set.as_ref())?
        });
        Ok(Self { progress })
    }

    #[pyo3(signature = (load, prescribed, gap, settings))]
    fn step(
        &mut self,
        py: Python<'_>,
        load: Vector<'_>,
        prescribed: Vector<'_>,
        gap: Option<Matrix<'_>>,
        settings: &PySettings,
    ) -> PyResult<PyLoadStep> {
        let loads = (load.as_slice()?, prescribed.as_slice()?);
        for_either!(&mut self.progress, path => path.step(py, loads, gap.as_ref(), &settings.checked))
    }
}

/// Loads of one step: total forces, prescribed displacements, and gaps if they differ from
/// those of the problem.
type StepArrays<'py> = (Vector<'py>, Vector<'py>, Option<Matrix<'py>>);

/// `StepArrays` as vectors; gaps row by row.
type OwnStep = (Vec<f64>, Vec<f64>, Option<Vec<f64>>);

fn own<const D: usize>(_: &Progress<D>, steps: &[StepArrays<'_>]) -> PyResult<Vec<OwnStep>> {
    let step = |(f, u, gap): &StepArrays<'_>| {
        let gap = gap.as_ref().map(arrays::rows::<D>).transpose()?;
        let gap = gap.map(|rows| rows.as_flattened().to_vec());
        Ok((f.as_slice()?.to_vec(), u.as_slice()?.to_vec(), gap))
    };
    steps.iter().map(step).collect()
}

#[pyfunction]
#[expect(
    clippy::type_complexity,
    reason = "the steps of each path, and an exception"
)]
pub(super) fn follow<'py>(
    py: Python<'py>,
    mut paths: Vec<PyRefMut<'py, PyPath>>,
    cases: Vec<Vec<StepArrays<'py>>>,
    settings: &PySettings,
) -> PyResult<Vec<(Vec<PyLoadStep>, Option<Py<PyAny>>)>> {
    let threads = paths
        .first()
        .and_then(|path| for_either!(&path.progress, path => path.problem.num_threads));
    let asked = paths
        .iter()
        .zip(&cases)
        .map(|(path, steps)| for_either!(&path.progress, path => own(path, steps)));
    let asked = asked.collect::<PyResult<Vec<_>>>()?;
    let all: Vec<&mut PyPath> = paths.iter_mut().map(|path| &mut **path).collect();
    let followed = interrupt::run(py, threads, |stop| {
        let results = tasks::map(all.into_iter().zip(&asked), |_, (path, steps)| {
            Ok(map_either!(&mut path.progress, path => {
                let elliptic = path.problem.elliptic.clone();
                (path.follow(steps, &settings.checked, stop)?, elliptic)
            }))
        });
        results.into_iter().collect::<Result<Vec<_>, Error>>()
    })?;
    let mut all = Vec::with_capacity(followed.len());
    for one in followed {
        let (steps, error) = for_either!(one, ((steps, error), elliptic) => {
            let steps = steps.into_iter();
            let steps = steps.map(|(step, set)| {
                PyLoadStep::new(py, &step, elliptic.as_ref(), set)
            });
            (steps.collect::<PyResult<_>>()?, error)
        });
        let error = error.map(|error| PyErr::from(error).into_value(py).into_any());
        all.push((steps, error));
    }
    Ok(all)
}
