//! The default method. Gauss–Seidel sweeps find the statuses, Newton finds the digits. If both
//! stall, proximal points continue, and then an interior-point method starts again.
//!
//! Decisions count work in products with `W`, not time, so that runs repeat bit for bit. The
//! constants were chosen by the median / mean number of products to η = 1e-10 on the sets of
//! `benches/problems.py`, seeds 0–149.
//!
//! | proximal points from failure | held | floating | rigid, unsolved |
//! |---|---|---|---|
//! | 1 | 16 / 39 | 31 / 149 | 1 of 150 |
//! | 2 | 16 / 30 | 31 / 122 | 0 |
//! | 3 | 16 / 30 | 31 / 84 | 2 |
//! | none | 16 / 30 | 31 / 46 | 30 |
//!
//! Without the rule of `GAIN` one floating body in four hundred is not solved.

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::solver::enumerate;
use crate::solver::gauss_seidel::{GaussSeidelPoint, Sweeper};
use crate::solver::interior;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::newton::{self, NewtonEnd};
use crate::solver::outcome::Outcome;
use crate::solver::proximal::{self, Attempt};
use crate::solver::settings::Start;

/// Sweeps before the first Newton attempt.
const FIRST_SWEEPS: usize = 5;

/// Sweeps after the first failure of Newton; the number doubles after each further failure.
const NEXT_SWEEPS: usize = 20;
const MOST_SWEEPS: usize = 1280;

/// After this many failures, a body that only contact holds starts again from zero.
const COLD: usize = 2;

/// After this many failures, proximal points are tried before the next sweeps. The second
/// number is for bodies that only contact holds, which have started again from zero before.
const PROXIMAL: usize = 2;
const PROXIMAL_HELD: usize = 3;

/// Attempts with proximal points before the interior-point method.
const INTERIOR: usize = 3;

/// With this many contacts and a sparse `W`, Newton steps take so long that proximal points
/// follow the first failure and the interior-point method follows their first attempt. They get
/// this number of steps, half of what they need themselves; between two interior-point paths
/// they get more, because they then complete most attempts.
const MANY: usize = 500;
const BEFORE_INTERIOR: usize = 20;
const AFTER_INTERIOR: usize = 250;

/// With at most this many plane contacts, all statuses are tried in milliseconds, after this
/// many failures.
const FEW: usize = 6;
const EXHAUST: usize = 3;

/// Sweeps continue from the result of Newton or proximal points if these have reduced η at
/// least by this factor. Otherwise sweeps that were about to find the statuses would lose them.
const GAIN: f64 = 0.3;

/// Runs until the monitor stops it.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    let sweeper = Sweeper::new(problem, start);
    let mut point = sweeper.start(start, monitor);
    if let NextStep::Stop(outcome) = sweeper.look(&point, monitor, false)? {
        return Ok(outcome);
    }
    if !start.closed.is_empty() {
        // In a load step, closed contacts start as sticking and open contacts as open. Most of
        // them keep this status, and of several solutions the path keeps its own.
        let closed = |node: usize| start.closed[node];
        if let Some(held) = newton::held_at(problem, closed, monitor)? {
            point = sweeper.point(held.r, &held.rigid);
            monitor.count(1.0);
            if let NextStep::Stop(outcome) = sweeper.look(&point, monitor, true)? {
                return Ok(outcome);
            }
        }
    }
    // With a start value, Newton comes first.
    let mut sweeps = if start.reaction.is_empty() {
        FIRST_SWEEPS
    } else {
        0
    };
    let mut next = NEXT_SWEEPS;
    let large = problem.contacts() >= MANY
        && problem
            .compliance
            .whole()
            .is_ok_and(|whole| whole.is_some());
    let proximal_from = if large {
        1
    } else if problem.rigid.modes.is_empty() {
        PROXIMAL
    } else {
        PROXIMAL_HELD
    };
    let interior_from = proximal_from + if large { 0 } else { INTERIOR };
    let mut path = 0;
    for failure in 1.. {
        if let Some(outcome) = sweeper.run(&mut point, monitor, sweeps)? {
            return Ok(outcome);
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small cost"
        )]
        let step = newton::step_cost(problem, &sweeper.law(&point)).0 as usize;
        if sweeps > 0 && step > sweeps {
            // Before the first Newton attempt, sweeps get the cost of two Newton steps.
            if let Some(outcome) =
                sweeper.run(&mut point, monitor, step.saturating_mul(2) - sweeps)?
            {
                return Ok(outcome);
            }
        }
        let rigid = sweeper.rigid_motion(&point);
        match newton::run(problem, &point.r, &rigid, monitor)? {
            NewtonEnd::Stop(outcome) => return Ok(outcome),
            NewtonEnd::Better(r, rigid) => point = further(&sweeper, point, r, &rigid),
            NewtonEnd::Stalled => {}
        }
        if failure == COLD && !problem.rigid.modes.is_empty() && start.closed.is_empty() {
            // The bilateral start may be near a minimum of the merit that is no solution:
            // sweeps try once from zero.
            point = sweeper.start(&Start::default(), monitor);
        }
        if failure == EXHAUST
            && problem.contacts() <= FEW
            && let Some(outcome) = exhaust(problem, monitor)?
        {
            return Ok(outcome);
        }
        if failure >= proximal_from {
            let number = failure - proximal_from;
            let most = match (large, number) {
                (true, 0) => BEFORE_INTERIOR,
                (true, _) => AFTER_INTERIOR,
                (false, _) => usize::MAX,
            };
            let rigid = sweeper.rigid_motion(&point);
            match proximal::attempt(problem, &point.r, &rigid, monitor, (number, most))? {
                Attempt::Stop(outcome) => return Ok(outcome),
                Attempt::Spent(r, rigid) => point = further(&sweeper, point, r, &rigid),
            }
        }
        if failure >= interior_from {
            match interior::run(problem, &mut path, monitor)? {
                NewtonEnd::Stop(outcome) => return Ok(outcome),
                NewtonEnd::Better(r, rigid) => {
                    // For any η: if it was lost there, no later point helps.
                    point = sweeper.point(r, &rigid);
                    sweeps = 0;
                    continue;
                }
                NewtonEnd::Stalled => {}
            }
        }
        sweeps = next;
        next = (2 * next).min(MOST_SWEEPS);
    }
    Ok(Outcome::Stalled)
}

/// The point where sweeps continue: `(r, a)`, the result of another method, if it is better.
fn further<const D: usize>(
    sweeper: &Sweeper<D>,
    point: GaussSeidelPoint<D>,
    r: Vec<[f64; D]>,
    rigid: &[f64],
) -> GaussSeidelPoint<D> {
    let end = sweeper.point(r, rigid);
    if sweeper.residual(&end) <= GAIN * sweeper.residual(&point) {
        end
    } else {
        point
    }
}

/// Tries all statuses of a few contacts: it gives a solution, a proof that there is none, or
/// `None`.
fn exhaust<const D: usize>(
    problem: &Reduced<D>,
    monitor: &mut Monitor<D>,
) -> Result<Option<Outcome>, Error> {
    let Some(found) = enumerate::few(problem, monitor.stop())? else {
        return Ok(None);
    };
    if found.proves_none(problem) {
        return Ok(Some(Outcome::NoEquilibrium));
    }
    for (r, rigid) in found.answers {
        let v = problem.relative_displacement(&r, &rigid);
        monitor.count(1.0);
        if let NextStep::Stop(outcome) = monitor.look(&r, &v, &rigid, true)? {
            return Ok(Some(outcome));
        }
    }
    Ok(None)
}
