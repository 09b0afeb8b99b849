//! Algorithms on the reduced problem, and nothing else: what they are given,
//! what they return, and how they are watched.

pub mod anderson;
pub mod auto;
pub mod gauss_seidel;
pub mod monitor;
pub mod newton;
pub mod uzawa;

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::bipotential;
use crate::law::cone::{Status, project};
use crate::problem::balance::{self, Balance};
use crate::problem::reduced::Reduced;
use crate::problem::residual::{Certificate, residual};
use crate::solver::monitor::Monitor;

/// Which algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The default: accelerated Gauss–Seidel, finished by Newton.
    #[default]
    Auto,
    /// Exact one-node solves with Anderson acceleration, (17).
    GaussSeidel,
    /// One projection with an adaptive step, (16), [dSF91, 79–81].
    Uzawa,
}

impl Method {
    /// The names a user writes, in the order of documentation.
    pub const NAMES: [(&'static str, Method); 3] = [
        ("auto", Method::Auto),
        ("gauss_seidel", Method::GaussSeidel),
        ("uzawa", Method::Uzawa),
    ];
}

/// Why a solver stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Converged,
    Stalled,
    IterationLimit,
    TimeLimit,
    NoEquilibrium,
}

impl Outcome {
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Stalled => "stalled",
            Self::IterationLimit => "iteration_limit",
            Self::TimeLimit => "time_limit",
            Self::NoEquilibrium => "no_equilibrium",
        }
    }
}

/// What the user may set; validated once.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub method: Method,
    /// Wished residual η; what it is held to is the larger of this and rounding.
    pub tol: f64,
    pub max_iterations: usize,
    pub max_seconds: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Auto,
            tol: 1e-10,
            max_iterations: 100_000,
            max_seconds: f64::INFINITY,
        }
    }
}

impl Settings {
    /// # Errors
    /// [`Error::Setting`] naming the first setting out of range.
    pub fn validate(&self) -> Result<(), Error> {
        // Written so that a NaN fails each of them.
        if !(self.tol > 0.0 && self.tol < 1.0) {
            return Err(Error::Setting {
                what: "tol",
                found: self.tol,
                expected: "a positive number below 1",
            });
        }
        if self.max_iterations == 0 {
            return Err(Error::Setting {
                what: "max_iterations",
                found: 0.0,
                expected: "a positive whole number",
            });
        }
        if !(self.max_seconds > 0.0) {
            return Err(Error::Setting {
                what: "max_seconds",
                found: self.max_seconds,
                expected: "a positive number",
            });
        }
        Ok(())
    }
}

/// Where to start, in the order of positions.
#[derive(Clone, Debug, Default)]
pub struct Start<const D: usize> {
    /// Reactions; empty for a cold start.
    pub reaction: Vec<[f64; D]>,
    /// Rigid motions `a`; empty for zero.
    pub rigid: Vec<f64>,
    /// Contacts that were closed before, which try to stick first; empty for none.
    pub closed: Vec<bool>,
}

/// The answer of a solver, or the best it reached, in the caller's numbering.
#[derive(Clone, Debug)]
pub struct Solution<const D: usize> {
    pub reaction: Vec<[f64; D]>,
    pub relative_displacement: Vec<[f64; D]>,
    pub status: Vec<Status>,
    /// Gap of the bipotential in joules, contact by contact.
    pub bipotential_gap: Vec<f64>,
    pub rigid_motion: Vec<f64>,
    /// Rigid motion that the loads set free: proof of `NoEquilibrium`, a finding
    /// where it did not converge; empty where there is none to tell.
    pub free_motion: Vec<f64>,
    pub outcome: Outcome,
    pub residual: f64,
    pub tolerance: f64,
    /// Rounding floor of the residual.
    pub floor: f64,
    pub iterations: usize,
    /// In products with `W`.
    pub work: f64,
    /// `(work, η)`, a row an iteration.
    pub history: Vec<(f64, f64)>,
    pub seconds: f64,
}

