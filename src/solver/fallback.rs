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

/// Withdraws a solution if trying all statuses of a few contacts proves that there is none.
pub(super) fn withdraw_if_none<const D: usize>(
    problem: &Reduced<D>,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    if problem.contacts() > tuning::quick_contacts() {
        return Ok(());
    }
    let started = Instant::now();
    if enumerate::few(problem, stop)?.is_some_and(|found| found.proves_none(problem)) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.law);
    }
    solution.seconds += started.elapsed().as_secs_f64();
    Ok(())
}

/// Tries all statuses of a few contacts if every method has stalled. It finds a solution or
/// proves that there is none.
pub(super) fn try_statuses<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    let started = Instant::now();
    if settings.max_seconds.is_finite() && problem.contacts() > tuning::quick_contacts() {
        return Ok(());
    }
    let Some(found) = enumerate::few(problem, stop)? else {
        return Ok(());
    };
    solution.seconds += started.elapsed().as_secs_f64();
    if found.proves_none(problem) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.law);
    }
    for (r, rigid) in found.answers {
        let certificate = Certificate::new(problem, &r, &rigid);
        if certificate.converged(settings.tol) {
            solution.put(problem, settings, &r, rigid, &certificate);
            solution.outcome = Outcome::Converged;
            return Ok(());
        }
    }
    Ok(())
}
