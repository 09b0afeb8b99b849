//! Semismooth Newton of Alart and Curnier on the closed contacts, (19) and (20).
//!
//! The line search reduces the norm of the residual of the certificate. It is cheap because `v`
//! is affine in `r`.

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::alart_curnier::Linearised;
use crate::law::frozen::Frozen;
use crate::linalg::small::length;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{imbalance_norm, merit, scaled_imbalance};
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::compliance_form::{self, ComplianceForm, Solved, is_free};
use crate::solver::newton::linearisation::{Linearisation, factorisation_cost, inversion_cost};
use crate::solver::newton::search::search;
use crate::solver::newton::stiffness_form::StiffnessForm;
use crate::solver::outcome::Ended;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// Newton alone: from the start until it converges or stalls.
pub fn alone<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    let begin = EvaluatedPoint::begin(problem, start, monitor);
    let _ = begin.look(monitor, false)?;
    let mut next = run(problem, &begin.r, &begin.rigid, monitor)?;
    while let Some(better) = next {
        next = run(problem, &better.r, &better.rigid, monitor)?;
    }
    Ok(())
}

/// Makes Newton steps from `(r, a)` until it converges or stalls: at a better point, or at
/// `None`.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    rigid: &[f64],
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Ended> {
    run_near(problem, &Near::nothing(), r, rigid, 0.0, monitor)
}

/// A nearby problem: with `α (r̂ − ĉ)` added to `v̂`, so that its matrix is regular; if `c` is
/// a solution, it is one of the nearby problem too. Or a problem with frozen laws.
///
/// Newton's method solves it with the map (19) at `r̂ − ρ v̂'`, where `v̂'` is that of the nearby
/// problem. Its solutions do not depend on ρ.
#[derive(Clone, Debug)]
pub struct Near<const D: usize> {
    /// `α`.
    pub shift: f64,
    /// `c`; not used if `α` is zero.
    pub centre: Vec<[f64; D]>,
    /// ρ of the map (19); not used with frozen laws.
    pub rho: f64,
    /// Frozen laws, one for each contact; none for the law itself.
    pub frozen: Vec<Frozen<D>>,
}

impl<const D: usize> Near<D> {
    pub fn nothing() -> Self {
        Self {
            shift: 0.0,
            centre: Vec::new(),
            rho: 1.0,
            frozen: Vec::new(),
        }
    }

    pub fn frozen(frozen: Vec<Frozen<D>>) -> Self {
        Self {
            frozen,
            ..Self::nothing()
        }
    }

    fn is_nothing(&self) -> bool {
        self.shift == 0.0 && self.frozen.is_empty()
    }

    /// The `v` of the nearby problem.
    fn felt<'v>(&self, problem: &Reduced<D>, at: &'v EvaluatedPoint<D>) -> Cow<'v, [[f64; D]]> {
        let EvaluatedPoint { r, v, .. } = at;
        if self.shift == 0.0 {
            return Cow::Borrowed(v);
        }
        let scaling = &problem.scaling;
        let felt = |i: usize| {
            let factor = self.shift * scaling.to_r[i] / scaling.to_v[i];
            std::array::from_fn(|k| v[i][k] + factor * (r[i][k] - self.centre[i][k]))
        };
        Cow::Owned((0..v.len()).map(felt).collect())
    }

    pub fn merit(&self, problem: &Reduced<D>, at: &EvaluatedPoint<D>) -> f64 {
        let EvaluatedPoint { r, v, .. } = at;
        if self.frozen.is_empty() {
            return merit(problem, r, &self.felt(problem, at));
        }
        let scaling = &problem.scaling;
        let (mut squares, mut largest) = (0.0, 0.0_f64);
        for (i, law) in self.frozen.iter().enumerate() {
            let (r, v) = scaling.scale(i, &r[i], &v[i]);
            let law = law.scaled(scaling.to_v[i], scaling.to_r[i]);
            let next = law.step(&r, &v, 1.0);
            for (x, y) in r.iter().zip(&next) {
                squares += (x - y).powi(2);
                largest = largest.max((x - y).abs());
            }
        }
        length(squares, largest).hypot(imbalance_norm(problem, r))
    }

    /// The law of this iteration, linearised at a point.
    fn linearised(&self, problem: &Reduced<D>, at: &EvaluatedPoint<D>) -> Linearisation<D> {
        let felt = self.felt(problem, at);
        if !self.frozen.is_empty() {
            return Linearisation::frozen(problem, &self.frozen, &at.r, &felt);
        }
        let mut law = Linearisation::with_step(problem, &at.r, &felt, self.rho);
        law.shift = self.shift;
        law
    }
}

/// [`run_near`] from a point: the last point, and whether its merit is at most `enough`.
pub fn approach<const D: usize>(
    problem: &Reduced<D>,
    near: &Near<D>,
    from: &EvaluatedPoint<D>,
    enough: f64,
    monitor: &mut Monitor<D>,
) -> Result<(EvaluatedPoint<D>, bool), Ended> {
    let next = match run_near(problem, near, &from.r, &from.rigid, enough, monitor)? {
        Some(better) => EvaluatedPoint::new(problem, better.r, better.rigid),
        None => from.clone(),
    };
    monitor.count(1.0);
    let solved = near.merit(problem, &next) <= enough;
    Ok((next, solved))
}

