//! Two penalty methods, made exact by the method of multipliers: the perturbed Lagrangian [SWT85]
//! and return mapping [G89]. Both solve (20d) of `docs/theory.md` for a penalty ε and multipliers
//! `c`, which are the last reactions: if this converges, the law holds without error, for any ε.
//!
//! They differ in the map (19) of Newton's method. The perturbed Lagrangian keeps the reactions as
//! unknowns, with the step `ρ = 1`: no number is multiplied by ε. Return mapping (20e) makes the
//! reaction a function of the displacement: the same map with `ρ = ε`.

use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::newton::newton::{self, Near};
use crate::solver::outcome::Ended;
use crate::solver::paper::principles::convex::iterate;
use crate::solver::paper::uzawa;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// The step ρ of the map (19) with a penalty, in units of the stiffness of each contact.
pub type MapStep = fn(f64) -> f64;

pub const LAGRANGIAN: MapStep = |_| 1.0;

pub const RETURN: MapStep = |penalty| penalty;

/// The problem (20d) of a penalty and multipliers.
pub fn regularise<const D: usize>(
    step: MapStep,
    penalty: f64,
    multipliers: Vec<[f64; D]>,
) -> Near<D> {
    Near {
        shift: 1.0 / penalty,
        centre: multipliers,
        rho: step(penalty),
        ..Near::nothing()
    }
}

/// Runs from multipliers equal to the start value until the monitor stops it, or new multipliers
/// give no improvement.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    step: MapStep,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    let (mut penalty, mut steps) = (tuning::penalty(), tuning::multiplier_burst());
    iterate(problem, start, monitor, |point, monitor| {
        monitor.measure_floor(&point.r, &point.rigid);
        let near = regularise(step, penalty, point.r.clone());
        let before = point.merit(problem);
        let enough = tuning::multiplier_enough() * before;
        let (next, solved) = newton::approach(problem, &near, point, enough, monitor)?;
        if solved {
            penalty = (tuning::penalty_rise() * penalty).min(tuning::penalty());
            return Ok(next);
        }
        let better = next.merit(problem) < before;
        if !better && penalty <= tuning::least_penalty() {
            let end = uzawa::run_burst(problem, &[], point, monitor, steps)?;
            steps *= 2;
            return Ok(end);
        }
        penalty = (tuning::penalty_fall() * penalty).max(tuning::least_penalty());
        Ok(if better { next } else { point.clone() })
    })
}
