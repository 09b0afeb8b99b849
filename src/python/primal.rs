//! The contact problem in the displacements, and its load path.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::condensation::condense::ProblemArrays;
use crate::error::Error;
use crate::linalg::sparse::csc::{Index, Symmetric};
use crate::linalg::sparse::rows::Rows;
use crate::primal::path::{PrimalPath, PrimalStep};
use crate::primal::problem::Primal;
use crate::python::arrays::{self, Coefficients, Csr, Indices, Matrix, Vector};
use crate::python::interrupt;
use crate::python::load_path::{ContactArrays, newton_dict, state_of_contacts};
use crate::python::problem::CsrArrays;
use crate::python::solver::settings;
use crate::reduced::elliptic_scaling::{EllipticScaling, times};
use crate::reduced::memory::Budget;
use crate::reduced::rotation::Rotation;

#[derive(Clone)]
pub(super) enum AnyPrimal {
    Two(Arc<Primal<2>>),
    Three(Arc<Primal<3>>),
}

/// `K`, `B`, gap and friction, for Newton on the displacements.
#[pyclass(frozen, from_py_object, name = "Primal", module = "bipot_rs._core")]
#[derive(Clone)]
pub(super) struct PyPrimal {
    /// In the variables of [`EllipticScaling`].
    pub(super) kind: AnyPrimal,
    pub(super) elliptic: Option<EllipticScaling>,
    pub(super) num_threads: Option<usize>,
}

/// The indices of `K`, in the bits of the caller if that can be.
enum Columns<'a> {
    Narrow(&'a [i32]),
    Wide(Vec<usize>),
}

/// The arguments that do not depend on the dimension.
struct Arguments<'a> {
    pointer: Vec<usize>,
    columns: Columns<'a>,
    values: &'a [f64],
    contact: CsrArrays<'a>,
    mu: Vec<f64>,
    elliptic: Option<EllipticScaling>,
    fixed: Vec<usize>,
    places: Option<&'a [[f64; 3]]>,
}

impl Arguments<'_> {
    fn make<const D: usize>(
        self,
        gap: &[[f64; D]],
        stop: &AtomicBool,
    ) -> Result<Arc<Primal<D>>, Error> {
        match &self.columns {
            Columns::Narrow(columns) => self.made_of(columns, gap, stop),
            Columns::Wide(columns) => self.made_of(columns, gap, stop),
        }
    }

    fn made_of<const D: usize, I: Index>(
        &self,
        columns: &[I],
        gap: &[[f64; D]],
        stop: &AtomicBool,
    ) -> Result<Arc<Primal<D>>, Error> {
        let b = &self.contact;
        let n = self.pointer.len().saturating_sub(1);
        let given = ProblemArrays {
            stiffness: Symmetric::new(n, &self.pointer, columns, self.values)?,
            contact: Rows {
                row_ptr: &b.pointer,
                columns: &b.index,
                values: b.values,
            },
            gap,
            mu: &self.mu,
            fixed: &self.fixed,
            places: self.places,
            known: None,
            budget: Budget::default(),
        };
        Primal::new(&given, self.elliptic.as_ref(), stop).map(Arc::new)
    }
}

