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

use crate::law::bipotential::gap;
use crate::reduced::compliance::Compliance;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::outcome::Ended;
use crate::solver::paper::principles::convex::{PrinciplePoint, iterate, minimise};
use crate::solver::paper::principles::displacement_principle;
use crate::solver::paper::principles::stress_principle;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// The pairs `(u_i, σ_i)` of the sequence, and `B` along it. A field `u` is given by the
/// reactions τ with which it is in equilibrium, and a field σ by its reactions `r`.
#[derive(Clone, Debug, Default)]
pub struct Sequence<const D: usize> {
    /// `r` of `σ_0, σ_1, …`.
    pub reaction: Vec<Vec<[f64; D]>>,
    /// τ of `u_0, u_1, …`.
    pub balanced: Vec<Vec<[f64; D]>>,
    /// `v` of `u_0, u_1, …`.
    pub relative_displacement: Vec<Vec<[f64; D]>>,
    /// `B` at `(u_0, σ_0), (u_0, σ_1), (u_1, σ_1), …`, in units of work; it does not increase
    /// [dSF91, 32, 34].
    pub bifunctional: Vec<f64>,
}

impl<const D: usize> Sequence<D> {
    /// With contacts in the numbering of the caller.
    #[must_use]
    pub fn scattered(self, compliance: &Compliance<D>) -> Self {
        let each = |fields: Vec<Vec<[f64; D]>>| -> Vec<Vec<[f64; D]>> {
            fields.iter().map(|at| compliance.scatter(at)).collect()
        };
        Self {
            reaction: each(self.reaction),
            balanced: each(self.balanced),
            relative_displacement: each(self.relative_displacement),
            bifunctional: self.bifunctional,
        }
    }
}

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
            0.5 * energy + gap(&of_r.r[i], &of_u.v[i], problem.law[i].mu)
        })
        .sum()
}

/// Runs until the monitor stops it or steps give no improvement. The fields of complete steps
/// are added to `sequence`; the monitor may stop in the middle of a step.
///
/// # Errors
/// [`Ended`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    sequence: &mut Sequence<D>,
) -> Result<(), Ended> {
    let mut of_u: Option<PrinciplePoint<D>> = None;
    iterate(problem, start, monitor, |of_r, monitor| {
        if sequence.reaction.is_empty() {
            sequence.reaction.push(of_r.r.clone());
        }
        monitor.measure_floor(&of_r.r, &of_r.rigid);
        let enough = enough(problem, of_r);
        let limits = displacement_principle::frozen(problem, &of_r.r);
        let from = of_u.as_ref().unwrap_or(of_r);
        let moved = minimise(problem, limits, from, enough, monitor)?;
        let value = bifunctional(problem, &moved, of_r);
        sequence.bifunctional.push(value);
        sequence.balanced.push(moved.r.clone());
        sequence.relative_displacement.push(moved.v.clone());
        let slips = stress_principle::frozen(problem, &moved.v);
        let next = minimise(problem, slips, of_r, enough, monitor)?;
        let value = bifunctional(problem, &moved, &next);
        sequence.bifunctional.push(value);
        sequence.reaction.push(next.r.clone());
        of_u = Some(moved);
        Ok(next)
    })
}

/// To second order in the error of the point.
fn enough<const D: usize>(problem: &Reduced<D>, point: &PrinciplePoint<D>) -> f64 {
    tuning::sequence_share() * point.residual(problem).min(1.0) * point.merit(problem)
}
