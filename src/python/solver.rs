//! `project` and the reduced problem.

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::cone::Status;
use crate::law::{cone, elliptic};
use crate::linalg::sparse::blocks::Blocks;
use crate::panics::caught;
use crate::python::arrays::{self, Coefficients, Matrix, Vector};
use crate::python::interrupt;
use crate::reduced::compliance::{self, Compliance, Part};
use crate::reduced::elliptic_scaling::{EllipticScaling, over, times};
use crate::reduced::existence::{balances, is_contradiction, is_unresisted};
use crate::reduced::reduced::{Reduced, Rigid};
use crate::reduced::residual::{Certificate, best_motion};
use crate::solver::monitor::Progress;
use crate::solver::paper::principles::minimising_sequence::Sequence;
use crate::solver::{self, Method, Settings, Solution, Start};
use crate::tasks;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Nodes in one task: few enough for balance, many enough for the cost of a task.
const NODES_A_TASK: usize = 4096;

type Projected<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i8>>);

/// The default number of threads.
#[pyfunction]
pub(super) fn threads() -> PyResult<usize> {
    Ok(crate::threads::count(None)?)
}

/// Projects every row of `tau` onto its cone, or increment set when `base` is given.
#[pyfunction]
#[pyo3(signature = (tau, mu, base=None))]
pub(super) fn project<'py>(
    py: Python<'py>,
    tau: Matrix<'py>,
    mu: Coefficients<'py>,
    base: Option<Matrix<'py>>,
) -> PyResult<Projected<'py>> {
    let base = base.as_ref();
    match (&mu, tau.as_array().ncols()) {
        (Coefficients::Elliptic(mu), _) => {
            project_rows::<3, _>(py, &tau, arrays::rows::<2>(mu)?, base, onto_elliptic)
        }
        (Coefficients::Round(mu), 2) => {
            project_rows::<2, _>(py, &tau, mu.as_slice()?, base, onto_round)
        }
        (Coefficients::Round(mu), _) => {
            project_rows::<3, _>(py, &tau, mu.as_slice()?, base, onto_round)
        }
    }
}

type Isotropic<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Factors `(n_c, d)` of the components in which the friction law is Coulomb's, and its
/// coefficients.
#[pyfunction]
pub(super) fn isotropic<'py>(
    py: Python<'py>,
    mu: Coefficients<'py>,
    d: usize,
) -> PyResult<Isotropic<'py>> {
    if d != 2 && d != 3 {
        return Err(PyValueError::new_err(format!("d is {d}, expected 2 or 3")));
    }
    let (mu, elliptic) = mu.friction(d)?;
    let factor = |at: usize| elliptic.as_ref().map_or(1.0, |s| s.factor(at / d, at % d));
    let factors = (0..d * mu.len()).map(factor).collect();
    let factors = arrays::square(py, factors, mu.len(), d)?;
    Ok((factors, arrays::from_vec(py, mu)))
}

type Onto<const D: usize, M> = fn(&[f64; D], Option<&[f64; D]>, M) -> ([f64; D], Status);

fn onto_round<const D: usize>(
    tau: &[f64; D],
    base: Option<&[f64; D]>,
    mu: f64,
) -> ([f64; D], Status) {
    match base {
        Some(base) => cone::project_increment(tau, base, mu),
        None => cone::project(tau, mu),
    }
}

fn onto_elliptic(tau: &[f64; 3], base: Option<&[f64; 3]>, mu: [f64; 2]) -> ([f64; 3], Status) {
    match base {
        Some(base) => elliptic::project_elliptic_increment(tau, base, mu),
        None => elliptic::project_elliptic(tau, mu),
    }
}

