//! The certificate that decides whether a point is a solution, (11) and (13). All solvers share
//! it.
//!
//! `F(r) = r̂ − proj(r̂ − ṽ̂, C)`, with `C = K_μ` without cohesion, in scaled variables, where ρ = 1, and
//! `η = ‖F(r)‖ / max(‖r̂‖, ‖F(0)‖)`, zero if both are zero. If only contact holds a body, η is
//! the larger of this and `‖R̂ᵀ r̂ + ê‖ / ‖ê‖`.

use crate::law::bipotential;
use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{length, norm, tangential_norm};
use crate::reduced::reduced::Reduced;
use crate::reduced::tuning;

/// A point with a larger rounding floor has not converged.
pub const WORST_FLOOR: f64 = 1e-6;

/// Rounding error of each term of a sum, relative to the term.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Largest remainder of the free displacement of closed contacts, or the tolerance if that is
/// larger. Two reactions that cancel each other, as between walls that overlap, can grow until
/// η, which is relative to them, is small for any remainder.
///
/// The motion of a rigid body cancels `q` to rounding, which is all that is left then: the free
/// displacement `q + R a` counts as at least this share of `q`, so that a remainder of 1e-12 of `q` is
/// none. Rounding is below that if the terms of `R a` are not a thousand times `q`.
const WORST_LEFT: f64 = 1e-6;

/// Largest penetration, or opening under pressure, in tolerances. For a moderate μ, η within
/// the tolerance implies it.
const DEEPEST: f64 = 10.0;

/// The certificate of a point `(r, a)`, evaluated afresh.
#[derive(Clone, Debug)]
pub struct Certificate<const D: usize> {
    /// `v = W r + R a + q`.
    pub v: Vec<[f64; D]>,
    /// Status of `proj(r̂ − ṽ̂)` at each contact.
    pub status: Vec<Status>,
    /// η.
    pub residual: f64,
    /// Rounding error of η, at most `WORST_FLOOR`.
    pub floor: f64,
    /// Whether the rounding of `v` is small enough for η to have a meaning.
    pub sound: bool,
    /// `‖F‖` over the displacement that the reactions must cancel, with reactions not larger than it:
    /// of rigid contacts, or beside soft springs, `r̂ − ṽ̂` would lose the digits of `ṽ̂`.
    left: f64,
    /// `‖(v_n − β‖v_t‖)₋‖` over `max(‖r_n‖, ‖(q_n + (R a)_n)₋‖)`, in its own scale, less rounding. A large μ hides it from η, in which
    /// a sliding contact counts only `v_n/√(1 + μ²)`.
    penetration: f64,
    /// `left` of the normals alone, each in its own scale: `min(r_n, v_n − β‖v_t‖)` over what they must
    /// cancel. A large displacement along the surface would hide penetration.
    depth: f64,
    /// `‖min(r_n, v_n − β‖v_t‖)₊‖` over the same, less rounding: a contact that is open and pressed. A large μ hides it from η as it hides penetration.
    apart: f64,
    /// `max(‖r̂‖, ‖F(0)‖)`.
    whole: f64,
}

