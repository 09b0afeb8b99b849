//! Calls the chosen method, and completes its result.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::cone::project;
use crate::linalg::small::add_scaled;
use crate::reduced::existence::is_contradiction;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::residual;
use crate::solver::at_rest;
use crate::solver::auto;
use crate::solver::fallback::{may_hide_openings, try_statuses};
use crate::solver::gauss_seidel;
use crate::solver::monitor::{Monitor, Progress};
use crate::solver::newton::newton;
use crate::solver::outcome::{Ended, Outcome, outcome_of};
use crate::solver::paper::multipliers::{self, LAGRANGIAN, RETURN};
use crate::solver::paper::pivoting;
use crate::solver::paper::principles::alternating_principles;
use crate::solver::paper::principles::convex::iterate_frozen;
use crate::solver::paper::principles::displacement_principle;
use crate::solver::paper::principles::minimising_sequence::{self, Sequence};
use crate::solver::paper::principles::stress_principle;
use crate::solver::paper::uzawa::{self, Variant};
use crate::solver::settings::{Method, Settings, Start};
use crate::solver::solution::{Solution, finish};
use crate::solver::tuning;

/// Solves the reduced problem.
///
/// A solver that does not converge gives no error: the best point is returned.
pub fn solve<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    start: &Start<D>,
    stop: &AtomicBool,
) -> Result<Solution<D>, Error> {
    solve_watched(problem, settings, start, stop, &Progress::default())
}

/// [`solve`] with its progress readable by another thread.
pub fn solve_watched<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    start: &Start<D>,
    stop: &AtomicBool,
    progress: &Progress,
) -> Result<Solution<D>, Error> {
    settings.validate()?;
    if !problem.rigid.modes.is_empty() && !settings.method.balances() {
        return Err(Error::NotHeld {
            method: settings.method.name(),
        });
    }
    let laws = problem.compliance.scatter(&problem.law);
    settings.method.require_law(&laws)?;
    let mut monitor = Monitor::new(problem, settings, stop, progress);
    if problem.contradiction.is_some() {
        return Ok(finish(problem, settings, monitor, Outcome::NoEquilibrium));
    }
    let auto = settings.method == Method::Auto;
    let resting = auto.then(|| at_rest::find_rest(problem)).flatten();
    if let Some(motion) = resting.as_ref().filter(|a| a.iter().any(|&a| a != 0.0)) {
        // The rounding of q would be as large as all displacements.
        let still = problem.without_offset()?;
        let mut start = start.clone();
        add_scaled(&mut start.rigid, -1.0, motion);
        let mut solution = solve_watched(&still, settings, &start, stop, progress)?;
        add_scaled(&mut solution.rigid_motion, 1.0, motion);
        return Ok(solution);
    }
    let mut sequence = Sequence::default();
    let ended = run_from(
        problem,
        settings,
        (start, &resting),
        &mut monitor,
        &mut sequence,
    );
    let mut outcome = outcome_of(ended)?;
    let is_open = |outcome| !matches!(outcome, Outcome::Converged | Outcome::NoEquilibrium);
    let unasked = auto && resting.is_none() && !monitor.balanced;
    if unasked
        && is_open(outcome)
        && !problem.rigid.modes.is_empty()
        && let Err(ended) = at_rest::ask(problem, &mut monitor, seconds_of_statics(settings))
    {
        outcome = outcome_of(Err(ended))?;
    }
    let furthest = monitor.furthest_rigid().to_vec();
    // Then reactions exist. With a compliance a balance is necessary only.
    let held = monitor.balanced && problem.moves_rigidly();
    let mut solution = finish(problem, settings, monitor, outcome);
    if settings.method == Method::MinimisingSequence {
        solution.sequence = Some(sequence.scattered(problem.compliance));
    }
    if resting.is_some() && solution.iterations == 0 {
        return Ok(solution); // nothing moves
    }
    // A point that converged only within the rounding floor may have reactions that grew
    // between walls until their rounding hides the overlap.
    let doubted = match solution.outcome {
        Outcome::Converged => solution.residual > settings.tol,
        outcome => matches!(outcome, Outcome::Stalled | Outcome::IterationLimit),
    };
    let pressures: Vec<f64> = solution.reaction.iter().map(|r| r[0]).collect();
    if doubted && is_contradiction(problem, &problem.compliance.gather(&pressures)) {
        solution.outcome = Outcome::NoEquilibrium;
    }
    let quick = problem.contacts() <= tuning::quick_contacts();
    let tries = match solution.outcome {
        Outcome::Converged => quick && may_hide_openings(problem, settings.tol),
        Outcome::Stalled => auto && (quick || settings.max_seconds.is_infinite()),
        _ => false,
    };
    if tries {
        try_statuses(problem, settings, &mut solution, stop)?;
    }
    if is_open(solution.outcome) && !furthest.is_empty() && !held {
        let r = problem.compliance.gather(&solution.reaction);
        solution.free_motion = at_rest::runaway(problem, &r, &furthest).unwrap_or_default();
    }
    Ok(solution)
}