#[pymethods]
impl PyPrimal {
    /// The arguments of `Condensed`.
    #[new]
    #[pyo3(signature = (stiffness, contact, gap, mu, fixed, num_threads, places=None))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of one problem")]
    fn new<'py>(
        py: Python<'py>,
        stiffness: Csr<'py>,
        contact: Csr<'py>,
        gap: Matrix<'py>,
        mu: Coefficients<'py>,
        fixed: Indices<'py>,
        num_threads: Option<usize>,
        places: Option<Matrix<'py>>,
    ) -> PyResult<Self> {
        let plane = gap.as_array().ncols() == 2;
        let (mu, elliptic) = mu.friction(gap.as_array().ncols())?;
        let asked = Arguments {
            pointer: arrays::indices(&stiffness.0, "K")?,
            columns: match &stiffness.1 {
                Indices::Narrow(columns) => Columns::Narrow(columns.as_slice()?),
                columns @ Indices::Wide(_) => {
                    Columns::Wide(arrays::many_indices(columns, "K", num_threads)?)
                }
            },
            values: stiffness.2.as_slice()?,
            contact: CsrArrays::new(&contact, "B", num_threads)?,
            fixed: arrays::indices(&fixed, "fixed")?,
            mu,
            elliptic: elliptic.clone(),
            places: places.as_ref().map(arrays::rows::<3>).transpose()?,
        };
        let kind = if plane {
            let gap = arrays::rows::<2>(&gap)?;
            AnyPrimal::Two(interrupt::run(py, num_threads, |stop| {
                asked.make(gap, stop)
            })?)
        } else {
            let gap = arrays::rows::<3>(&gap)?;
            AnyPrimal::Three(interrupt::run(py, num_threads, |stop| {
                asked.make(gap, stop)
            })?)
        };
        Ok(Self {
            kind,
            elliptic,
            num_threads,
        })
    }

    /// The same bodies and contacts with other friction coefficients.
    fn with_mu(&self, mu: Coefficients<'_>) -> PyResult<Self> {
        let (mu, elliptic) = match &self.kind {
            AnyPrimal::Two(_) => mu.friction(2)?,
            AnyPrimal::Three(_) => mu.friction(3)?,
        };
        let change = EllipticScaling::between(self.elliptic.as_ref(), elliptic.as_ref());
        let change = change.as_ref();
        let kind = match &self.kind {
            AnyPrimal::Two(inner) => {
                AnyPrimal::Two(Arc::new(inner.with_mu(mu, elliptic.as_ref(), change)?))
            }
            AnyPrimal::Three(inner) => {
                AnyPrimal::Three(Arc::new(inner.with_mu(mu, elliptic.as_ref(), change)?))
            }
        };
        Ok(Self {
            kind,
            elliptic,
            num_threads: self.num_threads,
        })
    }

    /// The same bodies and contacts with `Q B` and `Q g`; `rotation` has the rows of all `Q`.
    /// `None` if supports are oblique to the new frames.
    fn rotated(&self, py: Python<'_>, rotation: Matrix<'_>) -> PyResult<Option<Self>> {
        fn of<const D: usize>(
            inner: &Primal<D>,
            rotation: &[[f64; D]],
            elliptic: Option<&EllipticScaling>,
        ) -> Result<Option<Arc<Primal<D>>>, Error> {
            match inner.rotated(&Rotation::new(rotation, None), elliptic) {
                Ok(made) => Ok(Some(Arc::new(made))),
                Err(Error::NotIterative { .. }) => Ok(None),
                Err(other) => Err(other),
            }
        }
        let elliptic = self.elliptic.as_ref();
        let kind = match &self.kind {
            AnyPrimal::Two(inner) => {
                let rows = arrays::rows(&rotation)?;
                interrupt::run(py, self.num_threads, |_| of(inner, rows, elliptic))?
                    .map(AnyPrimal::Two)
            }
            AnyPrimal::Three(inner) => {
                let rows = arrays::rows(&rotation)?;
                interrupt::run(py, self.num_threads, |_| of(inner, rows, elliptic))?
                    .map(AnyPrimal::Three)
            }
        };
        Ok(kind.map(|kind| Self {
            kind,
            elliptic: self.elliptic.clone(),
            num_threads: self.num_threads,
        }))
    }

    /// Counts of the problem.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (bytes, forecast) = match &self.kind {
            AnyPrimal::Two(inner) => inner.bytes(),
            AnyPrimal::Three(inner) => inner.bytes(),
        };
        let dict = PyDict::new(py);
        dict.set_item("bytes_stiffness", bytes)?;
        dict.set_item("bytes_forecast", forecast)?;
        Ok(dict)
    }
}

enum AnyPath {
    Two(PrimalPath<2>),
    Three(PrimalPath<3>),
}