impl<const D: usize> Certificate<D> {
    /// Evaluates `v` and computes the certificate.
    pub fn new(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> Self {
        Self::of(problem, r, problem.relative_displacement(r, a), a)
    }

    /// Computes the certificate of a point whose `v` was not evaluated with `W`.
    pub fn of(problem: &Reduced<D>, r: &[[f64; D]], v: Vec<[f64; D]>, a: &[f64]) -> Self {
        let mut status = vec![Status::Open; r.len()];
        let law = law_norm(problem, r, &v, f64::INFINITY, |i, s| status[i] = s);
        let whole = size(problem, r, a);
        let residual = relative(problem, r, law, whole);
        let own = own_scales(problem);
        let rounding = Rounding::new(problem, &own, r, &v, a);
        let undone = undone(problem, &own, r, a);
        let left = law_norm(problem, r, &v, undone.all, |_, _| ()) / undone.all;
        let openings = v.iter().zip(&problem.law).map(|(v, law)| law.opening(v));
        let openings: Vec<f64> = openings
            .zip(&own)
            .map(|(opening, s)| opening * s.1)
            .collect();
        let pressed: Vec<f64> = r.iter().zip(&own).map(|(r, s)| r[0] * s.0).collect();
        let below: Vec<f64> = openings.iter().map(|o| (-o).max(0.0)).collect();
        let pairs = || openings.iter().zip(&pressed);
        let both: Vec<f64> = pairs().map(|(o, r)| o.min(*r).max(0.0)).collect();
        let mut normal = undone.normal;
        let beside =
            |most: f64| norm(&pairs().map(|(o, r)| o.min(r.min(most))).collect::<Vec<_>>());
        if beside(normal).max(rounding.pressed) > WORST_LEFT * normal {
            // Reactions along the surface move the normals too.
            let along: Vec<[f64; D]> = r
                .iter()
                .map(|r| std::array::from_fn(|k| if k == 0 { 0.0 } else { r[k] }))
                .collect();
            let mut moved = vec![[0.0; D]; r.len()];
            problem.compliance.product(&along, &mut moved);
            let moved = moved
                .iter()
                .zip(r)
                .zip(&own)
                .filter(|((_, r), _)| r[0] != 0.0);
            normal += norm(&moved.map(|((v, _), s)| v[0] * s.1).collect::<Vec<_>>());
        }
        let mut free = vec![[0.0; D]; r.len()];
        problem.add_rest(a, &mut free);
        let free = free.iter().zip(&own).map(|(v, s)| (-v[0] * s.1).max(0.0));
        let forces = norm(&pressed).max(norm(&free.collect::<Vec<_>>()));
        Self {
            v,
            status,
            residual,
            floor: rounding.floor(rounding.bound, whole).min(WORST_FLOOR),
            sound: rounding.floor(rounding.felt, whole) <= WORST_FLOOR
                && rounding.felt <= WORST_LEFT * undone.all
                && rounding.pressed <= WORST_LEFT * normal,
            left,
            penetration: ratio((norm(&below) - rounding.normal).max(0.0), forces),
            depth: beside(normal) / normal,
            apart: ratio((norm(&both) - rounding.plain).max(0.0), forces),
            whole,
        }
    }

    /// Contacts that are open by more than a converged point may penetrate.
    pub fn opened(&self, problem: &Reduced<D>, tol: f64) -> Vec<bool> {
        let least = DEEPEST * self.tolerance(tol) * self.whole;
        let opened = |(i, v): (usize, &[f64; D])| {
            let opening = problem.law[i].opening(v) * problem.scaling.to_v[i];
            self.status[i] == Status::Open && opening > least
        };
        self.v.iter().enumerate().map(opened).collect()
    }

    /// The tolerance of η if the caller asks for `tol`.
    pub fn tolerance(&self, tol: f64) -> f64 {
        if self.sound { tol.max(self.floor) } else { tol }
    }

    /// Whether this point is a solution.
    pub fn converged(&self, tol: f64) -> bool {
        let tolerance = self.tolerance(tol);
        self.sound
            && self.residual <= tolerance
            && self.left <= WORST_LEFT.max(tol)
            && self.penetration <= DEEPEST * tolerance
            && self.depth <= WORST_LEFT.max(DEEPEST * tol)
            // Compared with `tol`: the floor contains μ times the rounding of slip, which does
            // not explain an open contact.
            && self.apart <= DEEPEST * tol
    }
}

/// η of a point with a known `v`.
pub fn residual<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    a: &[f64],
) -> f64 {
    let law = law_norm(problem, r, v, f64::INFINITY, |_, _| ());
    relative(problem, r, law, size(problem, r, a))
}

/// `‖(F, R̂ᵀ r̂ + ê)‖`, which a line search reduces. The ratio η would favour a rigid motion
/// that grows without bound, because `‖F(0)‖` grows with it.
pub fn merit<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], v: &[[f64; D]]) -> f64 {
    let imbalance = problem.scaling.force_norm(&scaled_imbalance(problem, r));
    law_norm(problem, r, v, f64::INFINITY, |_, _| ()).hypot(imbalance)
}

/// η from `‖F(r)‖` and its reference size.
fn relative<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], law: f64, whole: f64) -> f64 {
    let law = ratio(law, whole);
    if problem.rigid.modes.is_empty() {
        return law;
    }
    let imbalance = problem.scaling.force_norm(&scaled_imbalance(problem, r));
    law.max(ratio(imbalance, force_size(problem, r)))
}

