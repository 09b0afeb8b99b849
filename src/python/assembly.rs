//! Stiffness matrices of meshes.

use std::sync::atomic::AtomicBool;

use crate::assembly::cells::Cells;
use crate::assembly::element::{Law, Reference};
use crate::assembly::inspection::{self, Bodies, Rows};
use crate::assembly::pattern::{Part, Pattern};
use crate::assembly::stiffness::{self as core, Elastic};
use crate::error::{Error, check_length};
use crate::linalg::sparse::csc::Index;
use crate::python::arrays::{
    self, Csr as GivenCsr, Indices, Matrix, NewIndices, NewMatrix, NewVector, Vector,
};
use crate::python::interrupt;
use crate::tasks;
use numpy::{PyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

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
    /// Narrow where the numbers of entries and of columns allow it.
    fn new<const D: usize>(pattern: &Pattern, values: Vec<f64>) -> Self {
        if i32::try_from(values.len().max(D * pattern.columns())).is_ok() {
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
/// `material` is the row of each cell; without it all cells have the first. `part` has the nodes
/// of the wanted rows, and the numbers of all nodes among the columns.
#[pyfunction]
#[pyo3(signature = (
    points, cells, slopes, weights, thickness, laws, material=None, part=None, num_threads=None
))]
pub(super) fn stiffness<'py>(
    py: Python<'py>,
    points: Matrix<'py>,
    cells: CellNodes<'py>,
    slopes: PyReadonlyArray3<'py, f64>,
    weights: Vector<'py>,
    thickness: f64,
    laws: Matrix<'py>,
    material: Option<Indices<'py>>,
    part: Option<(Indices<'py>, Indices<'py>)>,
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
        part: read_part(part, shape.1)?,
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
    part: Option<Part>,
}

fn read_part(part: Option<(Indices<'_>, Indices<'_>)>, nodes: usize) -> PyResult<Option<Part>> {
    let Some((rows, numbers)) = part else {
        return Ok(None);
    };
    let part = Part {
        rows: arrays::indices(&rows, "rows of K")?,
        numbers: arrays::indices(&numbers, "numbers of nodes")?,
    };
    check_length("numbers of nodes", part.numbers.len(), nodes)?;
    let ends = part.rows.iter().skip(1).chain([&nodes]);
    if let Some(row) = part.rows.iter().zip(ends).position(|(row, end)| row >= end) {
        return Err(Error::SparseStructure { what: "K", row }.into());
    }
    Ok(Some(part))
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
        let pattern = Pattern::new(&self.cells, self.part.clone());
        let values = mesh.values(&pattern, stop)?;
        Ok(Csr::new::<D>(&pattern, values))
    }
}

/// Sums matrices of cells. `matrices` has for each cell the blocks of its nodes i, j with `d²`
/// components k, l: `(cells, c² d²)`. `part` as in `stiffness`.
#[pyfunction]
#[pyo3(signature = (cells, nodes, dim, matrices, part=None, num_threads=None))]
pub(super) fn sum_of_cells<'py>(
    py: Python<'py>,
    cells: CellNodes<'py>,
    nodes: usize,
    dim: usize,
    matrices: Matrix<'py>,
    part: Option<(Indices<'py>, Indices<'py>)>,
    num_threads: Option<usize>,
) -> PyResult<CsrOutput<'py>> {
    fn sum<const D: usize>(
        cells: &Cells,
        matrices: &[f64],
        part: Option<Part>,
        stop: &AtomicBool,
    ) -> Result<Csr, Error> {
        let pattern = Pattern::new(cells, part);
        let values = core::sum_of_cells::<D>(cells, &pattern, matrices, stop)?;
        Ok(Csr::new::<D>(&pattern, values))
    }
    let part = read_part(part, nodes)?;
    let (cells, matrices) = (cells.cells(nodes)?, matrices.as_slice()?);
    let found = interrupt::run(py, num_threads, |stop| match dim {
        2 => sum::<2>(&cells, matrices, part, stop),
        _ => sum::<3>(&cells, matrices, part, stop),
    })?;
    Ok(found.into_arrays(py))
}

