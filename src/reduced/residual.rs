//! The certificate that decides whether a point is a solution, (11) and (13). All solvers share
//! it.
//!
//! `F(r) = r̂ − proj(r̂ − ṽ̂, C)`, with `C = K_μ` without cohesion, in scaled variables, where ρ = 1, and
//! `η = ‖F(r)‖ / max(‖r̂‖, ‖F(0)‖)`, zero if both are zero. If only contact holds a body, η is
//! the larger of this and `‖R̂ᵀ r̂ + ê‖ / ‖ê‖`.
//!
//! A small η alone is not a solution. With `tol` of the caller, and `t` the larger of it and `floor`:
//!
//! | field | limit | the failure that it prevents |
//! |---|---|---|
//! | `residual`, η | t | a point that is no solution |
//! | `sound` | yes | a rigid motion without bound, whose rounding hides any η, or what is left |
//! | `left` | tol or 1e-6 | two reactions that cancel, as between walls that overlap, and grow until η, which is relative to them, is small |
//! | `left_of_normals` | 10 tol or 1e-6 | the same beside a large displacement along the surface, which hides penetration |
//! | `penetration` | 10 t | penetration with a large μ: in η a sliding contact counts only `v_n/√(1 + μ²)` |
//! | `apart` | 10 tol | a contact that is open and pressed, which a large μ hides in the same way |
//!
//! Normals are measured in scales of their own (`Normals`).

use std::borrow::Cow;

use crate::law::bipotential;
use crate::law::cone::Status;
use crate::linalg::small::{length, norm, norm_of, plus_scaled};
use crate::reduced::reduced::Reduced;
use crate::reduced::rounding::Rounding;
use crate::reduced::tuning;

/// A point with a larger rounding floor has not converged.
pub const WORST_FLOOR: f64 = 1e-6;

/// Largest part of the free displacement of closed contacts that may be left, or the tolerance if
/// that is larger.
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
    /// Whether the rounding of `v` is small enough for η, and for what is left, to have a meaning.
    pub sound: bool,
    /// `‖F‖` over the displacement that the reactions must cancel.
    left: f64,
    /// `‖min(r_n, v_n − β‖v_t‖)‖` over the normal displacement that the reactions must cancel.
    left_of_normals: f64,
    /// `‖(v_n − β‖v_t‖)₋‖` over `max(‖r_n‖, ‖(q_n + (R a)_n)₋‖)`, less rounding.
    penetration: f64,
    /// `‖min(r_n, v_n − β‖v_t‖)₊‖` over the same, less rounding.
    apart: f64,
    /// `max(‖r̂‖, ‖F(0)‖)`.
    whole: f64,
}

/// What is left of a displacement that reactions must cancel, and its rounding, as shares of it.
struct Left {
    share: f64,
    rounding: f64,
}

impl Left {
    /// `left` takes the displacement: reactions count up to its size, because of rigid contacts, or
    /// beside soft springs, `r̂ − ṽ̂` would lose the digits of `ṽ̂`.
    fn of(displacement: f64, left: impl Fn(f64) -> f64, rounding: f64) -> Self {
        Self {
            share: left(displacement) / displacement,
            rounding: rounding / displacement,
        }
    }
}

