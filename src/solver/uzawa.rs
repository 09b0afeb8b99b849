//! The paper's algorithm (16): predictor `r̂ − ρ ṽ̂`, corrector `proj(·, K_μ)`,
//! [dSF91, 79–81], with a step that adapts itself.
//!
//! ρ is one number in node-scaled variables. A step is kept when the map moves
//! `ṽ` by no more than it moves `r`, `ρ ‖ṽ̂(r') − ṽ̂(r)‖ ≤ L ‖r̂' − r̂‖`; else ρ is
//! cut and the step taken again; where it moves much less, ρ grows.

use crate::error::Error;
use crate::law::bipotential::{corrected, law_step};
use crate::problem::reduced::Reduced;
use crate::problem::residual::scaled_imbalance;
use crate::solver::monitor::{Monitor, Verdict};
use crate::solver::{Outcome, Start};

/// Above this ratio a step is cut, below the other the next one grows.
const CUT_ABOVE: f64 = 0.9;
const GROW_BELOW: f64 = 0.3;
const CUT: f64 = 2.0 / 3.0;
const GROW: f64 = 1.5;

/// The proximal parameter for bodies held by contact alone, in scaled
/// variables: softer than for sweeps, because it limits ρ.
const DELTA: f64 = 1.0;

/// Iterations between two updates of the rigid motions.
const STEPS_A_PHASE: usize = 5;

/// Iterations between two measurements of what rounding allows.
const REFRESH: usize = 200;

/// Runs until the monitor stops it.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    let mut r = if start.reaction.is_empty() {
        vec![[0.0; D]; problem.contacts()]
    } else {
        start.reaction.clone()
    };
    let mut proximal = if start.rigid.is_empty() {
        vec![0.0; problem.rigid.modes.len()]
    } else {
        problem.scaling.rigid_to_scaled(&start.rigid)
    };
    let motion = |r: &[[f64; D]], proximal: &[f64]| {
        let s = scaled_imbalance(problem, r);
        let scaled: Vec<f64> = proximal
            .iter()
            .zip(&s)
            .map(|(a, s)| a + s / DELTA)
            .collect();
        problem.scaling.rigid_from_scaled(&scaled)
    };
    let displacement =
        |r: &[[f64; D]], proximal: &[f64]| problem.relative_displacement(r, &motion(r, proximal));

    let mut v = displacement(&r, &proximal);
    monitor.count(1.0);
    if let Verdict::Stop(outcome) = monitor.look(&r, &v, &motion(&r, &proximal), false)? {
        return Ok(outcome);
    }
    let mut rho = 1.0;
    for iteration in 1.. {
        let (mut next, mut next_v, mut ratio);
        loop {
            next = projected(problem, &r, &v, rho);
            next_v = displacement(&next, &proximal);
            monitor.count(1.0);
            ratio = rho * contraction(problem, (&r, &v), (&next, &next_v));
            // A ratio that is no number means a step without measure: it is taken as
            // it is, and the monitor judges it.
            if !(ratio > CUT_ABOVE) || rho < f64::EPSILON {
                break;
            }
            rho *= CUT * (1.0 / ratio).min(1.0);
        }
        r = next;
        v = next_v;
        if ratio > 0.0 && ratio < GROW_BELOW {
            rho *= GROW;
        }
        match monitor.look(&r, &v, &motion(&r, &proximal), true)? {
            Verdict::Stop(outcome) => return Ok(outcome),
            Verdict::Refresh => v = displacement(&r, &proximal),
            Verdict::Continue => {}
        }
        if iteration % REFRESH == 0 {
            monitor.measure_floor(&r, &motion(&r, &proximal));
        }
        if !proximal.is_empty() && iteration % STEPS_A_PHASE == 0 {
            for (a, s) in proximal.iter_mut().zip(scaled_imbalance(problem, &r)) {
                *a += s / DELTA;
            }
            v = displacement(&r, &proximal);
        }
    }
    Ok(Outcome::IterationLimit)
}

/// Predictor and corrector at every contact.
fn projected<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    rho: f64,
) -> Vec<[f64; D]> {
    let scaling = &problem.scaling;
    let node = |(i, (r, v)): (usize, (&[f64; D], &[f64; D]))| {
        let step = rho * scaling.to_v[i] / scaling.to_r[i];
        law_step(r, v, step, problem.mu[i]).0
    };
    r.iter().zip(v).enumerate().map(node).collect()
}

/// `‖ṽ̂' − ṽ̂‖ / ‖r̂' − r̂‖`, zero where nothing moved.
fn contraction<const D: usize>(
    problem: &Reduced<D>,
    (r, v): (&[[f64; D]], &[[f64; D]]),
    (next_r, next_v): (&[[f64; D]], &[[f64; D]]),
) -> f64 {
    let (mut moved_v, mut moved_r) = (0.0, 0.0);
    for i in 0..r.len() {
        let mu = problem.mu[i];
        let (before, after) = (corrected(&v[i], mu), corrected(&next_v[i], mu));
        for k in 0..D {
            moved_v += ((after[k] - before[k]) * problem.scaling.to_v[i]).powi(2);
            moved_r += ((next_r[i][k] - r[i][k]) * problem.scaling.to_r[i]).powi(2);
        }
    }
    if moved_r > 0.0 {
        (moved_v / moved_r).sqrt()
    } else {
        0.0
    }
}
