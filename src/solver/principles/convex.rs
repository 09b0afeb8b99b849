//! The convex problems that variational principles leave: `½ rᵀW r + (q + s n)ᵀ r` is to
//! be least over fixed sets, one a contact.
//!
//! Newton's method on the frozen laws takes a few steps from a near start; where it
//! comes to a stand, steps with momentum go on, which come to an answer whenever `W` is
//! symmetric and positive semidefinite, and Newton is tried again.

use crate::error::Error;
use crate::law::cone::project;
use crate::law::frozen::Frozen;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{merit, residual};
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::newton::{self, Near, NewtonEnd};
use crate::solver::outcome::Outcome;
use crate::solver::settings::Start;
use crate::solver::uzawa::{self, Burst};

/// Steps with momentum after a Newton that stalled, at first; doubled at each next one.
const FIRST_BURST: usize = 20;

/// Times that Newton is tried in one problem.
const ROUNDS: usize = 7;

/// What is left of the merit of the whole when a problem counts as solved.
const SHARE: f64 = 0.1;

/// Passes without a better point after which a principle has stalled: where it does not
/// contract it goes round, or comes to rest where no answer is.
const PATIENCE: usize = 30;

/// A better point by less than this share is none.
const BETTER: f64 = 0.999;

/// A point, and `v` at it.
#[derive(Clone, Debug)]
pub struct PrinciplePoint<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub v: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
}

impl<const D: usize> PrinciplePoint<D> {
    /// `‖(F, R̂ᵀ r̂ + ê)‖` of Coulomb's law.
    #[must_use]
    pub fn merit(&self, problem: &Reduced<D>) -> f64 {
        merit(problem, &self.r, &self.v)
    }

    /// η.
    #[must_use]
    pub fn residual(&self, problem: &Reduced<D>) -> f64 {
        residual(problem, &self.r, &self.v, &self.rigid)
    }

    /// What η is relative to.
    #[must_use]
    pub fn size(&self, problem: &Reduced<D>) -> f64 {
        let eta = self.residual(problem);
        if eta > 0.0 {
            self.merit(problem) / eta
        } else {
            0.0
        }
    }

    /// With `v` afresh.
    #[must_use]
    pub fn new(problem: &Reduced<D>, r: Vec<[f64; D]>, rigid: Vec<f64>) -> Self {
        let v = problem.relative_displacement(&r, &rigid);
        Self { r, v, rigid }
    }
}

/// What a problem came to.
#[derive(Debug)]
pub enum Least<const D: usize> {
    /// The monitor stopped it.
    Stop(Outcome),
    /// The last point; it need not be the least one where that takes too long.
    At(PrinciplePoint<D>),
}

/// Solves the problem of frozen laws from a point, until its own merit is at most
/// `enough`. Every point on the way is shown to the monitor, which judges it by
/// Coulomb's law.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn least<const D: usize>(
    problem: &Reduced<D>,
    frozen: Vec<Frozen<D>>,
    from: &PrinciplePoint<D>,
    enough: f64,
    monitor: &mut Monitor<D>,
) -> Result<Least<D>, Error> {
    let near = Near::frozen(frozen);
    let mut point = from.clone();
    let mut enough = enough.max(rounding(problem, from, monitor));
    let mut steps = FIRST_BURST;
    for round in 0..ROUNDS {
        if near.merit(problem, &point.r, &point.v) <= enough {
            break;
        }
        match newton::run_near(problem, &near, &point.r, &point.rigid, enough, monitor)? {
            NewtonEnd::Stop(outcome) => return Ok(Least::Stop(outcome)),
            NewtonEnd::Better(r, rigid) => point = PrinciplePoint::new(problem, r, rigid),
            NewtonEnd::Stalled => {}
        }
        monitor.count(1.0);
        if near.merit(problem, &point.r, &point.v) <= enough {
            break;
        }
        if round == 0 {
            monitor.measure_floor(&point.r, &point.rigid);
            enough = enough.max(rounding(problem, &point, monitor));
            if near.merit(problem, &point.r, &point.v) <= enough {
                break;
            }
        }
        let r = std::mem::take(&mut point.r);
        match uzawa::burst(problem, &near.frozen, r, &point.rigid, monitor, steps)? {
            Burst::Stop(outcome) => return Ok(Least::Stop(outcome)),
            Burst::End(r, rigid) => point = PrinciplePoint::new(problem, r, rigid),
        }
        monitor.count(1.0);
        steps *= 2;
    }
    Ok(Least::At(point))
}

