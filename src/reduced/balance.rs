//! Decides whether contact can balance the loads on bodies that only contact holds.
//!
//! The cone programme asks for an `r ∈ K_μ` with `Rᵀ r + e = 0`. If there is none, a rigid
//! motion `d` with `R d ∈ K*_μ` and `e·d > 0` proves it: then `d·(Rᵀ r + e) > 0` for each
//! `r ∈ K_μ`.
//!
//! Rigid motions are orthonormal in scaled variables. There, the shortest imbalance
//! `s = R̂ᵀ r̂ + ê` over all `r̂` of the cones is such a motion. Least squares with
//! non-negative amounts of generated columns finds it: each round adds the force in the cones
//! that does most work against `s`.
//!
//! Cohesion only resists: the programme is that of the cones without it, and the proof counts its
//! work.
//!
//! Which motions are free is not asked here: [`bodies`](crate::bodies) has decided it, by rows of
//! `K`, which act in both directions. Contacts push only. So neither this programme nor
//! [`runaway`], which looks for the motion along which an iteration has gone, is a question of
//! rank.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::law::contact_law::ContactLaw;
use crate::linalg::nonnegative::{add, shortest};
use crate::linalg::small::{dot_long, norm, tangential_norm};
use crate::linalg::union::Union;
use crate::reduced::existence::{LEAST_WORK, excludes, is_unresisted};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual;
use crate::reduced::tuning;

/// Result of the cone programme.
#[derive(Clone, Debug, PartialEq)]
pub enum Balance {
    /// Contact can balance the loads, or there is no proof that it cannot.
    Possible,
    /// Contact cannot balance the loads: they work on a rigid motion that no contact resists.
    Impossible {
        /// Amounts `a` of the rigid motions; the largest motion of a contact is 1.
        motion: Vec<f64>,
    },
}

/// Rounding error of the motion of a contact, relative to the size of its rows.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Error of rigid motions, which are null vectors of the condensed stiffness. A proof has a
/// larger slack where possible.
const KNOWN: f64 = 1e-13;

/// A contact does not resist a motion if its work against it is a smaller share of its largest
/// possible work.
const AT_REST: f64 = 1e-13;

/// A motion with a smaller slack is not used to open contacts: it would undo the other motion.
const LEAST_SLACK: f64 = 1e-6;

/// Decides the cone programme up to rounding.
///
/// It returns `Impossible` only with a motion that [`is_unresisted`] accepts.
#[must_use]
pub fn balance<const D: usize>(problem: &Reduced<D>, stop: &AtomicBool) -> Balance {
    for modes in coupled(problem) {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let part = MotionGroup::new(problem, &modes);
        if let Some(found) = part.unresisted(stop) {
            let mut scaled = vec![0.0; problem.scaling.modes.len()];
            for (&mode, amount) in modes.iter().zip(found) {
                scaled[mode] = amount;
            }
            let motion = of_largest_one(problem, &scaled);
            if is_unresisted(problem, &motion) {
                return Balance::Impossible { motion };
            }
        }
    }
    Balance::Possible
}

/// The direction of a rigid motion `a`, if it shows why an iteration at reactions `r` did not
/// converge: the motion is much larger than the deformation, the loads work on it, no normal
/// force stops it, and twice the motion leaves no larger merit: then contacts open or slide along
/// it, and it grows. Without any deformation there is nothing to compare it with. It is not a
/// proof that friction does not stop it.
#[must_use]
pub fn runaway<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    a: &[f64],
) -> Option<Vec<f64>> {
    let scaling = &problem.scaling;
    let motion = scaling.rigid_to_scaled(a);
    let length = norm(&motion);
    let still = problem.relative_displacement(r, &[]);
    let deformed = still.iter().zip(&scaling.to_v);
    let deformed: Vec<f64> = deformed
        .flat_map(|(v, scale)| v.map(|c| c * scale))
        .collect();
    let deformed = norm(&deformed);
    let is_large = length.is_finite() && length > tuning::runaway_motion() * deformed;
    if deformed == 0.0 || !is_large {
        return None;
    }
    let twice: Vec<f64> = a.iter().map(|a| 2.0 * a).collect();
    let merit = |a: &[f64]| residual::merit(problem, r, &problem.relative_displacement(r, a));
    if merit(&twice) > (1.0 + tuning::runaway_penetration()) * merit(a) {
        return None;
    }
    let motion: Vec<f64> = motion.iter().map(|x| x / length).collect();
    let all: Vec<usize> = (0..motion.len()).collect();
    let part = MotionGroup::new(problem, &all);
    // The iteration finds the motion inexactly: tolerate a penetration of a thousandth.
    let opens =
        |i: usize| part.motion_at(i, &motion)[0] >= -tuning::runaway_penetration() * part.size[i];
    let work = dot_long(&motion, &part.load);
    let free = work > LEAST_WORK * norm(&part.load) && (0..part.size.len()).all(opens);
    free.then(|| of_largest_one(problem, &motion))
}

