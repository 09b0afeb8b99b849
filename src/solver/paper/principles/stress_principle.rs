//! The stress principle [dSF91, 71, 72]: a convex programme over the cones, with the slip of
//! the last reactions.
//!
//! It minimises `½ rᵀW r + (q + (μ − β)‖v_t‖ n)ᵀ r` over `r ∈ C`, `K_μ` without cohesion, with
//! `‖v_t‖` fixed: the associated law, whose dilatancy the fixed slip reduces to β.

use crate::law::contact_law::ContactLaw;
use crate::law::frozen::Frozen;
use crate::linalg::small::tangential_norm;
use crate::reduced::reduced::Reduced;

/// The laws of a pass, with the slip of `v`.
pub fn frozen<const D: usize>(problem: &Reduced<D>, v: &[[f64; D]]) -> Vec<Frozen<D>> {
    let of_slip = |(v, law): (&[f64; D], &ContactLaw)| Frozen::Cone {
        law: *law,
        slip: law.correction() * tangential_norm(v),
    };
    v.iter().zip(&problem.law).map(of_slip).collect()
}