/// Below the rounding of `W r + q`, as last measured, nothing helps.
fn rounding<const D: usize>(
    problem: &Reduced<D>,
    point: &PrinciplePoint<D>,
    monitor: &Monitor<D>,
) -> f64 {
    monitor.floor() * point.size(problem)
}

/// How well the next problem of a principle at a point is to be solved: to a share of
/// what the point misses, and no better than the wish asks of the whole.
#[must_use]
pub fn enough<const D: usize>(
    problem: &Reduced<D>,
    point: &PrinciplePoint<D>,
    monitor: &Monitor<D>,
) -> f64 {
    let eta = point.residual(problem);
    point.merit(problem) * SHARE.max((0.5 * monitor.wish() / eta).min(1.0))
}

/// Passes of a principle until the monitor stops it or no pass helps. A pass leads
/// from a point to the next.
///
/// # Errors
/// What a pass returns, and [`Error::Interrupted`].
pub fn iterate<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    mut pass: impl FnMut(&PrinciplePoint<D>, &mut Monitor<D>) -> Result<Least<D>, Error>,
) -> Result<Outcome, Error> {
    let mut point = begin(problem, start, monitor);
    if let NextStep::Stop(outcome) = monitor.look(&point.r, &point.v, &point.rigid, false)? {
        return Ok(outcome);
    }
    into_cones(problem, &mut point, monitor);
    let (mut best, mut waited) = (f64::INFINITY, 0);
    while waited < PATIENCE {
        let before = monitor.iterations();
        point = match pass(&point, monitor)? {
            Least::Stop(outcome) => return Ok(outcome),
            Least::At(next) => next,
        };
        if monitor.iterations() == before {
            // There was nothing left to do: it is counted, so that limits hold.
            point = PrinciplePoint::new(problem, point.r, point.rigid);
            monitor.count(1.0);
            let verdict = monitor.look(&point.r, &point.v, &point.rigid, true)?;
            if let NextStep::Stop(outcome) = verdict {
                return Ok(outcome);
            }
        }
        let eta = point.residual(problem);
        waited += 1;
        if eta < BETTER * best {
            (best, waited) = (eta, 0);
        }
    }
    Ok(Outcome::Stalled)
}

/// Passes of one convex problem each, whose laws follow from the point before it.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn iterate_frozen<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    frozen: impl Fn(&PrinciplePoint<D>) -> Vec<Frozen<D>>,
) -> Result<Outcome, Error> {
    iterate(problem, start, monitor, |point, monitor| {
        let enough = enough(problem, point, monitor);
        least(problem, frozen(point), point, enough, monitor)
    })
}

/// The point that a start names.
fn begin<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> PrinciplePoint<D> {
    let mut rigid = vec![0.0; problem.rigid.modes.len()];
    if !start.rigid.is_empty() {
        rigid.copy_from_slice(&start.rigid);
    }
    if start.reaction.is_empty() {
        let r = vec![[0.0; D]; problem.contacts()];
        let mut v = problem.q.clone();
        problem.add_rigid(&rigid, &mut v);
        return PrinciplePoint { r, v, rigid };
    }
    monitor.count(1.0);
    PrinciplePoint::new(problem, start.reaction.clone(), rigid)
}

/// A start may lie outside the cones: its pressures would be no friction limits.
fn into_cones<const D: usize>(
    problem: &Reduced<D>,
    point: &mut PrinciplePoint<D>,
    monitor: &mut Monitor<D>,
) {
    let within = point.r.iter().zip(&problem.mu);
    let r: Vec<[f64; D]> = within.map(|(r, &mu)| project(r, mu).0).collect();
    if r != point.r {
        *point = PrinciplePoint::new(problem, r, std::mem::take(&mut point.rigid));
        monitor.count(1.0);
    }
}
