//! A reduced problem in the plane or in space.

use std::borrow::Cow;
use std::ops::RangeInclusive;
use std::sync::atomic::AtomicBool;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{Error, check_length};
use crate::law::contact_law::ContactLaw;
use crate::linalg::sparse::blocks::Blocks;
use crate::proof::uniqueness::Unique;
use crate::python::arrays::{self, Csr, CsrArrays, LawArrays, Matrix, Vector};
use crate::python::interrupt;
use crate::python::solution::PySolution;
use crate::reduced::best_motion::best_motion;
use crate::reduced::compliance::{Compliance, Part};
use crate::reduced::elliptic_scaling::{EllipticScaling, over, rounding, times};
use crate::reduced::reduced::{Reduced, Rigid};
use crate::reduced::residual::Certificate;
use crate::reduced::rigid_motions::RigidMotions;
use crate::solver::monitor::Progress;
use crate::solver::{self, Settings, Start, certify, enumerate};

/// Contacts of an island, the values of its `W`, and for a sparse one the first block of each
/// row and the column of each block.
pub(super) type IslandArrays = (
    Vec<usize>,
    Py<PyArray1<f64>>,
    Option<(Vec<usize>, Vec<usize>)>,
);

/// Problems of so many contacts are solved on the calling thread: to wake another takes longer
/// than a second thread saves.
const FEW: usize = 100;
/// Of so many, all statuses may be tried, without a look at signals.
const LONG: RangeInclusive<usize> = 9..=enumerate::MOST_CONTACTS;

/// The part of `W` of an island.
enum Stored<const D: usize> {
    /// The array of the caller.
    Dense(Py<PyArray1<f64>>),
    /// An island of a sparse `W`, which nobody else has: to borrow an array takes as long as to
    /// solve three contacts.
    Island(Vec<f64>),
    Sparse(Blocks<D>),
}

/// A problem whose dense `W` stays in the array of the caller. All else is in the variables of
/// [`EllipticScaling`].
pub(super) struct ReducedArrays<const D: usize> {
    parts: Vec<(Vec<usize>, Stored<D>)>,
    q: Vec<[f64; D]>,
    law: Vec<ContactLaw>,
    pub(super) elliptic: Option<EllipticScaling>,
    pub(super) rigid: Rigid<D>,
}

impl<const D: usize> ReducedArrays<D> {
    pub(super) fn new(
        py: Python<'_>,
        given: Vec<IslandArrays>,
        q: &Matrix<'_>,
        law: &LawArrays<'_>,
        modes: &Csr<'_>,
        load: &Vector<'_>,
    ) -> PyResult<Self> {
        let q = arrays::rows::<D>(q)?;
        let (law, elliptic) = law.read(D)?;
        check_length("mu", law.len(), q.len())?;
        check_partition(&given, q.len())?;
        let load = load.as_slice()?.to_vec();
        let mut motions = RigidMotions::default();
        if !load.is_empty() {
            let csr = CsrArrays::new(modes, "R", None)?;
            motions = RigidMotions::from_rows(csr.rows(), q.len(), load.len())?;
        }
        if let Some(elliptic) = &elliptic {
            let scale =
                |i: usize, m: &[f64; D]| std::array::from_fn(|k| m[k] * elliptic.factor(i, k));
            motions = motions.map(|i, _, m| scale(i, m));
        }
        let rigid = Rigid {
            modes: motions,
            load,
        };
        let alone = given.len() == 1;
        let mut parts = Vec::with_capacity(given.len());
        for (nodes, values, pattern) in given {
            let view = values.bind(py).try_readonly()?;
            let stored = match pattern {
                None if alone => Stored::Dense(values),
                None => Stored::Island(view.as_slice()?.to_vec()),
                Some((start, column)) => {
                    Stored::Sparse(Blocks::new(&start, &column, view.as_slice()?)?)
                }
            };
            parts.push((nodes, stored));
        }
        Ok(Self {
            parts,
            q: times(elliptic.as_ref(), q).into_owned(),
            law,
            elliptic,
            rigid,
        })
    }

