//! The tangential problem of one contact in space, (18): sticking, and the scalar equation of
//! the sliding reaction.
//!
//! After elimination of `v_n = 0`, `v_t = W̃ r_t + q̃`, and `r_t(λ) = −(W̃ + λI)⁻¹ q̃` is the
//! reaction of a contact that slips by `−λ r_t`. Multiplication by the determinant gives
//! polynomials of λ,
//!
//! ```text
//! u = adj(W̃ + λI) q̃,   r_t = −u/det,   W_nn r_n = P/det,   P = −q_n det + W_nt u,
//! ```
//!
//! so that an evaluation at one λ costs a square root and one or two divisions.

use crate::linalg::small::{Block, tangential_norm};

/// A determinant above this share of the squared trace is computed from the entries: it loses
/// about one digit. Below, the symmetric part is first transformed to its axes, where all terms
/// have one sign.
const WELL_CONDITIONED: f64 = 1.0 / 32.0;

/// Smaller squares have lost digits.
const TINY: f64 = 1e-280;

/// Limit of evaluations. Newton's method takes two to six; halving the exponents of a bracket
/// as wide as the range of doubles takes 70.
const TRIES: u32 = 160;

/// The last step is below this share of the distance over which `r_t(λ)` changes.
const SHORT: f64 = 1e-8;

/// After this many evaluations every second one halves the bracket.
const TRUSTED: u32 = 10;

/// `r_t(λ)` for all λ, in axes `(x, y)` and `(−y, x)` of any length: products of two components
/// have the factor `z = 1/(x² + y²)`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sliding {
    w_nn: f64,
    /// `−q_n`.
    pressed: f64,
    /// `W̃`.
    m: [[f64; 2]; 2],
    /// `q̃` and `W_nt`.
    q: [f64; 2],
    w: [f64; 2],
    axis: [f64; 2],
    z: f64,
    /// Whether `W̃` has rank one or zero up to rounding.
    singular: bool,
    /// `W̃ + λI` is positive for larger λ.
    least: f64,
    /// Size of the terms of `q̃`.
    magnitude: f64,
}

/// `Sliding` at one λ.
struct At {
    d: [f64; 2],
    u: [f64; 2],
    det: f64,
    /// `W_nt u`.
    coupled: f64,
    /// `P = W_nn r_n det`.
    p: f64,
    /// `‖u‖²`.
    squares: f64,
}

/// The axes of the symmetric part of a matrix, of any length, and the matrix in these axes: a
/// diagonal, and the skew part, which no rotation changes.
struct Axes {
    axis: [f64; 2],
    /// One over the squared length of the axes.
    z: f64,
    /// The larger first.
    diagonal: [f64; 2],
    skew: f64,
    /// The smaller eigenvalue was below rounding and is set to zero.
    singular: bool,
}

impl Axes {
    /// `terms` are the sizes of the terms of the diagonal of `m`.
    fn new([[a, b], [c, d]]: [[f64; 2]; 2], terms: [f64; 2]) -> Self {
        let size = terms[0] + terms[1];
        let (symmetric, mut skew) = (0.5 * (b + c), 0.5 * (b - c));
        // The two entries differ by rounding.
        if skew.abs() <= 4.0 * f64::EPSILON * size {
            skew = 0.0;
        }
        let (mean, half) = (0.5 * (a + d), 0.5 * (a - d));
        let spread = (half * half + symmetric * symmetric).sqrt();
        let reach = half.abs() + spread;
        // Far below rounding any axes are accurate enough, and squares might underflow.
        let axis = if spread <= f64::EPSILON * f64::EPSILON * size {
            [1.0, 0.0]
        } else if half >= 0.0 {
            [reach, symmetric]
        } else {
            [symmetric, reach]
        };
        let large = mean + spread;
        let mut small = if large > 0.0 {
            (a * d - symmetric * symmetric) / large // of a graded block more digits
        } else {
            mean - spread
        };
        let [x, y] = axis;
        let z = 1.0 / (x * x + y * y);
        // Zero along a prescribed tangent, whose row is zero.
        let rounding = 4.0 * f64::EPSILON * (terms[0] * y * y + terms[1] * x * x) * z;
        let singular = small >= -16.0 * rounding && small <= rounding;
        if singular {
            small = rounding;
        }
        Self {
            axis,
            z,
            singular,
            diagonal: [large, small],
            skew,
        }
    }
}

