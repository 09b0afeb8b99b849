//! Algorithms on the reduced problem, and nothing else: what they are given,
//! what they return, and how they are watched.

pub mod anderson;
pub mod auto;
pub mod compliance_form;
pub mod enumerate;
pub mod gauss_seidel;
pub mod index;
pub mod linearisation;
pub mod monitor;
pub mod monotony;
pub mod newton;
pub mod refine;
pub mod stiffness_form;
pub mod uniqueness;
pub mod uzawa;

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::Error;
use crate::law::bipotential;
use crate::law::cone::{Status, project};
use crate::linalg::small::tangential_norm;
use crate::problem::balance::{self, Balance};
use crate::problem::reduced::Reduced;
use crate::problem::residual::{Certificate, residual};
use crate::solver::monitor::{Monitor, Progress};
use crate::solver::uzawa::Variant;

/// Which algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The default: accelerated Gauss–Seidel, finished by Newton.
    #[default]
    Auto,
    /// Exact one-node solves with Anderson acceleration, (17).
    GaussSeidel,
    /// Semismooth Newton alone, (19) and (20).
    Newton,
    /// One projection with an adaptive step and Nesterov's momentum.
    Nesterov,
    /// One projection with an adaptive step, (16), [dSF91, 79–81].
    Uzawa,
    /// Two projections with the same step, [dSF91, 82–87].
    UzawaTwoProjection,
}

impl Method {
    /// The names a user writes, in the order of documentation.
    pub const NAMES: [(&'static str, Method); 6] = [
        ("auto", Method::Auto),
        ("newton", Method::Newton),
        ("gauss_seidel", Method::GaussSeidel),
        ("nesterov", Method::Nesterov),
        ("uzawa", Method::Uzawa),
        ("uzawa_two_projection", Method::UzawaTwoProjection),
    ];
}

/// Why a solver stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outcome {
    Converged,
    #[default]
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
#[derive(Clone, Debug, Default)]
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
    /// Bytes that the solver holds beside `W`: a transpose, an inverse.
    pub bytes_beside: usize,
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
    solve_watched(problem, settings, start, stop, &Progress::default())
}

/// [`solve`], while another thread may read how far it is.
///
/// # Errors
/// As [`solve`].
pub fn solve_watched<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    start: &Start<D>,
    stop: &AtomicBool,
    progress: &Progress,
) -> Result<Solution<D>, Error> {
    settings.validate()?;
    let mut monitor = Monitor::new(problem, settings, stop, progress);
    if problem.contradiction.is_some() {
        return Ok(finish(problem, settings, monitor, Outcome::NoEquilibrium));
    }
    if let Balance::Impossible { motion } = balance::balance(problem, stop) {
        let mut nothing = finish(problem, settings, monitor, Outcome::NoEquilibrium);
        nothing.free_motion = motion;
        return Ok(nothing);
    }
    let opening = bilateral_start(problem, start, &mut monitor)?;
    let start = opening.as_ref().unwrap_or(start);
    let outcome = match settings.method {
        Method::Auto => auto::run(problem, start, &mut monitor)?,
        Method::GaussSeidel => gauss_seidel::run(problem, start, &mut monitor)?,
        Method::Newton => newton::alone(problem, start, &mut monitor)?,
        Method::Nesterov => uzawa::run(problem, Variant::Momentum, start, &mut monitor)?,
        Method::Uzawa => uzawa::run(problem, Variant::OneProjection, start, &mut monitor)?,
        Method::UzawaTwoProjection => {
            uzawa::run(problem, Variant::TwoProjections, start, &mut monitor)?
        }
    };
    let last = monitor.last_rigid().to_vec();
    let mut solution = finish(problem, settings, monitor, outcome);
    if matches!(solution.outcome, Outcome::Stalled | Outcome::IterationLimit)
        && overlap(problem, &problem.compliance.gather(&solution.reaction))
    {
        solution.outcome = Outcome::NoEquilibrium;
    }
    if settings.method == Method::Auto && solution.outcome == Outcome::Stalled {
        exhaust(problem, settings, &mut solution, stop)?;
    }
    if solution.outcome != Outcome::Converged && !last.is_empty() {
        let r = problem.compliance.gather(&solution.reaction);
        solution.free_motion = balance::runaway(problem, &r, &last).unwrap_or_default();
    }
    Ok(solution)
}

