//! De Saxcé's correction, the bipotential and its gap, (9) and (10).

use crate::law::cone::{Status, project_with_height};
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{dot, minus_scaled, tangential_norm};

/// `ṽ = v + (μ − β)‖v_t‖ n` (9): the correction that makes the rule of slip a normality
/// law, `K*_μ ∋ ṽ ⊥ r ∈ K_μ` without cohesion.
pub fn corrected<const D: usize>(v: &[f64; D], law: impl Into<ContactLaw>) -> [f64; D] {
    let mut corrected = *v;
    corrected[0] += law.into().correction() * tangential_norm(v);
    corrected
}

/// One step of (11), `proj(r − ρ ṽ, C)`, and its status: the law of a contact, [dSF91, 79].
///
/// The height of `τ = r − ρ ṽ` over the normals of the edge of `C` is `τ_n + μ (‖τ_t‖ − c) =
/// r_n − ρ v_n − μ (ρ‖v_t‖ − ‖r_t − ρ v_t‖) + β ρ‖v_t‖ − μ c`. The difference of norms is
/// computed as a quotient without cancellation: for a large μ, the rounding of `μ‖v_t‖` would
/// otherwise hide `v_n`, and penetration with it.
pub fn law_step<const D: usize>(
    r: &[f64; D],
    v: &[f64; D],
    rho: f64,
    law: impl Into<ContactLaw>,
) -> ([f64; D], Status) {
    let law: ContactLaw = law.into();
    let tau = minus_scaled(r, rho, &corrected(v, law));
    let slip = rho * tangential_norm(v);
    let sum = slip + tangential_norm(&tau);
    let shorter = if sum > 0.0 {
        (1..D).map(|k| r[k] / sum * (2.0 * rho * v[k] - r[k])).sum()
    } else {
        0.0
    };
    let mut height = (r[0] - rho * v[0]) - law.mu * shorter;
    if !law.is_coulomb() {
        height += law.dilatancy * slip - law.mu * law.cohesion;
    }
    project_with_height(&tau, height, &law)
}

/// The gap of the bipotential, `γ = r·ṽ + c‖v_t‖ = r_n (v_n − β‖v_t‖) + (c + μ r_n)‖v_t‖ +
/// r_t·v_t` in units of work (10).
///
/// Non-negative for `v_n ≥ β‖v_t‖` and `r ∈ C`, and zero exactly if the law holds.
pub fn gap<const D: usize>(r: &[f64; D], v: &[f64; D], law: impl Into<ContactLaw>) -> f64 {
    let law: ContactLaw = law.into();
    let gap = dot(r, &corrected(v, law));
    if law.cohesion == 0.0 {
        return gap;
    }
    gap + law.cohesion * tangential_norm(v)
}
