//! Steps after a method: trying all statuses of a few contacts, which may confirm, withdraw or
//! find a solution.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::Certificate;
use crate::solver::enumerate;
use crate::solver::outcome::Outcome;
use crate::solver::settings::Settings;
use crate::solver::solution::Solution;
use crate::solver::tuning;

/// Whether friction is so large that the error of the law may be within the tolerance at every
/// point that balances the loads. A body that friction alone holds is pressed by the loads over
/// μ. An opening of this size violates the law, but not the tolerance.
pub(super) fn may_hide_openings<const D: usize>(problem: &Reduced<D>, tol: f64) -> bool {
    let largest = problem.law.iter().fold(0.0_f64, |m, law| m.max(law.mu));
    !problem.rigid.modes.is_empty() && largest * tuning::visible_pressure() * tol >= 1.0
}

/// Tries all statuses of a few contacts: withdraws a solution if this proves that there is none, and
/// finds one where a method has stalled.
pub(super) fn try_statuses<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    let started = Instant::now();
    let Some(few) = enumerate::few(problem, stop)? else {
        return Ok(());
    };
    solution.seconds += started.elapsed().as_secs_f64();
    if few.proves_none(problem) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.law);
    }
    if solution.outcome != Outcome::Stalled {
        return Ok(());
    }
    for (r, rigid) in few.answers {
        let certificate = Certificate::new(problem, &r, &rigid);
        if certificate.converged(settings.tol) {
            solution.put(problem, settings, &r, rigid, &certificate);
            solution.outcome = Outcome::Converged;
            break;
        }
    }
    Ok(())
}
