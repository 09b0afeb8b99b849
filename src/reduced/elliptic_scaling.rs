//! Changes variables such that friction with two coefficients becomes Coulomb friction.
//!
//! With coefficients `D = diag(μ₁, μ₂)` along the tangents of a contact, the cone is
//! `‖D⁻¹ r_t‖ ≤ r_n`, and a sliding contact has `r_t = −r_n D² v_t / ‖D v_t‖`. Let
//! `μ = max(μ₁, μ₂)`, `T = 1 ⊕ D/μ`, and
//!
//! ```text
//! r = T r̃,   ṽ = T v:   r·v = r̃·ṽ,   ‖D⁻¹ r_t‖ = ‖r̃_t‖/μ,   ‖D v_t‖ = μ ‖ṽ_t‖
//! ```
//!
//! Then Coulomb's law with `μ` holds between `r̃` and `ṽ`. The problem `v = W r + R a + q`,
//! `Rᵀ r + e = 0` keeps its form with `T W T`, `T R` and `T q`, which belong to the contact
//! matrix `T B` and the gap `T g`. The core solves this problem and computes its certificate.
//! Equal coefficients give exactly `T = I`.

use std::borrow::Cow;

use crate::error::Error;
use crate::law::contact_law::check_friction;
use crate::linalg::small::Block;

/// The tangential part of `T` of each contact in space, in the numbering of the caller.
#[derive(Clone, Debug)]
pub struct EllipticScaling {
    tangents: Vec<[f64; 2]>,
}

/// `μ`, and `T` unless it is the identity at each contact.
pub type Friction = (Vec<f64>, Option<EllipticScaling>);

/// The largest ratio of the two coefficients of a contact. `v_t` is `T⁻¹ ṽ_t`: along the
/// tangent with the smaller coefficient its error is this many times that of `ṽ_t`, and the
/// certificate checks only `ṽ`.
pub const LARGEST_RATIO: f64 = 1e6;

/// Relative rounding of an entry of `T W T`, of `T q` and `T v`, and of `T⁻¹ r`. A component of `T`
/// is a quotient; an entry has two of them, their product and one more. For the `W` that the
/// caller reads, `T⁻¹` has one more rounding each: at most six halves of ε.
pub const ROUNDING: f64 = 4.0 * f64::EPSILON;

impl EllipticScaling {
    pub fn new(mu: &[[f64; 2]]) -> Result<Friction, Error> {
        let mut round = Vec::with_capacity(mu.len());
        let mut tangents = Vec::with_capacity(mu.len());
        for (node, &pair) in mu.iter().enumerate() {
            for mu in pair {
                check_friction(node, mu)?;
            }
            let largest = pair[0].max(pair[1]);
            let t = if largest > 0.0 {
                pair.map(|m| m / largest)
            } else {
                [1.0; 2]
            };
            if t[0].min(t[1]) * LARGEST_RATIO < 1.0 {
                return Err(Error::EllipticFriction {
                    node,
                    mu: pair,
                    ratio: LARGEST_RATIO,
                });
            }
            round.push(largest);
            tangents.push(t);
        }
        let identity = tangents
            .iter()
            .flatten()
            .all(|t| t.to_bits() == 1.0_f64.to_bits());
        Ok((round, (!identity).then_some(Self { tangents })))
    }

    /// `T'' = T' T⁻¹`, which changes variables scaled by `from` to variables scaled by `to`.
    /// `None` is the identity.
    pub fn between(from: Option<&Self>, to: Option<&Self>) -> Option<Self> {
        let contacts = from.or(to)?.tangents.len();
        let of = |elliptic: Option<&Self>, i: usize| elliptic.map_or([1.0; 2], |s| s.tangents[i]);
        let ratio = |i: usize| {
            let (from, to) = (of(from, i), of(to, i));
            [to[0] / from[0], to[1] / from[1]]
        };
        Some(Self {
            tangents: (0..contacts).map(ratio).collect(),
        })
    }

    /// `T⁻¹`.
    pub fn inverse(&self) -> Self {
        let inverse = |t: &[f64; 2]| t.map(|t| 1.0 / t);
        Self {
            tangents: self.tangents.iter().map(inverse).collect(),
        }
    }

    /// Component `k` of `T` at a contact.
    pub fn factor(&self, contact: usize, k: usize) -> f64 {
        if k == 0 {
            1.0
        } else {
            self.tangents[contact][k - 1]
        }
    }

    /// `T_i w T_j`, where `w` is the block `W_ij`. The product of factors comes first, so that
    /// a symmetric matrix stays bitwise symmetric.
    pub fn block<const D: usize>(&self, w: &Block<D>, moved: usize, pushed: usize) -> Block<D> {
        Block::from_fn(|k, l| w[(k, l)] * (self.factor(moved, k) * self.factor(pushed, l)))
    }

    /// `T x`: `r` from `r̃`, `ṽ` from `v`.
    pub fn times<const D: usize>(&self, x: &[[f64; D]]) -> Vec<[f64; D]> {
        let at = |(i, x): (usize, &[f64; D])| std::array::from_fn(|k| x[k] * self.factor(i, k));
        x.iter().enumerate().map(at).collect()
    }

    /// `T⁻¹ x`: `r̃` from `r`, `v` from `ṽ`.
    pub fn over<const D: usize>(&self, x: &[[f64; D]]) -> Vec<[f64; D]> {
        let at = |(i, x): (usize, &[f64; D])| std::array::from_fn(|k| x[k] / self.factor(i, k));
        x.iter().enumerate().map(at).collect()
    }
}

/// [`EllipticScaling::times`], or `x` itself without a scaling.
pub fn times<'a, const D: usize>(
    elliptic: Option<&EllipticScaling>,
    x: &'a [[f64; D]],
) -> Cow<'a, [[f64; D]]> {
    elliptic.map_or(Cow::Borrowed(x), |s| Cow::Owned(s.times(x)))
}

/// [`EllipticScaling::over`], or `x` itself without a scaling.
pub fn over<'a, const D: usize>(
    elliptic: Option<&EllipticScaling>,
    x: &'a [[f64; D]],
) -> Cow<'a, [[f64; D]]> {
    elliptic.map_or(Cow::Borrowed(x), |s| Cow::Owned(s.over(x)))
}

/// [`ROUNDING`], or zero without a scaling.
pub fn rounding(elliptic: Option<&EllipticScaling>) -> f64 {
    elliptic.map_or(0.0, |_| ROUNDING)
}
