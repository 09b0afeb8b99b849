//! Estimates of the error of a solution.

use pyo3::prelude::*;

use crate::error::Error;
use crate::path::stepping::{evaluate, reduced_step, stiffness_rounding};
use crate::path::working_set;
use crate::python::arrays::{self, Matrix, Vector};
use crate::python::{interrupt, problem, solver};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::scaled_imbalance;
use crate::solver::newton::refine::{RefinedPoint, forward_error};

type Estimate = Option<(f64, f64)>;

/// Relative forward errors of the reaction and of the relative displacement, from one further
/// Newton correction.
#[pyfunction]
#[pyo3(signature = (problem, reaction, rigid, num_threads=None))]
pub(super) fn forward_errors(
    py: Python<'_>,
    problem: &solver::PyReduced,
    reaction: Matrix<'_>,
    rigid: Vector<'_>,
    num_threads: Option<usize>,
) -> PyResult<Estimate> {
    fn of<const D: usize>(
        problem: &Reduced<D>,
        reaction: &[[f64; D]],
        rigid: &[f64],
    ) -> RefinedPoint<D> {
        let r = problem.compliance.gather(reaction);
        RefinedPoint {
            v: problem.exact_displacement(&r, rigid),
            imbalance: scaled_imbalance(problem, &r),
            r,
            rigid: rigid.to_vec(),
        }
    }
    let rigid = rigid.as_slice()?;
    problem.check_motion(rigid)?;
    match &problem.kind {
        solver::AnyReduced::Two(owned) => {
            let reaction = owned.reaction(&reaction)?;
            owned.run(py, num_threads, None, |problem, stop, _| {
                forward_error(problem, &of(problem, &reaction, rigid), &[], stop)
            })
        }
        solver::AnyReduced::Three(owned) => {
            let reaction = owned.reaction(&reaction)?;
            owned.run(py, num_threads, None, |problem, stop, _| {
                forward_error(problem, &of(problem, &reaction, rigid), &[], stop)
            })
        }
    }
}

/// The same for a step of a load path, with `K` itself, from the total loads and the total
/// relative displacement after the step before.
#[pyfunction]
pub(super) fn forward_errors_of_step(
    py: Python<'_>,
    problem: &problem::PyCondensed,
    load: Vector<'_>,
    prescribed: Vector<'_>,
    before: Option<Matrix<'_>>,
    reaction: Matrix<'_>,
    rigid: Vector<'_>,
) -> PyResult<Estimate> {
    let loads = (load.as_slice()?, prescribed.as_slice()?);
    let rigid = rigid.as_slice()?;
    macro_rules! of {
        ($inner:expr) => {{
            let contacts = $inner.contacts();
            let state = problem.left(before.as_ref(), contacts)?;
            let reaction = problem.reaction(&reaction, contacts)?;
            let motions = $inner.bodies().motions().len();
            arrays::length("rigid_motion", rigid.len(), motions)?;
            interrupt::run(py, problem.num_threads, |stop| -> Result<_, Error> {
                let view = working_set::around($inner, &reaction, stop)?;
                let (members, of_view) = (&view.members, &view.problem);
                let state = state.map(|state| working_set::at(&state, members));
                let r = of_view.compliance();
                let r = r.gather(&working_set::pick(&reaction, members));
                let reduced = reduced_step(of_view, loads.0, loads.1, state.as_ref())?;
                let point = evaluate(of_view, &reduced, loads, state.as_ref(), r, rigid.to_vec())?;
                // The reported displacement is the total one; normal components are always
                // total.
                let mut total = Vec::new();
                if let Some(state) = &state {
                    let before = &state.relative_displacement;
                    total = of_view.compliance().gather(before);
                    for v in &mut total {
                        v[0] = 0.0;
                    }
                }
                let Some(found) = forward_error(&reduced, &point, &total, stop)? else {
                    return Ok(None);
                };
                let of_k = stiffness_rounding(of_view, &reduced, loads, &point, &total, stop)?;
                Ok(Some((found.0.max(of_k.0), found.1.max(of_k.1))))
            })
        }};
    }
    match &problem.kind {
        problem::AnyProblem::Two(inner) => of!(inner),
        problem::AnyProblem::Three(inner) => of!(inner),
    }
}
