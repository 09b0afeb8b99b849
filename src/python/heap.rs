//! The heap of a process that runs only bipot_rs.

use pyo3::prelude::*;

use crate::linalg::pages;

/// As [`pages::keep_heap`].
#[pyfunction]
pub(super) fn keep_heap() {
    pages::keep_heap();
}

/// As [`pages::return_heap`].
#[pyfunction]
pub(super) fn return_heap() {
    pages::return_heap();
}
