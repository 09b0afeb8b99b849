//! The exact solution of one contact against a fixed rest, (18).
//!
//! Find `r` with `v = W r + q`, `K*_μ ∋ ṽ ⊥ r ∈ K_μ`, for one block `W` of the
//! compliance. The block is used as it is given: symmetric to rounding in an
//! elastic problem, anything in a measured one.

use crate::law::cone::Status;
use crate::linalg::small::{Block, tangential_norm};

/// What a contact did before, which decides between solutions where there are several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Habit {
    /// Nothing is known: open first.
    None,
    /// The contact was closed: sticking is tried before opening, so that a load
    /// path stays on its branch (a wedged node stays wedged while it can).
    Closed,
}

/// Solves the one-node problem (18) exactly.
///
/// `None` is returned where there is no answer: the normal displacement cannot
/// move (`W_nn ≤ 0`) and penetrates, or the block is singular and sliding turns
/// the reaction away for ever.
#[must_use]
pub fn solve<const D: usize>(
    w: &Block<D>,
    q: &[f64; D],
    mu: f64,
    habit: Habit,
) -> Option<([f64; D], Status)> {
    let open = ([0.0; D], Status::Open);
    let w_nn = w[(0, 0)];
    if w_nn <= 0.0 {
        return (q[0] >= 0.0).then_some(open);
    }
    if q[0] >= 0.0 && (habit == Habit::None || mu == 0.0) {
        return Some(open);
    }
    if mu == 0.0 {
        let mut r = [0.0; D];
        r[0] = -q[0] / w_nn;
        return Some((r, Status::Slip));
    }
    let reduced = Reduced::new(w, q);
    if let Some(r) = reduced.stick() {
        let t = tangential_norm(&r);
        // A tie of stick and slip is stick; r = 0 is open.
        if t <= mu * r[0] && r[0] > 0.0 {
            return Some((r, Status::Stick));
        }
    }
    if q[0] >= 0.0 {
        return Some(open);
    }
    let r = reduced.slip(mu);
    let sound = r[0] > 0.0 && r.iter().all(|c| c.is_finite());
    sound.then_some((r, Status::Slip))
}

/// The problem with the normal equation `v_n = 0` eliminated:
/// `v_t = W̃ r_t + q̃`, `r_n = −(q_n + W_nt r_t)/W_nn`.
struct Reduced<const D: usize> {
    w_nn: f64,
    q_n: f64,
    /// `W_nt`, in the tangential places.
    w_nt: [f64; D],
    /// `W̃ = W_tt − W_tn W_nt / W_nn`, in the tangential block.
    w: Block<D>,
    /// `q̃ = q_t − W_tn q_n / W_nn`, in the tangential places.
    q: [f64; D],
    /// Size of the terms that `q̃` was formed from.
    magnitude: f64,
}

impl<const D: usize> Reduced<D> {
    fn new(w: &Block<D>, q: &[f64; D]) -> Self {
        let w_nn = w[(0, 0)];
        let ratio: [f64; D] = std::array::from_fn(|i| w[(i, 0)] / w_nn);
        let w_nt = std::array::from_fn(|j| if j == 0 { 0.0 } else { w[(0, j)] });
        let mut reduced = Block::<D>::zeros();
        for i in 1..D {
            for j in 1..D {
                reduced[(i, j)] = w[(i, j)] - ratio[i] * w[(0, j)];
            }
        }
        let shifted = std::array::from_fn(|i| if i == 0 { 0.0 } else { q[i] - ratio[i] * q[0] });
        let terms = (1..D).map(|i| q[i].abs() + (ratio[i] * q[0]).abs());
        Self {
            w_nn,
            q_n: q[0],
            magnitude: terms.fold(0.0, f64::max),
            w_nt,
            w: reduced,
            q: shifted,
        }
    }

    /// `(W̃ + λI)⁻¹ b` on the tangential places, by the explicit inverse of a
    /// matrix of order one or two; `None` where it is singular.
    fn shifted_solve(&self, lambda: f64, b: &[f64; D]) -> Option<[f64; D]> {
        let mut x = [0.0; D];
        if D == 2 {
            let pivot = self.w[(1, 1)] + lambda;
            if pivot <= 0.0 {
                return None;
            }
            x[1] = b[1] / pivot;
        } else {
            let (a, d) = (self.w[(1, 1)] + lambda, self.w[(2, 2)] + lambda);
            let (b12, b21) = (self.w[(1, 2)], self.w[(2, 1)]);
            let determinant = a * d - b12 * b21;
            if determinant <= 4.0 * f64::EPSILON * (a * d).abs() {
                return None;
            }
            x[1] = (d * b[1] - b12 * b[2]) / determinant;
            x[2] = (a * b[2] - b21 * b[1]) / determinant;
        }
        Some(x)
    }