    pub(super) fn contacts(&self) -> usize {
        self.q.len()
    }

    /// `r̃` of a reaction.
    pub(super) fn reaction<'a>(&self, array: &'a Matrix<'_>) -> PyResult<Cow<'a, [[f64; D]]>> {
        let rows = arrays::rows_of("reaction", array, self.contacts())?;
        Ok(over(self.elliptic.as_ref(), rows))
    }

    /// Runs `work` without the interpreter lock. `W` is read from the array of the caller and
    /// checked again, because it may have changed.
    pub(super) fn run<T: Send>(
        &self,
        py: Python<'_>,
        num_threads: Option<usize>,
        callback: Option<&Py<PyAny>>,
        work: impl FnOnce(&Reduced<'_, D>, &AtomicBool, &Progress) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        self.with_compliance(py, num_threads, callback, |given, stop, progress| {
            let made = match &self.elliptic {
                None => given,
                Some(elliptic) => given.scaled(elliptic)?,
            };
            let mut problem = Reduced::new(&made, &self.q, &self.law, &self.rigid)?;
            problem.entry_rounding = rounding(self.elliptic.as_ref());
            work(&problem, stop, progress)
        })
    }

    /// Calls `work` with the compliance `W` alone, without the change of variables.
    pub(super) fn with_compliance<T: Send>(
        &self,
        py: Python<'_>,
        num_threads: Option<usize>,
        callback: Option<&Py<PyAny>>,
        work: impl FnOnce(Compliance<'_, D>, &AtomicBool, &Progress) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        let view = |stored: &Stored<D>| -> PyResult<Option<PyReadonlyArray1<f64>>> {
            match stored {
                Stored::Dense(array) => Ok(Some(array.bind(py).try_readonly()?)),
                Stored::Island(_) | Stored::Sparse(_) => Ok(None),
            }
        };
        let views = self.parts.iter().map(|(_, stored)| view(stored));
        let views = views.collect::<PyResult<Vec<_>>>()?;
        let mut parts = Vec::with_capacity(self.parts.len());
        for ((nodes, stored), view) in self.parts.iter().zip(&views) {
            let part = match (stored, view) {
                (Stored::Sparse(blocks), _) => Part::Sparse(Cow::Borrowed(blocks)),
                (Stored::Island(values), _) => Part::Dense(Cow::Borrowed(values)),
                (_, Some(view)) => Part::Dense(Cow::Borrowed(view.as_slice()?)),
                (_, None) => continue,
            };
            parts.push((nodes.clone(), part));
        }
        // Rayon has other ways to its global pool in sparse factorisations.
        let is_sparse = |(_, stored): &(_, Stored<D>)| matches!(stored, Stored::Sparse(_));
        let dense = !self.parts.iter().any(is_sparse) && self.rigid.modes.is_empty();
        let short = D == 3 || !LONG.contains(&self.contacts());
        if self.contacts() <= FEW && short && dense && callback.is_none() {
            let _ = crate::threads::count(num_threads)?;
            let progress = Progress::asking(interrupt::look_here);
            return interrupt::here(py, |stop| work(Compliance::new(parts)?, stop, &progress));
        }
        let progress = Progress::default();
        let tell = |py: Python<'_>| {
            callback.map_or(Ok(()), |callback| {
                callback.call1(py, progress.read()).map(|_| ())
            })
        };
        interrupt::watch(py, num_threads, &tell, |stop| {
            work(Compliance::new(parts)?, stop, &progress)
        })
    }
}

impl<const D: usize> ReducedArrays<D> {
    /// Refuses a wrong number of amounts of rigid motions.
    pub(super) fn check_motion(&self, amounts: &[f64]) -> Result<(), Error> {
        check_length("rigid_motion", amounts.len(), self.rigid.modes.len())
    }