impl Sliding {
    /// For `W_nn > 0` and `D = 3`.
    #[inline]
    pub(super) fn new<const D: usize>(block: &Block<D>, free: &[f64; D]) -> Self {
        let w_nn = block[(0, 0)];
        let ratio = [block[(1, 0)] / w_nn, block[(2, 0)] / w_nn];
        let w = [block[(0, 1)], block[(0, 2)]];
        let reduced = |i: usize, j: usize| block[(i + 1, j + 1)] - ratio[i] * w[j];
        let m = [
            [reduced(0, 0), reduced(0, 1)],
            [reduced(1, 0), reduced(1, 1)],
        ];
        let q = [free[1] - ratio[0] * free[0], free[2] - ratio[1] * free[0]];
        let term = |i: usize| free[i + 1].abs() + (ratio[i] * free[0]).abs();
        let mut this = Self {
            w_nn,
            pressed: -free[0],
            m,
            q,
            w,
            axis: [1.0, 0.0],
            z: 1.0,
            singular: false,
            least: 0.0,
            magnitude: term(0).max(term(1)),
        };
        let trace = m[0][0] + m[1][1];
        let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        if !(trace > 0.0 && det >= WELL_CONDITIONED * trace * trace) {
            let term = |i: usize| block[(i + 1, i + 1)].abs() + (ratio[i] * w[i]).abs();
            let axes = Axes::new(m, [term(0), term(1)]);
            let [x, y] = axes.axis;
            let turned = |[a, b]: [f64; 2]| [x * a + y * b, x * b - y * a];
            let [large, small] = axes.diagonal;
            this.m = [[large, axes.skew], [-axes.skew, small]];
            (this.q, this.w) = (turned(q), turned(w));
            this.axis = axes.axis;
            this.z = axes.z;
            this.singular = axes.singular;
            this.least = (-small).max(0.0);
        }
        this
    }

    #[inline]
    fn product(&self, a: [f64; 2], b: [f64; 2]) -> f64 {
        (a[0] * b[0] + a[1] * b[1]) * self.z
    }

    #[inline]
    fn at(&self, lambda: f64) -> At {
        let [[a, b], [c, d]] = self.m;
        let d = [a + lambda, d + lambda];
        let u = [
            d[1] * self.q[0] - b * self.q[1],
            d[0] * self.q[1] - c * self.q[0],
        ];
        let det = d[0] * d[1] - b * c;
        let coupled = self.product(self.w, u);
        At {
            d,
            u,
            det,
            coupled,
            p: self.pressed * det + coupled,
            squares: self.product(u, u),
        }
    }

    /// The sticking reaction, `v = 0`, if it lies in the cone of `mu`.
    ///
    /// A singular block, with a tangential component that is prescribed or redundant, sticks
    /// with the shortest `r_t` if `q̃` is in its range.
    #[inline]
    pub(super) fn stick(&self, mu: f64) -> Option<[f64; 3]> {
        if let Some(r) = self.singular.then(|| self.shortest(mu)).flatten() {
            return Some(r);
        }
        let at = self.at(0.0);
        // The same comparison as the sign of the scalar equation at λ = 0: a reaction that is
        // refused here by rounding gives a root there.
        if !(at.det > 0.0 && at.p > 0.0 && mu * at.p >= self.w_nn * at.squares.sqrt()) {
            return None;
        }
        let mut r = self.tangential(&at);
        r[0] = at.p / (at.det * self.w_nn);
        // ‖u‖² may underflow while u does not.
        (at.squares > TINY || tangential_norm(&r) <= mu * r[0]).then_some(r)
    }

    /// The case of `W̃` of rank one or zero, with its diagonal form inverted where possible.
    /// `None` if `q̃` is not in its range, or the reaction is outside the cone.
    fn shortest(&self, mu: f64) -> Option<[f64; 3]> {
        let rounding = 64.0 * f64::EPSILON * self.magnitude;
        let lost = self.q.map(|c| c * c * self.z);
        let [large, small] = [self.m[0][0], self.m[1][1]];
        let moves = large > small; // else both are rounding
        if !(lost[1] <= rounding * rounding && (moves || lost[0] <= rounding * rounding)) {
            return None;
        }
        let along = if moves { self.q[0] / large } else { 0.0 };
        let r_n = (self.pressed + self.w[0] * along * self.z) / self.w_nn;
        let r = self.out_of_axes([along, 0.0], -self.z, r_n);
        (r_n > 0.0 && tangential_norm(&r) <= mu * r_n).then_some(r)
    }