fn project_rows<'py, const D: usize, M: Copy + Send + Sync>(
    py: Python<'py>,
    tau: &Matrix<'py>,
    mu: &[M],
    base: Option<&Matrix<'py>>,
    onto: Onto<D, M>,
) -> PyResult<Projected<'py>> {
    let tau = arrays::rows::<D>(tau)?;
    let base = base.map(arrays::rows::<D>).transpose()?;
    if mu.len() != tau.len() || base.is_some_and(|b| b.len() != tau.len()) {
        return Err(PyValueError::new_err(
            "tau, mu and base have different lengths",
        ));
    }
    let pool = crate::threads::pool(crate::threads::count(None)?)?;
    let mut out = vec![[0.0; D]; tau.len()];
    let mut status = vec![0_i8; tau.len()];
    let projected = py.detach(|| {
        let of_chunk = |chunk: usize, out: &mut [[f64; D]], status: &mut [i8]| {
            let first = chunk * NODES_A_TASK;
            for (k, (t, s)) in out.iter_mut().zip(status).enumerate() {
                let i = first + k;
                let (projected, found) = onto(&tau[i], base.map(|b| &b[i]), mu[i]);
                *t = projected;
                *s = found as i8;
            }
        };
        caught(|| {
            if tau.len() <= NODES_A_TASK {
                of_chunk(0, &mut out, &mut status);
            } else {
                pool.install(|| {
                    let parts = out
                        .chunks_mut(NODES_A_TASK)
                        .zip(status.chunks_mut(NODES_A_TASK));
                    tasks::for_each(parts, |chunk, (out, status)| of_chunk(chunk, out, status));
                });
            }
        })
    });
    projected?;
    Ok((arrays::from_rows(py, &out)?, PyArray1::from_vec(py, status)))
}

/// Checks the settings that Python passes.
pub(super) fn settings(
    method: &str,
    tol: f64,
    max_iterations: Option<usize>,
    max_seconds: Option<f64>,
) -> PyResult<Settings> {
    let known = Method::NAMES.iter().find(|(name, _)| *name == method);
    let Some(&(_, method)) = known else {
        let names: Vec<String> = Method::NAMES
            .iter()
            .map(|(n, _)| format!("'{n}'"))
            .collect();
        return Err(PyValueError::new_err(format!(
            "method is '{method}', expected one of {}",
            names.join(", ")
        )));
    };
    let default = Settings::default();
    let settings = Settings {
        method,
        tol,
        max_iterations: max_iterations.unwrap_or(default.max_iterations),
        max_seconds: max_seconds.unwrap_or(default.max_seconds),
    };
    settings.validate()?;
    Ok(settings)
}

/// The result of a solver in the variables of the caller, as a dictionary for
/// `bipot_rs.contact.results.result.Solution`.
pub(super) fn solution_dict<'py, const D: usize>(
    py: Python<'py>,
    solution: &Solution<D>,
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Bound<'py, PyDict>> {
    let reaction = times(elliptic, &solution.reaction);
    let relative_displacement = over(elliptic, &solution.relative_displacement);
    let numbers = reaction.iter().chain(&*relative_displacement);
    if !numbers.flatten().all(|c| c.is_finite()) || solution.residual.is_nan() {
        return Err(PyValueError::new_err(
            "W r + q is outside the range of doubles: the entries of W differ by too much; \
             choose other units",
        ));
    }
    let dict = PyDict::new(py);
    dict.set_item("reaction", arrays::from_rows(py, &reaction)?)?;
    let v = arrays::from_rows(py, &relative_displacement)?;
    dict.set_item("relative_displacement", v)?;
    dict.set_item("status", arrays::from_status(py, &solution.status))?;
    dict.set_item(
        "bipotential_gap",
        arrays::from_vec(py, solution.bipotential_gap.clone()),
    )?;
    dict.set_item(
        "rigid_motion",
        arrays::from_vec(py, solution.rigid_motion.clone()),
    )?;
    dict.set_item(
        "free_motion",
        arrays::from_vec(py, solution.free_motion.clone()),
    )?;
    dict.set_item("statuses_tried", solution.statuses_tried)?;
    dict.set_item("outcome", solution.outcome.name())?;
    dict.set_item("residual", solution.residual)?;
    dict.set_item("tolerance", solution.tolerance)?;
    dict.set_item("floor", solution.floor)?;
    dict.set_item("iterations", solution.iterations)?;
    dict.set_item("work", solution.work)?;
    let flat = solution
        .history
        .iter()
        .flat_map(|&(work, eta)| [work, eta])
        .collect();
    dict.set_item(
        "history",
        arrays::square(py, flat, solution.history.len(), 2)?,
    )?;
    let sequence = solution.sequence.as_ref();
    let sequence = sequence.map(|found| sequence_dict(py, found, elliptic));
    dict.set_item("minimising_sequence", sequence.transpose()?)?;
    dict.set_item("bytes_beside", solution.bytes_beside)?;
    dict.set_item("seconds", solution.seconds)?;
    Ok(dict)
}