/// `‖F(r)‖`, with each reaction longer than `most` shortened to it; calls `report` with the status of
/// each contact.
pub(super) fn law_norm<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    most: f64,
    mut report: impl FnMut(usize, Status),
) -> f64 {
    let scaling = &problem.scaling;
    let (mut squares, mut largest) = (0.0, 0.0_f64);
    for (i, (r, v)) in r.iter().zip(v).enumerate() {
        let mut r = r.map(|c| c * scaling.to_r[i]);
        let v = v.map(|c| c * scaling.to_v[i]);
        let mut law = problem.scaled_law(i);
        let share = if most.is_finite() {
            most / norm(&r)
        } else {
            1.0
        };
        if share < 1.0 {
            (r, law) = (r.map(|c| c * share), law.scaled(share));
        }
        let (projected, status) = bipotential::law_step(&r, &v, 1.0, law);
        report(i, status);
        for (x, p) in r.iter().zip(&projected) {
            squares += (x - p).powi(2);
            largest = largest.max((x - p).abs());
        }
    }
    length(squares, largest)
}

/// `max(‖r̂‖, ‖F(0)‖)`.
fn size<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> f64 {
    problem.free_size(a).max(problem.scaling.reaction_norm(r))
}

/// `‖ê‖`, or `‖r̂‖` if no load acts on the rigid motions. If the loads are smaller than the
/// rounding of the reactions, the size for which this rounding is tolerated.
fn force_size<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> f64 {
    /// `4 ε ‖r̂‖` is below [`WORST_FLOOR`] times this share of `‖r̂‖`.
    const LEAST: f64 = 1e-9;
    let load = problem.scaling.force_norm(&problem.scaling.load);
    let reactions = problem.scaling.reaction_norm(r);
    if load > 0.0 {
        load.max(LEAST * reactions)
    } else {
        reactions
    }
}

/// `R̂ᵀ r̂ + ê`.
pub fn scaled_imbalance<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<f64> {
    let scaling = &problem.scaling;
    let work = scaling.modes.work(r, &scaling.to_r);
    work.iter().zip(&scaling.load).map(|(w, e)| w + e).collect()
}

/// Length of the free displacement `q̂ + R̂ â` of contacts with a reaction, and [`WORST_LEFT`] of that
/// of `q̂`; infinite if nothing is to be cancelled.
///
/// The rigid motion counts only up to the size that loads can cause. A motion that has grown
/// without bound, and reactions that have grown with it, are not a measure of themselves.
fn undone<const D: usize>(
    problem: &Reduced<D>,
    own: &[(f64, f64)],
    r: &[[f64; D]],
    a: &[f64],
) -> Undone {
    let scaling = &problem.scaling;
    let rows = problem.q.iter().zip(&scaling.to_v);
    let q: Vec<f64> = rows.flat_map(|(q, s)| q.map(|c| c * s)).collect();
    let longest = tuning::longest_motion() * norm(&q).max(scaling.force_norm(&scaling.load));
    let motion = scaling.motion_norm(&scaling.rigid_to_scaled(a));
    let share = if motion > longest {
        longest / motion
    } else {
        1.0
    };
    let shorter: Vec<f64> = a.iter().map(|a| share * a).collect();
    let mut free = vec![[0.0; D]; r.len()];
    problem.add_rest(&shorter, &mut free);
    let size = |components: usize| {
        let of_closed = |v: &[[f64; D]]| -> f64 {
            let closed = (0..r.len()).filter(|&i| r[i].iter().any(|&c| c != 0.0));
            let scale = |i: usize| {
                if components == D {
                    scaling.to_v[i]
                } else {
                    own[i].1
                }
            };
            let scaled = closed.flat_map(|i| v[i][..components].iter().map(move |c| c * scale(i)));
            norm(&scaled.collect::<Vec<_>>())
        };
        let undone = of_closed(&free);
        if undone > 0.0 {
            undone + WORST_LEFT * of_closed(&problem.q)
        } else {
            f64::INFINITY
        }
    };
    Undone {
        all: size(D),
        normal: size(1),
    }
}

