//! The minimising sequence of the bifunctional [dSF91, 31–34] of `docs/theory.md`.
//!
//! Displacements in equilibrium with reactions τ have `v = W τ + q`. The minimum of `B` over
//! displacements has Tresca's reactions τ with limits fixed at `c + μ r_n`; the minimum over
//! reactions is that of the stress principle with slip fixed at `v_t(τ)`. Alternately they
//! decrease `B`: to 0 at a solution, or to a positive limit, where neither is a solution.

use crate::law::bipotential::gap;
use crate::law::frozen::Frozen;
use crate::reduced::compliance::Compliance;
use crate::reduced::reduced::Reduced;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::monitor::Monitor;
use crate::solver::outcome::Ended;
use crate::solver::paper::principles::convex::{into_cones, iterate, minimise, rounding};
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
    /// `B` at `(u_0, σ_0), (u_0, σ_1), (u_1, σ_1), …`, in units of work; except for
    /// rounding it is not negative and does not increase [dSF91, 32, 34].
    pub bifunctional: Vec<f64>,
}

impl<const D: usize> Sequence<D> {
    /// With contacts in the numbering of the caller.
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

/// `B` of displacements in equilibrium with `of_u`, and of reactions in their cones, in units of
/// work. `v_n < 0` by the error of the displacements counts as closed: it is no work to be won.
///
/// `W (τ − r)` is the difference of the two `v`, so that no product is needed.
pub fn bifunctional<const D: usize>(
    problem: &Reduced<D>,
    of_u: &EvaluatedPoint<D>,
    of_r: &EvaluatedPoint<D>,
) -> f64 {
    (0..problem.contacts())
        .map(|i| {
            let energy: f64 = (0..D)
                .map(|k| (of_u.r[i][k] - of_r.r[i][k]) * (of_u.v[i][k] - of_r.v[i][k]))
                .sum();
            let mut v = of_u.v[i];
            let law = problem.law[i];
            v[0] -= law.opening(&v).min(0.0);
            0.5 * energy + gap(&of_r.r[i], &v, law)
        })
        .sum()
}

/// `B` and a bound of its rounding: that of `v`, in the last measured floor of η, times the
/// reactions.
fn measure<const D: usize>(
    problem: &Reduced<D>,
    of_u: &EvaluatedPoint<D>,
    of_r: &EvaluatedPoint<D>,
    monitor: &Monitor<D>,
) -> (f64, f64) {
    let scaling = &problem.scaling;
    let forces = scaling.reaction_norm(&of_u.r) + scaling.reaction_norm(&of_r.r);
    let scaled = rounding(problem, of_r, monitor) * forces;
    let units = scaling.to_v.first().zip(scaling.to_r.first());
    let rounding = units.map_or(0.0, |(to_v, to_r)| scaled / to_v / to_r);
    (bifunctional(problem, of_u, of_r), rounding)
}

/// Solves one step, from a field to the minimum of `B` for the other field, with the value there.
///
/// A minimum that is not accurate enough may have a larger `B` than before; then it is computed
/// more accurately. `None` if it still has: the field before is the better one. `measure` gives
/// `B` and its rounding.
fn step<const D: usize>(
    problem: &Reduced<D>,
    (frozen, from): (&[Frozen<D>], &EvaluatedPoint<D>),
    mut enough: f64,
    monitor: &mut Monitor<D>,
    largest: f64,
    measure: impl Fn(&mut EvaluatedPoint<D>, &mut Monitor<D>) -> (f64, f64),
) -> Result<Option<(EvaluatedPoint<D>, f64)>, Ended> {
    let mut from = from.clone();
    for _ in 0..tuning::sequence_refinements() {
        let mut point = minimise(problem, frozen.to_vec(), &from, enough, monitor)?;
        let (value, rounding) = measure(&mut point, monitor);
        if value <= largest + rounding {
            return Ok(Some((point, value)));
        }
        from = point;
        enough *= tuning::sequence_share();
    }
    Ok(None)
}

/// Runs until the monitor stops it or steps give no improvement. The fields of complete steps
/// are added to `sequence`; the monitor may stop in the middle of a step.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    sequence: &mut Sequence<D>,
) -> Result<(), Ended> {
    let mut of_u: Option<EvaluatedPoint<D>> = None;
    iterate(problem, start, monitor, |of_r, monitor| {
        if sequence.reaction.is_empty() {
            sequence.reaction.push(of_r.r.clone());
        }
        monitor.measure_floor(&of_r.r, &of_r.rigid);
        let enough = enough(problem, of_r);
        let limits = displacement_principle::frozen(problem, &of_r.r);
        let from = of_u.as_ref().unwrap_or(of_r);
        let last = sequence.bifunctional.last().map_or(f64::INFINITY, |&b| b);
        let moved = step(
            problem,
            (&limits, from),
            enough,
            monitor,
            last,
            |u, monitor| measure(problem, u, of_r, monitor),
        )?;
        let (moved, value) = moved.unwrap_or_else(|| (from.clone(), last));
        sequence.bifunctional.push(value);
        sequence.balanced.push(moved.r.clone());
        sequence.relative_displacement.push(moved.v.clone());
        let slips = stress_principle::frozen(problem, &moved.v);
        let next = step(
            problem,
            (&slips, of_r),
            enough,
            monitor,
            value,
            |r, monitor| {
                into_cones(problem, r, monitor);
                measure(problem, &moved, r, monitor)
            },
        )?;
        let (next, value) = next.unwrap_or_else(|| (of_r.clone(), value));
        sequence.bifunctional.push(value);
        sequence.reaction.push(next.r.clone());
        of_u = Some(moved);
        Ok(next)
    })
}

/// To second order in the error of the point.
fn enough<const D: usize>(problem: &Reduced<D>, point: &EvaluatedPoint<D>) -> f64 {
    tuning::sequence_share() * point.residual(problem).min(1.0) * point.merit(problem)
}
