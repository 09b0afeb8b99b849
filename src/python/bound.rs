//! Proved error bounds of a point.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::condensation::problem::Problem;
use crate::error::check_length;
use crate::linalg::small::add_scaled;
use crate::path::stepping::{State, increment, reduced_step};
use crate::proof::error_bound::{Bound, BoundKind, Prepared};
use crate::python::arrays::{self, Matrix};
use crate::python::condensed_arrays::{CondensedArrays, Loads};
use crate::python::reduced_arrays::ReducedArrays;
use crate::reduced::elliptic_scaling::{over, rounding, times};
use crate::reduced::reduced::Reduced;

/// Points of a reduced problem; their reactions are stacked.
pub(super) struct Points<'a, 'py> {
    pub(super) reactions: &'a Matrix<'py>,
    pub(super) count: usize,
    pub(super) rigid: &'a [f64],
    /// The reported relative displacements.
    pub(super) reported: Option<&'a Matrix<'py>>,
}

/// Bounds at several points of one problem.
pub(super) fn of_reduced<const D: usize>(
    problem: &ReducedArrays<D>,
    py: Python<'_>,
    points: &Points<'_, '_>,
    num_threads: Option<usize>,
) -> PyResult<Vec<PyBound>> {
    problem.check_motion(points.rigid)?;
    let rows = arrays::rows::<D>(points.reactions)?;
    let contacts = problem.contacts();
    let expected = points.count.saturating_mul(contacts);
    check_length("reactions", rows.len(), expected)?;
    let reported = points.reported.map(arrays::rows::<D>).transpose()?;
    if let Some(reported) = reported {
        check_length("reported", reported.len(), rows.len())?;
    }
    let (count, rigid) = (points.count, points.rigid);
    let elliptic = problem.elliptic.as_ref();
    let (bounds, unique) = problem.run(py, num_threads, None, |problem, stop, _| {
        let prepared = Prepared::new(problem, stop)?;
        let mut bounds = Vec::new();
        for k in 0..count {
            let at = k * contacts..(k + 1) * contacts;
            let r = &over(elliptic, &rows[at.clone()]);
            let r = problem.compliance.gather(r);
            let v = reported.map(|v| problem.compliance.gather(&times(elliptic, &v[at])));
            let error = v.as_ref().map(|v| of_change(problem, v));
            let reported = v.as_deref().zip(error.as_deref());
            let bound = prepared.bound(problem, (&r, rigid), reported, stop)?;
            bounds.push(bound.change_variables(elliptic));
        }
        Ok((bounds, prepared.unique()))
    })?;
    let bounds = bounds.iter();
    Ok(bounds
        .map(|bound| PyBound::new(py, bound, unique))
        .collect())
}

/// The bound of a step of a load path, from the state before it and its relative displacement.
/// `None` with a working set.
pub(super) fn of_step<const D: usize>(
    problem: &CondensedArrays<D>,
    py: Python<'_>,
    (loads, state): (Loads<'_>, Option<&State<D>>),
    (reaction, rigid): (&[[f64; D]], &[f64]),
    reported: &Matrix<'_>,
) -> PyResult<Option<PyBound>> {
    let reported = arrays::rows_of("reported", reported, problem.contacts())?;
    problem.check_motion(rigid)?;
    let Problem::Whole(whole) = &*problem.problem else {
        return Ok(None);
    };
    let elliptic = problem.elliptic.as_ref();
    let (bound, unique) = problem.run(py, |stop| {
        let mut reduced = reduced_step(whole, loads.0, loads.1, state)?;
        reduced.entry_rounding = rounding(elliptic);
        let order = whole.compliance();
        let reported = times(elliptic, reported);
        let (v, mut error) = increment(&reported, state);
        let before = state.map(|state| of_change(&reduced, &state.relative_displacement));
        for change in [Some(of_change(&reduced, &reported)), before] {
            let change = change.unwrap_or_default();
            add_scaled(error.as_flattened_mut(), 1.0, change.as_flattened());
        }
        let (v, error) = (order.gather(&v), order.gather(&error));
        let r = order.gather(reaction);
        let prepared = Prepared::new(&reduced, stop)?;
        let bound = prepared.bound(&reduced, (&r, rigid), Some((&v, &error)), stop)?;
        Ok((bound.change_variables(elliptic), prepared.unique()))
    })?;
    Ok(Some(PyBound::new(py, &bound, unique)))
}

/// The rounding of `ṽ = T v`.
fn of_change<const D: usize>(problem: &Reduced<D>, v: &[[f64; D]]) -> Vec<[f64; D]> {
    let rounding = |row: &[f64; D]| row.map(|c| problem.entry_rounding * c.abs());
    v.iter().map(rounding).collect()
}

/// A proved bound; what is not available is `None`.
#[pyclass(frozen, get_all, name = "ProvedBound", module = "bipot_rs._core")]
pub(super) struct PyBound {
    kind: &'static str,
    unique: bool,
    gap: Py<PyArray1<f64>>,
    share: Option<f64>,
    reason: Option<&'static str>,
    which: usize,
    energy: Option<f64>,
    relative: Option<f64>,
    alone_within: Option<f64>,
    reaction: Option<Py<PyArray2<f64>>>,
    relative_displacement: Option<Py<PyArray2<f64>>>,
    contraction: Option<f64>,
    energy_by_gap: Option<f64>,
}

impl PyBound {
    fn new<const D: usize>(py: Python<'_>, bound: &Bound<D>, unique: bool) -> Self {
        let (reason, which) = match bound.kind {
            BoundKind::NotAvailable(reason) => {
                let (word, which) = reason.told();
                (Some(word), which)
            }
            _ => (None, 0),
        };
        let available = reason.is_none();
        let rows = |rows: &[[f64; D]]| available.then(|| arrays::from_rows(py, rows).unbind());
        Self {
            kind: bound.kind.name(),
            unique,
            gap: arrays::from_vec(py, bound.gap.clone()).unbind(),
            share: bound.share,
            reason,
            which,
            energy: available.then_some(bound.energy),
            relative: available.then_some(bound.relative),
            alone_within: available.then_some(bound.alone_within),
            reaction: rows(&bound.reaction),
            relative_displacement: rows(&bound.relative_displacement),
            contraction: bound.contraction.filter(|_| available),
            energy_by_gap: bound.energy_by_gap.filter(|_| available),
        }
    }
}
