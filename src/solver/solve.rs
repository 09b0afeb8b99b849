//! Calls the chosen method, and completes its result.

use std::sync::atomic::AtomicBool;

use crate::equilibrium::decide::Verdict;
use crate::error::Error;
use crate::law::cone::project;
use crate::reduced::existence::is_contradiction;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::residual;
use crate::reduced::runaway::runaway;
use crate::solver::at_rest;
use crate::solver::auto;
use crate::solver::enumerate;
use crate::solver::fallback::{may_hide_openings, try_statuses, withdraw_if_none};
use crate::solver::gauss_seidel;
use crate::solver::monitor::{Monitor, Progress};
use crate::solver::newton::newton;
use crate::solver::outcome::{Ended, Outcome};
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

/// Statics has at least this time, whatever limit a method has reached.
const LEAST_SECONDS: f64 = 2.0;

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
        shift(&mut start.rigid, -1.0, motion);
        let mut solution = solve_watched(&still, settings, &start, stop, progress)?;
        shift(&mut solution.rigid_motion, 1.0, motion);
        return Ok(solution);
    }
    let mut balanced = false;
    let opening = if let Some(motion) = &resting {
        match rest(problem, start, motion, &mut monitor)? {
            Rest::Moves(motion) => return Ok(refuse(problem, settings, monitor, motion)),
            Rest::Answer => {
                return Ok(finish(problem, settings, monitor, Outcome::Converged));
            }
            Rest::Start(start) => {
                balanced = start.is_some();
                start
            }
        }
    } else {
        if !auto
            && !problem.rigid.modes.is_empty()
            && let Some(motion) = find_free_fall(problem, settings, stop)?
        {
            return Ok(refuse(problem, settings, monitor, motion));
        }
        bilateral_start(problem, start, &mut monitor)?
    };
    let start = opening.as_ref().unwrap_or(start);
    let mut sequence = Sequence::default();
    let ended = run_method(problem, settings.method, start, &mut monitor, &mut sequence);
    let outcome = match ended {
        Ok(()) => Outcome::Stalled,
        Err(Ended::Stopped(outcome)) => outcome,
        Err(Ended::Failed(error)) => return Err(error),
    };
    let furthest = monitor.furthest_rigid().to_vec();
    let unasked = auto && resting.is_none() && !problem.rigid.modes.is_empty();
    if unasked
        && !matches!(outcome, Outcome::Converged | Outcome::NoEquilibrium)
        && let Some(motion) = find_free_fall(problem, settings, stop)?
    {
        return Ok(refuse(problem, settings, monitor, motion));
    }
    let free_motion = monitor.free_motion().to_vec();
    let mut solution = finish(problem, settings, monitor, outcome);
    if settings.method == Method::MinimisingSequence {
        solution.sequence = Some(sequence.scattered(problem.compliance));
    }
    if solution.outcome == Outcome::NoEquilibrium && !free_motion.is_empty() {
        solution.free_motion = free_motion;
    } else if solution.outcome == Outcome::NoEquilibrium {
        // Without a motion, a method gives this outcome only after it has tried all statuses.
        solution.statuses_tried = enumerate::statuses(&problem.law);
    }
    if solution.outcome == Outcome::Converged && may_hide_openings(problem, settings.tol) {
        withdraw_if_none(problem, &mut solution, stop)?;
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
    if auto && solution.outcome == Outcome::Stalled {
        try_statuses(problem, settings, &mut solution, stop)?;
    }
    let open = !matches!(
        solution.outcome,
        Outcome::Converged | Outcome::NoEquilibrium
    );
    // Bodies whose weights the contacts can carry at rest do not slide away.
    if open && !furthest.is_empty() && !balanced {
        let r = problem.compliance.gather(&solution.reaction);
        solution.free_motion = runaway(problem, &r, &furthest).unwrap_or_default();
    }
    Ok(solution)
}

/// `a ← a + sign · offset`.
fn shift(a: &mut [f64], sign: f64, offset: &[f64]) {
    for (a, offset) in a.iter_mut().zip(offset) {
        *a += sign * offset;
    }
}

/// A motion that proves that no reactions balance the loads, if there is one.
fn find_free_fall<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    stop: &AtomicBool,
) -> Result<Option<Vec<f64>>, Error> {
    let decision = at_rest::ask(problem, stop, settings.max_seconds.max(LEAST_SECONDS))?;
    Ok((decision.verdict == Verdict::None).then_some(decision.motion))
}

/// What statics says of bodies that nothing deforms.
enum Rest<const D: usize> {
    /// No reactions balance the loads, by this motion.
    Moves(Vec<f64>),
    /// The monitor has the solution.
    Answer,
    /// Reactions that are balanced, but not to the tolerance.
    Start(Option<Start<D>>),
}

/// Looks for a solution without any motion of contacts: the start, if it is one, or the balanced
/// reactions.
fn rest<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    motion: &[f64],
    monitor: &mut Monitor<D>,
) -> Result<Rest<D>, Error> {
    if !start.reaction.is_empty() {
        let given = (start.rigid.len() == motion.len()).then_some(start.rigid.as_slice());
        if is_answer(problem, &start.reaction, given.unwrap_or(motion), monitor)? {
            return Ok(Rest::Answer);
        }
    }
    let decision = at_rest::ask(problem, monitor.stop(), monitor.seconds_left())?;
    match decision.verdict {
        Verdict::None => Ok(Rest::Moves(decision.motion)),
        Verdict::Undecided => Ok(Rest::Start(None)),
        Verdict::Balanced => {
            let reaction = decision.reaction.as_chunks::<D>().0.to_vec();
            if is_answer(problem, &reaction, motion, monitor)? {
                return Ok(Rest::Answer);
            }
            Ok(Rest::Start(Some(Start {
                reaction,
                rigid: motion.to_vec(),
                closed: start.closed.clone(),
            })))
        }
    }
}

/// Shows a point to the monitor, and tells whether it is a solution.
fn is_answer<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    a: &[f64],
    monitor: &mut Monitor<D>,
) -> Result<bool, Error> {
    let v = problem.relative_displacement(r, a);
    monitor.count(1.0);
    match monitor.look(r, &v, a, false) {
        Err(Ended::Failed(error)) => Err(error),
        Err(Ended::Stopped(outcome)) => Ok(outcome == Outcome::Converged),
        Ok(_) => Ok(false),
    }
}

/// The result if a rigid motion proves that there is no equilibrium.
fn refuse<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    monitor: Monitor<D>,
    motion: Vec<f64>,
) -> Solution<D> {
    let mut nothing = finish(problem, settings, monitor, Outcome::NoEquilibrium);
    nothing.outcome = Outcome::NoEquilibrium;
    nothing.free_motion = motion;
    nothing
}

/// Calls the method.
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
    let _ = is_answer(problem, r, a, &mut monitor)?;
    Ok(finish(problem, settings, monitor, Outcome::Stalled))
}