    pub(super) fn residual(
        &self,
        py: Python<'_>,
        r: &Matrix<'_>,
        a: Option<&[f64]>,
    ) -> PyResult<f64> {
        let r = self.reaction(r)?;
        a.map_or(Ok(()), |a| self.check_motion(a))?;
        self.run(py, None, None, |problem, _, _| {
            let r = problem.compliance.gather(&r);
            let a = a.map_or_else(|| best_motion(problem, &r), <[f64]>::to_vec);
            Ok(Certificate::new(problem, &r, &a).residual)
        })
    }

    pub(super) fn solve(
        &self,
        py: Python<'_>,
        settings: &Settings,
        (reaction, rigid): (Option<&Matrix<'_>>, Vec<f64>),
        num_threads: Option<usize>,
        callback: Option<&Py<PyAny>>,
    ) -> PyResult<PySolution> {
        let reaction = reaction.map(|r| self.reaction(r)).transpose()?;
        if !rigid.is_empty() {
            self.check_motion(&rigid)?;
        }
        let solved = self.run(py, num_threads, callback, |problem, stop, progress| {
            let start = Start {
                reaction: reaction.map_or_else(Vec::new, |r| problem.compliance.gather(&r)),
                rigid,
                closed: Vec::new(),
            };
            solver::solve_watched(problem, settings, &start, stop, progress)
        })?;
        PySolution::new(py, &solved, self.elliptic.as_ref())
    }

    pub(super) fn assess(
        &self,
        py: Python<'_>,
        r: &Matrix<'_>,
        num_threads: Option<usize>,
        assess: Assess<D>,
    ) -> PyResult<Unique> {
        let r = self.reaction(r)?;
        self.run(py, num_threads, None, |problem, stop, _| {
            assess(problem, &problem.compliance.gather(&r), stop)
        })
    }
}

impl ReducedArrays<2> {
    /// All solutions of few contacts, found by trying all statuses.
    pub(super) fn answers(&self, py: Python<'_>) -> PyResult<Option<Answers>> {
        let coulomb = self.law.iter().all(ContactLaw::is_coulomb);
        if self.contacts() > enumerate::MOST_CONTACTS || !coulomb {
            return Ok(None);
        }
        let (solutions, complete) = self.run(py, Some(1), None, |problem, stop, _| {
            let all = enumerate::answers(problem, stop)?;
            let solutions = all.answers.iter();
            let solutions = solutions
                .map(|(r, a)| certify(problem, &Settings::default(), r, a, stop))
                .collect::<Result<Vec<_>, _>>()?;
            Ok((solutions, all.complete))
        })?;
        let solutions = solutions.iter().map(|one| PySolution::new(py, one, None));
        Ok(Some((solutions.collect::<PyResult<_>>()?, complete)))
    }
}

/// The solutions, and whether there are no others.
pub(super) type Answers = (Vec<PySolution>, bool);

/// What reactions imply for the number of solutions, in the plane or in space.
pub(super) type Assess<const D: usize> =
    fn(&Reduced<'_, D>, &[[f64; D]], &AtomicBool) -> Result<Unique, Error>;

/// Each contact must be in exactly one island: the core uses these indices.
fn check_partition(parts: &[IslandArrays], contacts: usize) -> PyResult<()> {
    let mut seen = vec![false; contacts];
    for &i in parts.iter().flat_map(|(nodes, ..)| nodes) {
        let first = seen.get_mut(i).map(|seen| !std::mem::replace(seen, true));
        if first != Some(true) {
            return Err(PyValueError::new_err(format!(
                "contact {i} is out of range, or twice in the islands of W, which has \
                 {contacts} contacts"
            )));
        }
    }
    let found = seen.iter().filter(|&&seen| seen).count();
    Ok(check_length("W", found, contacts)?)
}
