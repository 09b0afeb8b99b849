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

/// Closed unknowns for which one factorisation costs as much as one sweep: it
/// does `n/3` times the operations, but from the cache, about ten times faster.
const UNKNOWNS_A_SWEEP: usize = 30;

/// A bilateral start with a larger residual than this leaves most of the load
/// unbalanced; the cold start has 1.
const TRUSTED_START: f64 = 0.5;

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
    if !problem.rigid.modes.is_empty() && start.reaction.is_empty() {
        // Sweeps know little of the whole balance of forces: it is where the
        // bilateral solution begins, unless most of it came from contacts that pull.
        if let Some((r, rigid)) = newton::bilateral(problem) {
            let held = sweeper.point(r, &rigid);
            monitor.count(1.0);
            if let Verdict::Stop(outcome) = sweeper.look(&held, monitor, true)? {
                return Ok(outcome);
            }
            if sweeper.residual(&held) <= TRUSTED_START {
                point = held;
                let rigid = sweeper.rigid_motion(&point);
                match newton::run(problem, &point.r, &rigid, monitor)? {
                    End::Stop(outcome) => return Ok(outcome),
                    End::Better(r, rigid) => point = sweeper.point(r, &rigid),
                    End::Stalled => {}
                }
            }
        }
    }
    let mut sweeps = FIRST_SWEEPS;
    let mut next = NEXT_SWEEPS;
    loop {
        if let Some(outcome) = sweeper.run(&mut point, monitor, sweeps)? {
            return Ok(outcome);
        }
        let closed = D * point.r.iter().filter(|r| r[0] > 0.0).count();
        let factorisation = closed / UNKNOWNS_A_SWEEP;
        if factorisation > sweeps {
            // Sweeps are given what two factorisations would cost before the first.
            sweeps = (2 * factorisation).max(sweeps) - sweeps;
            if let Some(outcome) = sweeper.run(&mut point, monitor, sweeps)? {
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
