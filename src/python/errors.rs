//! Converts [`Error`] to exceptions.

use pyo3::exceptions::{
    PyArithmeticError, PyKeyboardInterrupt, PyMemoryError, PyOSError, PyRuntimeError, PyValueError,
};
use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::error::Error;
use crate::panics::Panicked;

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let text = error.to_string();
        let motion = of_motion(&error);
        let cell = match error {
            Error::FoldedCell { cell } => Some(cell),
            _ => None,
        };
        let made = match error {
            Error::Shape { .. }
            | Error::NotFinite { .. }
            | Error::EntryNotFinite { .. }
            | Error::IndexRange { .. }
            | Error::Repeated { .. }
            | Error::SparseStructure { .. }
            | Error::Friction { .. }
            | Error::EllipticFriction { .. }
            | Error::Setting { .. }
            | Error::NotHeld { .. }
            | Error::Range { .. }
            | Error::ThreadCount { .. }
            | Error::Megabytes { .. }
            | Error::Asymmetric { .. }
            | Error::FactorDropped
            | Error::UnknownLoads
            | Error::FewDigits { .. }
            | Error::Multigrid { .. }
            | Error::FoldedCell { .. }
            | Error::Indefinite { .. } => PyValueError::new_err(text),
            Error::FloatingBody { .. } | Error::DependentMotion { .. } => {
                ours("FloatingBodyError", text)
            }
            Error::NotBalanced { .. } | Error::NotConfirmed { .. } => {
                ours("NotConvergedError", text)
            }
            Error::NotIterative { reason } => {
                let made = ours("NotIterativeError", text);
                Python::attach(|py| drop(made.value(py).setattr("reason", reason)));
                made
            }
            Error::ContradictoryContact { .. } => ours("NoEquilibriumError", text),
            Error::Memory { .. } | Error::MemoryLimit { .. } => PyMemoryError::new_err(text),
            Error::Threads { .. } => PyOSError::new_err(text),
            Error::Interrupted => PyKeyboardInterrupt::new_err(text),
        };
        if let Some(cell) = cell {
            // Python adds the name of the body and the place.
            Python::attach(|py| drop(made.value(py).setattr("cell", cell)));
        }
        if let Some((kind, dof)) = motion {
            // Python adds the name of the body, and what few digits may explain.
            Python::attach(|py| {
                drop(made.value(py).setattr("kind", kind));
                drop(made.value(py).setattr("dof", dof));
            });
        }
        made
    }
}

/// The kind of an error about what can move, and a degree of freedom that moves.
fn of_motion(error: &Error) -> Option<(&'static str, usize)> {
    match *error {
        Error::FloatingBody { dof } => Some(("floating_body", dof)),
        Error::FewDigits { dof } => Some(("few_digits", dof)),
        Error::Indefinite { dof } => Some(("indefinite", dof)),
        _ => None,
    }
}

impl From<Panicked> for PyErr {
    fn from(panicked: Panicked) -> Self {
        PyRuntimeError::new_err(panicked.to_string())
    }
}

/// An exception of `bipot_rs.contact.errors`. It is a Python class because it carries a result.
fn ours(name: &str, text: String) -> PyErr {
    Python::attach(|py| {
        let made = PyModule::import(py, "bipot_rs.contact.errors")
            .and_then(|module| module.getattr(PyString::new(py, name)))
            .and_then(|class| class.call1((text.clone(),)));
        match made {
            Ok(exception) => PyErr::from_value(exception),
            // The package is incomplete: keep the message.
            Err(_) => PyArithmeticError::new_err(text),
        }
    })
}
