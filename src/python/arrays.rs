//! Conversion of NumPy arrays to slices and back. Python checks types and shapes; here only
//! memory safety is checked.

use crate::error::{Error, check_length};
use crate::law::cone::Status;
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::pages::zeros;
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::reduced::elliptic_scaling::{EllipticScaling, Friction};
use crate::tasks;
use crate::threads;
use numpy::ndarray::{Array2, Dimension, aview2};
use numpy::{
    PyArray1, PyArray2, PyReadonlyArray, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyReadwriteArray1,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A C-contiguous vector of `f64`.
pub(super) type Vector<'py> = PyReadonlyArray1<'py, f64>;
/// A C-contiguous matrix of `f64`.
pub(super) type Matrix<'py> = PyReadonlyArray2<'py, f64>;
/// A vector that a method changes.
pub(super) type Changed<'py> = PyReadwriteArray1<'py, f64>;
/// Indices or row pointers of 32 or 64 bits, as the caller has them: a copy of those of `K`
/// needs a large part of the memory of `K`.
#[derive(FromPyObject)]
pub(super) enum Indices<'py> {
    Narrow(PyReadonlyArray1<'py, i32>),
    Wide(PyReadonlyArray1<'py, i64>),
}

/// Row pointers, column indices and values of a matrix in CSR form.
pub(super) type Csr<'py> = (Indices<'py>, Indices<'py>, Vector<'py>);

/// A vector, a C-ordered matrix and indices as results.
pub(super) type NewVector<'py> = Bound<'py, PyArray1<f64>>;
pub(super) type NewMatrix<'py> = Bound<'py, PyArray2<f64>>;
pub(super) type NewIndices<'py> = Bound<'py, PyArray1<i64>>;

/// Row pointers, columns and values as results.
pub(super) type CsrOutput<'py> = (NewIndices<'py>, NewIndices<'py>, NewVector<'py>);

/// A sparse matrix with indices as `usize`.
pub(super) struct CsrArrays<'a> {
    pub(super) pointer: Vec<usize>,
    pub(super) index: Vec<usize>,
    pub(super) values: &'a [f64],
}

impl<'a> CsrArrays<'a> {
    pub(super) fn new(
        csr: &'a Csr<'_>,
        what: &'static str,
        num_threads: Option<usize>,
    ) -> PyResult<Self> {
        Ok(Self {
            pointer: indices(&csr.0, what)?,
            index: many_indices(&csr.1, what, num_threads)?,
            values: csr.2.as_slice()?,
        })
    }

    pub(super) fn rows(&self) -> Rows<'_> {
        Rows {
            row_ptr: &self.pointer,
            columns: &self.index,
            values: self.values,
        }
    }
}

/// Friction coefficients: one for each contact, or one for each tangent.
#[derive(FromPyObject)]
pub(super) enum Coefficients<'py> {
    Round(Vector<'py>),
    Elliptic(Matrix<'py>),
}

/// The numbers of the law of each contact: the attributes of a `ContactLaw` of Python.
#[derive(FromPyObject)]
pub(super) struct LawArrays<'py> {
    pub(super) mu: Coefficients<'py>,
    cohesion: Option<Vector<'py>>,
    dilatancy: Option<Vector<'py>>,
}

/// The laws of a problem, and the change of variables to them.
pub(super) type Laws = (Vec<ContactLaw>, Option<EllipticScaling>);

impl LawArrays<'_> {
    /// The laws of the problem that is solved in so many dimensions.
    pub(super) fn read(&self, dimension: usize) -> PyResult<Laws> {
        let (mu, elliptic) = self.mu.friction(dimension)?;
        let mut laws = ContactLaw::coulomb(&mu);
        if let Some(cohesion) = &self.cohesion {
            let cohesion = numbers("cohesion", cohesion, laws.len())?;
            laws.iter_mut()
                .zip(cohesion)
                .for_each(|(law, c)| law.cohesion = *c);
        }
        if let Some(dilatancy) = &self.dilatancy {
            let dilatancy = numbers("dilatancy", dilatancy, laws.len())?;
            laws.iter_mut()
                .zip(dilatancy)
                .for_each(|(law, d)| law.dilatancy = *d);
        }
        contact_law::check(&laws, laws.len())?;
        Ok((laws, elliptic))
    }
}

impl Coefficients<'_> {
    /// `μ` of the problem that is solved in so many dimensions, and the change of variables to it.
    pub(super) fn friction(&self, dimension: usize) -> PyResult<Friction> {
        match self {
            Self::Round(mu) => Ok((mu.as_slice()?.to_vec(), None)),
            Self::Elliptic(_) if dimension == 2 => Err(PyValueError::new_err(
                "mu has two coefficients of each contact, expected one: a plane contact has one tangent",
            )),
            Self::Elliptic(mu) => Ok(EllipticScaling::new(rows::<2>(mu)?)?),
        }
    }
}

/// The rows of an `(n_c, D)` array.
pub(super) fn rows<'a, const D: usize>(array: &'a Matrix<'_>) -> PyResult<&'a [[f64; D]]> {
    let flat = array.as_slice()?;
    let (rows, rest) = flat.as_chunks::<D>();
    if array.as_array().ncols() == D && rest.is_empty() {
        Ok(rows)
    } else {
        Err(PyValueError::new_err(
            "an array of contacts has the wrong number of columns",
        ))
    }
}