/// Solves the reduced problem.
///
/// Not converged is an outcome, not an error: the best point seen comes back.
///
/// # Errors
/// [`Error::Setting`] for settings out of range, [`Error::Interrupted`] when
/// `stop` is raised.
pub fn solve<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    start: &Start<D>,
    stop: &AtomicBool,
) -> Result<Solution<D>, Error> {
    settings.validate()?;
    let mut monitor = Monitor::new(problem, settings, stop);
    if problem.contradiction.is_some() {
        return Ok(finish(problem, settings, monitor, Outcome::NoEquilibrium));
    }
    if let Balance::Impossible { motion } = balance::balance(problem) {
        let mut nothing = finish(problem, settings, monitor, Outcome::NoEquilibrium);
        nothing.free_motion = motion;
        return Ok(nothing);
    }
    let opening = bilateral_start(problem, start, &mut monitor);
    let start = opening.as_ref().unwrap_or(start);
    let outcome = match settings.method {
        Method::Auto => auto::run(problem, start, &mut monitor)?,
        Method::GaussSeidel => gauss_seidel::run(problem, start, &mut monitor)?,
        Method::Uzawa => uzawa::run(problem, start, &mut monitor)?,
    };
    let last = monitor.last_rigid().to_vec();
    let mut solution = finish(problem, settings, monitor, outcome);
    if solution.outcome != Outcome::Converged && !last.is_empty() {
        let r = problem.compliance.gather(&solution.reaction);
        solution.free_motion = balance::runaway(problem, &r, &last).unwrap_or_default();
    }
    Ok(solution)
}

/// A bilateral start with a larger residual than this leaves most of the load
/// unbalanced; the cold start has 1.
const TRUSTED_START: f64 = 0.5;

/// Where bodies held by contact alone start when nothing else is given: no
/// iteration knows as much of their whole balance of forces as the bilateral
/// solution, unless most of that came from contacts that pull.
fn bilateral_start<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Option<Start<D>> {
    if problem.rigid.modes.is_empty() || !start.reaction.is_empty() {
        return None;
    }
    let (mut reaction, rigid) = newton::held_at(problem, |_| true, monitor)?;
    for (r, &mu) in reaction.iter_mut().zip(&problem.mu) {
        *r = project(r, mu).0; // contacts that would pull start open
    }
    let v = problem.relative_displacement(&reaction, &rigid);
    monitor.count(1.0);
    (residual(problem, &reaction, &v, &rigid) <= TRUSTED_START).then(|| Start {
        reaction,
        rigid,
        closed: start.closed.clone(),
    })
}

/// Judges the best point afresh and puts everything into the caller's numbering.
fn finish<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    monitor: Monitor<D>,
    outcome: Outcome,
) -> Solution<D> {
    let log = monitor.into_log();
    let certificate = Certificate::new(problem, &log.best_reaction, &log.best_rigid);
    let outcome = match (certificate.converged(settings.tol), outcome) {
        (true, _) => Outcome::Converged,
        (false, Outcome::Converged) => Outcome::Stalled,
        (false, other) => other,
    };
    let gap = log
        .best_reaction
        .iter()
        .zip(&certificate.v)
        .zip(&problem.mu);
    let gap: Vec<f64> = gap
        .map(|((r, v), &mu)| bipotential::gap(r, v, mu))
        .collect();
    // r = 0 is open, whatever rounding makes of r̂ − ṽ̂ at a grazing contact.
    let status: Vec<Status> = log
        .best_reaction
        .iter()
        .zip(&certificate.status)
        .map(|(r, &s)| {
            if r.iter().all(|&c| c == 0.0) {
                Status::Open
            } else {
                s
            }
        })
        .collect();
    let whole = problem.compliance;
    Solution {
        reaction: whole.scatter(&log.best_reaction),
        relative_displacement: whole.scatter(&certificate.v),
        status: whole.scatter(&status),
        bipotential_gap: whole.scatter(&gap),
        rigid_motion: log.best_rigid,
        free_motion: Vec::new(),
        outcome,
        residual: certificate.residual,
        tolerance: certificate.tolerance(settings.tol),
        floor: certificate.floor,
        iterations: log.iterations,
        work: log.work,
        history: log.history,
        seconds: log.seconds,
    }
}
