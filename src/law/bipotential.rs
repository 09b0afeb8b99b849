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

/// The state of one contact at the start of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartState<const D: usize> {
    /// Reaction `t⁰`.
    pub reaction: [f64; D],
    /// Normal relative displacement with the initial gap, `u_n⁰ + h₀`.
    pub opening: f64,
}

impl<const D: usize> StartState<D> {
    /// The bipotential `b(−Δu, Δt)` of [dSF91, 54]: finite on its effective
    /// domain, `+∞` outside it.
    ///
    /// `b = t_n⁰ Δu_n + t_t⁰·Δu_t + Δt_n (u_n⁰ + h₀) + μ (t_n⁰ + Δt_n) ‖Δu_t‖`, with the
    /// indicators of `Δt ∈ ΔK_μ` and `Δu_n + u_n⁰ + h₀ ≥ 0`. The paper omits the constant
    /// `t_n⁰ (u_n⁰ + h₀)`, which is zero for a start state on the law. It is included here, so
    /// that `b + Δt·Δu` is a sum of two non-negative terms for any start state.
    pub fn bipotential(&self, du: &[f64; D], dt: &[f64; D], law: impl Into<ContactLaw>) -> f64 {
        let gap = self.gap(du, dt, law);
        if gap.is_finite() {
            gap - dot(du, dt)
        } else {
            gap
        }
    }

    /// `b(−Δu, Δt) + Δu·Δt`, the gap of the incremental law: zero if the law holds, positive
    /// otherwise, `+∞` outside the domain of `b`.
    ///
    /// Computed from the totals, `(t_n⁰ + Δt_n)(Δu_n + u_n⁰ + h₀)` and
    /// `(t_t⁰ + Δt_t)·Δu_t + μ (t_n⁰ + Δt_n) ‖Δu_t‖`, where only the friction work cancels.
    pub fn gap(&self, du: &[f64; D], dt: &[f64; D], law: impl Into<ContactLaw>) -> f64 {
        let law: ContactLaw = law.into();
        let total: [f64; D] = std::array::from_fn(|k| self.reaction[k] + dt[k]);
        let mut v = *du;
        v[0] = du[0] + self.opening;
        // The sums above have an error of one ulp of their terms: a point this far outside
        // counts as a point of the boundary.
        let ulp = 2.0 * f64::EPSILON;
        let dilation = law.dilatancy * tangential_norm(du);
        let slack_v = ulp * (du[0].abs() + self.opening.abs() + dilation);
        let slack_r = ulp
            * (1.0 + law.mu)
            * (0..D)
                .map(|k| self.reaction[k].abs() + dt[k].abs())
                .sum::<f64>();
        if law.opening(&v) < -slack_v
            || total[0] < -slack_r
            || tangential_norm(&total) > law.limit(total[0]) + slack_r
        {
            return f64::INFINITY;
        }
        gap(&total, &v, law)
    }
}
