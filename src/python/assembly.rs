//! Stiffness matrices of meshes.

use std::sync::atomic::AtomicBool;

use numpy::{PyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::assembly::cells::Cells;
use crate::assembly::element::{Law, Reference};
use crate::assembly::pattern::{Index, Pattern};
use crate::assembly::stiffness::{self as core, Elastic};
use crate::error::Error;
use crate::python::arrays::{self, Indices, Matrix, Vector};
use crate::python::interrupt;

/// Nodes of cells `(c, cells)`, of 32 or 64 bits.
#[derive(FromPyObject)]
pub(super) enum CellNodes<'py> {
    Narrow(PyReadonlyArray2<'py, i32>),
    Wide(PyReadonlyArray2<'py, i64>),
}

impl CellNodes<'_> {
    fn cells(&self, nodes: usize) -> PyResult<Cells> {
        Ok(match self {
            Self::Narrow(array) => Cells::new(array.as_slice()?, array.as_array().nrows(), nodes)?,
            Self::Wide(array) => Cells::new(array.as_slice()?, array.as_array().nrows(), nodes)?,
        })
    }
}

/// Row pointers, columns and values.
enum Csr {
    Narrow(Vec<i32>, Vec<i32>, Vec<f64>),
    Wide(Vec<i64>, Vec<i64>, Vec<f64>),
}

type CsrOutput<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

impl Csr {
    /// Narrow where the number of entries allows it.
    fn new<const D: usize>(pattern: &Pattern, values: Vec<f64>) -> Self {
        if i32::try_from(values.len()).is_ok() {
            let (pointer, index) = pattern.csr::<D, i32>();
            Self::Narrow(pointer, index, values)
        } else {
            let (pointer, index) = pattern.csr::<D, i64>();
            Self::Wide(pointer, index, values)
        }
    }

    fn into_arrays(self, py: Python<'_>) -> CsrOutput<'_> {
        fn arrays<T: numpy::Element + Index>(
            py: Python<'_>,
            pointer: Vec<T>,
            index: Vec<T>,
            values: Vec<f64>,
        ) -> CsrOutput<'_> {
            (
                PyArray1::from_vec(py, pointer).into_any(),
                PyArray1::from_vec(py, index).into_any(),
                PyArray1::from_vec(py, values).into_any(),
            )
        }
        match self {
            Self::Narrow(pointer, index, values) => arrays(py, pointer, index, values),
            Self::Wide(pointer, index, values) => arrays(py, pointer, index, values),
        }
    }
}

/// `K` of a mesh of cells of one kind. `points` is `(d, nodes)`, `cells` `(c, cells)`, `slopes`
/// `(q, d, c)`. A row of `laws` has λ and μ of a material, or all `d⁴` entries of its tensor.
/// `material` is the row of each cell; without it all cells have the first.
#[pyfunction]
#[pyo3(signature = (
    points, cells, slopes, weights, thickness, laws, material=None, num_threads=None
))]
#[expect(clippy::too_many_arguments, reason = "the signature that Python sees")]
pub(super) fn stiffness<'py>(
    py: Python<'py>,
    points: Matrix<'py>,
    cells: CellNodes<'py>,
    slopes: PyReadonlyArray3<'py, f64>,
    weights: Vector<'py>,
    thickness: f64,
    laws: Matrix<'py>,
    material: Option<Indices<'py>>,
    num_threads: Option<usize>,
) -> PyResult<CsrOutput<'py>> {
    let shape = (points.as_array().nrows(), points.as_array().ncols());
    let cells = cells.cells(shape.1)?;
    let material = match &material {
        Some(given) => arrays::indices(given, "materials of cells")?,
        None => Vec::new(),
    };
    let mesh = Mesh {
        points: points.as_slice()?,
        cells,
        slopes: slopes.as_slice()?,
        weights: weights.as_slice()?,
        thickness,
        laws: laws.as_slice()?,
        law: laws.as_array().ncols(),
        material,
    };
    let found = interrupt::run(py, num_threads, |stop| match shape.0 {
        2 => mesh.stiffness::<2>(stop),
        _ => mesh.stiffness::<3>(stop),
    })?;
    Ok(found.into_arrays(py))
}

/// The arguments of [`stiffness`] that do not depend on the dimension.
struct Mesh<'a> {
    points: &'a [f64],
    cells: Cells,
    slopes: &'a [f64],
    weights: &'a [f64],
    thickness: f64,
    laws: &'a [f64],
    /// Number of entries of each law.
    law: usize,
    material: Vec<usize>,
}

impl Mesh<'_> {
    fn stiffness<const D: usize>(&self, stop: &AtomicBool) -> Result<Csr, Error> {
        let laws: Result<Vec<Law>, Error> = self
            .laws
            .chunks_exact(self.law.max(1))
            .map(|row| match row {
                &[lame_lambda, lame_mu] => Ok(Law::Isotropic(lame_lambda, lame_mu)),
                tensor => Law::general::<D>(tensor),
            })
            .collect();
        let corners = self.cells.corners();
        let mesh = Elastic {
            cells: &self.cells,
            points: self.points,
            reference: &Reference::<D>::new(self.slopes, self.weights, corners, self.thickness)?,
            laws: &laws?,
            material: &self.material,
        };
        let pattern = Pattern::new(&self.cells);
        let values = mesh.values(&pattern, stop)?;
        Ok(Csr::new::<D>(&pattern, values))
    }
}

/// Sums matrices of cells. `matrices` has for each cell the blocks of its nodes i, j with `d²`
/// components k, l: `(cells, c² d²)`.
#[pyfunction]
#[pyo3(signature = (cells, nodes, dim, matrices, num_threads=None))]
pub(super) fn sum_of_cells<'py>(
    py: Python<'py>,
    cells: CellNodes<'py>,
    nodes: usize,
    dim: usize,
    matrices: Matrix<'py>,
    num_threads: Option<usize>,
) -> PyResult<CsrOutput<'py>> {
    fn sum<const D: usize>(
        cells: &Cells,
        matrices: &[f64],
        stop: &AtomicBool,
    ) -> Result<Csr, Error> {
        let pattern = Pattern::new(cells);
        let values = core::sum_of_cells::<D>(cells, &pattern, matrices, stop)?;
        Ok(Csr::new::<D>(&pattern, values))
    }
    let (cells, matrices) = (cells.cells(nodes)?, matrices.as_slice()?);
    let found = interrupt::run(py, num_threads, |stop| match dim {
        2 => sum::<2>(&cells, matrices, stop),
        _ => sum::<3>(&cells, matrices, stop),
    })?;
    Ok(found.into_arrays(py))
}
