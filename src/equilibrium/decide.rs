//! Whether reactions balance the loads.
//!
//! The programme of largest margin has a solution on both sides of a limit. Its margin decides
//! which of its two results is checked: reactions inside their cones, or a motion. Where the
//! margin is rounding, as where the loads determine the reactions, the reactions of least length
//! are measured.

use crate::equilibrium::part::Part;
use crate::equilibrium::programme::Limits;
use crate::equilibrium::repair::Repair;
use crate::equilibrium::statics::Statics;
use crate::error::{Error, check_finite, check_length};
use crate::linalg::small::add_scaled;

/// A margin below this share of the mean load is rounding.
const SURE: f64 = 1e-9;

/// Loads that are out of balance by at most this share are balanced: the default tolerance of a
/// solution.
const BALANCED: f64 = 1e-10;

/// Reactions that are this many times the loads are no solution: their rounding hides the loads.
pub(super) const LARGEST: f64 = 1e9;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Balanced,
    None,
    Undecided,
}

impl Verdict {
    pub fn name(self) -> &'static str {
        match self {
            Self::Balanced => "balanced",
            Self::None => "none",
            Self::Undecided => "undecided",
        }
    }
}

/// The answer with its proof.
#[derive(Clone, Debug)]
pub struct Decision {
    pub verdict: Verdict,
    /// Reactions in the cones, all rows; the best ones found if the verdict is not balanced.
    pub reaction: Vec<f64>,
    /// Amounts of the motions, a proof that there are no reactions; empty without one.
    pub motion: Vec<f64>,
    /// The largest distance from the borders of the cones that all reactions can have, at most
    /// the mean load; negative if some have to be outside. A force.
    pub margin: f64,
    /// `margin` over the mean load.
    pub relative_margin: f64,
    /// Length of the reactions that the motion excludes, relative to the loads; infinite for a
    /// proof without a bound.
    pub excluded: f64,
    /// `‖Rᵀ r + e‖/‖e‖` of the reactions.
    pub imbalance: f64,
}

impl Decision {
    /// No reactions, which balance no loads, with a margin.
    fn begin(statics: &Statics, margin: f64) -> Self {
        Self {
            verdict: Verdict::Balanced,
            reaction: vec![0.0; statics.friction.len()],
            motion: Vec::new(),
            margin,
            relative_margin: margin,
            excluded: 0.0,
            imbalance: 0.0,
        }
    }

    /// Whether the margin is more than rounding.
    pub fn inside(&self) -> bool {
        self.relative_margin > SURE
    }
}

/// Decides whether `Rᵀ r + e = 0` for some `r` of the cones.
pub fn decide(statics: &Statics, load: &[f64], limits: Limits) -> Result<Decision, Error> {
    check_length("e", load.len(), statics.lengths.len())?;
    check_finite("e", load)?;
    let mut whole = Decision::begin(statics, f64::INFINITY);
    for group in &statics.groups {
        let decision = decide_part(&Part::new(statics, group, load, limits), load)?;
        add_scaled(&mut whole.reaction, 1.0, &decision.reaction);
        whole.margin = whole.margin.min(decision.margin);
        whole.relative_margin = whole.relative_margin.min(decision.relative_margin);
        whole.imbalance = whole.imbalance.max(decision.imbalance);
        match decision.verdict {
            Verdict::None => {
                return Ok(Decision {
                    margin: whole.margin,
                    relative_margin: whole.relative_margin,
                    reaction: whole.reaction,
                    ..decision
                });
            }
            Verdict::Undecided => whole.verdict = Verdict::Undecided,
            Verdict::Balanced => {}
        }
    }
    Ok(whole)
}

/// [`decide`] for the loads of one group.
pub(super) fn decide_part(part: &Part, load: &[f64]) -> Result<Decision, Error> {
    let mut decision = Decision::begin(part.statics, 0.0);
    if part.load_size() == 0.0 {
        return Ok(decision);
    }
    let measure = |reaction: &[f64]| part.imbalance(&part.statics.imbalance(reaction, load));
    let (inner, margin, motion) = part.find_margin()?;
    decision.imbalance = measure(&inner);
    decision.reaction = inner;
    if margin.is_finite() {
        decision.margin = margin * part.force;
        decision.relative_margin = margin;
    }
    if decision.inside() && decision.imbalance <= BALANCED {
        return Ok(decision);
    }
    let mut repair = Repair::new(part);
    let mut motions = vec![motion];
    // Above the limit by less than this, the least reactions would be balanced too.
    if !(margin < -SURE) || !exclude(&mut decision, &mut repair, &motions[0], load)? {
        let (least, other) = part.find_least()?;
        let imbalance = measure(&least);
        if imbalance < decision.imbalance || !decision.imbalance.is_finite() {
            (decision.reaction, decision.imbalance) = (least, imbalance);
        }
        motions.push(other);
        if decision.imbalance <= BALANCED {
            // Reactions that were measured outweigh a proof with a bound.
            decision.verdict = Verdict::Balanced;
            decision.motion.clear();
            decision.excluded = 0.0;
            return Ok(decision);
        }
        if decision.motion.is_empty() {
            decision.verdict = Verdict::Undecided;
        }
        for motion in motions.iter().rev() {
            if exclude(&mut decision, &mut repair, motion, load)? {
                break;
            }
        }
        if decision.verdict == Verdict::Undecided {
            let _ = exclude(&mut decision, &mut repair, &part.find_shortest()?, load)?;
        }
    }
    if decision.reaction.iter().any(|r| !r.is_finite()) {
        decision.reaction.fill(0.0);
        decision.imbalance = 1.0;
    }
    Ok(decision)
}

/// Whether a motion, once repaired, proves that there are no reactions; keeps it then.
fn exclude(
    decision: &mut Decision,
    repair: &mut Repair,
    motion: &[f64],
    load: &[f64],
) -> Result<bool, Error> {
    let Some((motion, excluded)) = repair.repair(motion, load)? else {
        return Ok(false);
    };
    let excluded = repair.relative(excluded);
    if excluded < LARGEST || excluded <= decision.excluded {
        return Ok(false);
    }
    decision.verdict = Verdict::None;
    decision.motion = motion;
    decision.excluded = excluded;
    Ok(excluded.is_infinite())
}
