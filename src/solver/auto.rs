//! The default method: sweeps find the statuses, Newton the digits.
//!
//! Its decisions count work, in products with `W`, and never time it, so that
//! runs repeat bit for bit.

use crate::error::Error;
use crate::problem::reduced::Reduced;
use crate::solver::gauss_seidel::Sweeper;
use crate::solver::monitor::{Monitor, Verdict};
use crate::solver::newton::{self, End};
use crate::solver::{Outcome, Start};

/// Sweeps before Newton is tried, at first and at least.
const FIRST_SWEEPS: usize = 5;

/// Sweeps after a Newton that stalled, at first; doubled at each next one.
const NEXT_SWEEPS: usize = 20;
const MOST_SWEEPS: usize = 1280;

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
    if let Verdict::Stop(outcome) = sweeper.look(&point, monitor, false)? {
        return Ok(outcome);
    }
    if !start.closed.is_empty() {
        // A load step: what was closed sticks, what was open stays open. Most of
        // it is true, and where several answers exist it keeps to the path.
        let closed = |node: usize| start.closed[node];
        if let Some((r, rigid)) = newton::held_at(problem, closed, monitor) {
            point = sweeper.point(r, &rigid);
            monitor.count(1.0);
            if let Verdict::Stop(outcome) = sweeper.look(&point, monitor, true)? {
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
    loop {
        if let Some(outcome) = sweeper.run(&mut point, monitor, sweeps)? {
            return Ok(outcome);
        }
        let closed = D * point.r.iter().filter(|r| r[0] > 0.0).count();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small cost"
        )]
        let factorisation = newton::factorisation_cost(closed, D * problem.contacts()) as usize;
        if sweeps > 0 && factorisation > sweeps {
            // Sweeps are given what two factorisations would cost before the first.
            if let Some(outcome) = sweeper.run(&mut point, monitor, 2 * factorisation - sweeps)? {
                return Ok(outcome);
            }
        }
        let rigid = sweeper.rigid_motion(&point);
        match newton::run(problem, &point.r, &rigid, monitor)? {
            End::Stop(outcome) => return Ok(outcome),
            End::Better(r, rigid) => point = sweeper.point(r, &rigid),
            End::Stalled => {}
        }
        sweeps = next;
        next = (2 * next).min(MOST_SWEEPS);
    }
}