/// Evaluates an expression with the rows of K, whose indices have 32 or 64 bits.
macro_rules! of_rows {
    ($stiffness:expr, $by_node:expr, $k:ident => $result:expr) => {
        of_rows!($stiffness, $by_node, $k => $result; Narrow, Wide)
    };
    ($stiffness:expr, $by_node:expr, $k:ident => $result:expr; $($kind:ident),*) => {{
        let (pointer, index, values) = $stiffness;
        let values = values.as_slice()?;
        match (pointer, index) {
            $((Indices::$kind(pointer), Indices::$kind(index)) => {
                let (pointer, index) = (pointer.as_slice()?, index.as_slice()?);
                let by_node = $by_node;
                let $k = Rows { pointer, index, values, by_node };
                $result
            })*
            _ => {
                let message = "pointers and indices of K have different types";
                return Err(PyValueError::new_err(message));
            }
        }
    }};
}

pub(super) use of_rows;

/// Forces of a dilation and bodies by degree of freedom; by body the work of shears, least and
/// greatest coordinates, and numbers of all and of free degrees of freedom.
pub(super) type BodiesOutput<'py> = (
    NewVector<'py>,
    NewIndices<'py>,
    NewVector<'py>,
    NewMatrix<'py>,
    NewMatrix<'py>,
    NewIndices<'py>,
    NewIndices<'py>,
);

#[pyfunction]
#[pyo3(signature = (stiffness, places, by_node, num_threads=None))]
pub(super) fn bodies<'py>(
    py: Python<'py>,
    stiffness: GivenCsr<'py>,
    places: Matrix<'py>,
    by_node: bool,
    num_threads: Option<usize>,
) -> PyResult<BodiesOutput<'py>> {
    if places.as_array().ncols() == 2 {
        bodies_in::<2>(py, &stiffness, &places, by_node, num_threads)
    } else {
        bodies_in::<3>(py, &stiffness, &places, by_node, num_threads)
    }
}

fn bodies_in<'py, const D: usize>(
    py: Python<'py>,
    stiffness: &GivenCsr<'py>,
    places: &Matrix<'py>,
    by_node: bool,
    num_threads: Option<usize>,
) -> PyResult<BodiesOutput<'py>> {
    let places = arrays::rows::<D>(places)?;
    let found = of_rows!(stiffness, by_node, k => {
        interrupt::run(py, num_threads, |_| inspect(&k, places))?
    });
    Ok(bodies_output(py, found))
}

pub(super) fn bodies_output<const D: usize>(py: Python<'_>, found: Bodies<D>) -> BodiesOutput<'_> {
    (
        arrays::from_vec(py, found.outward),
        PyArray1::from_vec(py, found.body),
        arrays::from_vec(py, found.work),
        arrays::from_rows(py, &found.low),
        arrays::from_rows(py, &found.high),
        PyArray1::from_vec(py, found.all),
        PyArray1::from_vec(py, found.free),
    )
}

#[pyfunction]
#[pyo3(signature = (stiffness, num_threads=None))]
pub(super) fn diagonal<'py>(
    py: Python<'py>,
    stiffness: GivenCsr<'py>,
    num_threads: Option<usize>,
) -> PyResult<NewVector<'py>> {
    let diagonal = of_rows!(&stiffness, true, k => {
        interrupt::run(py, num_threads, |_| {
            let n = k.pointer.len().saturating_sub(1);
            check_rows(&k, n, n)?;
            Ok(inspection::diagonal(&k, 0))
        })?
    });
    Ok(arrays::from_vec(py, diagonal))
}

/// The bodies of K, after its rows have been checked.
fn inspect<I: Index, const D: usize>(
    k: &Rows<'_, I>,
    places: &[[f64; D]],
) -> Result<Bodies<D>, Error> {
    let n = places.len();
    check_length("coordinates", n, n / D * D)?;
    check_rows(k, n, n)?;
    Ok(inspection::bodies(*k, places))
}

/// Checks that the arrays are those of a matrix of so many `rows` and `n` columns.
pub(super) fn check_rows<I: Index>(k: &Rows<'_, I>, rows: usize, n: usize) -> Result<(), Error> {
    check_length("row pointers of K", k.pointer.len(), rows + 1)?;
    check_length("values of K", k.values.len(), k.index.len())?;
    let rise = k
        .pointer
        .windows(2)
        .all(|pair| pair[0].at() <= pair[1].at());
    let ends = [k.pointer.first(), k.pointer.last()].map(|end| end.map(|end| end.at()));
    let whole = ends == [Some(0), Some(k.index.len())];
    let within = |_: usize, part: &[I]| part.iter().all(|j| j.at() < n);
    let inside = tasks::map(k.index.chunks(1 << 16), within);
    if rise && whole && inside.iter().all(|&inside| inside) {
        Ok(())
    } else {
        Err(Error::SparseStructure { what: "K", row: 0 })
    }
}
