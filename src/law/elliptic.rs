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
/// asymptote on the right, but for rounding, within which they end. Whatever `λ` is then, `r` is on the cone.
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

/// Newton's steps. Of 10⁷ points, a half of them near the borders of the cone and its
/// polar, none took more than 14 with coefficients from 1e-8 to 1e8, or 61 with all that
/// are allowed; two on the average.
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
    // The sign of τ_n tells on which side of 1 the root is.
    let (mut lambda, mut low, mut high) = (0.0, 0.0, 2.0);
    if n < 0.0 {
        // h lies below its asymptote (λ + m)/‖D τ_t‖, m the mean of μ_i² weighted with
        // (μ_i τ_i)².
        let (a, b) = (mu[0] * t1 / drag, mu[1] * t2 / drag);
        let mean = a * a * squares[0] + b * b * squares[1];
        lambda = (drag - n * mean) / (drag + n);
        (low, high) = (0.5, lambda);
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
        let value = 1.0 - lambda - n / phi;
        if value > 0.0 {
            low = lambda;
        } else {
            high = lambda;
        }
        let mut next = lambda + value / (1.0 + n / phi * slope);
        // From afar a step may lose all digits of a root near 1, and pass it.
        if n < 0.0 && low < 1.0 && next <= 1.0 {
            next = high.sqrt();
        }
        // What a long step has lost by rounding the next one makes good; where no
        // number is left between those that have been, all is said.
        let advances = low < next && next < high;
        if !advances {
            break;
        }
        lambda = next;
    }
    let (u, phi) = at(lambda);
    ([phi, mu[0] * u[0], mu[1] * u[1]], Status::Slip)
}