/// Whether the normal reactions at which an iteration ended prove that contacts
/// contradict each other: they push against one another and nothing else,
/// `W d = 0`, `Rᵀ d = 0`, while `d·q < 0`. No displacement opens all of them, for
/// `d·v` is that product whatever the reactions are, and a sum of `d_n v_n ≥ 0`.
fn overlap<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> bool {
    /// Beside blocks of mean diagonal one, below this the rounding of a sum.
    const NOTHING: f64 = 1e-9;
    let scaling = &problem.scaling;
    let d: Vec<[f64; D]> = r
        .iter()
        .map(|r| std::array::from_fn(|k| if k == 0 { r[0] } else { 0.0 }))
        .collect();
    let length = scaling.reaction_norm(&d);
    let mut moved = vec![[0.0; D]; r.len()];
    problem.compliance.product(&d, &mut moved);
    let (mut motion, mut work, mut size) = (0.0_f64, 0.0, 0.0_f64);
    for (i, (d, q)) in d.iter().zip(&problem.q).enumerate() {
        motion = motion.hypot(tangential_norm(&moved[i]).hypot(moved[i][0]) * scaling.to_v[i]);
        let free = q[0] * scaling.to_v[i];
        work += d[0] * scaling.to_r[i] * free;
        if d[0] > 0.0 {
            size = size.hypot(free);
        }
    }
    let balanced = scaling.modes.iter().all(|mode| {
        let terms = mode.iter().zip(&d).zip(&scaling.to_r);
        let sum: f64 = terms.map(|((m, d), s)| m[0] * d[0] * s).sum();
        sum.abs() <= NOTHING * length
    });
    length > 0.0 && motion <= NOTHING * length && balanced && work < -1e-6 * size * length
}

/// Where every method has come to a stand and the contacts are few, their
/// statuses are exhausted: that finds an answer, or proves that there is none.
fn exhaust<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    /// Contacts whose statuses are exhausted in milliseconds, whatever time is left.
    const QUICK: usize = 7;
    let started = Instant::now();
    if settings.max_seconds.is_finite() && problem.contacts() > QUICK {
        return Ok(());
    }
    let Some(found) = enumerate::few(problem, stop)? else {
        return Ok(());
    };
    solution.seconds += started.elapsed().as_secs_f64();
    // With a definite W an answer exists whatever μ is: that none was found would be
    // rounding. Only bodies that contact alone holds may have none.
    if found.complete && found.answers.is_empty() && !problem.rigid.modes.is_empty() {
        solution.outcome = Outcome::NoEquilibrium;
    }
    for (r, rigid) in found.answers {
        let certificate = Certificate::new(problem, &r, &rigid);
        if certificate.converged(settings.tol) {
            solution.put(problem, settings, &r, rigid, &certificate);
            solution.outcome = Outcome::Converged;
            return Ok(());
        }
    }
    Ok(())
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
) -> Result<Option<Start<D>>, Error> {
    if problem.rigid.modes.is_empty() || !start.reaction.is_empty() {
        return Ok(None);
    }
    let Some(held) = newton::held_at(problem, |_| true, monitor)? else {
        return Ok(None);
    };
    let (mut reaction, rigid) = (held.r, held.rigid);
    for (r, &mu) in reaction.iter_mut().zip(&problem.mu) {
        *r = project(r, mu).0; // contacts that would pull start open
    }
    let v = problem.relative_displacement(&reaction, &rigid);
    monitor.count(1.0);
    let trusted = residual(problem, &reaction, &v, &rigid) <= TRUSTED_START;
    Ok(trusted.then(|| Start {
        reaction,
        rigid,
        closed: start.closed.clone(),
    }))
}

