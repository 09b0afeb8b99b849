//! The displacement principle [dSF91, 67, 68]: unilateral contact and friction in one
//! convex problem, whose friction limits are those of the pressure found last.
//!
//! Of displacements it is `½ uᵀK u − fᵀu + Σ s ‖v_t‖` to be least over `v_n ≥ 0`, with
//! `s = μ r_n` frozen; its dual, `½ rᵀW r + qᵀr` over `r_n ≥ 0`, `‖r_t‖ ≤ s`, is what is
//! solved, and `r_n` the multiplier of `v_n ≥ 0` that [dSF91, 38b] asks for.

use crate::error::Error;
use crate::law::frozen::Frozen;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::outcome::Outcome;
use crate::solver::principles::convex::iterate_frozen;
use crate::solver::settings::Start;

/// The laws of a pass, friction limits frozen at the pressures of `r`.
#[must_use]
pub fn frozen<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<Frozen<D>> {
    let limit = |(r, mu): (&[f64; D], &f64)| Frozen::Tresca {
        limit: mu * r[0].max(0.0),
    };
    r.iter().zip(&problem.mu).map(limit).collect()
}

/// Runs until the monitor stops it or passes no longer help.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    iterate_frozen(problem, start, monitor, |point| frozen(problem, &point.r))
}