    /// The sliding reaction for `q_n < 0`, if the sticking reaction is outside the cone. It
    /// lies on the cone up to rounding; `None` if no λ gives one.
    ///
    /// It finds the root of `h = μ r_n/‖r_t‖ − 1`, which is linear in λ for an isotropic `W̃`
    /// and concave for an uncoupled one: Newton's method from the left end, kept inside a
    /// bracket. At the left end `h < 0`, because the sticking reaction is outside the cone. At
    /// the right end `h > 0`, because the bound on `‖r_t‖` gives `‖r_t‖ (W_nn + μ‖W_nt‖) < μ
    /// |q_n|`.
    #[inline]
    pub(super) fn slip(&self, mu: f64) -> Option<[f64; 3]> {
        let (mut low, mut high) = (self.least, f64::INFINITY);
        let mut lambda = low;
        let mut last_step = 0.0;
        for tries in 0..TRIES {
            let at = self.at(lambda);
            let length = at.squares.sqrt();
            // h ‖u‖, with the sign of h.
            let value = mu * at.p - self.w_nn * length;
            // Rounding of its terms: a smaller v_n has no meaning.
            let terms = mu * (self.pressed * at.det + at.coupled.abs()) + self.w_nn * length;
            if value.abs() <= 2.0 * f64::EPSILON * terms && length > 0.0 {
                return self.on_cone(&at, mu);
            }
            if value > 0.0 {
                if tries == 0 {
                    return None;
                }
                high = lambda;
            } else {
                low = lambda;
            }
            // (ln ‖u‖)' and P'; h' ‖u‖ = μ (P' − P (ln ‖u‖)').
            let growth = self.product(at.u, self.q) / at.squares;
            let p_slope = self.pressed * (at.d[0] + at.d[1]) + self.product(self.w, self.q);
            let newton = value / (mu * (at.p * growth - p_slope));
            // The shortest distance over which r_t(λ) changes.
            let reach = at.d[0].min(at.d[1]);
            if newton.abs() <= f64::EPSILON * reach || high - low <= f64::EPSILON * reach {
                return self.on_cone(&at, mu);
            }
            let next = lambda + newton;
            if !(next > low && next < high) || (tries > TRUSTED && tries % 2 == 0) {
                high = high.min(self.bound(mu));
                lambda = self.between(low, high);
                last_step = 0.0;
                continue;
            }
            lambda = next;
            // The remaining error of Newton's method: from the last two steps once both are
            // short, or from the last one if it is below the square root of ε.
            let (step, reach) = (newton.abs(), reach + newton);
            let local = 8.0 * last_step <= reach;
            if step <= SHORT * reach
                || local && step * step * step <= f64::EPSILON * reach * last_step * last_step
            {
                break;
            }
            last_step = step;
        }
        self.on_cone(&self.at(lambda), mu)
    }

    /// Beyond this λ, `h > 0`: the bound on `‖r_t‖` is `‖q̃‖/(λ − least)`.
    fn bound(&self, mu: f64) -> f64 {
        let (q, w) = (self.product(self.q, self.q), self.product(self.w, self.w));
        let bound = q.sqrt() * (self.w_nn / mu + w.sqrt()) / self.pressed;
        // Rounding must not exclude the root.
        self.least + 2.0 * bound
    }

    /// The mean of the exponents, because the root may be many orders below the bound.
    fn between(&self, low: f64, high: f64) -> f64 {
        let shift = self.m[1][1].min(self.m[0][0]);
        let middle = ((low + shift) * (high + shift)).sqrt() - shift;
        if middle > low && middle < high {
            middle
        } else {
            low + (high - low) / 1024.0
        }
    }

    /// The reaction with the slip of `at`, with its normal part from the cone.
    ///
    /// From `v_n = 0` it would be a difference that cancels for a large μ.
    #[inline]
    fn on_cone(&self, at: &At, mu: f64) -> Option<[f64; 3]> {
        let mut r = self.tangential(at);
        r[0] = tangential_norm(&r) / mu;
        if at.det.is_finite() {
            return (r[0] > 0.0 && r.iter().all(|c| c.is_finite())).then_some(r);
        }
        // λ near the end of the range of doubles, for a tiny μ: r_t has the direction of −q̃.
        let length = self.product(self.q, self.q).sqrt();
        let against = -self.product(self.w, self.q) / length;
        let r_n = self.pressed / (self.w_nn + mu * against);
        let r = self.out_of_axes(self.q, -mu * r_n * self.z / length, r_n);
        (r_n > 0.0 && r.iter().all(|c| c.is_finite())).then_some(r)
    }

    /// `r_t = −u/det`.
    #[inline]
    fn tangential(&self, at: &At) -> [f64; 3] {
        self.out_of_axes(at.u, -self.z / at.det, 0.0)
    }

    #[inline]
    fn out_of_axes(&self, [a, b]: [f64; 2], factor: f64, normal: f64) -> [f64; 3] {
        let [x, y] = self.axis;
        [normal, (x * a - y * b) * factor, (y * a + x * b) * factor]
    }
}
