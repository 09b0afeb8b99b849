//! The cone `K_μ`, with cohesion the set `C = {r_n ≥ 0, ‖r_t‖ ≤ c + μ r_n}`, and the set of
//! increments `ΔK_μ`: projection, status and generalised Jacobian, (7), (12) and (14) of
//! `docs/theory.md`.

use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{Block, Vector, amax, tangential_norm};

/// The three states of a contact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(i8)]
pub enum Status {
    #[default]
    Open = 0,
    Slip = 1,
    Stick = 2,
}

/// Euclidean projection onto the cone (7) or onto `C`, in closed form (12).
///
/// Components are normal first. The projection is positively homogeneous,
/// `project(s * tau) = s * project(tau)`, so it contains no absolute tolerance. `mu = 0` gives
/// the frictionless half-line, where a pressed node is [`Status::Slip`]: it is free to slide.
/// With cohesion an open node may have a tangential reaction, up to `c`. A friction coefficient
/// alone is Coulomb's law. The numbers of the law are checked before, once for all nodes.
pub fn project<const D: usize>(tau: &[f64; D], law: impl Into<ContactLaw>) -> ([f64; D], Status) {
    let law = law.into();
    shifted(tau, |tau, up| {
        let law = law.scaled(up);
        let height = tau[0] + law.mu * (tangential_norm(tau) - law.cohesion);
        project_with_height(tau, height, &law)
    })
}

/// A projection onto a cone for numbers of any size. Near the ends of the range, squares
/// overflow and quotients lose digits; homogeneity allows a shift by a power of two, which is
/// exact. `project` gets the factor of the shift too.
pub(super) fn shifted<const D: usize>(
    tau: &[f64; D],
    project: impl Fn(&[f64; D], f64) -> ([f64; D], Status),
) -> ([f64; D], Status) {
    let size = amax(tau);
    if size.is_finite() && (size > HUGE || (size < 1.0 / HUGE && size > 0.0)) {
        let exponent = if size > 1.0 { -SHIFT } else { SHIFT };
        let (up, down) = (2.0_f64.powi(exponent), 2.0_f64.powi(-exponent));
        let (r, status) = project(&tau.map(|c| c * up), up);
        return (r.map(|c| c * down), status);
    }
    project(tau, 1.0)
}

/// Beyond `HUGE` and below its inverse, [`shifted`] shifts the exponent by `SHIFT`.
const HUGE: f64 = 1e150;
const SHIFT: i32 = 512;

/// [`project`] with a given height `τ_n + μ (‖τ_t‖ − c)` of `τ` over the normals of the edge
/// `r_n = 0` of `C`, for a caller that knows it with a smaller error than the sum has.
pub(super) fn project_with_height<const D: usize>(
    tau: &[f64; D],
    height: f64,
    law: &ContactLaw,
) -> ([f64; D], Status) {
    let ContactLaw { mu, cohesion, .. } = *law;
    let n = tau[0];
    let t = tangential_norm(tau);
    // Open before stick: with mu = 0, tau = [-1, 0, 0] satisfies both tests, and
    // as "stick" it would return a tensile reaction.
    if height <= 0.0 && (n <= 0.0 || cohesion == 0.0) {
        let mut r = [0.0; D];
        if cohesion > 0.0 {
            let kept = (cohesion / t).min(1.0);
            r = tau.map(|component| kept * component);
            r[0] = 0.0;
        }
        return (r, Status::Open);
    }
    if !law.has_friction() {
        let mut r = [0.0; D];
        r[0] = n;
        return (r, Status::Slip);
    }
    if t <= law.limit(n) {
        return (*tau, Status::Stick);
    }
    // Onto the ray (0, c t/‖t‖) + s (1, μ t/‖t‖)/√(1+μ²): 1 + μ² overflows for a large μ, the
    // ray's components do not. t > 0 here: t = 0 is open or stick.
    let length = mu.hypot(1.0);
    let along = height.max(0.0) / length;
    let scale = (cohesion + along * (mu / length)) / t;
    let mut r = tau.map(|component| scale * component);
    r[0] = along / length;
    (r, Status::Slip)
}

/// Projection of an increment onto `ΔK_μ = K_μ − t⁰` [dSF91, 53]: translate,
/// project, translate back.
///
/// A sticking increment is returned unchanged, bit for bit. An open one is exactly `−t⁰`.
pub fn project_increment<const D: usize>(
    tau: &[f64; D],
    base: &[f64; D],
    law: impl Into<ContactLaw>,
) -> ([f64; D], Status) {
    let law = law.into();
    translated(tau, base, |total| project(total, law))
}

/// Projects onto a cone translated by `−t⁰`, with a projection onto the cone.
pub(super) fn translated<const D: usize>(
    tau: &[f64; D],
    base: &[f64; D],
    project: impl Fn(&[f64; D]) -> ([f64; D], Status),
) -> ([f64; D], Status) {
    let total: [f64; D] = std::array::from_fn(|k| base[k] + tau[k]);
    let (r, status) = project(&total);
    #[expect(clippy::float_cmp, reason = "a sticking point is returned bit for bit")]
    let sticks = r == total;
    let increment = if sticks {
        *tau
    } else {
        std::array::from_fn(|k| r[k] - base[k])
    };
    (increment, status)
}

/// Generalised Jacobian of [`project`] at `tau`, (14): one element of Clarke's
/// set, the limit from inside the status that [`project`] returns.
///
/// Slip, with `t = τ_t/‖τ_t‖` and the unit ray `m = (1, μ t)/√(1+μ²)`:
/// `m mᵀ + (‖r_t‖/‖τ_t‖) (I − t tᵀ)` on the tangential block. Open with cohesion: the latter
/// alone, and `I` on the tangential block within the disc.
pub fn derivative<const D: usize>(tau: &[f64; D], law: impl Into<ContactLaw>) -> Block<D> {
    let law: ContactLaw = law.into();
    let (r, status) = project(tau, law);
    let t = tangential_norm(tau);
    let mut unit = Vector::<D>::from(*tau);
    unit[0] = 0.0;
    if t > 0.0 {
        unit /= t;
    }
    match status {
        Status::Open if law.cohesion == 0.0 => Block::zeros(),
        Status::Open => {
            let mut across = Block::identity();
            if t > law.cohesion {
                across = (across - unit * unit.transpose()) * (law.cohesion / t);
            }
            across[(0, 0)] = 0.0;
            across
        }
        Status::Stick => Block::identity(),
        Status::Slip => {
            let mu = law.mu;
            let length = mu.hypot(1.0);
            let mut ray = unit * (mu / length);
            ray[0] = 1.0 / length;
            let mut jacobian = ray * ray.transpose();
            if t > 0.0 {
                let mut across = Block::identity() - unit * unit.transpose();
                across[(0, 0)] = 0.0;
                jacobian += across * (tangential_norm(&r) / t);
            }
            jacobian
        }
    }
}
