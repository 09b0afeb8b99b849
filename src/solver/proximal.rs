//! Proximal points with Newton steps, for redundant supports: there the matrix of Newton is
//! singular because the reactions are not determined.
//!
//! Each outer iteration solves the problem with `α (r̂ − ĉ)` added to `v̂`, from the point `c`
//! [R76]. Its matrix `Ŵ + α` has an inverse and its solution is near `c`; if `c` is a solution
//! of the problem, it is also one of the iteration. `α` decreases as long as Newton converges,
//! which makes the outer iteration superlinear, and increases after a failure, more after each
//! consecutive one.

use crate::reduced::reduced::Reduced;
use crate::solver::evaluated_point::EvaluatedPoint;
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
    let starts = [
        tuning::alpha_first(),
        tuning::alpha_second(),
        tuning::alpha_third(),
    ];
    let mut alpha = starts[number % starts.len()];
    let (mut rise, mut successes) = (tuning::alpha_rise(), 0);
    let mut point = EvaluatedPoint::new(problem, r.to_vec(), rigid.to_vec());
    monitor.count(1.0);
    let mut left = point.merit(problem);
    let started = monitor.iterations();
    for _ in 0..tuning::proximal_outer() {
        if monitor.iterations() - started >= most {
            break;
        }
        let near = Near {
            shift: alpha,
            centre: point.r.clone(),
            ..Near::nothing()
        };
        let enough = tuning::proximal_enough() * left;
        let (next, solved) = newton::approach(problem, &near, &point, enough, monitor)?;
        let there = next.merit(problem);
        if solved {
            successes += 1;
            if successes >= 2 {
                rise = tuning::alpha_rise();
            }
            alpha = (tuning::alpha_fall() * alpha).max(LEAST);
        } else {
            successes = 0;
            alpha = (rise * alpha).min(MOST);
            rise = (rise * tuning::alpha_rise()).min(tuning::steepest_rise());
        }
        if solved || there < left {
            (point, left) = (next, there);
        }
        monitor.measure_floor(&point.r, &point.rigid);
        let _ = point.look(monitor, false)?;
    }
    Ok(Solved {
        r: point.r,
        rigid: point.rigid,
    })
}