impl<const D: usize> Certificate<D> {
    /// Evaluates `v` and computes the certificate.
    pub fn new(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> Self {
        Self::of(problem, r, problem.relative_displacement(r, a), a)
    }

    /// Computes the certificate of a point whose `v` was not evaluated with `W`.
    pub fn of(problem: &Reduced<D>, r: &[[f64; D]], v: Vec<[f64; D]>, a: &[f64]) -> Self {
        let mut status = vec![Status::Open; r.len()];
        let law = shortened_law_norm(problem, r, &v, f64::INFINITY, |i, s| status[i] = s);
        let whole = size(problem, r, a);
        let normals = Normals::new(problem);
        let rounding = Rounding::new(problem, &normals, r, &v, a);
        let undone = Undone::new(problem, r, a);
        let left = Left::of(
            undone.size(|v| problem.scaling.displacement_norm(v)),
            |most| shortened_law_norm(problem, r, &v, most, |_, _| ()),
            rounding.felt,
        );
        let openings = v.iter().zip(&problem.law).map(|(v, law)| law.opening(v));
        let openings: Vec<f64> = normals.scale_displacements(openings).collect();
        let pressures = normals.pressures(r);
        let norm_of_pairs = |of: &dyn Fn(f64, f64) -> f64| {
            norm_of(openings.iter().zip(&pressures).map(|(o, p)| of(*o, *p)))
        };
        let of_normals = |displacement: f64| {
            let left = |most: f64| norm_of_pairs(&|o, p| o.min(p.min(most)));
            Left::of(displacement, left, rounding.pressed)
        };
        let normal_size = undone.size(|v| norm_of(normals.displacements(v)));
        let mut left_of_normals = of_normals(normal_size);
        if left_of_normals.share.max(left_of_normals.rounding) > WORST_LEFT {
            // Reactions along the surface move the normals too.
            left_of_normals = of_normals(normal_size + normals.moved_along(r));
        }
        let mut free = vec![[0.0; D]; r.len()];
        problem.add_rest(a, &mut free);
        let free = normals.displacements(&free);
        let forces = norm(&pressures).max(norm_of(free.map(|v| (-v).max(0.0))));
        let over_forces = |size: f64, rounding: f64| ratio((size - rounding).max(0.0), forces);
        Self {
            status,
            residual: relative(problem, r, law, whole),
            floor: rounding.floor(rounding.bound, whole).min(WORST_FLOOR),
            sound: rounding.floor(rounding.felt, whole) <= WORST_FLOOR
                && left.rounding <= WORST_LEFT
                && left_of_normals.rounding <= WORST_LEFT,
            left: left.share,
            left_of_normals: left_of_normals.share,
            penetration: over_forces(norm_of_pairs(&|o, _| (-o).max(0.0)), rounding.normal),
            apart: over_forces(norm_of_pairs(&|o, p| o.min(p).max(0.0)), rounding.plain),
            whole,
            v,
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

    pub fn converged(&self, tol: f64) -> bool {
        let tolerance = self.tolerance(tol);
        self.sound
            && self.residual <= tolerance
            && self.left <= WORST_LEFT.max(tol)
            && self.left_of_normals <= WORST_LEFT.max(DEEPEST * tol)
            && self.penetration <= DEEPEST * tolerance
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
    let law = law_norm(problem, r, v);
    relative(problem, r, law, size(problem, r, a))
}

/// `‖(F, R̂ᵀ r̂ + ê)‖`, which a line search reduces. The ratio η would favour a rigid motion
/// that grows without bound, because `‖F(0)‖` grows with it.
pub fn merit<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], v: &[[f64; D]]) -> f64 {
    let law = law_norm(problem, r, v);
    if problem.rigid.modes.is_empty() {
        return law;
    }
    law.hypot(imbalance_norm(problem, r))
}

/// η from `‖F(r)‖` and its reference size.
fn relative<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], law: f64, whole: f64) -> f64 {
    let law = ratio(law, whole);
    if problem.rigid.modes.is_empty() {
        return law;
    }
    let imbalance = imbalance_norm(problem, r);
    law.max(ratio(imbalance, force_size(problem, r)))
}

/// `‖F(r)‖`.
pub(super) fn law_norm<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> f64 {
    shortened_law_norm(problem, r, v, f64::INFINITY, |_, _| ())
}

