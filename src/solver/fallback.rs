//! After the method: the statuses of a few contacts are exhausted, which may take an
//! answer back or find one, and projections are the last resort.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::Certificate;
use crate::solver::enumerate;
use crate::solver::outcome::Outcome;
use crate::solver::settings::{Method, Settings};
use crate::solver::solution::Solution;

/// Contacts whose statuses are exhausted in milliseconds, whatever time is left.
const QUICK: usize = 7;

/// Whether friction is so large that what a point misses the law by may be within the
/// tolerance at every point that balances the loads: a body that friction alone holds
/// presses with the loads over μ, and a contact that may be open by as much is no
/// answer to the law, and one to the tolerance.
pub(super) fn hides<const D: usize>(problem: &Reduced<D>, tol: f64) -> bool {
    /// Beside the tolerance: what is pressed by this share of the loads is in sight.
    const IN_SIGHT: f64 = 100.0;
    let largest = problem.mu.iter().fold(0.0_f64, |m, &mu| m.max(mu));
    !problem.rigid.modes.is_empty() && largest * IN_SIGHT * tol >= 1.0
}

/// Takes back that a point is an answer where exhausting the statuses of a few contacts
/// proves that there is none.
pub(super) fn confirm<const D: usize>(
    problem: &Reduced<D>,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    if problem.contacts() > QUICK {
        return Ok(());
    }
    let started = Instant::now();
    if enumerate::few(problem, stop)?.is_some_and(|found| found.proves_none(problem)) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.mu);
    }
    solution.seconds += started.elapsed().as_secs_f64();
    Ok(())
}

/// Where every method has come to a stand and the contacts are few, their
/// statuses are exhausted: that finds an answer, or proves that there is none.
pub(super) fn exhaust<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    let started = Instant::now();
    if settings.max_seconds.is_finite() && problem.contacts() > QUICK {
        return Ok(());
    }
    let Some(found) = enumerate::few(problem, stop)? else {
        return Ok(());
    };
    solution.seconds += started.elapsed().as_secs_f64();
    if found.proves_none(problem) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.mu);
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

/// Where every method has come to a stand, projections from nothing may still creep to
/// an answer: they need no matrix that is sound, and do not look for statuses.
pub(super) fn last_resort<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    solve: impl Fn(&Settings) -> Result<Solution<D>, Error>,
) -> Result<(), Error> {
    /// Products that are worth it, of matrices that are small, and additions and
    /// multiplications of large ones.
    const MOST: usize = 20_000;
    const MOST_OPERATIONS: usize = 10_000_000_000;
    let affordable = MOST_OPERATIONS / problem.compliance.entries().max(1);
    for method in [Method::Nesterov, Method::Uzawa] {
        let left = settings.max_iterations.saturating_sub(solution.iterations);
        let seconds = settings.max_seconds - solution.seconds;
        let max_iterations = left.min(MOST).min(affordable);
        if max_iterations == 0 || seconds <= 0.0 {
            return Ok(());
        }
        let slow = Settings {
            method,
            max_iterations,
            max_seconds: seconds,
            ..*settings
        };
        let mut found = solve(&slow)?;
        found.iterations += solution.iterations;
        found.work += solution.work;
        found.seconds += solution.seconds;
        if found.outcome == Outcome::Converged {
            let earlier = std::mem::take(&mut solution.history);
            let offset = earlier.last().map_or(0.0, |row| row.0);
            let later = found.history.iter().map(|row| (row.0 + offset, row.1));
            found.history = earlier.into_iter().chain(later).collect();
            *solution = found;
            return Ok(());
        }
        (solution.iterations, solution.work) = (found.iterations, found.work);
        solution.seconds = found.seconds;
    }
    Ok(())
}