/// The unscaled rigid motion whose largest motion of a contact is 1.
fn of_largest_one<const D: usize>(problem: &Reduced<D>, scaled: &[f64]) -> Vec<f64> {
    let mut a = problem.scaling.rigid_from_scaled(scaled);
    let mut largest = 0.0_f64;
    for i in 0..problem.contacts() {
        let at = |k: usize| {
            let of_mode = problem.rigid.modes.iter().zip(&a);
            of_mode.map(|(mode, a)| mode[i][k] * a).sum::<f64>()
        };
        largest = (0..D).map(at).fold(0.0_f64, f64::hypot).max(largest);
    }
    if largest.is_normal() {
        a = a.iter().map(|x| x / largest).collect();
    }
    a
}

/// Groups of rigid motions that share no contact. Each group balances by itself, so that the
/// loads of a heavy body do not hide those of a light one.
fn coupled<const D: usize>(problem: &Reduced<D>) -> Vec<Vec<usize>> {
    let modes = &problem.scaling.modes;
    let mut sets = Union::new(modes.len());
    for i in 0..problem.contacts() {
        let mut felt = (0..modes.len()).filter(|&m| modes[m][i].iter().any(|&c| c != 0.0));
        if let Some(first) = felt.next() {
            felt.for_each(|other| sets.join(first, other));
        }
    }
    let mut groups: Vec<(usize, Vec<usize>)> = Vec::new();
    for mode in 0..modes.len() {
        let leader = sets.leader(mode);
        match groups.iter_mut().find(|(of, _)| *of == leader) {
            Some((_, members)) => members.push(mode),
            None => groups.push((leader, vec![mode])),
        }
    }
    groups.into_iter().map(|(_, members)| members).collect()
}

/// A group of rigid motions, and the contacts that they move.
struct MotionGroup<const D: usize> {
    /// `R̂`, for each contact and each motion.
    rows: Vec<[f64; D]>,
    /// Frobenius norm of the rows of each contact.
    size: Vec<f64>,
    /// `(1, μ)/√(1 + μ²)`: the edge of the cone of each contact.
    edge: Vec<[f64; 2]>,
    mu: Vec<f64>,
    load: Vec<f64>,
}

/// A force of length 1 in the cone of a contact, and its work on the motion.
struct Resistance<const D: usize> {
    contact: usize,
    force: [f64; D],
    /// Relative to the size of the rows of the contact; negative if the contact resists.
    work: f64,
}

impl<const D: usize> MotionGroup<D> {
    fn new(problem: &Reduced<D>, modes: &[usize]) -> Self {
        let scaling = &problem.scaling;
        let mut part = Self {
            rows: Vec::new(),
            size: Vec::new(),
            edge: Vec::new(),
            mu: Vec::new(),
            load: modes.iter().map(|&m| scaling.load[m]).collect(),
        };
        for (i, &ContactLaw { mu, .. }) in problem.law.iter().enumerate() {
            let rows = modes.iter().map(|&m| scaling.modes[m][i]);
            let size = rows.clone().flatten().map(|x| x * x).sum::<f64>().sqrt();
            if size > 0.0 {
                part.rows.extend(rows);
                part.size.push(size);
                let length = mu.hypot(1.0);
                part.edge.push([1.0 / length, mu / length]);
                part.mu.push(mu);
            }
        }
        part
    }

    /// `(R̂ d)_i`.
    fn motion_at(&self, contact: usize, motion: &[f64]) -> [f64; D] {
        let k = self.load.len();
        let mut at = [0.0; D];
        for (row, d) in self.rows[k * contact..].iter().zip(motion) {
            for (value, r) in at.iter_mut().zip(row) {
                *value += r * d;
            }
        }
        at
    }

    /// Whether the force opposite to a motion lies in the cone. The sign of `v_n` is needed:
    /// with `μ = 0` an opening contact also has `‖v_t‖ ≤ −μ v_n`.
    fn is_opposed(&self, contact: usize, v: &[f64; D]) -> bool {
        v[0] < 0.0 && tangential_norm(v) <= -self.mu[contact] * v[0]
    }

    /// The least work of a force of length 1 in the cone of a contact that moves by `v`.
    /// Outside `K*_μ` it is minus the distance of `v` from `K*_μ`.
    fn least_work(&self, contact: usize, v: &[f64; D]) -> f64 {
        let [normal, tangential] = self.edge[contact];
        let slip = tangential_norm(v);
        if self.is_opposed(contact, v) {
            -v[0].hypot(slip)
        } else {
            normal * v[0] - tangential * slip
        }
    }

