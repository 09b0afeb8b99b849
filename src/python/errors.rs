//! Converts [`Error`] to exceptions, which have its kind and its fields as attributes.

use pyo3::exceptions::{
    PyArithmeticError, PyKeyboardInterrupt, PyMemoryError, PyOSError, PyRuntimeError, PyValueError,
};
use pyo3::prelude::*;

use crate::error::Error;
use crate::panics::Panicked;

/// Makes the exception of an error: a class for its variants, each with its fields. `kind` is
/// the name of the variant in lower case, as in `floating_body`.
macro_rules! exception {
    ($error:expr, { $($class:expr => [$($variant:ident $({ $($field:ident),* })?),* $(,)?],)* }) => {{
        let text = $error.to_string();
        Python::attach(|py| match $error {
            $($(Error::$variant $({ $($field),* })? => {
                let made: PyErr = ($class)(py, text);
                let value = made.value(py);
                // Only a Python class that refuses attributes makes this fail.
                drop(value.setattr("kind", lower(stringify!($variant))));
                $($(drop(value.setattr(stringify!($field), $field));)*)?
                made
            })*)*
        })
    }};
}

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        exception!(error, {
            |_, text| PyValueError::new_err::<String>(text) => [
                Shape { what, expected, found },
                NotFinite { what, index, value },
                EntryNotFinite { what, row, column, value },
                IndexRange { what, position, found, limit },
                Repeated { what, index, first, second },
                SparseStructure { what, row },
                Friction { node, mu, largest },
                Cohesion { node, cohesion, largest },
                Dilatancy { node, dilatancy, mu },
                NotCoulomb { what, argument, node, value },
                EllipticFriction { node, mu, ratio },
                Setting { what, found, expected },
                NotHeld { method },
                Asymmetric { row, column, upper, lower },
                Indefinite { dof },
                FewDigits { dof },
                Range { softest, free },
                FactorDropped,
                UnknownLoads,
                ThreadCount { what, found, most },
                Megabytes { what, found },
                Multigrid { reason },
                FoldedCell { cell },
            ],
            |py, text| ours(py, "FloatingBodyError", text) => [
                FloatingBody { dof },
                DependentMotion { mode },
            ],
            |py, text| ours(py, "NotConvergedError", text) => [
                NotBalanced { dof, by_row, of_forces },
                NotConfirmed { contact, off, size },
            ],
            |py, text| ours(py, "NoEquilibriumError", text) => [
                ContradictoryContact { node, penetration },
            ],
            |py, text| ours(py, "NotIterativeError", text) => [
                NotIterative { reason, dof },
                NoOwnNode { contact, oblique, contacts },
            ],
            |_, text| PyMemoryError::new_err::<String>(text) => [
                Memory { what, bytes, available },
                MemoryLimit { what, bytes, limit },
            ],
            |_, text| PyOSError::new_err::<String>(text) => [Threads { threads }],
            |_, text| PyKeyboardInterrupt::new_err::<String>(text) => [Interrupted],
        })
    }
}

/// `floating_body` of `FloatingBody`.
fn lower(variant: &str) -> String {
    let mut name = String::with_capacity(variant.len() + 4);
    for (at, letter) in variant.char_indices() {
        if at > 0 && letter.is_ascii_uppercase() {
            name.push('_');
        }
        name.push(letter.to_ascii_lowercase());
    }
    name
}

impl From<Panicked> for PyErr {
    fn from(panicked: Panicked) -> Self {
        PyRuntimeError::new_err(panicked.to_string())
    }
}

/// An exception of `bipot_rs.contact.errors`. It is a Python class because it carries a result.
fn ours(py: Python<'_>, name: &str, text: String) -> PyErr {
    let made = PyModule::import(py, "bipot_rs.contact.errors")
        .and_then(|module| module.getattr(name))
        .and_then(|class| class.call1((text.clone(),)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        // The package is incomplete: keep the message.
        Err(_) => PyArithmeticError::new_err(text),
    }
}
