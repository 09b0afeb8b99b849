//! Algorithms on the reduced problem, and nothing else: what they are given,
//! what they return, and how they are watched.

pub mod alternating_principles;
pub mod anderson;
pub mod auto;
pub mod compliance_form;
pub mod convex;
pub mod displacement_principle;
pub mod enumerate;
pub mod farkas;
pub mod gauss_seidel;
pub mod interior;
pub mod linearisation;
pub mod minimising_sequence;
pub mod monitor;
pub mod newton;
pub mod pivoting;
pub mod proximal;
pub mod refine;
pub mod solution;
pub mod stiffness_form;
pub mod stress_principle;
pub mod uzawa;

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::Error;
use crate::law::cone::project;
use crate::reduced::balance::{self, Balance};
use crate::reduced::overlap::overlap;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{Certificate, residual};
use crate::solver::monitor::{Monitor, Progress};
use crate::solver::solution::finish;
pub use crate::solver::solution::{Outcome, Solution};
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
    /// Friction limits frozen at the last pressures, [dSF91, 68].
    DisplacementPrinciple,
    /// Contact, then friction, the other's reactions frozen, [dSF91, 69, 70].
    AlternatingPrinciples,
    /// Slip frozen at the last displacements, [dSF91, 72].
    StressPrinciple,
    /// Displacements and reactions in turn, the bifunctional falling, [dSF91, 31–34].
    MinimisingSequence,
    /// Complementary pivoting on the piecewise linear law, after [dSF91, 75].
    Pivoting,
}

impl Method {
    /// The names a user writes, in the order of documentation.
    pub const NAMES: [(&'static str, Method); 11] = [
        ("auto", Method::Auto),
        ("newton", Method::Newton),
        ("gauss_seidel", Method::GaussSeidel),
        ("nesterov", Method::Nesterov),
        ("uzawa", Method::Uzawa),
        ("uzawa_two_projection", Method::UzawaTwoProjection),
        ("displacement_principle", Method::DisplacementPrinciple),
        ("alternating_principles", Method::AlternatingPrinciples),
        ("stress_principle", Method::StressPrinciple),
        ("minimising_sequence", Method::MinimisingSequence),
        ("pivoting", Method::Pivoting),
    ];

    /// The name a user writes.
    #[must_use]
    pub fn name(self) -> &'static str {
        let mut names = Self::NAMES.iter();
        names
            .find(|(_, method)| *method == self)
            .map_or("", |(name, _)| name)
    }

    /// Whether it takes bodies that contact alone holds: frozen tangential reactions
    /// or none leave nothing to balance the loads on them with.
    #[must_use]
    pub fn balances(self) -> bool {
        !matches!(
            self,
            Self::AlternatingPrinciples | Self::MinimisingSequence | Self::Pivoting
        )
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

/// Solves the reduced problem.
///
/// Not converged is an outcome, not an error: the best point seen comes back.
///
/// # Errors
/// [`Error::Setting`] for settings out of range, [`Error::NotHeld`] where contact alone
/// holds a body and the method cannot balance it, [`Error::Interrupted`] when `stop` is
/// raised.
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
    if !problem.rigid.modes.is_empty() && !settings.method.balances() {
        return Err(Error::NotHeld {
            method: settings.method.name(),
        });
    }
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
        Method::DisplacementPrinciple => displacement_principle::run(problem, start, &mut monitor)?,
        Method::AlternatingPrinciples => alternating_principles::run(problem, start, &mut monitor)?,
        Method::StressPrinciple => stress_principle::run(problem, start, &mut monitor)?,
        Method::MinimisingSequence => minimising_sequence::run(problem, start, &mut monitor)?,
        Method::Pivoting => pivoting::run(problem, start, &mut monitor)?,
    };
    let furthest = monitor.furthest_rigid().to_vec();
    let mut solution = finish(problem, settings, monitor, outcome);
    if solution.outcome == Outcome::NoEquilibrium {
        // No method says so but by exhausting the statuses.
        solution.statuses_tried = enumerate::statuses(&problem.mu);
    }
    if solution.outcome == Outcome::Converged && hides(problem, settings.tol) {
        confirm(problem, &mut solution, stop)?;
    }
    // What only rounding has let pass may be reactions that have grown until they drown
    // the walls between which they grew.
    let doubted = match solution.outcome {
        Outcome::Converged => solution.residual > settings.tol,
        outcome => matches!(outcome, Outcome::Stalled | Outcome::IterationLimit),
    };
    if doubted && overlap(problem, &problem.compliance.gather(&solution.reaction)) {
        solution.outcome = Outcome::NoEquilibrium;
    }
    if settings.method == Method::Auto && solution.outcome == Outcome::Stalled {
        exhaust(problem, settings, &mut solution, stop)?;
    }
    if settings.method == Method::Auto && solution.outcome == Outcome::Stalled {
        creep(problem, settings, &mut solution, stop, progress)?;
    }
    let open = !matches!(
        solution.outcome,
        Outcome::Converged | Outcome::NoEquilibrium
    );
    if open && !furthest.is_empty() {
        let r = problem.compliance.gather(&solution.reaction);
        solution.free_motion = balance::runaway(problem, &r, &furthest).unwrap_or_default();
    }
    Ok(solution)
}