    /// The contact that resists a motion most, with its force.
    fn most_resisting(&self, motion: &[f64]) -> Option<Resistance<D>> {
        let mut worst: Option<(usize, f64)> = None;
        for (i, size) in self.size.iter().enumerate() {
            let work = self.least_work(i, &self.motion_at(i, motion)) / size;
            if worst.is_none_or(|(_, least)| work < least) {
                worst = Some((i, work));
            }
        }
        let (contact, work) = worst?;
        let v = self.motion_at(contact, motion);
        let slip = tangential_norm(&v);
        let mut force = v;
        if self.is_opposed(contact, &v) {
            let length = v[0].hypot(slip);
            force = force.map(|c| -c / length);
        } else {
            let [normal, tangential] = self.edge[contact];
            force[0] = normal;
            let share = if slip > 0.0 { tangential / slip } else { 0.0 };
            force[1..].iter_mut().for_each(|c| *c *= -share);
            if slip == 0.0 {
                force[1] = -tangential; // any direction will do
            }
        }
        Some(Resistance {
            contact,
            force,
            work,
        })
    }

    /// `R̂ᵀ r̂` of one force, relative to the size of the rows of the contact.
    fn column(&self, resistance: &Resistance<D>) -> Vec<f64> {
        let k = self.load.len();
        let first = k * resistance.contact;
        let of_row = |row: &[f64; D]| {
            let work = row.iter().zip(&resistance.force);
            work.map(|(r, f)| r * f).sum::<f64>() / self.size[resistance.contact]
        };
        self.rows[first..first + k].iter().map(of_row).collect()
    }

    /// A motion that proves that the loads cannot be balanced, if one is found.
    fn unresisted(&self, stop: &AtomicBool) -> Option<Vec<f64>> {
        let size = norm(&self.load);
        let balanced = |length: f64| !(length > LEAST_WORK * size);
        let (mut least, mut motion) = (f64::INFINITY, None);
        let (mut halved, mut rounds) = (f64::INFINITY, 0);
        let imbalance = shortest(&self.load, |s, length| {
            if stop.load(Ordering::Relaxed) {
                return None;
            }
            let found = self.most_resisting(s).filter(|_| !balanced(length))?;
            let resistance = -found.work / length;
            if resistance < least {
                least = resistance;
                motion = Some(s.iter().map(|x| x / length).collect::<Vec<f64>>());
            }
            rounds += 1;
            if resistance < 0.5 * halved {
                (halved, rounds) = (resistance, 0);
            }
            let goes_on =
                resistance > AT_REST && rounds <= tuning::balance_patience() * self.load.len();
            goes_on.then(|| self.column(&found))
        });
        if balanced(norm(&imbalance)) {
            return None;
        }
        // Without contacts there was no round.
        let motion = motion.unwrap_or_else(|| imbalance.iter().map(|x| x / size).collect());
        let lifted = self.lifted(&motion);
        let strict = lifted.filter(|lifted| self.proves(lifted));
        strict.or_else(|| self.proves(&motion).then_some(motion))
    }

    /// Whether a motion of length about 1 is a proof despite rounding. With `m = ê·d` and `δ_i`
    /// the distance of `(R̂ d)_i` from `K*_μ`, all reactions in the cones that balance the
    /// loads have `m ≤ −Σ (R̂ d)_i·r̂_i ≤ ‖δ‖ ‖r̂‖`.
    fn proves(&self, motion: &[f64]) -> bool {
        let length = norm(motion);
        let distance = |i: usize| {
            let slack =
                self.least_work(i, &self.motion_at(i, motion)) - ROUNDING * self.size[i] * length;
            (-slack).max(0.0).powi(2)
        };
        let distance = (0..self.size.len()).map(distance).sum::<f64>().sqrt();
        let work = dot_long(motion, &self.load);
        let size = norm(&self.load) * length;
        work > LEAST_WORK * size && excludes(work, distance, size)
    }

    /// A motion moved into `K*_μ` by adding a little of a motion inside it.
    fn lifted(&self, motion: &[f64]) -> Option<Vec<f64>> {
        let (inside, slack) = self.inside()?;
        let found = self.most_resisting(motion)?;
        let mut motion = motion.to_vec();
        add(&mut motion, (2.0 * KNOWN - found.work) / slack, &inside);
        Some(motion)
    }

    /// A motion of length 1 with `(R̂ d)_n > μ ‖(R̂ d)_t‖` at each contact, and its least slack
    /// relative to the size of the rows of a contact. It is the shortest point of the convex
    /// hull of the columns, computed as a projection with one more component.
    fn inside(&self) -> Option<(Vec<f64>, f64)> {
        let k = self.load.len();
        let mut target = vec![0.0; k + 1];
        target[k] = -1.0;
        let mut opened = None;
        let _ = shortest(&target, |s, bound| {
            let length = norm(&s[..k]);
            let found = self
                .most_resisting(&s[..k])
                .filter(|_| bound > LEAST_SLACK)?;
            // The slack of the shortest point is its length, and −s_k is its square: half of it
            // suffices.
            if found.work > -0.5 * s[k] && found.work > LEAST_SLACK * length {
                let unit = s[..k].iter().map(|x| x / length).collect();
                opened = Some((unit, found.work / length));
                return None;
            }
            let mut column = self.column(&found);
            column.push(1.0);
            Some(column)
        });
        opened
    }
}