    /// `r` from its tangential part by `v_n = 0`.
    fn with_normal(&self, mut r: [f64; D]) -> [f64; D] {
        let coupled: f64 = (1..D).map(|k| self.w_nt[k] * r[k]).sum();
        r[0] = -(self.q_n + coupled) / self.w_nn;
        r
    }

    /// `v = 0`.
    ///
    /// A singular block (a tangential component that is prescribed, or redundant)
    /// sticks where what it cannot move does not ask to slide, with the shortest `r_t`.
    fn stick(&self) -> Option<[f64; D]> {
        let minus_q = self.q.map(|c| -c);
        let r = self
            .shifted_solve(0.0, &minus_q)
            .or_else(|| self.shortest(&minus_q))?;
        Some(self.with_normal(r))
    }

    /// The shortest solution of `W̃ x = b` for `W̃` of rank one or zero,
    /// `W̃ᵀ b / ‖W̃‖²`; none where `b` is not in its range.
    fn shortest(&self, b: &[f64; D]) -> Option<[f64; D]> {
        let squares: f64 = self.w.iter().map(|c| c * c).sum();
        let mut x = [0.0; D];
        if squares > 0.0 {
            x = std::array::from_fn(|j| {
                (1..D).map(|i| self.w[(i, j)] * b[i]).sum::<f64>() / squares
            });
        }
        let lacks = |i: usize| b[i] - (1..D).map(|j| self.w[(i, j)] * x[j]).sum::<f64>();
        let rounding = 64.0 * f64::EPSILON * self.magnitude;
        (1..D).all(|i| lacks(i).abs() <= rounding).then_some(x)
    }

    /// The sliding reaction, for `q_n < 0` where sticking leaves the cone.
    fn slip(&self, mu: f64) -> [f64; D] {
        if D == 2 {
            // r_t = s μ r_n with the sign that opposes the free slip; the
            // denominator is positive because sticking left the cone on this side.
            let s = -self.q[1].signum();
            let r_n = -self.q_n / (self.w_nn + s * mu * self.w_nt[1]);
            let mut r = [r_n; D];
            r[1] = s * mu * r_n;
            return r;
        }
        let (r, r_n) = self.slip_root(mu);
        let scale = mu * r_n / tangential_norm(&r);
        let mut on_cone = r.map(|c| c * scale);
        on_cone[0] = r_n;
        on_cone
    }

    /// Finds λ > 0 with `‖r_t(λ)‖ = μ r_n(λ)`, `r_t(λ) = −(W̃ + λI)⁻¹ q̃`.
    ///
    /// The root is that of `h = μ r_n/‖r_t‖ − 1`, which is linear in λ for an
    /// isotropic block; Newton on it, kept inside a bracket that halves at
    /// worst. `h < 0` at λ → 0 (sticking leaves the cone), `h > 0` at the upper
    /// end, where `‖r_t‖ (W_nn + μ‖W_nt‖) < μ |q_n|` by the bound on `‖r_t‖`.
    fn slip_root(&self, mu: f64) -> ([f64; D], f64) {
        let minus_q = self.q.map(|c| -c);
        let coupling = tangential_norm(&self.w_nt);
        let spread = self.w.iter().map(|c| c.abs()).sum::<f64>();
        let (mut low, mut high) = (
            0.0,
            tangential_norm(&self.q) * (self.w_nn + mu * coupling) / (mu * -self.q_n) + spread,
        );
        let mut lambda = (0.5 * high).min(spread);
        let mut best = ([0.0; D], 0.0);
        for _ in 0..200 {
            let Some(r) = self.shifted_solve(lambda, &minus_q) else {
                low = lambda;
                lambda = 0.5 * (low + high);
                continue;
            };
            let r = self.with_normal(r);
            let t = tangential_norm(&r);
            best = (r, r[0]);
            let value = mu * r[0] / t - 1.0;
            if value < 0.0 {
                low = lambda;
            } else {
                high = lambda;
            }
            let change = self
                .shifted_solve(lambda, &r.map(|c| -c))
                .unwrap_or([0.0; D]);
            let t_change = (1..D).map(|k| r[k] * change[k]).sum::<f64>() / t;
            let n_change = -(1..D).map(|k| self.w_nt[k] * change[k]).sum::<f64>() / self.w_nn;
            let slope = mu * (n_change - r[0] * t_change / t) / t;
            let newton = lambda - value / slope;
            let next = if newton > low && newton < high {
                newton
            } else {
                0.5 * (low + high)
            };
            // Below this change of λ neither r_t nor r_n moves by more than rounding.
            let still = (next - lambda).abs() <= f64::EPSILON * (lambda + spread);
            if still || value.abs() <= 2.0 * f64::EPSILON {
                break;
            }
            lambda = next;
        }
        best
    }
}
