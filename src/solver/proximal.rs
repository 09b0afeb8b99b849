//! Proximal points with Newton steps, for redundant supports: there the matrix of Newton is
//! singular because the reactions are not determined.
//!
//! Each outer iteration solves the problem with `α (r̂ − ĉ)` added to `v̂`, from the point `c`
//! [R76]. Its matrix `Ŵ + α` has an inverse and its solution is near `c`; if `c` is a solution
//! of the problem, it is also one of the iteration. `α` decreases as long as Newton converges,
//! which makes the outer iteration superlinear, and increases after a failure, more after each
//! consecutive one.

use crate::reduced::reduced::Reduced;
use crate::reduced::residual::merit;
use crate::solver::monitor::Monitor;
use crate::solver::newton::compliance_form::Solved;
use crate::solver::newton::newton::{self, Near};
use crate::solver::outcome::Ended;
use crate::solver::tuning;

/// Between these limits `α` is above rounding and does not hold the point.
const LEAST: f64 = 1e-13;
const MOST: f64 = 1.0;

/// Makes the `number`-th attempt from `(r, a)`, with at most `most` Newton steps; returns its
/// last point.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    rigid: &[f64],
    monitor: &mut Monitor<D>,
    (number, most): (usize, usize),
) -> Result<Solved<D>, Ended> {
    let (mut r, mut rigid) = (r.to_vec(), rigid.to_vec());
    let starts = [
        tuning::alpha_first(),
        tuning::alpha_second(),
        tuning::alpha_third(),
    ];
    let mut alpha = starts[number % starts.len()];
    let (mut rise, mut successes) = (tuning::alpha_rise(), 0);
    let mut v = problem.relative_displacement(&r, &rigid);
    monitor.count(1.0);
    let mut left = merit(problem, &r, &v);
    let started = monitor.iterations();
    for _ in 0..tuning::proximal_outer() {
        if monitor.iterations() - started >= most {
            break;
        }
        let near = Near {
            shift: alpha,
            centre: r.clone(),
            ..Near::nothing()
        };
        let enough = tuning::proximal_enough() * left;
        let (next, next_rigid) =
            match newton::run_near(problem, &near, &r, &rigid, enough, monitor)? {
                Some(better) => (better.r, better.rigid),
                None => (r.clone(), rigid.clone()),
            };
        let next_v = problem.relative_displacement(&next, &next_rigid);
        monitor.count(1.0);
        let there = merit(problem, &next, &next_v);
        if near.merit(problem, &next, &next_v) <= enough {
            successes += 1;
            if successes >= 2 {
                rise = tuning::alpha_rise();
            }
            alpha = (tuning::alpha_fall() * alpha).max(LEAST);
            (r, rigid, v, left) = (next, next_rigid, next_v, there);
        } else {
            successes = 0;
            alpha = (rise * alpha).min(MOST);
            rise = (rise * tuning::alpha_rise()).min(tuning::steepest_rise());
            if there < left {
                (r, rigid, v, left) = (next, next_rigid, next_v, there);
            }
        }
        monitor.measure_floor(&r, &rigid);
        let _ = monitor.look(&r, &v, &rigid, false)?;
    }
    Ok(Solved { r, rigid })
}
