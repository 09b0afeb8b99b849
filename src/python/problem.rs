//! The condensed contact problem and its load path.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::csc::Symmetric;
use crate::panics::caught;
use crate::problem::condense::{self, Given};
use crate::problem::memory;
use crate::problem::sparse::Rows;
use crate::python::arrays::{self, Indices, Matrix, Vector};
use crate::python::interrupt;
use crate::python::solver::{settings, solution_dict};
use crate::stepping::{LoadPath, State, Step};

/// Row pointers, column indices and values of a matrix in CSR form.
type Csr<'py> = (Indices<'py>, Indices<'py>, Vector<'py>);

type FreePart<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

#[derive(Clone)]
pub(super) enum Kind {
    Two(Arc<condense::Condensed<2>>),
    Three(Arc<condense::Condensed<3>>),
}

/// Calls one generic body for both dimensions.
macro_rules! either {
    ($kind:expr, $inner:ident => $body:expr) => {
        match $kind {
            Kind::Two($inner) => $body,
            Kind::Three($inner) => $body,
        }
    };
}

/// `K`, `B`, gap and friction, condensed onto the contact set.
#[pyclass(frozen, module = "bipot_rs._core")]
pub(super) struct Condensed {
    pub(super) kind: Kind,
    pub(super) num_threads: Option<usize>,
}

/// A sparse matrix with indices as the core counts them.
struct Sparse<'a> {
    pointer: Vec<usize>,
    index: Vec<usize>,
    values: &'a [f64],
}

impl<'a> Sparse<'a> {
    fn new(csr: &'a Csr<'_>, what: &'static str) -> PyResult<Self> {
        Ok(Self {
            pointer: arrays::indices(&csr.0, what)?,
            index: arrays::indices(&csr.1, what)?,
            values: csr.2.as_slice()?,
        })
    }
}

fn condensed<const D: usize>(
    stiffness: &Sparse<'_>,
    contact: &Sparse<'_>,
    gap: &[[f64; D]],
    mu: &[f64],
    fixed: &[usize],
    stop: &AtomicBool,
) -> Result<Arc<condense::Condensed<D>>, Error> {
    let n = stiffness.pointer.len().saturating_sub(1);
    let given = Given {
        stiffness: Symmetric::new(n, &stiffness.pointer, &stiffness.index, stiffness.values)?,
        contact: Rows {
            row_ptr: &contact.pointer,
            columns: &contact.index,
            values: contact.values,
        },
        gap,
        mu,
        fixed,
    };
    condense::Condensed::new(&given, stop).map(Arc::new)
}

#[pymethods]
impl Condensed {
    #[new]
    #[pyo3(signature = (stiffness, contact, gap, mu, fixed, num_threads))]
    fn new<'py>(
        py: Python<'py>,
        stiffness: Csr<'py>,
        contact: Csr<'py>,
        gap: Matrix<'py>,
        mu: Vector<'py>,
        fixed: Indices<'py>,
        num_threads: Option<usize>,
    ) -> PyResult<Self> {
        let k = Sparse::new(&stiffness, "K")?;
        let b = Sparse::new(&contact, "B")?;
        let fixed = arrays::indices(&fixed, "fixed")?;
        let mu = mu.as_slice()?;
        let kind = if gap.as_array().ncols() == 2 {
            let gap = arrays::rows::<2>(&gap)?;
            Kind::Two(interrupt::run(py, num_threads, |stop| {
                condensed(&k, &b, gap, mu, &fixed, stop)
            })?)
        } else {
            let gap = arrays::rows::<3>(&gap)?;
            Kind::Three(interrupt::run(py, num_threads, |stop| {
                condensed(&k, &b, gap, mu, &fixed, stop)
            })?)
        };
        Ok(Self { kind, num_threads })
    }

    /// `W`, dense.
    fn compliance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (dense, n) = either!(&self.kind, inner => {
            let n = inner.contact_components();
            memory::check("the dense compliance W", 8 * (n as u128).pow(2))?;
            (caught(|| inner.compliance().to_dense())?, n)
        });
        arrays::square(py, dense, n, n)
    }

    /// `W` in blocks where it is sparse: the first block of each row, the column of
    /// each, and their entries, row-major.
    #[expect(clippy::type_complexity, reason = "the arrays of one sparse matrix")]
    fn sparse_compliance<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Vec<usize>, Vec<usize>, Bound<'py, PyArray1<f64>>)>> {
        let blocks = either!(&self.kind, inner => inner.compliance().rows_of_blocks()?);
        Ok(blocks.map(|(start, column, values)| (start, column, arrays::from_vec(py, values))))
    }

    /// `q` with the whole gap, the columns of `R` as rows, and `e`.
    fn free_part<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<FreePart<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        either!(&self.kind, inner => {
            let part = interrupt::run(py, self.num_threads, |_| inner.free_part(load, prescribed))?;
            let rows = part.rigid.modes.len();
            let flat: Vec<f64> = part.rigid.modes.iter().flat_map(|m| m.as_flattened().to_vec()).collect();
            Ok((
                arrays::from_rows(py, &part.q)?,
                arrays::square(py, flat, rows, inner.contact_components())?,
                arrays::from_vec(py, part.rigid.load),
            ))
        })
    }

    /// Makes the inverse of `W`, where there is one, before a step asks for it.
    fn make_inverse(&self, py: Python<'_>) -> PyResult<()> {
        either!(&self.kind, inner => {
            interrupt::run(py, self.num_threads, |stop| inner.compliance().make_inverse(stop))?
        });
        Ok(())
    }

    /// `u` of all degrees of freedom.
    fn displacement<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
        reaction: Matrix<'py>,
        rigid: Vector<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        let rigid = rigid.as_slice()?;
        let u = either!(&self.kind, inner => {
            let reaction = arrays::rows(&reaction)?;
            interrupt::run(py, self.num_threads, |_| {
                inner.displacement(load, prescribed, reaction, rigid)
            })?
        });
        Ok(arrays::from_vec(py, u))
    }

    /// Counts and seconds of the condensation.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (stats, n, dofs, bodies, bytes) = either!(&self.kind, inner => {
            {
                let bytes = inner.compliance().bytes();
                (inner.stats(), inner.order(), inner.rigid_dofs(), inner.rigid_bodies(), bytes)
            }
        });
        let dict = PyDict::new(py);
        dict.set_item("n", n)?;
        dict.set_item("n_contact_dofs", stats.contact_dofs)?;
        dict.set_item("nnz_factor", stats.nnz_factor)?;
        dict.set_item("flops", stats.flops)?;
        dict.set_item("bytes_factor", stats.bytes_factor)?;
        dict.set_item("bytes_peak", stats.bytes_peak)?;
        dict.set_item("bytes_compliance", bytes)?;
        dict.set_item("cond_S", stats.cond_s)?;
        dict.set_item("bodies", stats.bodies)?;
        dict.set_item("islands", stats.islands)?;
        dict.set_item("rigid_motions", dofs.len())?;
        dict.set_item("rigid_motion_dofs", dofs)?;
        dict.set_item("rigid_motion_bodies", bodies)?;
        dict.set_item("ordering", stats.ordering)?;
        dict.set_item("seconds_order", stats.seconds_order)?;
        dict.set_item("seconds_symbolic", stats.seconds_symbolic)?;
        dict.set_item("seconds_factor", stats.seconds_factor)?;
        dict.set_item("seconds_compliance", stats.seconds_compliance)?;
        Ok(dict)
    }
}

