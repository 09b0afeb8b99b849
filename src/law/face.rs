//! The face of `K_μ`, or of `C` with cohesion, that contains a reaction, and the distance of
//! `V(v)` from its inward normals, the orthogonal face of the dual cone: the terms of an error
//! bound.
//!
//! `V = (p v_n + μ‖v_t‖, v_t)` with any weight `p > 0`; `p = 1` is de Saxcé's ṽ. The law (9) is
//! `K_μ ∋ r ⊥ V ∈ K*_μ` for each `p`, because `V·r` is a sum of terms ≥ 0; with cohesion
//! `V·(s − r) ≥ 0` for all `s ∈ C`. Dilatancy would change μ in `V` and has no bound.
//!
//! Rounded numbers are near a cone, not on it. A face therefore stands for the *exact* point of
//! the cone nearest to the numbers, with its distance. Results come with a bound of their
//! rounding error.

use crate::law::bipotential::law_step;
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{dot, tangential_norm};

/// Relative error of lengths and quotients of two or three components.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A smaller reaction counts as zero: products with it are outside the range of doubles.
/// Variables are scaled to order one.
const NOTHING: f64 = 1e-200;

/// The part of the cone that contains a reaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place<const D: usize> {
    Apex,
    /// On the ray `(1, μ t)`; the unit vector `(0, t)`, rounded.
    Ray([f64; D]),
    /// Inside; for a cone without friction, on its axis.
    Inside,
    /// Without pressure, but with the shear of cohesion: at its limit, with the unit vector of the
    /// shear, or below it.
    Edge(Option<[f64; D]>),
}

/// A point of `K_μ`: its numbers have an error of at most `moved` in each component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face<const D: usize> {
    pub reaction: [f64; D],
    pub place: Place<D>,
    pub moved: f64,
    smooth: bool,
}

impl<const D: usize> Face<D> {
    /// The face of a reaction that lies in the cone up to rounding, such as a projection.
    pub fn of(r: &[f64; D], law: impl Into<ContactLaw>) -> Self {
        let law: ContactLaw = law.into();
        let pressed = r[0] > NOTHING;
        let limit = law.limit(if pressed { r[0] } else { 0.0 });
        let t = tangential_norm(r);
        let inside = t * (1.0 + ROUNDING) <= limit * (1.0 - ROUNDING);
        let mut direction = r.map(|c| c / t);
        direction[0] = 0.0;
        let mut reaction = *r;
        let place = if !pressed {
            reaction[0] = 0.0;
            match (law.cohesion > 0.0, inside) {
                (false, _) => Place::Apex,
                (true, true) => Place::Edge(None),
                (true, false) => Place::Edge(Some(direction)),
            }
        } else if inside || t == 0.0 || !law.has_friction() {
            Place::Inside
        } else {
            Place::Ray(direction)
        };
        if place == Place::Apex || t == 0.0 || !law.has_friction() {
            reaction[1..].fill(0.0);
        }
        let at_limit = matches!(place, Place::Ray(_) | Place::Edge(Some(_)));
        Self {
            reaction,
            place,
            moved: if at_limit {
                (limit - t).abs() + ROUNDING * (limit + t)
            } else {
                0.0
            },
            smooth: !law.has_friction(),
        }
    }

    /// `e = y − V(v)` and its error for any `v` within `dv`, where `y` is the point nearest to
    /// `V` among the points of `K*_μ` orthogonal to the face.
    ///
    /// `y` is the projection of `V` onto a convex set: the dual at the apex, a ray along
    /// `m = (μ, −t)` on a ray, zero inside. So `e` changes by no more than `V`.
    pub fn misfit(&self, v: &[f64; D], dv: &[f64; D], p: f64, mu: f64) -> ([f64; D], [f64; D]) {
        // Without friction K* is v_n ≥ 0, and y has the tangents of V.
        let felt = |v: &[f64; D]| {
            let mut v = *v;
            if self.smooth {
                v[1..].fill(0.0);
            }
            v
        };
        let (v, dv) = (&felt(v), &felt(dv));
        let slip = tangential_norm(v);
        let size = p * v[0].abs() + (1.0 + mu) * slip;
        let spread = (p * dv[0] + (1.0 + mu) * tangential_norm(dv)) * (1.0 + ROUNDING);
        let uncertain = spread + 8.0 * ROUNDING * size;
        match self.place {
            Place::Apex => {
                // V lies in K*_μ if and only if v_n ≥ 0; then e is exactly zero.
                if v[0] > dv[0] {
                    return ([0.0; D], [0.0; D]);
                }
                // y − V is the projection of −V onto K_μ.
                let mut weighted = *v;
                weighted[0] *= p;
                let (e, _) = law_step(&[0.0; D], &weighted, 1.0, mu);
                (e, [uncertain; D])
            }
            Place::Inside => {
                let mut e = v.map(|c| -c);
                let mut error = *dv;
                e[0] = -(p * v[0] + mu * slip);
                error[0] = spread + ROUNDING * size;
                (e, error)
            }
            Place::Ray(direction) => {
                let length = mu.hypot(1.0);
                let mut m = direction.map(|t| -t / length);
                m[0] = mu / length;
                let mut corrected = *v;
                corrected[0] = p * v[0] + mu * slip;
                let along: f64 = m.iter().zip(&corrected).map(|(m, x)| m * x).sum();
                let along = along.max(0.0);
                let e = std::array::from_fn(|k| along * m[k] - corrected[k]);
                (e, [uncertain; D])
            }
            Place::Edge(direction) => {
                let height = p * v[0] + mu * slip;
                let mut e = v.map(|c| -c);
                e[0] = (-height).max(0.0);
                if let Some(t) = direction {
                    // The normals are a (1, 0) + b (μ, −t) with a, b ≥ 0.
                    let against = -dot(&t, v);
                    let along = (mu * height + against).max(0.0) / (1.0 + mu * mu);
                    let turned = if height >= mu * against {
                        against
                    } else {
                        along
                    };
                    let turned = turned.max(0.0);
                    e[0] = (mu * turned - height).max(0.0);
                    for k in 1..D {
                        e[k] -= turned * t[k];
                    }
                }
                (e, [uncertain; D])
            }
        }
    }

    /// The [`Self::misfit`] of a contact that slides in a known direction: its reaction lies on the
    /// ray of this face, so that `V·r = p v_n r_n`.
    pub fn misfit_along(&self, v: f64, dv: f64, p: f64) -> (f64, f64) {
        if self.place == Place::Apex && v > dv {
            return (0.0, 0.0);
        }
        let e = -p * v;
        let error = p * dv * (1.0 + ROUNDING) + ROUNDING * e.abs();
        match self.place {
            Place::Apex => (e.max(0.0), error),
            _ => (e, error),
        }
    }

    /// The [`Self::misfit`] of a contact of which `v = 0` is known: `V = (p v_n, v_t)` and `y = 0`.
    pub fn misfit_held(v: &[f64; D], dv: &[f64; D], p: f64) -> ([f64; D], [f64; D]) {
        let mut e = v.map(|c| -c);
        let mut error = *dv;
        e[0] = -p * v[0];
        error[0] = p * dv[0] * (1.0 + ROUNDING) + ROUNDING * e[0].abs();
        (e, error)
    }
}
