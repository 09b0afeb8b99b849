//! Counts and seconds of a condensation, as classes of Python.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::condensation::body::DIGITS;
use crate::condensation::forecast::Forecast;
use crate::condensation::problem::Problem;

/// A frozen class of Python with attributes, and `as_dict` with their names.
macro_rules! record {
    ($(#[$about:meta])* $name:ident, $python:literal { $($field:ident: $kind:ty,)* }) => {
        $(#[$about])*
        #[pyclass(frozen, get_all, name = $python, module = "bipot_rs._core")]
        pub(super) struct $name {
            $(pub(super) $field: $kind,)*
        }

        #[pymethods]
        impl $name {
            /// The attributes by their names.
            fn as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
                let dict = PyDict::new(py);
                $(dict.set_item(stringify!($field), self.$field.clone())?;)*
                Ok(dict)
            }
        }
    };
}

record! {
    /// Counts and seconds of a condensation.
    #[expect(non_snake_case, reason = "the name that Python sees")]
    PyStats, "CondensationStats" {
        n: usize,
        n_contact_dofs: usize,
        nnz_factor: usize,
        flops: f64,
        bytes_factor: usize,
        bytes_peak: u128,
        bytes_compliance: usize,
        cond_S: f64,
        keeps_digits: bool,
        factor_kept: bool,
        working_set: Option<usize>,
        bodies: usize,
        islands: usize,
        rigid_motions: usize,
        rigid_motion_dofs: Vec<usize>,
        rigid_motion_bodies: Vec<usize>,
        ordering: &'static str,
        orderings: usize,
        seconds_order: f64,
        seconds_symbolic: f64,
        seconds_factor: f64,
        seconds_compliance: f64,
    }
}

record! {
    /// Counts of the analysis of K, before the factorisation.
    PyForecast, "CondensationForecast" {
        bodies: usize,
        n_contact_dofs: usize,
        nnz_factor: usize,
        flops: f64,
        bytes_factor: usize,
        bytes_peak: u128,
        ordering: &'static str,
    }
}

impl<const D: usize> From<&Problem<D>> for PyStats {
    fn from(problem: &Problem<D>) -> Self {
        let (stats, bodies) = (problem.stats(), problem.bodies());
        let counts = &stats.forecast;
        let motions = bodies.motions();
        Self {
            n: bodies.order(),
            n_contact_dofs: counts.contact_dofs,
            nnz_factor: counts.nnz_factor,
            flops: counts.flops,
            bytes_factor: counts.bytes_factor,
            bytes_peak: counts.bytes_peak,
            bytes_compliance: problem.bytes_compliance(),
            cond_S: stats.cond_s,
            keeps_digits: stats.amplification <= DIGITS,
            factor_kept: stats.factor_kept,
            working_set: match problem {
                Problem::Whole(_) => None,
                Problem::Growing { candidates, .. } => Some(candidates.seeds().len()),
            },
            bodies: counts.bodies,
            islands: stats.islands,
            rigid_motions: motions.len(),
            rigid_motion_dofs: (0..motions.len()).map(|k| bodies.most_moved(k)).collect(),
            rigid_motion_bodies: motions.iter().map(|&(body, _)| body).collect(),
            ordering: counts.ordering,
            orderings: stats.orderings,
            seconds_order: stats.seconds_order,
            seconds_symbolic: stats.seconds_symbolic,
            seconds_factor: stats.seconds_factor,
            seconds_compliance: stats.seconds_compliance,
        }
    }
}

impl From<Forecast> for PyForecast {
    fn from(forecast: Forecast) -> Self {
        Self {
            bodies: forecast.bodies,
            n_contact_dofs: forecast.contact_dofs,
            nnz_factor: forecast.nnz_factor,
            flops: forecast.flops,
            bytes_factor: forecast.bytes_factor,
            bytes_peak: forecast.bytes_peak,
            ordering: forecast.ordering,
        }
    }
}
