//! A condensed problem in the plane or in space.

use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;

use crate::condensation::bodies::Loaded;
use crate::condensation::problem::{Confirmed, Problem};
use crate::error::{Error, check_length};
use crate::path::stepping::{State, reduced_step};
use crate::proof::uniqueness::Unique;
use crate::python::arrays::{self, LawArrays, Matrix, NewMatrix, Vector};
use crate::python::interrupt;
use crate::python::reduced_arrays::Assess;
use crate::reduced::compliance::Compliance;
use crate::reduced::elliptic_scaling::{EllipticScaling, over, rounding, times};

/// Total forces and prescribed displacements of a step.
pub(super) type Loads<'a> = (&'a [f64], &'a [f64]);

/// A condensed problem, in the variables of [`EllipticScaling`].
#[derive(Clone)]
pub(super) struct CondensedArrays<const D: usize> {
    pub(super) problem: Arc<Problem<D>>,
    pub(super) elliptic: Option<EllipticScaling>,
    pub(super) num_threads: Option<usize>,
}

/// `u` of total loads, prescribed displacements, reaction and rigid motion.
pub(super) type StateArrays<'py> = (Vector<'py>, Vector<'py>, Matrix<'py>, Vector<'py>);

/// The states with their reactions in the variables of the problem.
pub(super) fn loaded<'a, const D: usize>(
    states: &'a [StateArrays<'_>],
    reactions: &'a [impl Deref<Target = [[f64; D]]>],
) -> PyResult<Vec<Loaded<'a, D>>> {
    let pairs = states.iter().zip(reactions);
    let one = pairs.map(|((load, prescribed, _, rigid), reaction)| {
        Ok(Loaded {
            load: load.as_slice()?,
            prescribed: prescribed.as_slice()?,
            reaction,
            rigid: rigid.as_slice()?,
        })
    });
    one.collect()
}

impl<const D: usize> CondensedArrays<D> {
    /// Runs `work` without the interpreter lock.
    pub(super) fn run<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&AtomicBool) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        interrupt::run(py, self.num_threads, work)
    }

    pub(super) fn contacts(&self) -> usize {
        self.problem.contacts()
    }

    /// Number of contact components, `D n_c`.
    pub(super) fn components(&self) -> usize {
        D * self.contacts()
    }

    /// What one solution of a step implies for the number of its solutions.
    pub(super) fn assess(
        &self,
        py: Python<'_>,
        (loads, before, reaction): (Loads<'_>, Option<&Matrix<'_>>, &Matrix<'_>),
        assess: Assess<D>,
    ) -> PyResult<Unique> {
        let state = self.state(before)?;
        let reaction = self.reaction(reaction)?;
        let Problem::Whole(whole) = &*self.problem else {
            // Contacts outside a working set are only known to be open in this solution.
            return Ok(Unique::Unknown);
        };
        let r = whole.compliance().gather(&reaction);
        self.run(py, |stop| {
            let mut reduced = reduced_step(whole, loads.0, loads.1, state.as_ref())?;
            reduced.entry_rounding = rounding(self.elliptic.as_ref());
            assess(&reduced, &r, stop)
        })
    }

    /// Refuses a wrong number of amounts of rigid motions.
    pub(super) fn check_motion(&self, amounts: &[f64]) -> Result<(), Error> {
        let motions = self.problem.bodies().motions().len();
        check_length("rigid_motion", amounts.len(), motions)
    }

    /// `r̃` of a reaction.
    pub(super) fn reaction(&self, array: &Matrix<'_>) -> PyResult<Vec<[f64; D]>> {
        let rows = arrays::rows_of("reaction", array, self.contacts())?;
        Ok(over(self.elliptic.as_ref(), rows).into_owned())
    }

    /// The part of the state before a step that its reduced problem needs: `ṽ`.
    pub(super) fn state(&self, before: Option<&Matrix<'_>>) -> PyResult<Option<State<D>>> {
        let Some(before) = before else {
            return Ok(None);
        };
        let rows = arrays::rows_of("before", before, self.contacts())?;
        Ok(Some(State {
            relative_displacement: times(self.elliptic.as_ref(), rows).into_owned(),
            ..State::default()
        }))
    }

    /// The problem of one step, with the gaps of the step if there are any.
    pub(super) fn moved(&self, gap: Option<&[[f64; D]]>) -> Result<Self, Error> {
        let Some(gap) = gap else {
            return Ok(self.clone());
        };
        check_length("gap", gap.len(), self.contacts())?;
        let gap = times(self.elliptic.as_ref(), gap).into_owned();
        Ok(self.with(self.problem.with_gap(gap)?))
    }

    /// The same variables for another problem.
    pub(super) fn with(&self, problem: Problem<D>) -> Self {
        Self {
            problem: Arc::new(problem),
            elliptic: self.elliptic.clone(),
            num_threads: self.num_threads,
        }
    }

    /// `W` in the variables of the caller, as `form` stores it.
    pub(super) fn compliance<T: Send>(
        &self,
        py: Python<'_>,
        form: impl FnOnce(&Compliance<'_, D>) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        let inverse = self.elliptic.as_ref().map(EllipticScaling::inverse);
        self.run(py, |stop| {
            let whole = self.problem.whole(stop)?;
            match inverse {
                None => form(whole.compliance()),
                Some(inverse) => form(&whole.compliance().scaled(&inverse)?),
            }
        })
    }

    /// Rigid motions at the contacts, as rows.
    pub(super) fn as_rows<'py>(&self, py: Python<'py>, modes: &[Vec<[f64; D]>]) -> NewMatrix<'py> {
        let rows = modes.iter();
        let flat = rows.flat_map(|mode| over(self.elliptic.as_ref(), mode).as_flattened().to_vec());
        arrays::square(py, flat.collect(), modes.len(), self.components())
    }

    pub(super) fn displacements<'py>(
        &self,
        py: Python<'py>,
        states: &[StateArrays<'py>],
        confirmed: Option<&[[Matrix<'py>; 3]]>,
    ) -> PyResult<NewMatrix<'py>> {
        let elliptic = self.elliptic.as_ref();
        let reactions = states
            .iter()
            .map(|(_, _, reaction, _)| Ok(over(elliptic, arrays::rows(reaction)?)))
            .collect::<PyResult<Vec<_>>>()?;
        let loaded = loaded(states, &reactions)?;
        let scale = |rows| PyResult::Ok(times(elliptic, arrays::rows(rows)?).into_owned());
        let confirmed = confirmed
            .unwrap_or_default()
            .iter()
            .map(|[v, gap, slip]| {
                Ok(Confirmed {
                    v: scale(v)?,
                    gap: scale(gap)?,
                    slip: scale(slip)?,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let problem = &self.problem;
        let all = self.run(py, |_| {
            let all = problem.displacements(&loaded)?;
            for ((u, state), held_to) in all.iter().zip(&loaded).zip(&confirmed) {
                problem.confirm(state, u, held_to)?;
            }
            Ok(all)
        })?;
        let order = problem.bodies().order();
        Ok(arrays::square(py, all.concat(), states.len(), order))
    }

    pub(super) fn with_law(&self, law: &LawArrays<'_>) -> PyResult<Self> {
        let (law, elliptic) = law.read(D)?;
        let change = EllipticScaling::between(self.elliptic.as_ref(), elliptic.as_ref());
        let mut problem = self.problem.with_law(law)?;
        if let Some(change) = change {
            problem = problem.scaled(&change)?;
        }
        Ok(Self {
            elliptic,
            ..self.with(problem)
        })
    }
}