/// [`rows`] of an array with one row for each of `contacts`.
pub(super) fn rows_of<'a, const D: usize>(
    what: &'static str,
    array: &'a Matrix<'_>,
    contacts: usize,
) -> PyResult<&'a [[f64; D]]> {
    let rows = rows(array)?;
    check_length(what, rows.len(), contacts)?;
    Ok(rows)
}

/// The values of an array of `expected` ones.
pub(super) fn numbers<'a, N: Dimension>(
    what: &'static str,
    array: &'a PyReadonlyArray<'_, f64, N>,
    expected: usize,
) -> PyResult<&'a [f64]> {
    let values = array.as_slice()?;
    check_length(what, values.len(), expected)?;
    Ok(values)
}

/// [`numbers`] of an array that a method changes.
pub(super) fn changed<'a>(
    what: &'static str,
    array: &'a mut Changed<'_>,
    expected: usize,
) -> PyResult<&'a mut [f64]> {
    let values = array.as_slice_mut()?;
    check_length(what, values.len(), expected)?;
    Ok(values)
}

/// The place of the first number that is not from `least` to `most`; NaN never is.
#[pyfunction]
pub(super) fn find_outside(
    values: PyReadonlyArrayDyn<'_, f64>,
    least: f64,
    most: f64,
) -> PyResult<Option<usize>> {
    let inside = |value: &f64| (least..=most).contains(value);
    // Parts without an exit inside are compared many numbers at once.
    let mut parts = values.as_slice()?.chunks(256);
    let Some(part) = parts.position(|part| !part.iter().fold(true, |all, v| all & inside(v)))
    else {
        return Ok(None);
    };
    let before = &values.as_slice()?[256 * part..];
    Ok(before
        .iter()
        .position(|value| !inside(value))
        .map(|k| 256 * part + k))
}

/// Indices as `usize`.
pub(super) fn indices(array: &Indices<'_>, what: &'static str) -> PyResult<Vec<usize>> {
    many_indices(array, what, Some(1))
}

/// [`indices`] of a large matrix, by the threads of `num_threads`.
pub(super) fn many_indices(
    array: &Indices<'_>,
    what: &'static str,
    num_threads: Option<usize>,
) -> PyResult<Vec<usize>> {
    fn convert<T: Copy + Sync>(
        values: &[T],
        num_threads: Option<usize>,
    ) -> Result<Option<Vec<usize>>, Error>
    where
        usize: TryFrom<T>,
    {
        threads::install(num_threads, values.len() > TASK, || {
            let mut wide = zeros(values.len());
            let parts = wide.chunks_mut(TASK).zip(values.chunks(TASK));
            let whole = tasks::map(parts, |_, (wide, values)| {
                wide.iter_mut().zip(values).all(|(wide, &value)| {
                    let found = usize::try_from(value).ok();
                    *wide = found.unwrap_or_default();
                    found.is_some()
                })
            });
            whole.iter().all(|&whole| whole).then_some(wide)
        })
    }
    /// Entries of one task.
    const TASK: usize = 1 << 16;
    let whole = match array {
        Indices::Narrow(array) => convert(array.as_slice()?, num_threads)?,
        Indices::Wide(array) => convert(array.as_slice()?, num_threads)?,
    };
    whole.ok_or_else(|| PyValueError::new_err(format!("{what} holds a negative index")))
}

/// An `(n_c, D)` array. `NumPy` allocates small arrays faster than it adopts them.
pub(super) fn from_rows<'py, const D: usize>(py: Python<'py>, rows: &[[f64; D]]) -> NewMatrix<'py> {
    PyArray2::from_array(py, &aview2(rows))
}

/// A C-ordered matrix from its rows.
pub(super) fn square(py: Python<'_>, flat: Vec<f64>, rows: usize, columns: usize) -> NewMatrix<'_> {
    let array = Array2::from_shape_vec((rows, columns), flat);
    PyArray2::from_owned_array(py, array.expect("rows of equal length"))
}

/// Values of contacts, `d` columns.
pub(super) fn of_contacts(py: Python<'_>, flat: Vec<f64>, d: usize) -> NewMatrix<'_> {
    let rows = flat.len() / d;
    square(py, flat, rows, d)
}

/// Indices, 64 bits wide.
pub(super) fn from_indices(py: Python<'_>, indices: Vec<usize>) -> NewIndices<'_> {
    let wide = |index| i64::try_from(index).expect("an index of an array");
    PyArray1::from_vec(py, indices.into_iter().map(wide).collect())
}

/// A matrix by rows.
pub(super) fn from_csr(py: Python<'_>, matrix: OwnedMatrix) -> CsrOutput<'_> {
    (
        from_indices(py, matrix.pointer),
        from_indices(py, matrix.index),
        from_vec(py, matrix.values),
    )
}

/// A vector.
pub(super) fn from_vec(py: Python<'_>, values: Vec<f64>) -> NewVector<'_> {
    PyArray1::from_vec(py, values)
}

/// Statuses as `int8`.
pub(super) fn from_status<'py>(py: Python<'py>, status: &[Status]) -> Bound<'py, PyArray1<i8>> {
    PyArray1::from_slice(py, &status.iter().map(|&s| s as i8).collect::<Vec<_>>())
}
