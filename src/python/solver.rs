//! The projection, and the settings of solvers.

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::law::{cone, elliptic};
use crate::python::arrays::{self, Coefficients, LawArrays, Matrix, NewMatrix, NewVector};
use crate::python::contact_values::factors;
use crate::python::dimension::check_dimension;
use crate::python::interrupt;
use crate::reduced::compliance;
use crate::solver::{Method, Settings};
use crate::tasks;

/// Nodes in one task: few enough for balance, many enough for the cost of a task.
const NODES_A_TASK: usize = 4096;

type Projected<'py> = (NewMatrix<'py>, Bound<'py, PyArray1<i8>>);

#[pyfunction]
pub(super) fn threads() -> PyResult<usize> {
    Ok(crate::threads::count(None)?)
}

#[pyfunction]
#[pyo3(signature = (tau, law, base=None))]
pub(super) fn project<'py>(
    py: Python<'py>,
    tau: Matrix<'py>,
    law: LawArrays<'py>,
    base: Option<Matrix<'py>>,
) -> PyResult<Projected<'py>> {
    let base = base.as_ref();
    match (&law.mu, tau.as_array().ncols()) {
        (Coefficients::Elliptic(mu), _) => {
            project_rows::<3, _>(py, &tau, arrays::rows::<2>(mu)?, base, onto_elliptic)
        }
        (_, 2) => project_rows::<2, _>(py, &tau, &law.read(2)?.0, base, onto_round),
        _ => project_rows::<3, _>(py, &tau, &law.read(3)?.0, base, onto_round),
    }
}

type Isotropic<'py> = (NewMatrix<'py>, NewVector<'py>);

#[pyfunction]
pub(super) fn isotropic<'py>(
    py: Python<'py>,
    mu: Coefficients<'py>,
    d: usize,
) -> PyResult<Isotropic<'py>> {
    check_dimension(d)?;
    let (mu, elliptic) = mu.friction(d)?;
    let factors = arrays::of_contacts(py, factors(d, 0..mu.len(), elliptic.as_ref()), d);
    Ok((factors, arrays::from_vec(py, mu)))
}

type Onto<const D: usize, M> = fn(&[f64; D], Option<&[f64; D]>, M) -> ([f64; D], Status);

fn onto_round<const D: usize>(
    tau: &[f64; D],
    base: Option<&[f64; D]>,
    law: ContactLaw,
) -> ([f64; D], Status) {
    match base {
        Some(base) => cone::project_increment(tau, base, law),
        None => cone::project(tau, law),
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
    let mut out = vec![[0.0; D]; tau.len()];
    let mut status = vec![0_i8; tau.len()];
    let outs = out.chunks_mut(NODES_A_TASK);
    let parts = outs.zip(status.chunks_mut(NODES_A_TASK));
    let of_part = |part: usize, (out, status): (&mut [[f64; D]], &mut [i8])| {
        let first = part * NODES_A_TASK;
        for (k, (t, s)) in out.iter_mut().zip(status).enumerate() {
            let i = first + k;
            let (projected, found) = onto(&tau[i], base.map(|b| &b[i]), mu[i]);
            *t = projected;
            *s = found as i8;
        }
    };
    interrupt::in_pool(py, tau.len() > NODES_A_TASK, || {
        tasks::for_each(parts, of_part);
    })?;
    Ok((arrays::from_rows(py, &out), PyArray1::from_vec(py, status)))
}

/// The settings of a solve, checked once.
#[pyclass(frozen, name = "Settings", module = "bipot_rs._core")]
pub(super) struct PySettings {
    pub(super) checked: Settings,
}

#[pymethods]
impl PySettings {
    #[new]
    fn new(
        method: &str,
        tol: f64,
        max_iterations: Option<usize>,
        max_seconds: Option<f64>,
    ) -> PyResult<Self> {
        let named = Method::NAMES.iter().find(|(name, _)| *name == method);
        let Some(&(_, method)) = named else {
            return Err(PyValueError::new_err(format!(
                "method is '{method}', expected one of '{}'",
                Method::NAMES.map(|(name, _)| name).join("', '")
            )));
        };
        let default = Settings::default();
        let checked = Settings {
            method,
            tol,
            max_iterations: max_iterations.unwrap_or(default.max_iterations),
            max_seconds: max_seconds.unwrap_or(default.max_seconds),
        };
        checked.validate()?;
        Ok(Self { checked })
    }

    #[getter]
    fn method(&self) -> &'static str {
        self.checked.method.name()
    }

    #[getter]
    fn tol(&self) -> f64 {
        self.checked.tol
    }

    #[getter]
    fn max_iterations(&self) -> usize {
        self.checked.max_iterations
    }

    /// None without a limit.
    #[getter]
    fn max_seconds(&self) -> Option<f64> {
        Some(self.checked.max_seconds).filter(|seconds| seconds.is_finite())
    }
}

#[pyfunction]
pub(super) fn is_sparse(blocks: usize, contacts: usize) -> bool {
    compliance::is_sparse(blocks, contacts)
}
