//! Two penalty methods, made exact by the method of multipliers.
//!
//! With a penalty ε of each contact and multipliers `c`, Coulomb's law holds for
//!
//! ```text
//! v' = v + (r − c)/ε                                                         (20d)
//! ```
//!
//! in place of `v`. With `c = 0`, a closed contact penetrates by `r_n/ε` and a sticking one slips
//! by `‖r_t‖/ε`: the error of the reactions is proportional to `1/ε`. The method of multipliers
//! repeats the solution with the last reactions as `c` [R76]. If this converges, `r = c` and
//! `v' = v`: the law holds without error, for any ε. The two methods differ in the map (19) of
//! Newton's method.
//!
//! **The perturbed Lagrangian** [SWT85],
//!
//! ```text
//! ½ uᵀK u − fᵀu − Σ ( r·v + ‖r − c‖²/(2 ε) ),
//! ```
//!
//! has a saddle point over `r` in the set of the law that satisfies (20d). Displacements and
//! reactions both remain unknowns: the step of the map is `ρ = 1`, and no number is multiplied by
//! ε.
//!
//! **Return mapping** [G89] treats contact as an elastoplastic law. The trial reaction is elastic,
//! and returns to the half-line of the normal law, then to the disc of the friction law,
//!
//! ```text
//! τ = c − ε v,    r_n = max(τ_n, 0),    r_t = min(1, μ r_n/‖τ_t‖) τ_t                 (20e)
//! ```
//!
//! The reaction is a function of the displacement, whose derivative is the consistent tangent of
//! Newton's method. It is the map with the step `ρ = ε`, applied to `v'`: in
//! `r − ε v' = c − ε v` the reaction cancels, and `F = r − r(v)`.

use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::newton::newton::{self, Near};
use crate::solver::outcome::Ended;
use crate::solver::paper::principles::convex::{PrinciplePoint, iterate};
use crate::solver::paper::uzawa;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// The step ρ of the map (19) with a penalty, in units of the stiffness of each contact.
pub type MapStep = fn(f64) -> f64;

/// The step of the perturbed Lagrangian.
pub const LAGRANGIAN: MapStep = |_| 1.0;

/// The step of return mapping.
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
        let (r, rigid) =
            match newton::run_near(problem, &near, &point.r, &point.rigid, enough, monitor)? {
                Some(better) => (better.r, better.rigid),
                None => (point.r.clone(), point.rigid.clone()),
            };
        let next = PrinciplePoint::new(problem, r, rigid);
        monitor.count(1.0);
        if near.merit(problem, &next.r, &next.v) <= enough {
            penalty = (tuning::penalty_rise() * penalty).min(tuning::penalty());
            return Ok(next);
        }
        let better = next.merit(problem) < before;
        if !better && penalty <= tuning::least_penalty() {
            let r = point.r.clone();
            let end = uzawa::run_burst(problem, &[], r, &point.rigid, monitor, steps)?;
            steps *= 2;
            monitor.count(1.0);
            return Ok(PrinciplePoint::new(problem, end.r, end.rigid));
        }
        penalty = (tuning::penalty_fall() * penalty).max(tuning::least_penalty());
        Ok(if better { next } else { point.clone() })
    })
}
