//! The elliptic cone of friction that depends on direction, `K_D = {r : ‖D⁻¹ r_t‖ ≤ r_n}`
//! with `D = diag(μ₁, μ₂)`: its Euclidean projection and its set of increments.
//!
//! Solvers never meet this cone: a change of variables,
//! [`Stretch`](crate::problem::stretch::Stretch), makes it Coulomb's.

use crate::law::cone::{Status, project, shifted, translated};

/// Coefficients of an elliptic cone lie between this and its inverse: their squares,
/// and what they are multiplied by, then stay in the range of doubles.
pub const LEAST: f64 = 1e-75;

/// Euclidean projection onto `K_D`, with the coefficients of both tangents: both
/// positive, within [`LEAST`] and its inverse, or both zero.
///
/// Open where `‖D τ_t‖ ≤ −τ_n`, the polar cone; stick where `‖D⁻¹ τ_t‖ ≤ τ_n`.
/// Otherwise `τ − r = λ (−r_n, D⁻² r_t)` with `λ > 0`, a normal of the cone at `r`:
///
/// ```text
/// r_t = u D,   r_n = φ(λ) = ‖u(λ)‖,   u_i = τ_i / (μ_i + λ/μ_i),   (1 − λ) φ(λ) = τ_n
/// ```
///
/// solved as `F(λ) = 1 − λ − τ_n h(λ) = 0`, `h = 1/φ`. `h` is concave, as in the secular
/// equation of trust regions, and a straight line where one direction dominates. So for
/// `τ_n ≥ 0` `F` is convex and decreasing and Newton's steps from `λ = 0` never pass the
/// root; for `τ_n < 0` it is concave, and neither do those from the zero of its
/// asymptote on the right. They end where rounding lets them advance no further.
/// Whatever `λ` is then, `r` is on the cone.
#[must_use]
pub fn project_elliptic(tau: &[f64; 3], mu: [f64; 2]) -> ([f64; 3], Status) {
    if mu[0].to_bits() == mu[1].to_bits() {
        return project(tau, mu[0]);
    }
    shifted(tau, |tau| onto(tau, mu))
}

/// [`project_elliptic`] onto `K_D − t⁰`.
#[must_use]
pub fn project_elliptic_increment(
    tau: &[f64; 3],
    base: &[f64; 3],
    mu: [f64; 2],
) -> ([f64; 3], Status) {
    translated(tau, base, |total| project_elliptic(total, mu))
}

/// Newton's steps. Of 10⁷ points with coefficients from 1e-75 to 1e75, a half of them
/// near the borders, none took more than 18, most one or two.
const MOST_STEPS: usize = 100;

fn onto(tau: &[f64; 3], mu: [f64; 2]) -> ([f64; 3], Status) {
    let [n, t1, t2] = *tau;
    // ‖D τ_t‖, the height of the polar cone's border below the origin.
    let drag = (mu[0] * t1).hypot(mu[1] * t2);
    if drag <= -n {
        return ([0.0; 3], Status::Open);
    }
    if (t1 / mu[0]).hypot(t2 / mu[1]) <= n {
        return (*tau, Status::Stick);
    }
    let squares = mu.map(|m| m * m);
    let mut lambda = 0.0;
    if n < 0.0 {
        // h lies below its asymptote (λ + m)/‖D τ_t‖, m the mean of μ_i² weighted with
        // (μ_i τ_i)².
        let (a, b) = (mu[0] * t1 / drag, mu[1] * t2 / drag);
        let mean = a * a * squares[0] + b * b * squares[1];
        lambda = (drag - n * mean) / (drag + n);
    }
    let at = |lambda: f64| {
        let u = [t1 / (mu[0] + lambda / mu[0]), t2 / (mu[1] + lambda / mu[1])];
        (u, u[0].hypot(u[1]))
    };
    for _ in 0..MOST_STEPS {
        let (u, phi) = at(lambda);
        // h' = Σ (u_i/φ)²/(μ_i² + λ) / φ
        let slope: f64 = (0..2)
            .map(|i| (u[i] / phi).powi(2) / (squares[i] + lambda))
            .sum();
        let next = lambda + (1.0 - lambda - n / phi) / (1.0 + n / phi * slope);
        // Against its way, or beyond where the sign of τ_n puts the root: rounding, as
        // of a slope that vanishes near the polar cone. Written so that a NaN ends it.
        let advances = if n < 0.0 {
            1.0 <= next && next < lambda
        } else {
            lambda < next && next <= 1.0
        };
        if !advances {
            break;
        }
        lambda = next;
    }
    let (u, phi) = at(lambda);
    ([phi, mu[0] * u[0], mu[1] * u[1]], Status::Slip)
}
