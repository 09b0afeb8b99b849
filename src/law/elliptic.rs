//! The elliptic cone of friction that depends on direction, `K_D = {r : ‖D⁻¹ r_t‖ ≤ r_n}`
//! with `D = diag(μ₁, μ₂)`: its Euclidean projection and its set of increments.
//!
//! Solvers do not use this cone: the change of variables
//! [`EllipticScaling`](crate::reduced::elliptic_scaling::EllipticScaling) makes the law
//! Coulomb's.

use crate::law::cone::{Status, project, shifted, translated};

/// Euclidean projection onto `K_D`. The coefficients of both tangents are positive, within
/// 1e-75 and its inverse, so that products with their squares stay in the range of doubles, or
/// both zero.
///
/// Open where `‖D τ_t‖ ≤ −τ_n`, the polar cone; stick where `‖D⁻¹ τ_t‖ ≤ τ_n`.
/// Otherwise `τ − r = λ (−r_n, D⁻² r_t)` with `λ > 0`, a normal of the cone at `r`:
///
/// ```text
/// r_t = D u,   r_n = ‖u‖,   u_i = τ_i / (μ_i + λ/μ_i),   (1 − λ) r_n = τ_n
/// ```
///
/// With `s = λ` above the plane `τ_n = 0` and `s = 1/λ` below it (the same equations of
/// the polar cone) this is, on `0 < s < 1`,
///
/// ```text
/// 1 − s = |τ_n| / φ(s),   φ(s) = ‖c_i / (1 + s w_i)‖,
/// c = D⁻¹ τ_t, w_i = 1/μ_i²  above,   c = D τ_t, w_i = μ_i²  below.
/// ```
///
/// `1/φ` is concave, as in the secular equation of trust regions, so that the difference of
/// both sides is convex and decreasing. Newton's iteration from `s = 0`, the boundary of the
/// cone or of its polar, does not pass the root except by rounding, where it stops. Near this
/// boundary the first step is accurate to the digits of the distance from it.
pub fn project_elliptic(tau: &[f64; 3], mu: [f64; 2]) -> ([f64; 3], Status) {
    if mu[0].to_bits() == mu[1].to_bits() {
        return project(tau, mu[0]);
    }
    shifted(tau, |tau, _| onto(tau, mu))
}

/// [`project_elliptic`] onto `K_D − t⁰`.
pub fn project_elliptic_increment(
    tau: &[f64; 3],
    base: &[f64; 3],
    mu: [f64; 2],
) -> ([f64; 3], Status) {
    translated(tau, base, |total| project_elliptic(total, mu))
}

/// Limit of Newton's iterations. Of 8·10⁶ points, half of them near the boundaries of the cone
/// and its polar, with all admissible ratios of the coefficients, none needed more than 18; the
/// average is two.
const MOST_STEPS: usize = 40;

fn onto(tau: &[f64; 3], mu: [f64; 2]) -> ([f64; 3], Status) {
    let [n, t1, t2] = *tau;
    let drag = [mu[0] * t1, mu[1] * t2];
    let shear = [t1 / mu[0], t2 / mu[1]];
    if drag[0].hypot(drag[1]) <= -n {
        return ([0.0; 3], Status::Open);
    }
    if shear[0].hypot(shear[1]) <= n {
        return (*tau, Status::Stick);
    }
    let squares = mu.map(|m| m * m);
    let below = n < 0.0;
    let (c, w) = if below {
        (drag, squares)
    } else {
        (shear, squares.map(f64::recip))
    };
    let at = |s: f64| {
        let u = [c[0] / (1.0 + s * w[0]), c[1] / (1.0 + s * w[1])];
        (u, u[0].hypot(u[1]))
    };
    let mut s = 0.0;
    for _ in 0..MOST_STEPS {
        let (u, phi) = at(s);
        let share = n.abs() / phi;
        // (1/φ)' φ = Σ (u_i/φ)² w_i / (1 + s w_i)
        let slope: f64 = (0..2)
            .map(|i| (u[i] / phi).powi(2) * w[i] / (1.0 + s * w[i]))
            .sum();
        let next = s + (1.0 - s - share) / (1.0 + share * slope);
        let advances = next > s;
        if !advances {
            break;
        }
        s = next;
    }
    let (u, phi) = at(s);
    let scale = if below { s } else { 1.0 };
    (
        [scale * phi, scale * (mu[0] * u[0]), scale * (mu[1] * u[1])],
        Status::Slip,
    )
}
