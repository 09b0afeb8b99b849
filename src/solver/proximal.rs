//! Proximal points with Newton steps, for redundant supports: there the matrix of Newton is
//! singular because the reactions are not determined.
//!
//! Each outer iteration solves the problem with `α (r̂ − ĉ)` added to `v̂`, from the point `c`
//! [R76]. Its matrix `Ŵ + α` has an inverse and its solution is near `c`; if `c` is a solution
//! of the problem, it is also one of the iteration. `α` decreases as long as Newton converges,
//! which makes the outer iteration superlinear, and increases after a failure, more after each
//! consecutive one.

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::merit;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::newton::{self, Near, NewtonEnd};
use crate::solver::outcome::Outcome;

/// Initial `α` in units of the compliance of a contact itself; each attempt uses the next. With
/// a single value, 2 of 150 assemblies of rigid bodies are not solved.
const FIRST: [f64; 3] = [0.1, 1.0, 0.01];

/// Factor of `α` after a success.
const FALL: f64 = 0.2;

/// Factor of `α` after a failure, and the factor of that factor after each further one; two
/// consecutive successes reset it. On flows of 7000 grains a fixed factor alternates between
/// the same two values of `α`.
const RISE: f64 = 5.0;
const STEEPEST: f64 = 1e4;

/// Between these limits `α` is above rounding and does not hold the point.
const LEAST: f64 = 1e-13;
const MOST: f64 = 1.0;

/// An outer iteration reduces the merit to this share.
const ENOUGH: f64 = 0.05;

/// Outer iterations of an attempt.
const OUTER: usize = 60;

/// The end of an attempt.
#[derive(Debug)]
pub enum Attempt<const D: usize> {
    /// The monitor stopped it.
    Stop(Outcome),
    /// It used all its iterations; `(r, a)` is the last point.
    Spent(Vec<[f64; D]>, Vec<f64>),
}

/// Makes the `number`-th attempt from `(r, a)`, with at most `most` Newton steps.
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
            ..Near::nothing()
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
