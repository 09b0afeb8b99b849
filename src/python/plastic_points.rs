//! The response of many plastic points.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::law::contact_law::ContactLaw;
use crate::law::plastic_point::{Rate, respond};
use crate::python::arrays::{self, Matrix, NewMatrix};
use crate::python::interrupt;
use crate::tasks;

/// Points in one task: few enough for balance, many enough for the cost of a task.
const POINTS_A_TASK: usize = 1024;

/// Stress, flow, and derivatives by row.
type Responses<'py> = (NewMatrix<'py>, NewMatrix<'py>, NewMatrix<'py>);

#[pyfunction]
pub(super) fn respond_points<'py>(
    py: Python<'py>,
    tau: Matrix<'py>,
    points: Matrix<'py>,
) -> PyResult<Responses<'py>> {
    match tau.as_array().ncols() {
        2 => respond_rows::<2, 4>(py, &tau, &points),
        3 => respond_rows::<3, 9>(py, &tau, &points),
        4 => respond_rows::<4, 16>(py, &tau, &points),
        6 => respond_rows::<6, 36>(py, &tau, &points),
        d => Err(PyValueError::new_err(format!(
            "points have {d} components, expected 2, 3, 4 or 6"
        ))),
    }
}

fn respond_rows<'py, const D: usize, const SQUARE: usize>(
    py: Python<'py>,
    tau: &Matrix<'py>,
    points: &Matrix<'py>,
) -> PyResult<Responses<'py>> {
    let tau = arrays::rows::<D>(tau)?;
    let points = arrays::rows_of::<7>("points", points, tau.len())?;
    let mut stress = vec![[0.0; D]; tau.len()];
    let mut flow = vec![[0.0; D]; tau.len()];
    let mut jacobian = vec![[0.0; SQUARE]; tau.len()];
    let parts = stress
        .chunks_mut(POINTS_A_TASK)
        .zip(flow.chunks_mut(POINTS_A_TASK))
        .zip(jacobian.chunks_mut(POINTS_A_TASK));
    let of_part = |part: usize, ((stress, flow), jacobian): Part<'_, D, SQUARE>| {
        for k in 0..stress.len() {
            let at = part * POINTS_A_TASK + k;
            let [moduli @ .., mu, cohesion, dilatancy, hardening, before] = points[at];
            let law = ContactLaw {
                mu,
                cohesion,
                dilatancy,
            };
            let rate = Rate { hardening, before };
            let response = respond(&tau[at], moduli, &law, &rate);
            stress[k] = response.stress;
            flow[k] = response.flow;
            // nalgebra stores columns, NumPy reads rows.
            let rows = response.jacobian.transpose();
            jacobian[k].copy_from_slice(rows.as_slice());
        }
    };
    interrupt::in_pool(py, tau.len() > POINTS_A_TASK, || {
        tasks::for_each(parts, of_part);
    })?;
    Ok((
        arrays::from_rows(py, &stress),
        arrays::from_rows(py, &flow),
        arrays::from_rows(py, &jacobian),
    ))
}

/// The results of one task.
type Part<'a, const D: usize, const SQUARE: usize> = (
    (&'a mut [[f64; D]], &'a mut [[f64; D]]),
    &'a mut [[f64; SQUARE]],
);
