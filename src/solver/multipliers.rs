//! A penalty law of contact and the method of multipliers around it, which `return_mapping` and
//! `perturbed_lagrangian` share.
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
//! `v' = v`: the law holds without error, for any ε.

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::newton::newton::{self, Near, NewtonEnd};
use crate::solver::outcome::Outcome;
use crate::solver::principles::convex::{Least, PrinciplePoint, iterate};
use crate::solver::settings::Start;
use crate::solver::uzawa::{self, Burst};

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

/// The problem of a penalty, in units of the stiffness of each contact, and multipliers: (20d).
#[must_use]
pub fn regularised<const D: usize>(penalty: f64, multipliers: Vec<[f64; D]>) -> Near<D> {
    Near {
        shift: 1.0 / penalty,
        centre: multipliers,
        ..Near::nothing()
    }
}

/// Runs from multipliers equal to the start value until the monitor stops it, or new multipliers
/// give no improvement. `make` gives [`regularised`] the step of its map.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    make: impl Fn(f64, Vec<[f64; D]>) -> Near<D>,
) -> Result<Outcome, Error> {
    let (mut penalty, mut steps) = (PENALTY, FIRST_BURST);
    iterate(problem, start, monitor, |point, monitor| {
        monitor.measure_floor(&point.r, &point.rigid);
        let near = make(penalty, point.r.clone());
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
