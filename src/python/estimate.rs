//! Estimates of the error of a solution, from one further Newton correction.

use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;

use crate::error::Error;
use crate::path::stepping::{State, evaluate, reduced_step, stiffness_rounding};
use crate::path::working_set;
use crate::python::condensed_arrays::{CondensedArrays, Loads};
use crate::reduced::reduced::Reduced;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::newton::refine::{RefinedPoint, forward_error};

/// Relative forward errors of the reaction and of the relative displacement.
pub(super) type Estimate = Option<(f64, f64)>;

/// The estimate for a solution of a reduced problem.
pub(super) fn of_reduced<const D: usize>(
    problem: &Reduced<D>,
    reaction: &[[f64; D]],
    rigid: &[f64],
    stop: &AtomicBool,
) -> Result<Estimate, Error> {
    let r = problem.compliance.gather(reaction);
    let v = problem.exact_displacement(&r, rigid);
    let rigid = rigid.to_vec();
    let point = RefinedPoint::new(problem, EvaluatedPoint { r, v, rigid });
    forward_error(problem, &point, &[], stop)
}

/// Relative forward errors of a step of a load path, with `K` itself, from the total loads and the
/// state after the step before.
pub(super) fn of_step<const D: usize>(
    problem: &CondensedArrays<D>,
    py: Python<'_>,
    (loads, state): (Loads<'_>, Option<State<D>>),
    (reaction, rigid): (&[[f64; D]], &[f64]),
) -> PyResult<Estimate> {
    problem.check_motion(rigid)?;
    problem.run(py, |stop| {
        let view = working_set::around(&problem.problem, reaction, stop)?;
        let (members, of_view) = (&view.members, &view.problem);
        let state = state.map(|state| working_set::at(&state, members));
        let r = of_view.compliance();
        let r = r.gather(&working_set::pick(reaction, members));
        let reduced = reduced_step(of_view, loads.0, loads.1, state.as_ref())?;
        let point = evaluate(of_view, &reduced, loads, state.as_ref(), r, rigid.to_vec())?;
        // The reported displacement is the total one; normal components are always total.
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
}
