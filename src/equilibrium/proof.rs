//! Whether a motion proves that no reactions balance the loads.
//!
//! Let `v = R d` lie in the dual cone of each contact, `v_n ≥ ‖D v_t‖` with the coefficients
//! `D`. For each `r ∈ C`, `r·v ≥ −c‖v_t‖`. If `Rᵀ r + e = 0`, then
//!
//! ```text
//! 0 = d·(Rᵀ r + e) ≥ e·d − Σ c‖v_t‖,
//! ```
//!
//! so that `e·d > Σ c‖v_t‖` proves that there are none. All sums are exact here, and what is
//! rounded after them is rounded to the safe side: rational arithmetic on the numbers of the
//! caller confirms each proof.

use crate::equilibrium::statics::Statics;
use crate::linalg::compensated::ExactSum;
use crate::linalg::small::{amax, norm};

/// Rounding of a few operations on numbers with an error of ε.
const FEW: f64 = 16.0 * f64::EPSILON;

/// How a motion acts on contacts and loads.
pub(super) struct Witness {
    /// For each contact, by how much `v_n` exceeds `‖D v_t‖`: a lower bound, exact if it is zero.
    pub(super) slack: Vec<f64>,
    /// Lower bound of `e·d − Σ c‖v_t‖`.
    pub(super) work: f64,
    /// Length of the part of the motion outside the dual cones; zero for a proof.
    pub(super) lack: f64,
}

impl Witness {
    /// The witness of a motion that moves only these contacts.
    pub(super) fn new(statics: &Statics, contacts: &[usize], load: &[f64], motion: &[f64]) -> Self {
        let mut slack = Vec::with_capacity(contacts.len());
        let mut held = 0.0;
        let mut lack = 0.0_f64;
        for &contact in contacts {
            let cohesion = statics.cohesion[contact];
            let rows = statics.rows_of(contact);
            let mut lengths = [0.0_f64; 2];
            let normal = move_row(statics, rows.start, motion);
            let opening = normal.value();
            let mut squares = Squares::new(&normal);
            for row in rows.clone().skip(1) {
                if statics.friction[row] == 0.0 && cohesion == 0.0 {
                    continue;
                }
                let tangential = move_row(statics, row, motion);
                let moved = tangential.value();
                lengths[0] = lengths[0].hypot(statics.friction[row] * moved);
                lengths[1] = lengths[1].hypot(moved);
                squares.subtract(statics.friction[row], &tangential);
            }
            let [resisted, slip] = lengths.map(|length| length * (1.0 + FEW));
            held += cohesion * slip;
            let mut difference = opening - FEW * opening.abs() - resisted;
            if difference < 0.0 && opening > 0.0 && squares.is_inside() {
                difference = 0.0;
            }
            let mu = statics.largest_friction(contact);
            lack = lack.hypot(difference.min(0.0) / mu.hypot(1.0));
            slack.push(difference);
        }
        let mut sum = ExactSum::default();
        for (&e, &d) in load.iter().zip(motion) {
            sum.add_product(e, d);
        }
        let work = sum.value();
        #[expect(clippy::cast_precision_loss, reason = "a number of contacts")]
        let held = held * (1.0 + FEW * (slack.len() as f64 + 1.0));
        Self {
            slack,
            work: work - FEW * work.abs() - held,
            lack,
        }
    }

    /// Whether no reactions at all balance the loads.
    pub(super) fn proves(&self) -> bool {
        self.work > 0.0 && self.slack.iter().all(|&slack| slack >= 0.0)
    }

    /// Reactions up to this length do not balance the loads: `e·d ≤ ‖lack‖ ‖r‖` for those that
    /// do.
    pub(super) fn excluded(&self) -> f64 {
        if self.proves() {
            f64::INFINITY
        } else if self.work > 0.0 {
            self.work / self.lack
        } else {
            0.0
        }
    }
}

/// A component of `R d`.
fn move_row(statics: &Statics, row: usize, motion: &[f64]) -> ExactSum {
    let mut sum = ExactSum::default();
    for (j, value) in statics.row(row) {
        sum.add_product(value, motion[j]);
    }
    sum
}

/// `v_n² − ‖D v_t‖²` without rounding, if the components of `v` are numbers: a motion may lie on
/// the border of a dual cone, where any rounding would count against it.
struct Squares {
    difference: ExactSum,
    exact: bool,
}

impl Squares {
    /// Products of smaller numbers are rounded.
    const LEAST: f64 = 1e-100;

    fn new(normal: &ExactSum) -> Self {
        let opening = normal.value();
        let mut difference = ExactSum::default();
        difference.add_product(opening, opening);
        Self {
            difference,
            exact: normal.is_number() && opening > Self::LEAST,
        }
    }

    fn subtract(&mut self, friction: f64, tangential: &ExactSum) {
        let moved = tangential.value();
        let high = friction * moved;
        let low = friction.mul_add(moved, -high);
        self.exact &= tangential.is_number() && (high == 0.0 || high.abs() > Self::LEAST);
        for (a, b) in [(high, high), (2.0 * high, low), (low, low)] {
            self.difference.add_product(-a, b);
        }
    }

    fn is_inside(&self) -> bool {
        self.exact && self.difference.value() >= 0.0
    }
}

/// The motion whose largest amount, in lengths of columns, is 1.
pub(super) fn normalise(motion: &[f64], lengths: &[f64]) -> Option<Vec<f64>> {
    let amounts: Vec<f64> = motion.iter().zip(lengths).map(|(d, l)| d * l).collect();
    let largest = amax(&amounts);
    let usable = norm(&amounts).is_finite() && largest > 0.0;
    usable.then(|| motion.iter().map(|d| d / largest).collect())
}
