//! The exact response of one plastic point: the law of a contact in strain space.
//!
//! A point of a soil with the mean stress `σ_m` and the deviator `s` obeys the law of a contact
//! with `r = (a − σ_m, s)` and `v = (p_v, −p_e)`, where `p` is its increment of plastic strain
//! and `a` the mean stress of the apex. It is elastic besides: with springs `ρ` and the stress
//! `τ` that it would have without flow,
//!
//! ```text
//! r = τ + diag(ρ_n, ρ_t, ..) v,   ‖r_t‖ ≤ c + μ r_n,   r_n ≥ 0,   v_n ≥ β‖v_t‖
//! ```
//!
//! Friction is `D = 2`, a point of Mohr and Coulomb in plane strain `D = 3`, one of Drucker and
//! Prager `D = 4` in plane strain and `D = 6` in space. The law with frozen limits, [dSF91, 37],
//! has μ = β and the frozen part of the limit as its cohesion.

use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{Block, Vector, tangential_norm};

/// Friction that grows with slip, as in the proximal iteration: `H (‖v_t‖ − before)` is added
/// to the limit. Zero is the law itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rate {
    /// H, not negative.
    pub hardening: f64,
    /// The slip at which nothing is added.
    pub before: f64,
}

/// The end of a step of one point.
#[derive(Clone, Copy, Debug)]
pub struct Response<const D: usize> {
    /// r, on the law.
    pub stress: [f64; D],
    /// v, on the law: from its closed form, not from `r − τ`, which would lose its digits.
    pub flow: [f64; D],
    /// An element of the generalised derivative of r by τ. It is not symmetric for β < μ.
    pub jacobian: Block<D>,
}

/// The response of a point to the stress `tau` that it would have without flow.
///
/// `stiffness` are `(ρ_n, ρ_t)`, positive. The law is checked before, once for all points; its
/// cohesion may be less than zero only with a [`Rate`].
pub fn respond<const D: usize>(
    tau: &[f64; D],
    stiffness: [f64; 2],
    law: &ContactLaw,
    rate: &Rate,
) -> Response<D> {
    let [normal, tangential] = stiffness;
    let beta = law.dilatancy;
    let size = tangential_norm(tau);
    let limit = law.cohesion - rate.hardening * rate.before;
    let hardness = tangential + rate.hardening;
    let with_dilation = hardness + law.mu * beta * normal;
    let slip = (size - limit - law.mu * tau[0]).max(0.0) / with_dilation;
    // Where dilation alone does not bring r_n back to zero, the point opens further: r_n = 0.
    let opens = tau[0] + normal * beta * slip < 0.0;
    let slips = slip > 0.0 && !opens;
    let mut stress = *tau;
    let mut flow = [0.0; D];
    let mut jacobian = Block::<D>::identity();
    if !opens && !slips {
        return Response {
            stress,
            flow,
            jacobian,
        };
    }
    let slip = if opens {
        (size - limit).max(0.0) / hardness
    } else {
        slip
    };
    // A negative limit may not turn the stress round.
    let slip = slip.min(size / tangential);
    flow[0] = beta * slip;
    stress[0] = tau[0] + normal * flow[0];
    if opens {
        flow[0] = flow[0].max(-tau[0] / normal);
        stress[0] = 0.0;
    }
    // Not from the flow: near the apex the rounding of τ would be large.
    let bound = (limit + rate.hardening * slip + law.mu * stress[0]).max(0.0);
    let share = if size > bound { bound / size } else { 1.0 };
    let mut unit = Vector::<D>::zeros();
    for k in 1..D {
        stress[k] = share * tau[k];
        if size > 0.0 {
            unit[k] = tau[k] / size;
            flow[k] = -slip * unit[k];
        }
    }
    // The derivatives of the slip and of the two lengths r_n and ‖r_t‖ by τ.
    let by_normal = if opens { 0.0 } else { -law.mu };
    let mut of_slip = unit;
    of_slip[0] = by_normal;
    of_slip *= f64::from(u8::from(slip > 0.0)) / if opens { hardness } else { with_dilation };
    let mut of_normal = Vector::<D>::zeros();
    if !opens {
        of_normal = of_slip * (normal * beta);
        of_normal[0] += 1.0;
    }
    for k in 0..D {
        jacobian[(0, k)] = of_normal[k];
    }
    if slip > 0.0 {
        let of_length = of_slip * rate.hardening + of_normal * law.mu;
        for i in 1..D {
            for k in 0..D {
                let across = f64::from(u8::from(i == k)) - unit[i] * unit[k];
                let turned = if k > 0 { share * across } else { 0.0 };
                jacobian[(i, k)] = turned + unit[i] * of_length[k];
            }
        }
    }
    Response {
        stress,
        flow,
        jacobian,
    }
}
