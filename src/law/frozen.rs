//! The law of one contact with some quantities fixed, as in a variational principle: a
//! projection onto a fixed convex set, which is the law of a convex problem.
//!
//! With `v = W r + q` and `W` symmetric positive semidefinite,
//!
//! ```text
//! r = proj(r − ρ (v + s n), C)   at every contact
//! ```
//!
//! are the conditions for a minimum of `½ rᵀW r + (q + s n)ᵀ r` over `r ∈ C`.

use crate::law::alart_curnier::Linearised;
use crate::law::cone::{Status, derivative, project};
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{Block, Vector, minus_scaled, tangential_norm};

/// The set `C` of one contact, and the fixed slip work `s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Frozen<const D: usize> {
    /// Tresca: `r_n ≥ 0` and `‖r_t‖ ≤ limit` for any `r_n` [dSF91, 68].
    Tresca { limit: f64 },
    /// Contact with given tangential reactions `tangential`: `r_n ≥ 0` [dSF91, 69].
    Contact { tangential: [f64; D] },
    /// Friction with a given normal reaction: `‖r_t‖ ≤ limit` [dSF91, 70].
    Friction { normal: f64, limit: f64 },
    /// The set of a law, `K_μ` for Coulomb's, with `s = slip` added to `v_n` [dSF91, 72].
    Cone { law: ContactLaw, slip: f64 },
}

impl<const D: usize> Frozen<D> {
    /// In scaled variables, `r̂ = to_r r`, `v̂ = to_v v`.
    pub fn scaled(mut self, to_v: f64, to_r: f64) -> Self {
        match &mut self {
            Self::Tresca { limit } => *limit *= to_r,
            Self::Contact { tangential } => *tangential = tangential.map(|c| c * to_r),
            Self::Friction { normal, limit } => {
                *normal *= to_r;
                *limit *= to_r;
            }
            Self::Cone { law, slip } => {
                *law = law.scaled(to_r);
                *slip *= to_v;
            }
        }
        self
    }

    /// `proj(r − ρ (v + s n), C)`.
    pub fn step(&self, r: &[f64; D], v: &[f64; D], rho: f64) -> [f64; D] {
        let mut x = minus_scaled(r, rho, v);
        match *self {
            Self::Tresca { limit } => {
                x[0] = x[0].max(0.0);
                onto_disc(&mut x, limit);
            }
            Self::Contact { tangential } => {
                let normal = x[0].max(0.0);
                x = tangential;
                x[0] = normal;
            }
            Self::Friction { normal, limit } => {
                x[0] = normal;
                onto_disc(&mut x, limit);
            }
            Self::Cone { law, slip } => {
                x[0] -= rho * slip;
                return project(&x, law).0;
            }
        }
        x
    }

    /// A map with the same zeros as `r − step(r, v, 1)`, and an element of its generalised
    /// derivative at `(r, v)`. The status is `Open` if the only condition is `r = 0`.
    pub fn linearised(&self, r: &[f64; D], v: &[f64; D]) -> Linearised<D> {
        let x = minus_scaled(r, 1.0, v);
        let mut rows = Linearised::empty();
        match *self {
            Self::Tresca { limit } => {
                normal_row(&mut rows, &x, r, v);
                disc_rows(&mut rows, &x, r, v, limit);
                if rows.by_v == Block::<D>::zeros() && limit == 0.0 {
                    rows.status = Status::Open;
                }
            }
            Self::Contact { tangential } => {
                normal_row(&mut rows, &x, r, v);
                for k in 1..D {
                    rows.by_r[(k, k)] = 1.0;
                    rows.value[k] = r[k] - tangential[k];
                }
            }
            Self::Friction { normal, limit } => {
                rows.by_r[(0, 0)] = 1.0;
                rows.value[0] = r[0] - normal;
                disc_rows(&mut rows, &x, r, v, limit);
            }
            Self::Cone { law, slip } => {
                let mut x = x;
                x[0] -= slip;
                let (projected, status) = project(&x, law);
                if law.cohesion == 0.0 {
                    rows.status = status; // with cohesion there are more conditions
                }
                rows.value = Vector::from(*r) - Vector::from(projected);
                rows.by_v = derivative(&x, law);
                rows.by_r = Block::identity() - rows.by_v;
            }
        }
        rows
    }
}

/// The tangential part projected onto the disc of a radius.
fn onto_disc<const D: usize>(x: &mut [f64; D], radius: f64) {
    let length = tangential_norm(x);
    if length > radius {
        for c in &mut x[1..] {
            *c *= radius / length;
        }
    }
}

/// `0 ≤ v_n ⊥ r_n ≥ 0`.
fn normal_row<const D: usize>(rows: &mut Linearised<D>, x: &[f64; D], r: &[f64; D], v: &[f64; D]) {
    if x[0] > 0.0 {
        rows.by_v[(0, 0)] = 1.0;
        rows.value[0] = v[0];
    } else {
        rows.by_r[(0, 0)] = 1.0;
        rows.value[0] = r[0];
    }
}

/// `r_t` in the disc of a radius, and opposite to `v_t` on its boundary: the tangential rows of
/// (19) with a given radius.
fn disc_rows<const D: usize>(
    rows: &mut Linearised<D>,
    x: &[f64; D],
    r: &[f64; D],
    v: &[f64; D],
    radius: f64,
) {
    let length = tangential_norm(x);
    if radius > 0.0 && length <= radius {
        for (k, c) in v.iter().enumerate().skip(1) {
            rows.by_v[(k, k)] = 1.0;
            rows.value[k] = *c;
        }
        return;
    }
    let turns = if radius > 0.0 { radius / length } else { 0.0 };
    for i in 1..D {
        rows.value[i] = r[i] - turns * x[i];
        for j in 1..D {
            let along = if length > 0.0 {
                x[i] / length * (x[j] / length)
            } else {
                0.0
            };
            let one = f64::from(u8::from(i == j));
            let g = turns * (one - along);
            rows.by_r[(i, j)] = one - g;
            rows.by_v[(i, j)] = g;
        }
    }
}
