//! What can move: directions, rigid motions, connected bodies, and what holds them.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::bodies::basis::{RigidMotion, list_motions};
use crate::bodies::directions::{DofDirection, find_directions};
use crate::bodies::holding::Holding;
use crate::bodies::rank::{ACCURACY, Combinations};
use crate::bodies::resistance::measure_resistance;
use crate::bodies::tuning;
use crate::error::{Error, check_length};
use crate::linalg::union::Union;
use crate::python::arrays::{self, Csr, Indices, Matrix, NewIndices, NewMatrix};
use crate::python::dimension::check_dimension;

#[pyfunction]
pub(super) fn dof_directions<'py>(
    py: Python<'py>,
    places: Matrix<'py>,
    d: usize,
) -> PyResult<NewIndices<'py>> {
    check_dimension(d)?;
    let directions = find_directions(arrays::rows::<3>(&places)?, d);
    let number = |direction| {
        let number = match direction {
            None => return -1,
            Some(DofDirection::Along(axis)) => axis,
            Some(DofDirection::About(axis)) => 3 + axis,
        };
        i64::try_from(number).expect("one of six")
    };
    Ok(PyArray1::from_vec(
        py,
        directions.into_iter().map(number).collect(),
    ))
}

#[pyfunction]
pub(super) fn rigid_motions<'py>(
    py: Python<'py>,
    direction: PyReadonlyArray1<'py, i64>,
    arm: Matrix<'py>,
    d: usize,
    reach: f64,
) -> PyResult<NewMatrix<'py>> {
    let (directions, arms) = (direction.as_slice()?, arrays::rows::<3>(&arm)?);
    check_length("directions", directions.len(), arms.len())?;
    check_dimension(d)?;
    let motions = list_motions(d);
    let mut values = vec![0.0; directions.len() * motions.len()];
    let rows = values.chunks_exact_mut(motions.len());
    for ((row, &direction), &arm) in rows.zip(directions).zip(arms) {
        let direction = match usize::try_from(direction) {
            Ok(axis @ 0..3) => DofDirection::Along(axis),
            Ok(about @ 3..6) => DofDirection::About(about - 3),
            _ => continue,
        };
        for (value, motion) in row.iter_mut().zip(&motions) {
            *value = RigidMotion::at(*motion, direction, arm, reach);
        }
    }
    Ok(arrays::square(py, values, directions.len(), motions.len()))
}

#[pyfunction]
pub(super) fn connected<'py>(
    py: Python<'py>,
    count: usize,
    first: Indices<'py>,
    second: Indices<'py>,
) -> PyResult<NewIndices<'py>> {
    let pairs = (
        arrays::indices(&first, "pairs")?,
        arrays::indices(&second, "pairs")?,
    );
    check_length("pairs", pairs.1.len(), pairs.0.len())?;
    let mut sets = Union::new(count);
    for (&a, &b) in pairs.0.iter().zip(&pairs.1) {
        check_index(a.max(b), count)?;
        sets.join(a, b);
    }
    Ok(arrays::from_indices(py, sets.numbers()))
}

/// Numbers of rows, their forces, and whether some are weak.
type ResistingRows<'py> = (NewIndices<'py>, NewMatrix<'py>, bool);

#[pyfunction]
pub(super) fn resisting_rows<'py>(
    py: Python<'py>,
    rows: Csr<'py>,
    motions: Matrix<'py>,
    wanted: Indices<'py>,
) -> PyResult<ResistingRows<'py>> {
    let pointer = arrays::indices(&rows.0, "row pointers")?;
    let columns = arrays::indices(&rows.1, "columns")?;
    let values = rows.2.as_slice()?;
    let at = motions.as_slice()?;
    let (columns_known, m) = motions.as_array().dim();
    let (mut numbers, mut forces, mut weak) = (Vec::new(), Vec::new(), false);
    for row in arrays::indices(&wanted, "rows")? {
        check_index(row + 1, pointer.len())?;
        let entries = pointer[row]..pointer[row + 1];
        check_index(entries.start, entries.end + 1)?;
        check_index(entries.end, values.len().min(columns.len()) + 1)?;
        let entries = columns[entries.clone()]
            .iter()
            .copied()
            .zip(values[entries].iter().copied());
        for (column, _) in entries.clone() {
            check_index(column, columns_known)?;
        }
        if let Some(row_forces) = measure_resistance(entries, m, |j, k| at[j * m + k], 1.0) {
            weak |= row_forces
                .iter()
                .all(|force| force.abs() < tuning::spring_force());
            numbers.push(row);
            forces.extend(row_forces);
        }
    }
    let forces = arrays::square(py, forces, numbers.len(), m);
    Ok((arrays::from_indices(py, numbers), forces, weak))
}

#[pyfunction]
#[pyo3(signature = (rows, accuracy=ACCURACY))]
pub(super) fn free_motions<'py>(
    py: Python<'py>,
    rows: Matrix<'py>,
    accuracy: f64,
) -> PyResult<NewMatrix<'py>> {
    let motions = rows.as_array().ncols();
    let mut holding = Holding::new(motions);
    for row in rows.as_slice()?.chunks_exact(motions.max(1)) {
        holding.hold(row);
    }
    let free = holding.find_free_motions(accuracy);
    Ok(arrays::square(py, free.concat(), free.len(), motions))
}

#[pyfunction]
pub(super) fn combine_motions<'py>(py: Python<'py>, rows: Matrix<'py>) -> NewMatrix<'py> {
    let rows = rows.as_array();
    let columns = rows.columns().into_iter();
    let combinations = Combinations::new(columns.map(|column| column.to_vec()).collect());
    let motions = combinations.amounts.len();
    arrays::square(py, combinations.amounts.concat(), motions, motions)
}

fn check_index(index: usize, limit: usize) -> Result<(), Error> {
    if index < limit {
        return Ok(());
    }
    Err(Error::IndexRange {
        what: "an array of bodies",
        position: 0,
        found: index,
        limit,
    })
}