/// [`run`] on a nearby problem, until its merit is at most `enough`.
pub fn run_near<const D: usize>(
    problem: &Reduced<D>,
    near: &Near<D>,
    r: &[[f64; D]],
    rigid: &[f64],
    enough: f64,
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Ended> {
    let mut at = EvaluatedPoint::new(problem, r.to_vec(), rigid.to_vec());
    monitor.count(1.0);
    // Merits of the last points, and the best point with its merit.
    let mut recent = vec![near.merit(problem, &at)];
    let started = recent[0];
    let solved = |at: &EvaluatedPoint<D>| {
        let (r, rigid) = (at.r.clone(), at.rigid.clone());
        Solved { r, rigid }
    };
    let mut best = (started, None);
    for _ in 0..tuning::newton_steps() {
        if best.0 <= enough && !near.is_nothing() {
            break;
        }
        let law = near.linearised(problem, &at);
        let wish = tuning::newton_forcing() * monitor.wish();
        let forcing = || {
            let share = wish / at.residual(problem);
            share.clamp(tuning::least_forcing(), tuning::most_forcing())
        };
        let imbalance = scaled_imbalance(problem, &at.r);
        let stop = monitor.stop();
        let mut count = |products| monitor.count(products);
        let Some(to) = solve(problem, &law, (&at, &imbalance), &forcing, &mut count, stop)? else {
            break;
        };
        let to = EvaluatedPoint::new(problem, to.r, to.rigid);
        monitor.count(1.0);
        let moved = |share: f64| {
            let next = at.towards(&to, share);
            (near.merit(problem, &next), next)
        };
        let Ok(next) = search(&recent, tuning::newton_halvings(), moved) else {
            break;
        };
        let (share, there) = (next.share, next.merit);
        at = next.point;
        recent.push(there);
        let end = at.look(monitor, true)?;
        if there < best.0 {
            best = (there, Some(solved(&at)));
        }
        if end == NextStep::Refresh {
            at = EvaluatedPoint::new(problem, at.r, at.rigid);
            recent = vec![near.merit(problem, &at)];
        }
        if share < tuning::creeping_share() {
            break; // creeping: sweeps do better
        }
    }
    Ok(best.1)
}

/// The largest [`step_cost`] of all statuses.
pub fn most_step_cost<const D: usize>(problem: &Reduced<D>) -> f64 {
    let unknowns = D * problem.contacts() + problem.scaling.modes.len();
    compliance_form::cost(problem, unknowns)
}

/// Cost of a step of a linearised law in products with `W`, and whether the form in
/// displacements is cheaper.
pub fn step_cost<const D: usize>(problem: &Reduced<D>, law: &Linearisation<D>) -> (f64, bool) {
    let free = |(node, at): &(usize, &Linearised<D>)| is_free(problem, *node, at.status);
    let open = law.at.iter().enumerate().filter(free).count();
    let held: usize = law.at.iter().map(Linearised::held).sum();
    let motions = problem.scaling.modes.len();
    let closed = D * (problem.contacts() - open) + motions;
    let in_reactions = compliance_form::cost(problem, closed);
    // An inverse costs one and a half times an LU of all unknowns. Its share is counted even if
    // it has been made: decisions must not depend on earlier solves.
    let inverse = if problem.compliance.may_have_inverse() {
        inversion_cost(problem) / tuning::inverse_shared_by()
    } else {
        f64::INFINITY
    };
    let free = D * problem.contacts() - held + motions;
    let in_displacements = factorisation_cost(problem, free) + 2.0 + inverse;
    (
        in_reactions.min(in_displacements),
        in_displacements < in_reactions,
    )
}

/// The full step of a linearised law from a point with `imbalance = R̂ᵀ r̂ + ê`, by the
/// cheaper form. `None` if its matrix is singular.
pub fn solve<const D: usize>(
    problem: &Reduced<D>,
    law: &Linearisation<D>,
    (at, imbalance): (&EvaluatedPoint<D>, &[f64]),
    tol: &dyn Fn() -> f64,
    count: &mut dyn FnMut(f64),
    stop: &AtomicBool,
) -> Result<Option<Solved<D>>, Error> {
    if law.shift == 0.0 && law.by_status && step_cost(problem, law).1 {
        if problem.compliance.inverse_known().is_none() {
            count(inversion_cost(problem));
        }
        let form = StiffnessForm::new(problem, law);
        if let Some(solved) = form.solve(at, imbalance, count, stop)? {
            return Ok(Some(solved));
        }
    }
    let from = (at.r.as_slice(), at.rigid.as_slice());
    ComplianceForm::new(problem, law).solve(from, imbalance, tol, count, stop)
}

/// The solution `(r, a)` with some contacts held in every direction and the others open. `None`
/// if it is not unique.
pub fn held_at<const D: usize>(
    problem: &Reduced<D>,
    holds: impl Fn(usize) -> bool,
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Error> {
    let cold = EvaluatedPoint {
        r: vec![[0.0; D]; problem.contacts()],
        v: problem.q.clone(),
        rigid: vec![0.0; problem.rigid.modes.len()],
    };
    let law = Linearisation::held(problem, holds, &cold.r, &cold.v);
    let stop = monitor.stop();
    let mut count = |products| monitor.count(products);
    let (_, in_displacements) = step_cost(problem, &law);
    if !in_displacements
        && problem.rigid.modes.is_empty()
        && problem.compliance.is_symmetric()
        && !problem.compliance.is_sparse()
        && let Some(solved) =
            ComplianceForm::new(problem, &law).solve_definite(&cold.r, &mut count, stop)?
    {
        return Ok(Some(solved));
    }
    let from = (&cold, problem.scaling.load.as_slice());
    let forcing = tuning::most_forcing;
    solve(problem, &law, from, &forcing, &mut count, stop)
}