/// `‖F(r)‖` with each reaction longer than `most` shortened to it; calls `report` with the status
/// of each contact.
fn shortened_law_norm<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    most: f64,
    mut report: impl FnMut(usize, Status),
) -> f64 {
    let (mut squares, mut largest) = (0.0, 0.0_f64);
    for (i, (r, v)) in r.iter().zip(v).enumerate() {
        let (mut r, v) = problem.scaling.scale(i, r, v);
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
pub(super) fn force_size<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> f64 {
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
    plus_scaled(&scaling.modes.work(r, &scaling.to_r), 1.0, &scaling.load)
}

/// `‖R̂ᵀ r̂ + ê‖`.
pub fn imbalance_norm<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> f64 {
    problem.scaling.force_norm(&scaled_imbalance(problem, r))
}

/// The free displacements of contacts with a reaction, which the reactions must cancel.
struct Undone<const D: usize> {
    /// `q + R a`. The rigid motion counts only up to the size that loads can cause: one that has
    /// grown without bound, and reactions that have grown with it, are not a measure of themselves.
    free: Vec<[f64; D]>,
    q: Vec<[f64; D]>,
}

impl<const D: usize> Undone<D> {
    fn new(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> Self {
        let scaling = &problem.scaling;
        let loads = scaling.force_norm(&scaling.load);
        let size = scaling.displacement_norm(&problem.q).max(loads);
        let mut free = vec![[0.0; D]; r.len()];
        problem.add_rest(&shorten(problem, a, size), &mut free);
        let mut q = problem.q.clone();
        for i in (0..r.len()).filter(|&i| r[i].iter().all(|&c| c == 0.0)) {
            (free[i], q[i]) = ([0.0; D], [0.0; D]);
        }
        Self { free, q }
    }

    /// Their length, and [`WORST_LEFT`] of that of `q`; infinite if nothing is to be cancelled.
    fn size(&self, length: impl Fn(&[[f64; D]]) -> f64) -> f64 {
        let undone = length(&self.free);
        if undone > 0.0 {
            undone + WORST_LEFT * length(&self.q)
        } else {
            f64::INFINITY
        }
    }
}

/// A rigid motion, shortened to ten thousand times a displacement. In a solution it cancels deformation
/// and free displacement and has their size; a longer one grows without bound.
pub(super) fn shorten<'a, const D: usize>(
    problem: &Reduced<D>,
    a: &'a [f64],
    displacement: f64,
) -> Cow<'a, [f64]> {
    let motion = (problem.scaling).motion_norm(&problem.scaling.rigid_to_scaled(a));
    let longest = tuning::longest_motion() * displacement;
    if motion > longest {
        a.iter().map(|a| longest / motion * a).collect()
    } else {
        Cow::Borrowed(a)
    }
}

/// Normals in the scales for which the normal part of the compliance of a contact, and not the mean
/// of all parts, is 1.
pub(super) struct Normals<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    to_r: Vec<f64>,
    to_v: Vec<f64>,
}

impl<'p, const D: usize> Normals<'p, D> {
    fn new(problem: &'p Reduced<'p, D>) -> Self {
        let scaling = &problem.scaling;
        let scales = |i: usize| {
            let block = problem.compliance.block(i);
            #[expect(clippy::cast_precision_loss, reason = "D is 2 or 3")]
            let factor = (block.trace() / D as f64 / block[(0, 0)]).sqrt();
            let factor = if factor.is_normal() { factor } else { 1.0 };
            (scaling.to_r[i] / factor, scaling.to_v[i] * factor)
        };
        let (to_r, to_v) = (0..problem.contacts()).map(scales).unzip();
        Self {
            problem,
            to_r,
            to_v,
        }
    }

    /// The scale of a normal displacement over that of all components of the contact.
    pub(super) fn factor(&self, contact: usize) -> f64 {
        self.to_v[contact] / self.problem.scaling.to_v[contact]
    }

    fn pressures(&self, r: &[[f64; D]]) -> Vec<f64> {
        r.iter().zip(&self.to_r).map(|(r, s)| r[0] * s).collect()
    }

    fn displacements(&self, v: &[[f64; D]]) -> impl Iterator<Item = f64> + Clone {
        self.scale_displacements(v.iter().map(|v| v[0]))
    }

    fn scale_displacements(
        &self,
        normal: impl Iterator<Item = f64> + Clone,
    ) -> impl Iterator<Item = f64> + Clone {
        normal.zip(&self.to_v).map(|(v, s)| v * s)
    }

    /// By how much tangential reactions displace pressed contacts.
    fn moved_along(&self, r: &[[f64; D]]) -> f64 {
        let mut along = r.to_vec();
        for r in &mut along {
            r[0] = 0.0;
        }
        let mut moved = vec![[0.0; D]; r.len()];
        self.problem.compliance.product(&along, &mut moved);
        let pressed = moved.iter().zip(r);
        let pressed = pressed.map(|(v, r)| if r[0] == 0.0 { 0.0 } else { v[0] });
        norm_of(self.scale_displacements(pressed))
    }
}

/// A ratio that is zero for a zero numerator, and never NaN.
pub(super) fn ratio(part: f64, whole: f64) -> f64 {
    if part == 0.0 {
        0.0
    } else if whole > 0.0 && part.is_finite() && whole.is_finite() {
        part / whole
    } else {
        f64::INFINITY
    }
}