/// A point that is known already, judged as any other; its work is that of judging.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn judged<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    r: &[[f64; D]],
    a: &[f64],
    stop: &AtomicBool,
) -> Result<Solution<D>, Error> {
    let progress = Progress::default();
    let mut monitor = Monitor::new(problem, settings, stop, &progress);
    let v = problem.relative_displacement(r, a);
    monitor.count(1.0);
    monitor.look(r, &v, a, false)?;
    Ok(finish(problem, settings, monitor, Outcome::Stalled))
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
    let mut solution = Solution {
        outcome: match (certificate.converged(settings.tol), outcome) {
            (true, _) => Outcome::Converged,
            (false, Outcome::Converged) => Outcome::Stalled,
            (false, other) => other,
        },
        iterations: log.iterations,
        work: log.work,
        history: log.history,
        seconds: log.seconds,
        ..Solution::default()
    };
    solution.put(
        problem,
        settings,
        &log.best_reaction,
        log.best_rigid,
        &certificate,
    );
    solution
}

/// Error of the reactions above which a refined solution is none.
const WORST_REACTION: f64 = 1e-6;

impl<const D: usize> Solution<D> {
    /// Puts a judged point here, in the caller's numbering.
    fn put(
        &mut self,
        problem: &Reduced<D>,
        settings: &Settings,
        r: &[[f64; D]],
        rigid: Vec<f64>,
        certificate: &Certificate<D>,
    ) {
        let nodes = r.iter().zip(&certificate.v).zip(&problem.mu);
        let gap: Vec<f64> = nodes
            .map(|((r, v), &mu)| bipotential::gap(r, v, mu))
            .collect();
        // r = 0 is open, whatever rounding makes of r̂ − ṽ̂ at a grazing contact.
        let status: Vec<Status> = r
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
        self.reaction = whole.scatter(r);
        self.relative_displacement = whole.scatter(&certificate.v);
        self.status = whole.scatter(&status);
        self.bipotential_gap = whole.scatter(&gap);
        self.rigid_motion = rigid;
        self.residual = certificate.residual;
        self.tolerance = certificate.tolerance(settings.tol);
        self.floor = certificate.floor;
        self.bytes_beside = whole.bytes_beside();
    }

    /// Refines a converged solution by a better evaluation of `v` than `W` gives,
    /// which judges it from then on: the better of the point and the refined one, if
    /// one of them is an answer, else it has stalled.
    ///
    /// # Errors
    /// What `evaluate` returns, and [`Error::Interrupted`].
    pub fn refine(
        &mut self,
        problem: &Reduced<D>,
        settings: &Settings,
        evaluate: impl Fn(Vec<[f64; D]>, Vec<f64>) -> Result<refine::Point<D>, Error>,
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        let start = problem.compliance.gather(&self.reaction);
        let point = evaluate(start, self.rigid_motion.clone())?;
        let refined = refine::refine(problem, point.clone(), evaluate, stop)?;
        let forward = refine::forward_error(problem, &refined, &[], stop)?;
        let judged = [refined, point].map(|point| {
            let certificate = Certificate::of(problem, &point.r, point.v, &point.rigid);
            (certificate, point.r, point.rigid)
        });
        let [refined, as_it_was] = judged;
        let answers = |judged: &(Certificate<D>, _, _)| judged.0.converged(settings.tol);
        // η is relative to what soft supports give way: where it is met and another
        // correction still moves the reactions, it says nothing of them.
        let settled = forward.is_none_or(|(of_r, _)| of_r <= WORST_REACTION);
        let better = match (answers(&refined), answers(&as_it_was)) {
            (true, _) if settled => refined,
            (false, true) if settled => as_it_was,
            _ => {
                self.outcome = Outcome::Stalled;
                refined
            }
        };
        let (certificate, r, rigid) = better;
        self.put(problem, settings, &r, rigid, &certificate);
        Ok(())
    }
}
