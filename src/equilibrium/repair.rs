//! Moves a motion into the dual cones, by a small share of one that opens the contacts.
//!
//! The motion of a programme lies on the border of the dual cones, half of its contacts outside
//! by rounding. A motion `d0` with all contacts inside, which does not depend on the loads,
//! repairs it: `d + ε d0`. Where reactions can balance each other without loads (self-stress),
//! some contacts have no such motion; then `d0` opens the others.

use crate::equilibrium::part::Part;
use crate::equilibrium::proof::{Witness, normalise};
use crate::error::Error;
use crate::linalg::small::plus_scaled;

/// A contact opens if its slack is above this share of the largest amount of the motion.
const OPENS: f64 = 1e-9;
/// Rounding of a motion, relative to its largest amount: the least share of `d0` adds this much.
const ROUNDING: f64 = 1e-15;
/// Amounts below this are rounding, and not zero only by it.
const NOTHING: f64 = 1e-11;
/// Trials, each with ten times the share of the one before.
const TRIALS: i32 = 6;

/// What the repairs of one group have in common.
pub(super) struct Repair<'a, 'p> {
    part: &'a Part<'p>,
    /// Motions that open contacts, made on first use.
    openings: [Option<Vec<f64>>; 2],
}

impl<'a, 'p> Repair<'a, 'p> {
    pub(super) fn new(part: &'a Part<'p>) -> Self {
        let openings = [None, None];
        Self { part, openings }
    }

    /// The motion, or one near it, that excludes the largest reactions; with the length of these.
    pub(super) fn repair(
        &mut self,
        motion: &[f64],
        load: &[f64],
    ) -> Result<Option<(Vec<f64>, f64)>, Error> {
        let (part, lengths) = (self.part, &self.part.statics.lengths);
        let Some(motion) = normalise(motion, lengths) else {
            return Ok(None);
        };
        // A motion that needs no repair may be exact where its rounding is removed.
        let clean = clear_amounts(&motion, lengths, NOTHING);
        let mut best: Option<(Vec<f64>, f64)> = None;
        let mut offer = |motion: Vec<f64>, witness: &Witness| {
            let excluded = witness.excluded();
            if excluded > best.as_ref().map_or(0.0, |best| best.1) {
                best = Some((motion, excluded));
            }
            excluded.is_infinite()
        };
        for base in [&motion, &clean] {
            let witness = part.witness(load, base);
            if witness.work > 0.0 && offer(base.clone(), &witness) {
                return Ok(best);
            }
        }
        for (each, cleared) in [(false, false), (true, false), (true, true)] {
            let Some(mut opening) = self.open(each)? else {
                continue;
            };
            if cleared {
                // In directions in which contacts hold each other, amounts are rounding.
                opening = clear_amounts(&opening, lengths, OPENS);
            }
            let opened = part.witness(load, &opening).slack;
            for base in [&motion, &clean] {
                let slack = part.witness(load, base).slack;
                let opens = slack.iter().zip(&opened).filter(|pair| *pair.1 > OPENS);
                let shares = opens.map(|(slack, open)| (ROUNDING - 1.01 * slack.min(0.0)) / open);
                let least = shares.fold(ROUNDING / OPENS.sqrt(), f64::max);
                for trial in 0..TRIALS {
                    let moved = plus_scaled(base, least * 10_f64.powi(trial), &opening);
                    let witness = part.witness(load, &moved);
                    if !(witness.work > 0.0) {
                        break;
                    }
                    if offer(moved, &witness) {
                        return Ok(best);
                    }
                }
            }
            if opened.iter().all(|&slack| slack > OPENS) {
                break;
            }
        }
        Ok(best)
    }

    /// The length of excluded reactions relative to the loads.
    pub(super) fn relative(&self, excluded: f64) -> f64 {
        excluded / self.part.load_size()
    }

    /// The motion `d0`, its largest amount 1.
    fn open(&mut self, each: bool) -> Result<Option<Vec<f64>>, Error> {
        let slot = &mut self.openings[usize::from(each)];
        if slot.is_none() {
            let motion = self.part.find_opening(each)?;
            *slot = Some(normalise(&motion, &self.part.statics.lengths).unwrap_or_default());
        }
        Ok(slot.clone().filter(|motion| !motion.is_empty()))
    }
}

/// The motion without amounts below the `least`.
fn clear_amounts(motion: &[f64], lengths: &[f64], least: f64) -> Vec<f64> {
    let amounts = motion.iter().zip(lengths);
    amounts
        .map(|(&d, l)| if (d * l).abs() < least { 0.0 } else { d })
        .collect()
}
