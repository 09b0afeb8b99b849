//! The minimising sequence of the bifunctional [dSF91, 31–34].
//!
//! Displacements in equilibrium with reactions τ have `v = W τ + q`. With reactions `r` that
//! satisfy the law, the bifunctional is
//!
//! ```text
//! B(τ, r) = ½ (τ − r)ᵀ W (τ − r) + Σ γ(v(τ), r)  ≥ 0.
//! ```
//!
//! The minimum of `B` over displacements has Tresca's reactions τ with limits fixed at `μ r_n`.
//! The minimum over reactions is that of the stress principle with slip fixed at `v_t(τ)`.
//! Alternately they decrease `B`: to 0 at a solution, or to a positive limit, where each is the
//! minimum for the other and neither is a solution.

use crate::error::Error;
use crate::law::bipotential::gap;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::outcome::Outcome;
use crate::solver::principles::convex::{Least, PrinciplePoint, iterate, least};
use crate::solver::principles::displacement_principle;
use crate::solver::principles::stress_principle;
use crate::solver::settings::Start;

/// Largest merit of a step relative to the squared error of the whole. `B` is of second order
/// in that error, and a step solved only to first order could increase it.
const SHARE: f64 = 0.01;

/// `B` of displacements in equilibrium with `of_u`, and of reactions, in units of work.
///
/// `W (τ − r)` is the difference of the two `v`, so that no product is needed.
#[must_use]
pub fn bifunctional<const D: usize>(
    problem: &Reduced<D>,
    of_u: &PrinciplePoint<D>,
    of_r: &PrinciplePoint<D>,
) -> f64 {
    (0..problem.contacts())
        .map(|i| {
            let energy: f64 = (0..D)
                .map(|k| (of_u.r[i][k] - of_r.r[i][k]) * (of_u.v[i][k] - of_r.v[i][k]))
                .sum();
            0.5 * energy + gap(&of_r.r[i], &of_u.v[i], problem.mu[i])
        })
        .sum()
}

/// Runs until the monitor stops it or steps give no improvement.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    run_told(problem, start, monitor, &mut |_| ())
}

/// [`run`], calling `tell` with `B` after each step.
///
/// # Errors
/// As [`run`].
pub fn run_told<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    tell: &mut impl FnMut(f64),
) -> Result<Outcome, Error> {
    let mut of_u: Option<PrinciplePoint<D>> = None;
    iterate(problem, start, monitor, |of_r, monitor| {
        monitor.measure_floor(&of_r.r, &of_r.rigid);
        let enough = enough(problem, of_r);
        let limits = displacement_principle::frozen(problem, &of_r.r);
        let from = of_u.as_ref().unwrap_or(of_r);
        let moved = match least(problem, limits, from, enough, monitor)? {
            Least::Stop(outcome) => return Ok(Least::Stop(outcome)),
            Least::At(moved) => moved,
        };
        tell(bifunctional(problem, &moved, of_r));
        let slips = stress_principle::frozen(problem, &moved.v);
        let next = least(problem, slips, of_r, enough, monitor)?;
        if let Least::At(next) = &next {
            tell(bifunctional(problem, &moved, next));
        }
        of_u = Some(moved);
        Ok(next)
    })
}

/// To second order in the error of the point.
fn enough<const D: usize>(problem: &Reduced<D>, point: &PrinciplePoint<D>) -> f64 {
    SHARE * point.residual(problem).min(1.0) * point.merit(problem)
}