/// Contacts whose statuses are exhausted in milliseconds, whatever time is left.
const QUICK: usize = 7;

/// Whether friction is so large that what a point misses the law by may be within the
/// tolerance at every point that balances the loads: a body that friction alone holds
/// presses with the loads over μ, and a contact that may be open by as much is no
/// answer to the law, and one to the tolerance.
fn hides<const D: usize>(problem: &Reduced<D>, tol: f64) -> bool {
    /// Beside the tolerance: what is pressed by this share of the loads is in sight.
    const IN_SIGHT: f64 = 100.0;
    let largest = problem.mu.iter().fold(0.0_f64, |m, &mu| m.max(mu));
    !problem.rigid.modes.is_empty() && largest * IN_SIGHT * tol >= 1.0
}

/// Takes back that a point is an answer where exhausting the statuses of a few contacts
/// proves that there is none.
fn confirm<const D: usize>(
    problem: &Reduced<D>,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    if problem.contacts() > QUICK {
        return Ok(());
    }
    let started = Instant::now();
    if enumerate::few(problem, stop)?.is_some_and(|found| found.proves_none(problem)) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.mu);
    }
    solution.seconds += started.elapsed().as_secs_f64();
    Ok(())
}

/// Where every method has come to a stand and the contacts are few, their
/// statuses are exhausted: that finds an answer, or proves that there is none.
fn exhaust<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    let started = Instant::now();
    if settings.max_seconds.is_finite() && problem.contacts() > QUICK {
        return Ok(());
    }
    let Some(found) = enumerate::few(problem, stop)? else {
        return Ok(());
    };
    solution.seconds += started.elapsed().as_secs_f64();
    if found.proves_none(problem) {
        solution.outcome = Outcome::NoEquilibrium;
        solution.statuses_tried = enumerate::statuses(&problem.mu);
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

/// Where every method has come to a stand, projections from nothing may still creep to
/// an answer: they need no matrix that is sound, and do not look for statuses.
fn creep<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    solution: &mut Solution<D>,
    stop: &AtomicBool,
    progress: &Progress,
) -> Result<(), Error> {
    /// Products that are worth it, of matrices that are small, and additions and
    /// multiplications of large ones.
    const MOST: usize = 20_000;
    const MOST_OPERATIONS: usize = 10_000_000_000;
    let affordable = MOST_OPERATIONS / problem.compliance.entries().max(1);
    for method in [Method::Nesterov, Method::Uzawa] {
        let left = settings.max_iterations.saturating_sub(solution.iterations);
        let seconds = settings.max_seconds - solution.seconds;
        let max_iterations = left.min(MOST).min(affordable);
        if max_iterations == 0 || seconds <= 0.0 {
            return Ok(());
        }
        let slow = Settings {
            method,
            max_iterations,
            max_seconds: seconds,
            ..*settings
        };
        let mut found = solve_watched(problem, &slow, &Start::default(), stop, progress)?;
        found.iterations += solution.iterations;
        found.work += solution.work;
        found.seconds += solution.seconds;
        if found.outcome == Outcome::Converged {
            let earlier = std::mem::take(&mut solution.history);
            let offset = earlier.last().map_or(0.0, |row| row.0);
            let later = found.history.iter().map(|row| (row.0 + offset, row.1));
            found.history = earlier.into_iter().chain(later).collect();
            *solution = found;
            return Ok(());
        }
        (solution.iterations, solution.work) = (found.iterations, found.work);
        solution.seconds = found.seconds;
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
