//! The heap of this process.

use pyo3::prelude::*;

use crate::linalg::pages;

#[pyfunction]
pub(super) fn return_heap() {
    pages::return_heap();
}