/// What reactions must cancel: all components, and normals in their own scale.
struct Undone {
    all: f64,
    normal: f64,
}

/// The scales of `r_n` and `v_n` of each contact for which the normal part of its compliance, and not the
/// mean of all parts, is 1.
fn own_scales<const D: usize>(problem: &Reduced<D>) -> Vec<(f64, f64)> {
    let scaling = &problem.scaling;
    let of = |i: usize| {
        let block = problem.compliance.block(i);
        #[expect(clippy::cast_precision_loss, reason = "D is 2 or 3")]
        let factor = (block.trace() / D as f64 / block[(0, 0)]).sqrt();
        let factor = if factor.is_normal() { factor } else { 1.0 };
        (scaling.to_r[i] / factor, scaling.to_v[i] * factor)
    };
    (0..problem.contacts()).map(of).collect()
}

/// Rounding errors of `F`, in absolute value.
struct Rounding {
    /// `4 ε ‖ |Ŵ||r̂| + |R̂||â| + |q̂| ‖`, as far as it changes `F`; not the rounding of `r̂`.
    felt: f64,
    /// The same of normals in their own scale.
    pressed: f64,
    /// The same, whether they change `F` or not.
    normal: f64,
    /// The same, including the rounding of motions and reactions.
    plain: f64,
    /// The total with friction: if `r ≠ 0`, `ṽ_n` includes μ times the rounding of `v_t`.
    bound: f64,
    /// Rounding of the balance of forces, relative to the forces.
    balance: f64,
}

/// The share of a rigid motion whose rounding is tolerated.
///
/// In a solution, the rigid motion cancels deformation and free displacement and has their
/// size. A larger motion grows without bound; its rounding is no reason for a larger tolerance.
fn needed<const D: usize>(problem: &Reduced<D>, still: &[[f64; D]], a: &[f64]) -> f64 {
    let scaling = &problem.scaling;
    let motion = scaling.motion_norm(&scaling.rigid_to_scaled(a));
    let rows = still.iter().zip(&scaling.to_v);
    let undone: Vec<f64> = rows.flat_map(|(v, s)| v.map(|c| c * s)).collect();
    let longest = tuning::longest_motion() * norm(&undone);
    if motion > longest {
        longest / motion
    } else {
        1.0
    }
}

impl Rounding {
    /// `felt` for the point as it is; all else with at most the rigid motion of a solution.
    fn new<const D: usize>(
        problem: &Reduced<D>,
        own: &[(f64, f64)],
        r: &[[f64; D]],
        v: &[[f64; D]],
        a: &[f64],
    ) -> Self {
        let mut still = vec![[0.0; D]; r.len()];
        problem.compliance.absolute_product(r, &mut still);
        for (value, q) in still.iter_mut().zip(&problem.q) {
            for (c, q) in value.iter_mut().zip(q) {
                *c += q.abs();
            }
        }
        let whole = Self::of(problem, own, r, v, a, still.clone());
        let share = needed(problem, &still, a);
        if share >= 1.0 {
            return whole;
        }
        let shorter: Vec<f64> = a.iter().map(|a| share * a).collect();
        Self {
            felt: whole.felt,
            pressed: whole.pressed,
            ..Self::of(problem, own, r, v, &shorter, still)
        }
    }

