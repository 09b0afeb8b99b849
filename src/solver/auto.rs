//! The default method: sweeps find the statuses, Newton the digits, and where
//! both come to a stand, proximal points move on, and interior points begin anew.
//!
//! Its decisions count work, in products with `W`, and never time it, so that
//! runs repeat bit for bit. What they were chosen by: median / mean products to
//! η = 1e-10 on the sets of `benches/problems.py`, seeds 0–149.
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

/// Sweeps before Newton is tried, at first and at least.
const FIRST_SWEEPS: usize = 5;

/// Sweeps after a Newton that stalled, at first; doubled at each next one.
const NEXT_SWEEPS: usize = 20;
const MOST_SWEEPS: usize = 1280;

/// The failure after which a body held by contact alone starts again from nothing.
const COLD: usize = 2;

/// The failure from which on proximal points come before the next sweeps, and that
/// of bodies held by contact alone, which have started again from nothing before it.
const PROXIMAL: usize = 2;
const PROXIMAL_HELD: usize = 3;

/// Attempts with proximal points before interior points are tried.
const INTERIOR: usize = 3;

/// Contacts of a sparse `W` from which on steps of Newton take so long that proximal
/// points come after its first failure and interior points after their first attempt, and
/// the steps that this is given: half of what they need themselves. Between two paths of interior points it is given more, for it ends
/// most of what they began.
const MANY: usize = 500;
const BEFORE_INTERIOR: usize = 20;
const AFTER_INTERIOR: usize = 250;

/// Plane contacts whose statuses are exhausted in milliseconds, and the failure
/// after which they are.
const FEW: usize = 6;
const EXHAUST: usize = 3;

/// What Newton or proximal points must leave of η for sweeps to go on from where they
/// ended: sweeps that were on their way to the statuses lose it otherwise.
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
        // A load step: what was closed sticks, what was open stays open. Most of
        // it is true, and where several answers exist it keeps to the path.
        let closed = |node: usize| start.closed[node];
        if let Some(held) = newton::held_at(problem, closed, monitor)? {
            point = sweeper.point(held.r, &held.rigid);
            monitor.count(1.0);
            if let NextStep::Stop(outcome) = sweeper.look(&point, monitor, true)? {
                return Ok(outcome);
            }
        }
    }
    // Where there is something to start from, Newton is tried at once.
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
            // Sweeps are given what two steps of Newton would cost before the first.
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
            // The bilateral start may lie beside a minimum of the merit that is no
            // answer: sweeps are given one chance from nothing.
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
                    // However large its η is: what is lost there is not lost in the middle.
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

/// Where sweeps go on: from `(r, a)`, at which another method ended, if it gained.
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

/// Tries all statuses of a few contacts: an answer, a proof that there is none, or nothing.
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