/// The fields of a minimising sequence in the variables of the caller, a row for each field, as
/// a dictionary for `bipot_rs.contact.results.minimising_sequence.MinimisingSequence`.
fn sequence_dict<'py, const D: usize>(
    py: Python<'py>,
    sequence: &Sequence<D>,
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Bound<'py, PyDict>> {
    fn stacked<'py, 'a, const D: usize>(
        py: Python<'py>,
        fields: &'a [Vec<[f64; D]>],
        of: impl Fn(&'a [[f64; D]]) -> Cow<'a, [[f64; D]]>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let columns = fields.first().map_or(0, |field| D * field.len());
        let flat = fields
            .iter()
            .flat_map(|field| of(field).as_flattened().to_vec());
        arrays::square(py, flat.collect(), fields.len(), columns)
    }
    let dict = PyDict::new(py);
    let force = |field| times(elliptic, field);
    let displacement = |field| over(elliptic, field);
    dict.set_item("reaction", stacked(py, &sequence.reaction, force)?)?;
    dict.set_item("balanced_reaction", stacked(py, &sequence.balanced, force)?)?;
    let v = stacked(py, &sequence.relative_displacement, displacement)?;
    dict.set_item("relative_displacement", v)?;
    let values = arrays::from_vec(py, sequence.bifunctional.clone());
    dict.set_item("bifunctional", values)?;
    Ok(dict)
}

/// Whether an island with this many blocks and contacts is stored as a sparse matrix.
#[pyfunction]
pub(super) fn is_sparse(blocks: usize, contacts: usize) -> bool {
    compliance::is_sparse(blocks, contacts)
}

/// A reduced problem `v = W r + R a + q` in the numbering of the caller.
#[pyclass(frozen, name = "Reduced", module = "bipot_rs._core")]
pub(super) struct PyReduced {
    pub(super) kind: AnyReduced,
}

pub(super) enum AnyReduced {
    Two(ReducedArrays<2>),
    Three(ReducedArrays<3>),
}

/// Contacts of an island, the values of its `W`, and for a sparse one the first block of each
/// row and the column of each block.
type IslandArrays = (
    Vec<usize>,
    Py<PyArray1<f64>>,
    Option<(Vec<usize>, Vec<usize>)>,
);

/// The part of `W` of an island.
enum Stored<const D: usize> {
    /// The array of the caller.
    Dense(Py<PyArray1<f64>>),
    Sparse(Blocks<D>),
}

/// A problem whose dense `W` stays in the array of the caller. All else is in the variables of
/// [`EllipticScaling`].
pub(super) struct ReducedArrays<const D: usize> {
    parts: Vec<(Vec<usize>, Stored<D>)>,
    q: Vec<[f64; D]>,
    mu: Vec<f64>,
    pub(super) elliptic: Option<EllipticScaling>,
    rigid: Rigid<D>,
}

impl<const D: usize> ReducedArrays<D> {
    fn new(
        py: Python<'_>,
        given: Vec<IslandArrays>,
        q: &Matrix<'_>,
        mu: &Coefficients<'_>,
        modes: &Matrix<'_>,
        load: &Vector<'_>,
    ) -> PyResult<Self> {
        let q = arrays::rows::<D>(q)?;
        let (mu, elliptic) = mu.friction(D)?;
        arrays::length("mu", mu.len(), q.len())?;
        check_partition(&given, q.len())?;
        let (count, size) = modes.as_array().dim();
        if count > 0 {
            arrays::length("R", size, D * q.len())?;
        }
        let columns = modes.as_slice()?.chunks_exact(D * q.len().max(1));
        let rigid = Rigid {
            modes: columns
                .map(|column| times(elliptic.as_ref(), column.as_chunks::<D>().0).into_owned())
                .collect(),
            load: load.as_slice()?.to_vec(),
        };
        let mut parts = Vec::with_capacity(given.len());
        for (nodes, values, pattern) in given {
            let stored = match pattern {
                None => Stored::Dense(values),
                Some((start, column)) => {
                    let values = values.bind(py).try_readonly()?;
                    let made = Blocks::new(&start, &column, values.as_slice()?);
                    Stored::Sparse(made?)
                }
            };
            parts.push((nodes, stored));
        }
        Ok(Self {
            parts,
            q: times(elliptic.as_ref(), q).into_owned(),
            mu,
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
            let problem = Reduced::new(&made, &self.q, &self.mu, &self.rigid)?;
            work(&problem, stop, progress)
        })
    }