enum Progress {
    Two(Arc<condense::Condensed<2>>, LoadPath<2>),
    Three(Arc<condense::Condensed<3>>, LoadPath<3>),
}

/// A load path in progress; without a state it starts from the unloaded bodies.
#[pyclass(module = "bipot_rs._core")]
pub(super) struct Path {
    progress: Progress,
    num_threads: Option<usize>,
}

/// Reaction, total relative displacement, status and rigid motion of a step.
type StartArrays<'py> = (
    Matrix<'py>,
    Matrix<'py>,
    numpy::PyReadonlyArray1<'py, i8>,
    Vector<'py>,
);

/// A path from the state of a step, or from the unloaded bodies.
fn load_path<const D: usize>(
    problem: &condense::Condensed<D>,
    start: Option<&StartArrays<'_>>,
) -> PyResult<LoadPath<D>> {
    match start {
        Some(arrays) => Ok(LoadPath::from_state(state(problem, arrays)?)),
        None => Ok(LoadPath::default()),
    }
}

fn state<const D: usize>(
    problem: &condense::Condensed<D>,
    (reaction, displacement, status, rigid): &StartArrays<'_>,
) -> PyResult<State<D>> {
    let status = status.as_slice()?.iter().map(|s| match s {
        1 => Status::Slip,
        2 => Status::Stick,
        _ => Status::Open,
    });
    let contacts = problem.contacts();
    let state = State {
        reaction: arrays::rows_of("start", reaction, contacts)?.to_vec(),
        relative_displacement: arrays::rows_of("start", displacement, contacts)?.to_vec(),
        status: status.collect(),
        rigid: rigid.as_slice()?.to_vec(),
    };
    arrays::length("start", state.status.len(), contacts)?;
    arrays::length("start", state.rigid.len(), problem.rigid_dofs().len())?;
    Ok(state)
}

fn step_dict<'py, const D: usize>(py: Python<'py>, step: &Step<D>) -> PyResult<Bound<'py, PyDict>> {
    let dict = solution_dict(py, &step.solution)?;
    let flat = step.slip.iter().flat_map(|s| s[1..].to_vec()).collect();
    dict.set_item("slip", arrays::square(py, flat, step.slip.len(), D - 1)?)?;
    Ok(dict)
}

#[pymethods]
impl Path {
    #[new]
    #[pyo3(signature = (problem, start=None))]
    fn new(problem: &Condensed, start: Option<StartArrays<'_>>) -> PyResult<Self> {
        let progress = match &problem.kind {
            Kind::Two(inner) => Progress::Two(Arc::clone(inner), load_path(inner, start.as_ref())?),
            Kind::Three(inner) => {
                Progress::Three(Arc::clone(inner), load_path(inner, start.as_ref())?)
            }
        };
        Ok(Self {
            progress,
            num_threads: problem.num_threads,
        })
    }

    /// One step to the total loads; the path moves on only where it converged.
    #[expect(
        clippy::too_many_arguments,
        reason = "the settings of one call from Python"
    )]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
        method: &str,
        tol: f64,
        max_iterations: Option<usize>,
        max_seconds: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = settings(method, tol, max_iterations, max_seconds)?;
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        match &mut self.progress {
            Progress::Two(inner, path) => {
                let step = interrupt::run(py, self.num_threads, |stop| {
                    path.advance(inner, load, prescribed, &settings, stop)
                })?;
                step_dict(py, &step)
            }
            Progress::Three(inner, path) => {
                let step = interrupt::run(py, self.num_threads, |stop| {
                    path.advance(inner, load, prescribed, &settings, stop)
                })?;
                step_dict(py, &step)
            }
        }
    }
}