    fn of<const D: usize>(
        problem: &Reduced<D>,
        own: &[(f64, f64)],
        r: &[[f64; D]],
        v: &[[f64; D]],
        a: &[f64],
        mut terms: Vec<[f64; D]>,
    ) -> Self {
        for (i, value) in terms.iter_mut().enumerate() {
            for k in 0..D {
                let rigid = problem.rigid.modes.at(i);
                value[k] += rigid.map(|(c, mode)| (mode[k] * a[c]).abs()).sum::<f64>();
                value[k] *= ROUNDING * problem.scaling.to_v[i];
            }
        }
        for (value, law) in terms.iter_mut().zip(&problem.law) {
            if law.dilatancy > 0.0 {
                value[0] += law.dilatancy * tangential_norm(value); // v_n − β‖v_t‖ is compared
            }
        }
        let own = |i: usize| own[i].1 / problem.scaling.to_v[i];
        let normal: Vec<f64> = terms
            .iter()
            .enumerate()
            .map(|(i, value)| value[0] * own(i))
            .collect();
        let mut pressed = normal.clone();
        // Rigid motions have an error of ε times their length. The normal part of a motion
        // along a wall is such an error; times a motion without bound it would look like
        // pressure.
        for (i, value) in terms.iter_mut().enumerate() {
            let rigid = problem.rigid.modes.at(i);
            let blur = rigid.map(|(c, mode)| norm(mode) * a[c].abs()).sum::<f64>();
            let blur = ROUNDING * problem.scaling.to_v[i] * blur;
            for c in value {
                *c = c.max(blur);
            }
        }
        let mut felt = terms.clone();
        for (i, value) in felt.iter_mut().enumerate() {
            let r = r[i].map(|c| c * problem.scaling.to_r[i]);
            let v = v[i].map(|c| c * problem.scaling.to_v[i]);
            let share = feeling(&r, &v, &problem.scaled_law(i), value[0]);
            pressed[i] *= share[0];
            for (c, share) in value.iter_mut().zip(share) {
                *c *= share;
            }
        }
        let plain = |(i, value): (usize, &[f64; D])| {
            let reaction = ROUNDING * (r[i][0] * problem.scaling.to_r[i]).abs() / own(i);
            (value[0] * own(i)).max(reaction)
        };
        let plain: Vec<f64> = terms.iter().enumerate().map(plain).collect();
        // τ = r̂ − ṽ̂ rounds r̂ too. If W_ii is near its mean, this is already included. A
        // contact of rigid bodies has W_ii = 0, and its reactions may grow until ṽ̂ is below
        // their rounding.
        for (i, value) in terms.iter_mut().enumerate() {
            for (c, r) in value.iter_mut().zip(&r[i]) {
                *c = c.max(ROUNDING * (r * problem.scaling.to_r[i]).abs());
            }
        }
        for (i, value) in terms.iter_mut().enumerate() {
            if r[i].iter().any(|&c| c != 0.0) {
                value[0] += problem.law[i].mu * tangential_norm(value);
            }
        }
        let mut balance = 0.0;
        if !problem.rigid.modes.is_empty() {
            let load = problem.scaling.force_norm(&problem.scaling.load);
            let forces = problem.scaling.reaction_norm(r) + load;
            balance = ROUNDING * ratio(forces, force_size(problem, r));
        }
        Self {
            felt: norm(felt.as_flattened()),
            pressed: norm(&pressed),
            normal: norm(&normal),
            plain: norm(&plain),
            bound: norm(terms.as_flattened()),
            balance,
        }
    }

    /// The error of η for an absolute error; `whole` is the denominator of η.
    fn floor(&self, absolute: f64, whole: f64) -> f64 {
        // η is exactly zero if its reference size is zero.
        let law = if whole > 0.0 { absolute / whole } else { 0.0 };
        law.max(self.balance)
    }
}

/// Upper bounds for the change of `F` of a contact with the components of `v̂`: zero if the
/// contact is open by more than `rounding`; small for tangential components if the contact
/// slides far under a small pressure, because they only turn a small force.
fn feeling<const D: usize>(
    r: &[f64; D],
    v: &[f64; D],
    law: &ContactLaw,
    rounding: f64,
) -> [f64; D] {
    if r.iter().all(|&c| c == 0.0) && law.cohesion == 0.0 && law.opening(v) > rounding {
        return [0.0; D];
    }
    let (projected, status) = bipotential::law_step(r, v, 1.0, *law);
    let mut share = [1.0; D];
    if status == Status::Open && law.cohesion > 0.0 && law.opening(v) > rounding {
        share[0] = 0.0;
    }
    if status == Status::Slip || law.cohesion > 0.0 {
        let tau: [f64; D] = std::array::from_fn(|k| r[k] - v[k]);
        let turned = tangential_norm(&projected) / tangential_norm(&tau).max(f64::MIN_POSITIVE);
        share[1..].fill(turned.min(1.0));
    }
    share
}

/// A ratio that is zero for a zero numerator, and never NaN.
fn ratio(part: f64, whole: f64) -> f64 {
    if part == 0.0 {
        0.0
    } else if whole > 0.0 && part.is_finite() && whole.is_finite() {
        part / whole
    } else {
        f64::INFINITY
    }
}
