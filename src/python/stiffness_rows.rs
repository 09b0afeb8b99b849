//! `K` of a mesh in space, in parts of its rows.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::assembly::inspection::{InspectedRows, Rows, diagonal};
use crate::error::{Error, check_length};
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::primal::nodes::Nodes;
use crate::primal::stiffness_rows::StiffnessRows;
use crate::python::arrays::{self, Csr, Indices, Matrix};
use crate::python::assembly::{BodiesOutput, bodies_output, check_rows, of_rows};
use crate::python::interrupt;

/// The rows of `K` so far, for `Primal.of_rows`.
#[pyclass(name = "StiffnessRows", module = "bipot_rs._core")]
pub(super) struct PyStiffnessRows {
    /// `None` after `Primal.of_rows`, which takes them.
    pub(super) rows: Option<StiffnessRows>,
    inspected: InspectedRows,
    n: usize,
    pub(super) num_threads: Option<usize>,
}

#[pymethods]
impl PyStiffnessRows {
    /// `places` are the coordinates of the degrees of freedom, which are numbered by nodes;
    /// `fixed` ascends.
    #[new]
    #[pyo3(signature = (places, fixed, num_threads=None))]
    fn new(places: Matrix<'_>, fixed: Indices<'_>, num_threads: Option<usize>) -> PyResult<Self> {
        let places = arrays::rows::<3>(&places)?;
        let nodes = Nodes::new::<3>(places.len(), Some(places), &OwnedMatrix::default())?;
        let fixed = arrays::indices(&fixed, "fixed")?;
        Ok(Self {
            rows: Some(StiffnessRows::new(nodes, &fixed)?),
            inspected: InspectedRows::default(),
            n: places.len(),
            num_threads,
        })
    }

    /// Adds the next rows, all of some nodes; whether their diagonal is positive. `places` are
    /// coordinates as of `bodies`.
    fn append(&mut self, py: Python<'_>, part: Csr<'_>, places: Matrix<'_>) -> PyResult<bool> {
        let places = arrays::rows::<3>(&places)?;
        let (first, n) = (self.inspected.count(), self.n);
        let (own, inspected) = (&mut self.rows, &mut self.inspected);
        of_rows!(&part, true, k => interrupt::run(py, self.num_threads, |_| {
            check_length("coordinates", places.len(), n)?;
            let count = k.pointer.len().saturating_sub(1);
            check_rows(&k, count, n)?;
            if first + count > n {
                return Err(Error::SparseStructure { what: "K", row: n });
            }
            inspected.add(k, places);
            let end = (first + count) / 3;
            if let Some(own) = own {
                own.append(end, |dof| k.row(dof - first));
            }
            Ok(diagonal(&k, first).iter().all(|&value| value > 0.0))
        }))
    }

    /// As `bodies`, of all rows, once.
    fn bodies<'py>(&mut self, py: Python<'py>, places: Matrix<'py>) -> PyResult<BodiesOutput<'py>> {
        let places = arrays::rows::<3>(&places)?;
        check_length("coordinates", places.len(), self.n)?;
        let inspected = std::mem::take(&mut self.inspected);
        if inspected.count() != self.n {
            return Err(Error::SparseStructure {
                what: "K",
                row: inspected.count(),
            }
            .into());
        }
        Ok(bodies_output(py, inspected.bodies(places, true)))
    }
}
