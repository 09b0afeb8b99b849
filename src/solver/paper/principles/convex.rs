//! The convex problems of the variational principles: minimise `½ rᵀW r + (q + s n)ᵀ r` over
//! fixed sets, one for each contact.
//!
//! Newton's method with frozen laws takes a few steps from a near start. If it stalls, steps
//! with momentum follow, which converge if `W` is symmetric and positive semidefinite, and then
//! Newton again.

use crate::law::cone::project;
use crate::law::frozen::Frozen;
use crate::reduced::reduced::Reduced;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::monitor::Monitor;
use crate::solver::newton::newton::{self, Near};
use crate::solver::outcome::Ended;
use crate::solver::paper::uzawa;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// Solves the problem with frozen laws from a point, until its merit is at most `enough`; the
/// last point need not be the minimum if that takes too long. The monitor checks every point with
/// Coulomb's law.
pub fn minimise<const D: usize>(
    problem: &Reduced<D>,
    frozen: Vec<Frozen<D>>,
    from: &EvaluatedPoint<D>,
    enough: f64,
    monitor: &mut Monitor<D>,
) -> Result<EvaluatedPoint<D>, Ended> {
    let near = Near::frozen(frozen);
    let mut point = from.clone();
    let mut enough = enough.max(rounding(problem, from, monitor));
    let mut steps = tuning::principle_burst();
    for round in 0..tuning::principle_rounds() {
        if near.merit(problem, &point) <= enough {
            break;
        }
        let (next, solved) = newton::approach(problem, &near, &point, enough, monitor)?;
        point = next;
        if solved {
            break;
        }
        if round == 0 {
            monitor.measure_floor(&point.r, &point.rigid);
            enough = enough.max(rounding(problem, &point, monitor));
            if near.merit(problem, &point) <= enough {
                break;
            }
        }
        point = uzawa::run_burst(problem, &near.frozen, &point, monitor, steps)?;
        steps *= 2;
    }
    Ok(point)
}

/// Below the last measured rounding of `W r + q` no iteration helps.
pub fn rounding<const D: usize>(
    problem: &Reduced<D>,
    point: &EvaluatedPoint<D>,
    monitor: &Monitor<D>,
) -> f64 {
    let eta = point.residual(problem);
    if eta > 0.0 {
        monitor.floor() * (point.merit(problem) / eta)
    } else {
        0.0
    }
}

/// The accuracy of the next problem of a principle: a share of the error of the point, and no
/// smaller than the tolerance requires.
pub fn enough<const D: usize>(
    problem: &Reduced<D>,
    point: &EvaluatedPoint<D>,
    monitor: &Monitor<D>,
) -> f64 {
    let eta = point.residual(problem);
    point.merit(problem) * tuning::principle_share().max((0.5 * monitor.wish() / eta).min(1.0))
}

/// Makes passes of a principle until the monitor stops it or a pass gives no improvement. A
/// pass leads from one point to the next.
pub fn iterate<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    mut pass: impl FnMut(&EvaluatedPoint<D>, &mut Monitor<D>) -> Result<EvaluatedPoint<D>, Ended>,
) -> Result<(), Ended> {
    let mut point = EvaluatedPoint::begin(problem, start, monitor);
    let _ = point.look(monitor, false)?;
    into_cones(problem, &mut point, monitor);
    let (mut best, mut waited) = (f64::INFINITY, 0);
    while waited < tuning::principle_patience() {
        let before = monitor.iterations();
        point = pass(&point, monitor)?;
        if monitor.iterations() == before {
            // A pass without any step counts too, so that limits hold.
            point = EvaluatedPoint::new(problem, point.r, point.rigid);
            monitor.count(1.0);
            let _ = point.look(monitor, true)?;
        }
        let eta = point.residual(problem);
        waited += 1;
        if eta < tuning::better_share() * best {
            (best, waited) = (eta, 0);
        }
    }
    Ok(())
}

/// Makes passes of one convex problem each, whose laws follow from the point before.
pub fn iterate_frozen<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    frozen: impl Fn(&EvaluatedPoint<D>) -> Vec<Frozen<D>>,
) -> Result<(), Ended> {
    iterate(problem, start, monitor, |point, monitor| {
        let enough = enough(problem, point, monitor);
        minimise(problem, frozen(point), point, enough, monitor)
    })
}

/// A start, or a minimum that is not exact, may lie outside the cones: its pressures would not be
/// valid friction limits, and the bipotential is infinite.
pub fn into_cones<const D: usize>(
    problem: &Reduced<D>,
    point: &mut EvaluatedPoint<D>,
    monitor: &mut Monitor<D>,
) {
    let within = point.r.iter().zip(&problem.law);
    let r: Vec<[f64; D]> = within.map(|(r, law)| project(r, *law).0).collect();
    if r != point.r {
        *point = EvaluatedPoint::new(problem, r, std::mem::take(&mut point.rigid));
        monitor.count(1.0);
    }
}