/// The time of statics, whatever limit a method has reached.
fn seconds_of_statics(settings: &Settings) -> f64 {
    settings.max_seconds.max(2.0)
}

/// Finds a start, and calls the method.
fn run_from<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    (start, resting): (&Start<D>, &Option<Vec<f64>>),
    monitor: &mut Monitor<D>,
    sequence: &mut Sequence<D>,
) -> Result<(), Ended> {
    let floats = !problem.rigid.modes.is_empty();
    if settings.method != Method::Auto && floats {
        let _ = at_rest::ask(problem, monitor, seconds_of_statics(settings))?;
    }
    let opening = match resting {
        Some(motion) => at_rest::rest(problem, start, motion.clone(), monitor)?,
        None => bilateral_start(problem, start, monitor)?,
    };
    let start = opening.as_ref().unwrap_or(start);
    run_method(problem, settings.method, start, monitor, sequence)
}

fn run_method<const D: usize>(
    problem: &Reduced<D>,
    method: Method,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
    sequence: &mut Sequence<D>,
) -> Result<(), Ended> {
    match method {
        Method::Auto => auto::run(problem, start, monitor),
        Method::GaussSeidel => gauss_seidel::run(problem, start, monitor),
        Method::Newton => newton::alone(problem, start, monitor),
        Method::Nesterov => uzawa::run(problem, Variant::Momentum, start, monitor),
        Method::Uzawa => uzawa::run(problem, Variant::OneProjection, start, monitor),
        Method::UzawaTwoProjection => uzawa::run(problem, Variant::TwoProjections, start, monitor),
        Method::ReturnMapping => multipliers::run(problem, RETURN, start, monitor),
        Method::PerturbedLagrangian => multipliers::run(problem, LAGRANGIAN, start, monitor),
        Method::DisplacementPrinciple => iterate_frozen(problem, start, monitor, |point| {
            displacement_principle::frozen(problem, &point.r)
        }),
        Method::AlternatingPrinciples => alternating_principles::run(problem, start, monitor),
        Method::StressPrinciple => iterate_frozen(problem, start, monitor, |point| {
            stress_principle::frozen(problem, &point.v)
        }),
        Method::MinimisingSequence => minimising_sequence::run(problem, start, monitor, sequence),
        Method::Pivoting => pivoting::run(problem, start, monitor),
    }
}

/// The start of bodies that only contact holds, if the caller gives none: the bilateral
/// solution. It balances all forces better than an iteration, unless most of the balance comes
/// from contacts that pull.
fn bilateral_start<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Option<Start<D>>, Error> {
    if problem.rigid.modes.is_empty() || !start.reaction.is_empty() {
        return Ok(None);
    }
    let Some(held) = newton::held_at(problem, |_| true, monitor)? else {
        return Ok(None);
    };
    let (mut reaction, rigid) = (held.r, held.rigid);
    for (r, law) in reaction.iter_mut().zip(&problem.law) {
        *r = project(r, *law).0; // contacts that would pull start open
    }
    let v = problem.relative_displacement(&reaction, &rigid);
    monitor.count(1.0);
    let trusted = residual(problem, &reaction, &v, &rigid) <= tuning::trusted_start();
    Ok(trusted.then(|| Start {
        reaction,
        rigid,
        closed: start.closed.clone(),
    }))
}

/// The solution at a known point, with its certificate; its work is that of the certificate.
pub fn certify<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    r: &[[f64; D]],
    a: &[f64],
    stop: &AtomicBool,
) -> Result<Solution<D>, Error> {
    let progress = Progress::default();
    let mut monitor = Monitor::new(problem, settings, stop, &progress);
    let _ = outcome_of(monitor.look_at(r, a, false))?;
    Ok(finish(problem, settings, monitor, Outcome::Stalled))
}
