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

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::newton::newton::{self, Near, NewtonEnd};
use crate::solver::outcome::Outcome;
use crate::solver::paper::principles::convex::{Least, PrinciplePoint, iterate};
use crate::solver::paper::uzawa::{self, Burst};
use crate::solver::settings::Start;

/// The penalty in units of the stiffness of a contact alone, ρ of (15). The error of one
/// solution falls with it; the rounding of `ε v` in the trial reaction grows with it.
const PENALTY: f64 = 1e3;

/// Factors of the penalty after a failure of Newton's method, and after a success with a smaller
/// penalty. A soft contact changes its status less abruptly.
const FALL: f64 = 0.1;
const RISE: f64 = 10.0;
const LEAST: f64 = 1.0;

/// Steps with momentum if Newton's method fails with the smallest penalty too, as where a body
/// that only contact holds starts without a closed contact. The number doubles each time.
const FIRST_BURST: usize = 20;

/// A solution with given multipliers reduces the merit to this share of that of the law itself.
const ENOUGH: f64 = 0.05;

/// The step ρ of the map (19) with a penalty, in units of the stiffness of each contact.
pub type MapStep = fn(f64) -> f64;

/// The step of the perturbed Lagrangian.
pub const LAGRANGIAN: MapStep = |_| 1.0;

/// The step of return mapping.
pub const RETURN: MapStep = |penalty| penalty;

/// The problem (20d) of a penalty and multipliers.
#[must_use]
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
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    step: MapStep,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    let (mut penalty, mut steps) = (PENALTY, FIRST_BURST);
    iterate(problem, start, monitor, |point, monitor| {
        monitor.measure_floor(&point.r, &point.rigid);
        let near = regularise(step, penalty, point.r.clone());
        let before = point.merit(problem);
        let enough = ENOUGH * before;
        let (r, rigid) =
            match newton::run_near(problem, &near, &point.r, &point.rigid, enough, monitor)? {
                NewtonEnd::Stop(outcome) => return Ok(Least::Stop(outcome)),
                NewtonEnd::Better(r, rigid) => (r, rigid),
                NewtonEnd::Stalled => (point.r.clone(), point.rigid.clone()),
            };
        let next = PrinciplePoint::new(problem, r, rigid);
        monitor.count(1.0);
        if near.merit(problem, &next.r, &next.v) <= enough {
            penalty = (RISE * penalty).min(PENALTY);
            return Ok(Least::At(next));
        }
        let better = next.merit(problem) < before;
        if !better && penalty <= LEAST {
            let r = point.r.clone();
            let burst = uzawa::burst(problem, &[], r, &point.rigid, monitor, steps)?;
            steps *= 2;
            monitor.count(1.0);
            return Ok(match burst {
                Burst::Stop(outcome) => Least::Stop(outcome),
                Burst::End(r, rigid) => Least::At(PrinciplePoint::new(problem, r, rigid)),
            });
        }
        penalty = (FALL * penalty).max(LEAST);
        Ok(Least::At(if better { next } else { point.clone() }))
    })
}
