//! What exists in the plane and in space: the core is generic over the dimension, Python chooses
//! it when the program runs.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A value of the plane or of space.
#[derive(Clone)]
pub(super) enum Dimension<P, S> {
    Plane(P),
    Space(S),
}

/// Evaluates one expression for a value of either dimension.
macro_rules! for_either {
    ($value:expr, $inner:pat => $result:expr) => {
        match $value {
            $crate::python::dimension::Dimension::Plane($inner) => $result,
            $crate::python::dimension::Dimension::Space($inner) => $result,
        }
    };
}

/// Evaluates one expression for a value of either dimension; its result has the same one.
macro_rules! map_either {
    ($value:expr, $inner:pat => $result:expr) => {
        match $value {
            $crate::python::dimension::Dimension::Plane($inner) => {
                $crate::python::dimension::Dimension::Plane($result)
            }
            $crate::python::dimension::Dimension::Space($inner) => {
                $crate::python::dimension::Dimension::Space($result)
            }
        }
    };
}

impl<P, S> Dimension<P, S> {
    pub(super) const fn count(&self) -> usize {
        match self {
            Self::Plane(_) => 2,
            Self::Space(_) => 3,
        }
    }
}

pub(super) use {for_either, map_either};

pub(super) fn check_dimension(d: usize) -> PyResult<()> {
    if d == 2 || d == 3 {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("d is {d}, expected 2 or 3")))
}

impl Dimension<(), ()> {
    /// The dimension of arrays with so many columns.
    pub(super) fn of(columns: usize) -> Self {
        if columns == 2 {
            Self::Plane(())
        } else {
            Self::Space(())
        }
    }
}
