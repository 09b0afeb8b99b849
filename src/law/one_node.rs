//! The exact solution of one contact, with the reactions of all others fixed, (18).
//!
//! Find `r` with `v = W r + q` on the law, `K*_μ ∋ ṽ ⊥ r ∈ K_μ` for Coulomb's, for one block `W` of the compliance. The
//! block need not be symmetric: it is so up to rounding in an elastic problem, but not in a
//! measured one.

use std::ops::RangeInclusive;

use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::law::sliding::Sliding;
use crate::law::slip_multiplier;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::Block;

/// The previous status of a contact, which selects one of several solutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Habit {
    /// Unknown: open is tried first.
    None,
    /// The contact was closed: sticking is tried before opening, so that a load path stays on
    /// its branch. A wedged node then stays wedged while it can.
    Closed,
}

/// Solves the one-node problem (18). For a positive definite block the error is the rounding of
/// the terms of `v = W r + q`.
/// If there are several solutions, open comes before stick unless `habit` says otherwise, and
/// stick before slip; of several slip solutions it returns one. It returns `None` if there is
/// no solution: the normal displacement cannot change (`W_nn ≤ 0`) and penetrates; or the block
/// is singular and the reaction never opposes the slip; or the numbers are outside the range of
/// doubles. The numbers of the law, of `w` and of `q` must be finite.
pub fn solve<const D: usize>(
    w: &Block<D>,
    q: &[f64; D],
    law: impl Into<ContactLaw>,
    habit: Habit,
) -> Option<([f64; D], Status)> {
    let law: ContactLaw = law.into();
    // In the plane and in space Coulomb's law has closed forms.
    if law.is_coulomb() && D <= 3 {
        solve_coulomb(w, q, law.mu, habit)
    } else {
        slip_multiplier::solve(w, q, &law, habit)
    }
}

fn solve_coulomb<const D: usize>(
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
        return r[0].is_finite().then_some((r, Status::Slip));
    }
    if D == 3 {
        let (size, free) = (
            w_nn + w[(1, 1)].abs() + w[(2, 2)].abs(),
            q[0].abs() + q[1].abs() + q[2].abs(),
        );
        if !(MIDDLE.contains(&size) && MIDDLE.contains(&free)) && free > 0.0 {
            let shift = (exponent(size), exponent(free));
            return shifted(w, q, shift, |w, q| solve_coulomb(w, q, mu, habit));
        }
    }
    let opens = || (q[0] >= 0.0).then_some(open);
    let found = if D == 2 {
        let plane = Plane::new(w, q);
        let sticks = plane.stick(mu).map(|r| (r, Status::Stick));
        sticks.or_else(opens).or_else(|| plane.slip(mu))
    } else {
        let space = Sliding::new(w, q);
        let whole = |r: [f64; 3], status| (std::array::from_fn(|k| r[k]), status);
        let slips = || space.slip(mu).map(|r| whole(r, Status::Slip));
        let sticks = space.stick(mu).map(|r| whole(r, Status::Stick));
        sticks.or_else(opens).or_else(slips)
    };
    found.filter(|(r, _)| r.iter().all(|c| c.is_finite()))
}

/// Sizes of `W` and `q` for which products of degree four neither overflow nor underflow, even
/// if their smallest numbers are many orders smaller.
const MIDDLE: RangeInclusive<f64> = 1e-20..=1e20;

/// A solution in other units, `2^of_w` and `2^of_q`, in which the largest numbers are of order one;
/// powers of two are exact.
#[inline(never)]
pub(super) fn shifted<const D: usize>(
    w: &Block<D>,
    q: &[f64; D],
    (of_w, of_q): (i32, i32),
    solve: impl FnOnce(&Block<D>, &[f64; D]) -> Option<([f64; D], Status)>,
) -> Option<([f64; D], Status)> {
    let w = w.map(|c| times_two_to(c, -of_w));
    let q = q.map(|c| times_two_to(c, -of_q));
    let (r, status) = solve(&w, &q)?;
    let r = r.map(|c| times_two_to(c, of_q - of_w));
    r.iter().all(|c| c.is_finite()).then_some((r, status))
}

/// A contact in the plane with the normal equation `v_n = 0` eliminated:
/// `v_t = W̃ r_t + q̃`, `r_n = −(q_n + W_nt r_t)/W_nn`.
struct Plane {
    w_nn: f64,
    w_nt: f64,
    q_n: f64,
    /// `W̃ = W_tt − W_tn W_nt / W_nn`.
    w: f64,
    /// `q̃ = q_t − W_tn q_n / W_nn`.
    q: f64,
    /// Size of the terms of `q̃`.
    magnitude: f64,
}

impl Plane {
    fn new<const D: usize>(w: &Block<D>, q: &[f64; D]) -> Self {
        let w_nn = w[(0, 0)];
        let ratio = w[(1, 0)] / w_nn;
        Self {
            w_nn,
            w_nt: w[(0, 1)],
            q_n: q[0],
            w: w[(1, 1)] - ratio * w[(0, 1)],
            q: q[1] - ratio * q[0],
            magnitude: q[1].abs().max((ratio * q[0]).abs()),
        }
    }

    /// The sticking reaction, `v = 0`, if it lies in the cone of `mu`.
    ///
    /// A tangential component that cannot move sticks without force if its free displacement is
    /// zero.
    fn stick<const D: usize>(&self, mu: f64) -> Option<[f64; D]> {
        let r_t = if self.w > 0.0 {
            -self.q / self.w
        } else if self.q.abs() <= 64.0 * f64::EPSILON * self.magnitude {
            0.0
        } else {
            return None;
        };
        let r_n = -(self.q_n + self.w_nt * r_t) / self.w_nn;
        // If stick and slip both fit, it is stick; r = 0 is open.
        (r_t.abs() <= mu * r_n && r_n > 0.0).then(|| reaction(r_n, r_t))
    }

    /// The sliding reaction for `q_n < 0`, if the sticking reaction is outside the cone:
    /// `r_t = s μ r_n`, with the sign that opposes the free slip.
    fn slip<const D: usize>(&self, mu: f64) -> Option<([f64; D], Status)> {
        let s = -self.q.signum();
        let held = self.w_nn + s * mu * self.w_nt;
        if held > 0.0 {
            let r_n = -self.q_n / held;
            return Some((reaction(r_n, s * mu * r_n), Status::Slip));
        }
        // A sticking reaction outside the cone on this side makes `held` positive, except by
        // rounding.
        let r_t = -self.q / self.w;
        (self.w > 0.0).then(|| (reaction(r_t.abs() / mu, r_t), Status::Stick))
    }
}

fn reaction<const D: usize>(r_n: f64, r_t: f64) -> [f64; D] {
    std::array::from_fn(|k| if k == 0 { r_n } else { r_t })
}
