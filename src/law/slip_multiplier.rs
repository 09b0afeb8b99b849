//! The exact solution of one contact with cohesion or dilatancy, or with more than three
//! components, by the multiplier λ of slip.
//!
//! For `v_t = −λ r_t` with a given `λ ≥ 0`, `r_t = a + b r_n` with
//!
//! ```text
//! a = −(W_tt + λ)⁻¹ q_t,   b = −(W_tt + λ)⁻¹ W_tn,
//! 0 ≤ r_n ⊥ S r_n + s − βλ‖a + b r_n‖ ≥ 0,   S = W_nn + W_nt b,   s = q_n + W_nt a.
//! ```
//!
//! One quadratic equation gives `r_n(λ)`, zero for an open contact. It remains
//! `h(λ) = (c + μ r_n)/‖r_t‖ − 1 = 0`, or `h(0) ≥ 0`, where the contact does not slip. As λ grows,
//! `r_t` tends to zero and `h` to infinity if `c` or the limit of `r_n` is positive: between there
//! is a root. For an isotropic `W_tt` that is not coupled with the normal, `h` is linear.

use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::law::one_node::{Habit, shifted};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{Block, Vector, amax, tangential_norm};

/// Limit of evaluations. Most contacts need fewer than twelve.
const TRIES: usize = 200;

/// The reaction for one λ.
#[derive(Clone, Copy)]
struct AtMultiplier<const D: usize> {
    r: [f64; D],
    /// `c + μ r_n` and `‖r_t‖`.
    limit: f64,
    friction: f64,
}

impl<const D: usize> AtMultiplier<D> {
    /// `h`.
    fn excess(&self) -> f64 {
        if self.friction == 0.0 {
            return f64::INFINITY;
        }
        self.limit / self.friction - 1.0
    }

    fn status(&self, closed: Status) -> Status {
        if self.r[0] > 0.0 {
            closed
        } else {
            Status::Open
        }
    }
}

/// The one-node problem (18) of any law. `None` if no solution is found: the
/// block is singular, or the numbers are outside the range of doubles.
pub(super) fn solve<const D: usize>(
    w: &Block<D>,
    q: &[f64; D],
    law: &ContactLaw,
    habit: Habit,
) -> Option<([f64; D], Status)> {
    let (stiff, free) = (amax(w.as_slice()), amax(q));
    if free == 0.0 {
        return Some(([0.0; D], Status::Open));
    }
    if stiff == 0.0 || !(stiff.is_finite() && free.is_finite()) {
        return None;
    }
    let (of_w, of_q) = (exponent(stiff), exponent(free));
    let law = law.scaled(times_two_to(1.0, of_w - of_q));
    shifted(w, q, (of_w, of_q), |w, q| solve_scaled(w, q, &law, habit))
}

fn solve_scaled<const D: usize>(
    w: &Block<D>,
    q: &[f64; D],
    law: &ContactLaw,
    habit: Habit,
) -> Option<([f64; D], Status)> {
    let opens = law.cohesion == 0.0 && law.opening(q) >= 0.0;
    if opens && (habit == Habit::None || !law.has_friction()) {
        return Some(([0.0; D], Status::Open));
    }
    if !law.has_friction() {
        let mut r = [0.0; D];
        r[0] = -q[0] / w[(0, 0)];
        return (w[(0, 0)] > 0.0).then_some((r, Status::Slip));
    }
    // Without a tangential compliance, sticking needs one: any that is small.
    let at_rest = [0.0, f64::EPSILON * w.amax()]
        .into_iter()
        .find_map(|lambda| Some((lambda, evaluate(w, q, law, lambda)?)));
    let (mut low, start) = at_rest?;
    if start.excess() >= 0.0 && !(opens && start.r[0] == 0.0) {
        return Some((start.r, start.status(Status::Stick)));
    }
    if opens {
        return Some(([0.0; D], Status::Open));
    }
    let mut below = start.excess();
    let mut high = w.amax();
    let mut end = evaluate(w, q, law, high)?;
    while end.excess() < 0.0 {
        (low, below) = (high, end.excess());
        high *= 16.0;
        end = evaluate(w, q, law, high).filter(|_| high < f64::MAX / 16.0)?;
    }
    let mut above = end.excess();
    let mut last_low = None;
    for tries in 0..TRIES {
        if high - low <= f64::EPSILON * high {
            break;
        }
        // The secant; a side that stays twice counts half (Illinois).
        let mut middle = high - above * (high - low) / (above - below);
        if !(middle > low && middle < high) || tries % 8 == 7 {
            middle = if low > 0.0 && high > 4.0 * low {
                (low * high).sqrt()
            } else if high > 4.0 * low {
                high / 1024.0
            } else {
                0.5 * (low + high)
            };
        }
        let next = evaluate(w, q, law, middle)?;
        let excess = next.excess();
        if excess >= 0.0 {
            (high, above, end) = (middle, excess, next);
            if last_low == Some(false) {
                below *= 0.5;
            }
        } else {
            (low, below) = (middle, excess);
            if last_low == Some(true) {
                above *= 0.5;
            }
        }
        last_low = Some(excess < 0.0);
        if excess.abs() <= 2.0 * f64::EPSILON {
            end = next;
            break;
        }
    }
    let mut r = end.r;
    if !(end.friction > 0.0) {
        return None;
    }
    // Exactly at the limit.
    for component in &mut r[1..] {
        *component *= end.limit / end.friction;
    }
    Some((r, end.status(Status::Slip)))
}

/// `None` if there is no reaction with this λ.
fn evaluate<const D: usize>(
    w: &Block<D>,
    q: &[f64; D],
    law: &ContactLaw,
    lambda: f64,
) -> Option<AtMultiplier<D>> {
    let mut tangential = *w + Block::identity() * lambda;
    tangential.fill_row(0, 0.0);
    tangential.fill_column(0, 0.0);
    tangential[(0, 0)] = 1.0;
    let inverse = tangential.try_inverse()?;
    let without_normal = |x: Vector<D>| {
        let mut x = x;
        x[0] = 0.0;
        -(inverse * x)
    };
    let a = without_normal(Vector::from(*q));
    let b = without_normal(w.column(0).into_owned());
    let row = w.row(0).transpose();
    let (of_r, constant) = (w[(0, 0)] + row.dot(&b), q[0] + row.dot(&a));
    let k = law.dilatancy * lambda;
    let lengths = |x: &Vector<D>| tangential_norm(&(*x).into());
    let r_n = if constant - k * lengths(&a) >= 0.0 {
        0.0
    } else if w[(0, 0)] <= 0.0 {
        return None;
    } else if k == 0.0 {
        (of_r > 0.0).then(|| -constant / of_r)?
    } else {
        // (S r_n + s)² = k² ‖a + b r_n‖² with S r_n + s ≥ 0: the larger root.
        let square = of_r * of_r - k * k * b.dot(&b);
        let half = of_r * constant - k * k * a.dot(&b);
        let rest = constant * constant - k * k * a.dot(&a);
        if !(of_r > 0.0 && square > 0.0) {
            return None;
        }
        let root = (half * half - square * rest).max(0.0).sqrt();
        if half <= 0.0 {
            (root - half) / square
        } else {
            -rest / (half + root)
        }
    };
    let mut r: [f64; D] = (a + b * r_n).into();
    r[0] = r_n.max(0.0);
    let at = AtMultiplier {
        r,
        limit: law.limit(r[0]),
        friction: tangential_norm(&r),
    };
    r.iter().all(|c| c.is_finite()).then_some(at)
}