    /// The same with `W` alone, without the change of variables.
    fn with_compliance<T: Send>(
        &self,
        py: Python<'_>,
        num_threads: Option<usize>,
        callback: Option<&Py<PyAny>>,
        work: impl FnOnce(Compliance<'_, D>, &AtomicBool, &Progress) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        let view = |stored: &Stored<D>| -> PyResult<Option<PyReadonlyArray1<f64>>> {
            match stored {
                Stored::Dense(array) => Ok(Some(array.bind(py).try_readonly()?)),
                Stored::Sparse(_) => Ok(None),
            }
        };
        let views = self.parts.iter().map(|(_, stored)| view(stored));
        let views = views.collect::<PyResult<Vec<_>>>()?;
        let mut parts = Vec::with_capacity(self.parts.len());
        for ((nodes, stored), view) in self.parts.iter().zip(&views) {
            let part = match (stored, view) {
                (Stored::Sparse(blocks), _) => Part::Sparse(Cow::Borrowed(blocks)),
                (_, Some(view)) => Part::Dense(Cow::Borrowed(view.as_slice()?)),
                (_, None) => continue,
            };
            parts.push((nodes.clone(), part));
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

    fn solve<'py>(
        &self,
        py: Python<'py>,
        settings: &Settings,
        (reaction, rigid): (Option<&Matrix<'_>>, Vec<f64>),
        num_threads: Option<usize>,
        callback: Option<&Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let reaction = reaction.map(|r| self.reaction(r)).transpose()?;
        if !rigid.is_empty() {
            arrays::length("rigid_motion", rigid.len(), self.rigid.modes.len())?;
        }
        let solved = self.run(py, num_threads, callback, |problem, stop, progress| {
            let start = Start {
                reaction: reaction.map_or_else(Vec::new, |r| problem.compliance.gather(&r)),
                rigid,
                closed: Vec::new(),
            };
            solver::solve_watched(problem, settings, &start, stop, progress)
        })?;
        solution_dict(py, &solved, self.elliptic.as_ref())
    }

    fn certificate(&self, py: Python<'_>, r: &Matrix<'_>, a: Option<&[f64]>) -> PyResult<f64> {
        let r = self.reaction(r)?;
        if let Some(a) = a {
            arrays::length("rigid_motion", a.len(), self.rigid.modes.len())?;
        }
        self.run(py, None, None, |problem, _, _| {
            let r = problem.compliance.gather(&r);
            let a = a.map_or_else(|| best_motion(problem, &r), <[f64]>::to_vec);
            Ok(Certificate::new(problem, &r, &a).residual)
        })
    }

    /// Checks that only the core makes.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        self.run(py, None, None, |_, _, _| Ok(()))
    }

    /// Calls `decide` with one number for each contact or each rigid motion.
    fn decide<T: Send>(
        &self,
        py: Python<'_>,
        witness: &[f64],
        expected: usize,
        decide: impl FnOnce(&Reduced<'_, D>, &[f64]) -> T + Send,
    ) -> PyResult<T> {
        arrays::length("witness", witness.len(), expected)?;
        self.run(py, None, None, |problem, _, _| Ok(decide(problem, witness)))
    }

    /// The asymmetry of `W` as given.
    fn asymmetry(&self, py: Python<'_>) -> PyResult<f64> {
        self.with_compliance(py, None, None, |given, _, _| Ok(given.asymmetry()))
    }
}

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
    Ok(arrays::length("W", found, contacts)?)
}

impl PyReduced {
    /// Refuses a wrong number of amounts of rigid motions.
    pub(super) fn check_motion(&self, rigid: &[f64]) -> PyResult<()> {
        let expected = match &self.kind {
            AnyReduced::Two(owned) => owned.rigid.modes.len(),
            AnyReduced::Three(owned) => owned.rigid.modes.len(),
        };
        Ok(arrays::length("rigid_motion", rigid.len(), expected)?)
    }
}

#[pymethods]
impl PyReduced {
    /// `parts` has (contacts, values, pattern) for each island: a dense row-major matrix
    /// without a pattern, or blocks with (first block of a row, columns).
    #[new]
    fn new(
        py: Python<'_>,
        parts: Vec<IslandArrays>,
        q: Matrix<'_>,
        mu: Coefficients<'_>,
        modes: Matrix<'_>,
        load: Vector<'_>,
    ) -> PyResult<Self> {
        let kind = if q.as_array().ncols() == 2 {
            let owned = ReducedArrays::new(py, parts, &q, &mu, &modes, &load)?;
            owned.check(py)?;
            AnyReduced::Two(owned)
        } else {
            let owned = ReducedArrays::new(py, parts, &q, &mu, &modes, &load)?;
            owned.check(py)?;
            AnyReduced::Three(owned)
        };
        Ok(Self { kind })
    }