/// A load path in the displacements. Without a state it starts from the unloaded bodies.
#[pyclass(name = "PrimalPath", module = "bipot_rs._core")]
pub(super) struct PyPrimalPath {
    problem: PyPrimal,
    path: AnyPath,
}

fn begin<const D: usize>(
    problem: &Primal<D>,
    elliptic: Option<&EllipticScaling>,
    start: Option<&ContactArrays<'_>>,
    displacement: Option<&Vector<'_>>,
) -> PyResult<PrimalPath<D>> {
    let Some((reaction, displaced, status)) = start else {
        return Ok(PrimalPath::default());
    };
    let arrays = (reaction, displaced, status);
    let state = state_of_contacts(problem.contacts.count(), elliptic, arrays)?;
    let u = displacement.map_or(Ok(&[][..]), |u| u.as_slice())?;
    if !u.is_empty() {
        arrays::length("displacement of start", u.len(), problem.order())?;
    }
    Ok(PrimalPath::new(Some(state), u.to_vec()))
}

fn advance<const D: usize>(
    path: &mut PrimalPath<D>,
    problem: &Primal<D>,
    gap: Option<Vec<[f64; D]>>,
    (load, prescribed): (&[f64], &[f64]),
    settings: &crate::solver::Settings,
    stop: &AtomicBool,
) -> Result<PrimalStep<D>, Error> {
    match gap {
        None => path.advance(problem, load, prescribed, settings, stop),
        Some(gap) => path.advance(&problem.with_gap(gap)?, load, prescribed, settings, stop),
    }
}

fn step_dict<'py, const D: usize>(
    py: Python<'py>,
    made: PrimalStep<D>,
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Bound<'py, PyDict>> {
    let work = (made.newton, made.krylov);
    let dict = newton_dict(py, &made.step, work, (made.reason, made.errors), elliptic)?;
    dict.set_item("displacement", arrays::from_vec(py, made.displacement))?;
    dict.set_item("bytes_multigrid", made.bytes)?;
    Ok(dict)
}

#[pymethods]
impl PyPrimalPath {
    #[new]
    #[pyo3(signature = (problem, start=None, displacement=None))]
    fn new(
        problem: PyPrimal,
        start: Option<ContactArrays<'_>>,
        displacement: Option<Vector<'_>>,
    ) -> PyResult<Self> {
        let (start, displacement) = (start.as_ref(), displacement.as_ref());
        let elliptic = problem.elliptic.as_ref();
        let path = match &problem.kind {
            AnyPrimal::Two(inner) => AnyPath::Two(begin(inner, elliptic, start, displacement)?),
            AnyPrimal::Three(inner) => AnyPath::Three(begin(inner, elliptic, start, displacement)?),
        };
        Ok(Self { problem, path })
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
        let loads = (load.as_slice()?, prescribed.as_slice()?);
        let elliptic = self.problem.elliptic.as_ref();
        let threads = self.problem.num_threads;
        match (&mut self.path, &self.problem.kind) {
            (AnyPath::Two(path), AnyPrimal::Two(inner)) => {
                let gap = gap.as_ref().map(arrays::rows).transpose()?;
                let gap = gap.map(|gap| times(elliptic, gap).into_owned());
                let made = interrupt::run(py, threads, |stop| {
                    advance(path, inner, gap, loads, &settings, stop)
                })?;
                step_dict(py, made, elliptic)
            }
            (AnyPath::Three(path), AnyPrimal::Three(inner)) => {
                let gap = gap.as_ref().map(arrays::rows).transpose()?;
                let gap = gap.map(|gap| times(elliptic, gap).into_owned());
                let made = interrupt::run(py, threads, |stop| {
                    advance(path, inner, gap, loads, &settings, stop)
                })?;
                step_dict(py, made, elliptic)
            }
            _ => Err(Error::Shape {
                what: "the dimension of the path",
                expected: 2,
                found: 3,
            }
            .into()),
        }
    }
}
