//! Proved error bounds of a point.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::condensation::problem::Problem;
use crate::path::stepping::{increment, reduced_step};
use crate::proof::error_bound::{Bound, BoundKind, Prepared, Reason};
use crate::python::arrays::{self, Matrix, Vector};
use crate::python::{interrupt, problem, solver};
use crate::reduced::elliptic_scaling::over;

type Dicts<'py> = Vec<Told<'py>>;
type Told<'py> = pyo3::Bound<'py, PyDict>;

/// Bounds at several points of one problem; their reactions are stacked.
///
/// `reported` are the reported relative displacements of these points.
#[pyfunction]
#[pyo3(signature = (problem, reactions, points, rigid, reported=None, num_threads=None))]
pub(super) fn error_bounds<'py>(
    py: Python<'py>,
    problem: &solver::PyReduced,
    reactions: Matrix<'py>,
    points: usize,
    rigid: Vector<'py>,
    reported: Option<Matrix<'py>>,
    num_threads: Option<usize>,
) -> PyResult<Dicts<'py>> {
    let rigid = rigid.as_slice()?;
    problem.check_motion(rigid)?;
    macro_rules! of {
        ($owned:expr, $d:literal) => {{
            let rows = arrays::rows::<$d>(&reactions)?;
            let contacts = $owned.contacts();
            arrays::length("reactions", rows.len(), points.saturating_mul(contacts))?;
            let told = reported.as_ref().map(arrays::rows::<$d>).transpose()?;
            if let Some(told) = told {
                arrays::length("reported", told.len(), rows.len())?;
            }
            let elliptic = $owned.elliptic.as_ref();
            let found = $owned.run(py, num_threads, None, |problem, stop, _| {
                let prepared = match elliptic {
                    None => Prepared::new(problem, stop)?,
                    Some(_) => Prepared::refused(problem, Reason::Directional),
                };
                let exactly = vec![[0.0; $d]; contacts];
                let mut found = Vec::new();
                for k in 0..points {
                    let r = &rows[k * contacts..][..contacts];
                    let r = problem.compliance.gather(&over(elliptic, r));
                    let told =
                        told.map(|v| problem.compliance.gather(&v[k * contacts..][..contacts]));
                    let given = told.as_ref().map(|v| (v.as_slice(), exactly.as_slice()));
                    found.push(prepared.bound(problem, (&r, rigid), given, stop)?);
                }
                Ok((found, prepared.unique()))
            })?;
            let (found, unique) = found;
            found.iter().map(|bound| dict(py, bound, unique)).collect()
        }};
    }
    match &problem.kind {
        solver::AnyReduced::Two(owned) => of!(owned, 2),
        solver::AnyReduced::Three(owned) => of!(owned, 3),
    }
}

/// The same for a step of a load path, from the total loads, the total relative displacement
/// after the step before, and that of the step. `None` with a working set.
#[pyfunction]
#[pyo3(signature = (problem, load, prescribed, before, reaction, reported, rigid))]
#[expect(clippy::too_many_arguments, reason = "what makes a step, from Python")]
pub(super) fn error_bound_of_step<'py>(
    py: Python<'py>,
    problem: &problem::PyCondensed,
    load: Vector<'py>,
    prescribed: Vector<'py>,
    before: Option<Matrix<'py>>,
    reaction: Matrix<'py>,
    reported: Matrix<'py>,
    rigid: Vector<'py>,
) -> PyResult<Option<Told<'py>>> {
    let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
    let rigid = rigid.as_slice()?;
    macro_rules! of {
        ($inner:expr) => {{
            let contacts = $inner.contacts();
            let state = problem.left(before.as_ref(), contacts)?;
            let reaction = problem.reaction(&reaction, contacts)?;
            let is_elliptic = problem.elliptic.is_some();
            let reported = arrays::rows_of("reported", &reported, contacts)?;
            arrays::length("rigid_motion", rigid.len(), $inner.bodies().motions().len())?;
            let Problem::Whole(whole) = &**$inner else {
                return Ok(None);
            };
            let (bound, unique) = interrupt::run(py, problem.num_threads, |stop| {
                let reduced = reduced_step(whole, load, prescribed, state.as_ref())?;
                let order = whole.compliance();
                let (v, error) = increment(reported, state.as_ref());
                let (v, error) = (order.gather(&v), order.gather(&error));
                let r = order.gather(&reaction);
                let prepared = if is_elliptic {
                    Prepared::refused(&reduced, Reason::Directional)
                } else {
                    Prepared::new(&reduced, stop)?
                };
                let bound = prepared.bound(&reduced, (&r, rigid), Some((&v, &error)), stop)?;
                Ok((bound, prepared.unique()))
            })?;
            Ok(Some(dict(py, &bound, unique)?))
        }};
    }
    match &problem.kind {
        problem::AnyProblem::Two(inner) => of!(inner),
        problem::AnyProblem::Three(inner) => of!(inner),
    }
}

fn dict<'py, const D: usize>(
    py: Python<'py>,
    bound: &Bound<D>,
    unique: bool,
) -> PyResult<Told<'py>> {
    let dict = PyDict::new(py);
    dict.set_item("kind", bound.kind.name())?;
    dict.set_item("unique", unique)?;
    dict.set_item("gap", arrays::from_vec(py, bound.gap.clone()))?;
    dict.set_item("share", bound.share)?;
    if let BoundKind::NotAvailable(reason) = bound.kind {
        let (word, which) = reason.told();
        dict.set_item("reason", word)?;
        dict.set_item("which", which)?;
        return Ok(dict);
    }
    dict.set_item("energy", bound.energy)?;
    dict.set_item("relative", bound.relative)?;
    dict.set_item("alone_within", bound.alone_within)?;
    dict.set_item("reaction", arrays::from_rows(py, &bound.reaction)?)?;
    let moved = arrays::from_rows(py, &bound.relative_displacement)?;
    dict.set_item("relative_displacement", moved)?;
    dict.set_item("contraction", bound.contraction)?;
    dict.set_item("energy_by_gap", bound.energy_by_gap)?;
    Ok(dict)
}