    /// Largest `|W_ij − W_ji|` over the largest entry.
    #[getter]
    fn asymmetry(&self, py: Python<'_>) -> PyResult<f64> {
        match &self.kind {
            AnyReduced::Two(owned) => owned.asymmetry(py),
            AnyReduced::Three(owned) => owned.asymmetry(py),
        }
    }

    /// η at `(r, a)`; without `a`, at the rigid motion of least squares.
    #[pyo3(signature = (reaction, rigid=None))]
    fn residual(
        &self,
        py: Python<'_>,
        reaction: Matrix<'_>,
        rigid: Option<Vector<'_>>,
    ) -> PyResult<f64> {
        let rigid = rigid.as_ref().map(|a| a.as_slice()).transpose()?;
        match &self.kind {
            AnyReduced::Two(owned) => owned.certificate(py, &reaction, rigid),
            AnyReduced::Three(owned) => owned.certificate(py, &reaction, rigid),
        }
    }

    /// Whether amounts of the rigid motions prove that there is no equilibrium.
    fn is_unresisted(&self, py: Python<'_>, amounts: Vector<'_>) -> PyResult<bool> {
        let a = amounts.as_slice()?;
        match &self.kind {
            AnyReduced::Two(owned) => owned.decide(py, a, owned.rigid.modes.len(), is_unresisted),
            AnyReduced::Three(owned) => owned.decide(py, a, owned.rigid.modes.len(), is_unresisted),
        }
    }

    /// Whether amounts of normal displacements prove that contacts contradict each other.
    fn is_contradiction(&self, py: Python<'_>, amounts: Vector<'_>) -> PyResult<bool> {
        let amounts = amounts.as_slice()?;
        match &self.kind {
            AnyReduced::Two(owned) => owned.decide(py, amounts, owned.contacts(), |problem, a| {
                is_contradiction(problem, &problem.compliance.gather(a))
            }),
            AnyReduced::Three(owned) => {
                owned.decide(py, amounts, owned.contacts(), |problem, a| {
                    is_contradiction(problem, &problem.compliance.gather(a))
                })
            }
        }
    }

    /// Whether normal reactions balance the loads; `None` if they are too large to count.
    fn balances(&self, py: Python<'_>, pressure: Vector<'_>) -> PyResult<Option<bool>> {
        let pressure = pressure.as_slice()?;
        match &self.kind {
            AnyReduced::Two(owned) => owned.decide(py, pressure, owned.contacts(), |problem, p| {
                balances(problem, &problem.compliance.gather(p))
            }),
            AnyReduced::Three(owned) => {
                owned.decide(py, pressure, owned.contacts(), |problem, p| {
                    balances(problem, &problem.compliance.gather(p))
                })
            }
        }
    }

    #[pyo3(signature = (method, tol, max_iterations, max_seconds, reaction, rigid, num_threads, callback=None))]
    #[expect(
        clippy::too_many_arguments,
        reason = "the settings of one call from Python"
    )]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        method: &str,
        tol: f64,
        max_iterations: Option<usize>,
        max_seconds: Option<f64>,
        reaction: Option<Matrix<'py>>,
        rigid: Option<Vector<'py>>,
        num_threads: Option<usize>,
        callback: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = settings(method, tol, max_iterations, max_seconds)?;
        let rigid = rigid.map_or(Ok(Vec::new()), |a| a.as_slice().map(<[f64]>::to_vec))?;
        let start = (reaction.as_ref(), rigid);
        let callback = callback.as_ref();
        match &self.kind {
            AnyReduced::Two(owned) => owned.solve(py, &settings, start, num_threads, callback),
            AnyReduced::Three(owned) => owned.solve(py, &settings, start, num_threads, callback),
        }
    }
}
