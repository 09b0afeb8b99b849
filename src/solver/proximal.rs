//! Proximal points, with Newton inside: for supports in excess, where the matrix
//! of Newton is singular because reactions are not determined.
//!
//! Each outer iteration solves the problem with `α (r̂ − ĉ)` added to `v̂`, `c` the
//! point it starts from [R76]. Its matrix `Ŵ + α` has an inverse, its answer is
//! near, and an answer of the problem is one of it. `α` falls as long as Newton
//! follows, which makes the outer iteration converge faster than linearly, and
//! rises, at each failure in a row by more, where it does not.

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::merit;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::newton::{self, Near, NewtonEnd};
use crate::solver::outcome::Outcome;

/// `α` at first, in units of a contact's own compliance; each further attempt takes
/// the next. With one value alone 2 of 150 assemblies of rigid bodies are not solved.
const FIRST: [f64; 3] = [0.1, 1.0, 0.01];

/// What `α` is multiplied by after a success.
const FALL: f64 = 0.2;

/// What it is multiplied by after a failure, and what that factor is after each
/// further one; two successes in a row forget it. A fixed factor comes back for
/// ever to the same two values of `α` on flows of 7000 grains.
const RISE: f64 = 5.0;
const STEEPEST: f64 = 1e4;

/// Between these `α` neither drowns in rounding nor holds the point still.
const LEAST: f64 = 1e-13;
const MOST: f64 = 1.0;

/// What an outer iteration leaves of the merit it began with.
const ENOUGH: f64 = 0.05;

/// Outer iterations of an attempt.
const OUTER: usize = 60;

/// How an attempt ended.
#[derive(Debug)]
pub enum Attempt<const D: usize> {
    /// The monitor stopped it.
    Stop(Outcome),
    /// Its iterations are spent; `(r, a)` is the last point.
    Spent(Vec<[f64; D]>, Vec<f64>),
}

/// The `number`-th attempt, from `(r, a)`, until `most` steps of Newton are spent.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn attempt<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    rigid: &[f64],
    monitor: &mut Monitor<D>,
    (number, most): (usize, usize),
) -> Result<Attempt<D>, Error> {
    let (mut r, mut rigid) = (r.to_vec(), rigid.to_vec());
    let (mut alpha, mut rise, mut successes) = (FIRST[number % FIRST.len()], RISE, 0);
    let mut v = problem.relative_displacement(&r, &rigid);
    monitor.count(1.0);
    let mut left = merit(problem, &r, &v);
    let started = monitor.iterations();
    for _ in 0..OUTER {
        if monitor.iterations() - started >= most {
            break;
        }
        let near = Near {
            shift: alpha,
            centre: r.clone(),
            frozen: Vec::new(),
        };
        let enough = ENOUGH * left;
        let (next, next_rigid) =
            match newton::run_near(problem, &near, &r, &rigid, enough, monitor)? {
                NewtonEnd::Stop(outcome) => return Ok(Attempt::Stop(outcome)),
                NewtonEnd::Better(next, next_rigid) => (next, next_rigid),
                NewtonEnd::Stalled => (r.clone(), rigid.clone()),
            };
        let next_v = problem.relative_displacement(&next, &next_rigid);
        monitor.count(1.0);
        let there = merit(problem, &next, &next_v);
        if near.merit(problem, &next, &next_v) <= enough {
            successes += 1;
            if successes >= 2 {
                rise = RISE;
            }
            alpha = (FALL * alpha).max(LEAST);
            (r, rigid, v, left) = (next, next_rigid, next_v, there);
        } else {
            successes = 0;
            alpha = (rise * alpha).min(MOST);
            rise = (rise * RISE).min(STEEPEST);
            if there < left {
                (r, rigid, v, left) = (next, next_rigid, next_v, there);
            }
        }
        monitor.measure_floor(&r, &rigid);
        if let NextStep::Stop(outcome) = monitor.look(&r, &v, &rigid, false)? {
            return Ok(Attempt::Stop(outcome));
        }
    }
    Ok(Attempt::Spent(r, rigid))
}
