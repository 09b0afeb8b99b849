//! The largest multiple of a live load that reactions can balance beside a dead load.
//!
//! A motion `d` with `R d` in the dual cones and `e₁·d > 0` bounds it: `0 ≥ e₀·d + λ e₁·d −
//! Σ c‖v_t‖` for all reactions that balance `e₀ + λ e₁`.

use crate::equilibrium::decide::{Decision, LARGEST, Verdict, decide, decide_part};
use crate::equilibrium::part::Part;
use crate::equilibrium::programme::Limits;
use crate::equilibrium::proof::Witness;
use crate::equilibrium::repair::Repair;
use crate::equilibrium::statics::Statics;
use crate::error::{Error, check_length};

/// Shares of the multiplier above it, at which a mechanism has to prove that there is no balance.
const ABOVE: [f64; 7] = [1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4];
/// Shares below it, at which reactions are measured.
const BELOW: [f64; 8] = [0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-6, 1e-4, 1e-2];

/// An interval of the multiplier that is this share of it is not halved.
const NARROW: f64 = 1e-8;

/// The largest multiplier, from both sides.
#[derive(Clone, Debug)]
pub struct LimitLoad {
    /// The answer for the dead load alone. If nothing balances it, there is nothing else. One
    /// that is exactly on its limit may be undecided; a mechanism is a proof without it.
    pub dead: Decision,
    /// No reactions balance the loads above this; infinite if no bound was proved.
    pub upper: f64,
    /// The motion that proves it; empty if `upper` is infinite.
    pub mechanism: Vec<f64>,
    /// Length of the reactions that the mechanism excludes above `upper`, relative to the loads;
    /// infinite for a proof without a bound.
    pub excluded: f64,
    /// The largest multiplier with reactions that were measured, and these; infinite if the
    /// reactions of the live load alone may be added any number of times.
    pub reached: Option<(f64, Vec<f64>)>,
}

/// Finds the largest `λ` for which `Rᵀ r + e₀ + λ e₁ = 0` has reactions in the cones.
pub fn find_limit(
    statics: &Statics,
    dead: &[f64],
    live: &[f64],
    limits: Limits,
) -> Result<LimitLoad, Error> {
    check_length("the live load", live.len(), statics.lengths.len())?;
    let mut limit = LimitLoad {
        dead: decide(statics, dead, limits)?,
        upper: f64::INFINITY,
        mechanism: Vec::new(),
        excluded: f64::INFINITY,
        reached: None,
    };
    if limit.dead.verdict == Verdict::None {
        return Ok(limit);
    }
    let none = statics.without_cohesion();
    let forever = decide(&none, live, limits)?;
    if forever.verdict == Verdict::Balanced {
        let balanced = limit.dead.verdict == Verdict::Balanced;
        limit.reached = balanced.then_some((f64::INFINITY, forever.reaction));
        return Ok(limit);
    }
    let mut largest = f64::INFINITY;
    for group in &statics.groups {
        if group.motions.iter().all(|&j| live[j] == 0.0) {
            continue;
        }
        let part = Part::new(statics, group, dead, limits);
        // The bound of a motion in the dual cones, rounded up; not a number if the live load does
        // not work on it.
        let bound = |motion: &[f64]| {
            let without = part.witness(dead, motion).work;
            let gained = Witness::new(&none, &group.contacts, live, motion).work;
            if !(gained > 0.0) {
                return f64::NAN;
            }
            let upper = -without / gained;
            upper + 4.0 * f64::EPSILON * upper.abs()
        };
        let (multiplier, motion) = part.find_multiplier(live)?;
        let multiplier = if multiplier.is_finite() {
            largest = largest.min(multiplier.max(0.0));
            multiplier.max(0.0)
        } else {
            0.0
        };
        let mut repair = Repair::new(&part);
        let mut bounded: Option<Bound> = None;
        for above in ABOVE {
            // The dead load alone may be at its limit.
            let tried = multiplier * (1.0 + above) + above * part.force_of(live);
            let load = add(dead, tried, live);
            let Some((mechanism, excluded)) = repair.repair(&motion, &load)? else {
                continue;
            };
            let upper = bound(&mechanism);
            let excluded = excluded / part.size_of(&load);
            if excluded.is_infinite() && upper >= 0.0 {
                bounded = Some((upper, mechanism, excluded));
                break;
            }
            // Where contacts hold each other, rounding may leave no other proof.
            if excluded >= LARGEST && bounded.is_none() {
                bounded = Some((tried, mechanism, excluded));
            }
        }
        if !bounded.as_ref().is_some_and(|bound| bound.2.is_infinite()) {
            // Where contacts hold each other, or the dead load is on its limit, loads are asked.
            let ask = |tried: f64| -> Result<Option<Bound>, Error> {
                // Of this group alone: `bound` knows the cohesion of no other.
                let load = add(dead, tried, live);
                let decision = decide_part(&Part::new(statics, group, &load, limits), &load)?;
                if decision.verdict != Verdict::None {
                    return Ok(None);
                }
                let upper = bound(&decision.motion);
                let unlimited = decision.excluded.is_infinite() && upper >= 0.0;
                let proved = if unlimited { upper.min(tried) } else { tried };
                Ok((!upper.is_nan()).then_some((proved, decision.motion, decision.excluded)))
            };
            bounded = narrow(bounded, multiplier, part.force_of(live), ask)?;
        }
        if let Some((upper, mechanism, excluded)) = bounded
            && upper < limit.upper
        {
            (limit.upper, limit.mechanism, limit.excluded) = (upper, mechanism, excluded);
        }
    }
    largest = largest.min(limit.upper);
    if !largest.is_finite() {
        return Ok(limit);
    }
    for below in BELOW {
        let tried = (largest * (1.0 - below)).min(limit.upper);
        let decision = decide(statics, &add(dead, tried, live), limits)?;
        if decision.verdict == Verdict::Balanced {
            limit.reached = Some((tried, decision.reaction));
            return Ok(limit);
        }
    }
    if limit.dead.verdict == Verdict::Balanced {
        limit.reached = Some((0.0, limit.dead.reaction.clone()));
    }
    Ok(limit)
}

/// A bound of the multiplier, the mechanism, and the length of the reactions that it excludes.
type Bound = (f64, Vec<f64>, f64);

/// The least bound that `ask` proves at some multiplier above `below`: powers of ten of `unit`
/// find one, if there is none yet; halving the interval the least.
fn narrow(
    mut best: Option<Bound>,
    mut below: f64,
    unit: f64,
    ask: impl Fn(f64) -> Result<Option<Bound>, Error>,
) -> Result<Option<Bound>, Error> {
    for exponent in -10..=10 {
        let tried = 10_f64.powi(exponent) * unit;
        if best.is_none() && tried > below {
            best = ask(tried)?;
            if best.is_none() {
                below = tried;
            }
        }
    }
    while let Some((upper, ..)) = &best
        && upper - below > NARROW * upper.max(0.01 * unit)
    {
        let middle = below.midpoint(*upper);
        match ask(middle)? {
            Some(bound) => best = Some(bound),
            None => below = middle,
        }
    }
    Ok(best)
}

/// `e₀ + λ e₁`.
fn add(dead: &[f64], multiplier: f64, live: &[f64]) -> Vec<f64> {
    let pairs = dead.iter().zip(live);
    pairs
        .map(|(dead, live)| multiplier.mul_add(*live, *dead))
        .collect()
}
