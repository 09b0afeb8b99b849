//! Monitors a solver: history, best point, limits, and whether to stop.

use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use crate::error::Error;
use crate::law::bipotential::law_step;
use crate::law::cone::{Status, project};
use crate::linalg::small::{norm, tangential_norm};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{self, Certificate};
use crate::solver::enumerate;
use crate::solver::outcome::{Ended, Outcome};
use crate::solver::settings::Settings;
use crate::solver::solution::Solution;
use crate::solver::tuning;

/// The next step of a solver that goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NextStep {
    Continue,
    /// The running `v` has converged and a fresh one has not: evaluate it again.
    Refresh,
}

/// Progress of a solve, readable by another thread at any time.
#[derive(Debug)]
pub struct Progress {
    iterations: AtomicUsize,
    work: AtomicU64,
    residual: AtomicU64,
    /// Asks the caller between iterations, on the thread of the solve, whether to stop.
    ask: Option<fn() -> bool>,
}

impl Default for Progress {
    /// No point yet: a residual of zero would look like a solution.
    fn default() -> Self {
        let progress = Self {
            iterations: AtomicUsize::new(0),
            work: AtomicU64::new(0),
            residual: AtomicU64::new(0),
            ask: None,
        };
        progress.tell(0, 0.0, f64::INFINITY);
        progress
    }
}

impl Progress {
    /// The progress of a solve that asks `ask` between iterations whether to stop.
    pub fn asking(ask: fn() -> bool) -> Self {
        let ask = Some(ask);
        Self {
            ask,
            ..Self::default()
        }
    }

    fn tell(&self, iterations: usize, work: f64, residual: f64) {
        self.iterations.store(iterations, Ordering::Relaxed);
        self.work.store(work.to_bits(), Ordering::Relaxed);
        self.residual.store(residual.to_bits(), Ordering::Relaxed);
    }

    /// Iterations, work in products with `W`, and the smallest η so far.
    pub fn read(&self) -> (usize, f64, f64) {
        let number = |value: &AtomicU64| f64::from_bits(value.load(Ordering::Relaxed));
        let iterations = self.iterations.load(Ordering::Relaxed);
        (iterations, number(&self.work), number(&self.residual))
    }
}

#[derive(Debug)]
pub struct Monitor<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    settings: &'p Settings,
    stop: &'p AtomicBool,
    progress: &'p Progress,
    started: Instant,
    log: Log<D>,
    furthest_rigid: Vec<f64>,
    /// Whether statics has found reactions that balance the loads.
    pub(super) balanced: bool,
    best: f64,
    /// η when it last halved, and the iteration.
    halved: f64,
    last_halved: usize,
    last_better: usize,
    /// The last measured rounding floor of η.
    floor: f64,
    /// η of the last point whose fresh evaluation failed.
    refuted: f64,
    rigid: bool,
}

/// The results of a solve.
#[derive(Clone, Debug, Default)]
pub struct Log<const D: usize> {
    pub best_reaction: Vec<[f64; D]>,
    pub best_rigid: Vec<f64>,
    /// That of the best point, if it has converged.
    pub certificate: Option<Certificate<D>>,
    /// All but the best point.
    pub result: Solution<D>,
}

impl<'p, const D: usize> Monitor<'p, D> {
    pub fn new(
        problem: &'p Reduced<'p, D>,
        settings: &'p Settings,
        stop: &'p AtomicBool,
        progress: &'p Progress,
    ) -> Self {
        Self {
            problem,
            settings,
            stop,
            progress,
            started: Instant::now(),
            log: Log {
                best_reaction: vec![[0.0; D]; problem.contacts()],
                best_rigid: vec![0.0; problem.rigid.modes.len()],
                ..Log::default()
            },
            furthest_rigid: Vec::new(),
            balanced: false,
            best: f64::INFINITY,
            halved: f64::INFINITY,
            last_halved: 0,
            last_better: 0,
            floor: 0.0,
            refuted: f64::INFINITY,
            rigid: problem.moves_rigidly(),
        }
    }

    /// Set when the caller asks to stop.
    pub fn stop(&self) -> &'p AtomicBool {
        self.stop
    }

    /// The tolerance of η.
    pub fn wish(&self) -> f64 {
        self.settings.tol
    }

    /// η of the last point that it was shown.
    pub fn residual(&self) -> f64 {
        let last = self.log.result.history.last();
        last.map_or(f64::INFINITY, |point| point.1)
    }

    pub fn iterations(&self) -> usize {
        self.log.result.iterations
    }

    /// Counts products with `W`.
    pub fn count(&mut self, products: f64) {
        self.log.result.work += products;
    }

    /// [`Monitor::look`] with a `v` evaluated afresh.
    pub fn look_at(&mut self, r: &[[f64; D]], a: &[f64], iterated: bool) -> Result<(), Ended> {
        let v = self.problem.relative_displacement(r, a);
        self.count(1.0);
        self.look(r, &v, a, iterated).map(|_| ())
    }

    /// Checks the point `(r, a)` with its running `v`, after an iteration (`iterated`) or at
    /// the start.
    pub fn look(
        &mut self,
        r: &[[f64; D]],
        v: &[[f64; D]],
        a: &[f64],
        iterated: bool,
    ) -> Result<NextStep, Ended> {
        if self.stop.load(Ordering::Relaxed) || self.progress.ask.is_some_and(|ask| ask()) {
            return Err(Error::Interrupted.into());
        }
        self.log.result.iterations += usize::from(iterated);
        if norm(a) >= norm(&self.furthest_rigid) {
            self.furthest_rigid.clear();
            self.furthest_rigid.extend_from_slice(a);
        }
        let eta = residual::residual(self.problem, r, v, a);
        if let Some(nothing) = self.check_zero(r, a) {
            self.log
                .result
                .history
                .push((self.log.result.work, nothing.residual));
            self.keep(&vec![[0.0; D]; r.len()], a, nothing.residual, Some(nothing));
            return Err(Ended::Stopped(Outcome::Converged));
        }
        self.log
            .result
            .history
            .push((self.log.result.work, eta.min(f64::MAX)));
        let at_rest = self.log.result.iterations >= self.last_halved + tuning::rest();
        let claims = eta <= self.settings.tol || (eta <= self.floor && at_rest);
        if claims && eta <= 0.5 * self.refuted {
            let within = within_cones(self.problem, r, v);
            let r = within.as_ref();
            let nothing = vec![0.0; a.len()];
            let a = if self.rigid && rests(self.problem, r) {
                nothing.as_slice()
            } else {
                a
            };
            let fresh = Certificate::new(self.problem, r, a);
            self.log.result.work += 2.0;
            self.floor = fresh.floor;
            let converged = fresh.converged(self.settings.tol);
            if converged || fresh.residual < self.best {
                self.keep(r, a, fresh.residual, converged.then_some(fresh));
            }
            self.tell();
            if converged {
                return Err(Ended::Stopped(Outcome::Converged));
            }
            // The running v was too good, or η is not sufficient: check again at half of it.
            self.refuted = eta;
            self.check_limits()?;
            return Ok(NextStep::Refresh);
        }
        if eta < self.best {
            if eta < tuning::better_share() * self.best {
                self.last_better = self.log.result.iterations;
            }
            self.keep(r, a, eta, None);
        }
        self.tell();
        if eta < 0.5 * self.halved {
            self.halved = eta;
            self.last_halved = self.log.result.iterations;
        }
        self.check_limits()?;
        Ok(NextStep::Continue)
    }

    fn keep(&mut self, r: &[[f64; D]], a: &[f64], eta: f64, certificate: Option<Certificate<D>>) {
        self.best = eta;
        self.log.best_reaction.copy_from_slice(r);
        self.log.best_rigid.copy_from_slice(a);
        self.log.certificate = certificate;
    }

    fn tell(&self) {
        let log = &self.log.result;
        self.progress.tell(log.iterations, log.work, self.best);
    }

    /// If `r = 0` is a solution, iterations shrink the reactions until the end of the range of
    /// doubles, and η, which is relative to them, stays large. Far below the other
    /// displacements, the point `r = 0` is checked instead.
    fn check_zero(&mut self, r: &[[f64; D]], a: &[f64]) -> Option<Certificate<D>> {
        /// In scaled variables, where displacements of contacts are of order one.
        const NONE: f64 = 1e-100;
        let size = self.problem.scaling.reaction_norm(r);
        if size == 0.0 || size > NONE {
            return None;
        }
        let nothing = Certificate::new(self.problem, &vec![[0.0; D]; r.len()], a);
        self.log.result.work += 2.0;
        nothing.converged(self.settings.tol).then_some(nothing)
    }

    /// Measures the rounding floor at `(r, a)`, for a residual that has stopped decreasing.
    pub fn measure_floor(&mut self, r: &[[f64; D]], a: &[f64]) {
        self.floor = Certificate::new(self.problem, r, a).floor;
        self.log.result.work += 2.0;
    }

    pub fn floor(&self) -> f64 {
        self.floor
    }

    /// The largest rigid motion so far: it grows without bound if a body slides away.
    pub fn furthest_rigid(&self) -> &[f64] {
        &self.furthest_rigid
    }

    /// Ends the solve: this motion proves that no reactions balance the loads.
    pub fn exclude_reactions(&mut self, motion: Vec<f64>) -> Ended {
        self.log.result.free_motion = motion;
        Ended::Stopped(Outcome::NoEquilibrium)
    }

    /// Ends the solve: no statuses of the contacts are a solution.
    pub fn exhaust_statuses(&mut self) -> Ended {
        self.log.result.statuses_tried = enumerate::statuses(&self.problem.law);
        Ended::Stopped(Outcome::NoEquilibrium)
    }

    pub fn seconds_left(&self) -> f64 {
        self.settings.max_seconds - self.started.elapsed().as_secs_f64()
    }

    fn check_limits(&self) -> Result<(), Ended> {
        Err(Ended::Stopped(
            if self.log.result.iterations >= self.settings.max_iterations {
                Outcome::IterationLimit
            } else if self.settings.max_seconds.is_finite() && self.seconds_left() < 0.0 {
                Outcome::TimeLimit
            } else if self.log.result.iterations > self.last_better + tuning::monitor_patience() {
                Outcome::Stalled
            } else {
                return Ok(());
            },
        ))
    }

    pub fn into_log(mut self) -> Log<D> {
        self.log.result.seconds = self.started.elapsed().as_secs_f64();
        self.log
    }
}

/// Whether rigid bodies with these reactions can stay where they are: `q` is zero where contacts press,
/// and closes no other. A motion would be rounding, as large as all displacements of closed contacts.
fn rests<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> bool {
    let mut contacts = r.iter().zip(&problem.q).zip(&problem.law);
    contacts.all(|((r, q), law)| {
        q.iter().all(|&q| q == 0.0) || r.iter().all(|&r| r == 0.0) && law.opening(q) >= 0.0
    })
}

/// The projection of a candidate solution onto the cones. A large μ hides from η how far outside the
/// cones a point is: a little more pressure suffices. With cohesion an open contact has no pressure
/// at all, not even the rest of an iteration.
fn within_cones<'r, const D: usize>(
    problem: &Reduced<D>,
    r: &'r [[f64; D]],
    v: &[[f64; D]],
) -> Cow<'r, [[f64; D]]> {
    /// Largest distance of sliding contacts from the boundary of the cone that is due to
    /// rounding.
    const RIM: f64 = 1e-12;
    let scaling = &problem.scaling;
    let inside = |i: usize| {
        let (law, mut within) = (problem.law[i], r[i]);
        let rho = scaling.to_v[i] / scaling.to_r[i];
        if law.cohesion > 0.0 && law_step(&r[i], &v[i], rho, law).1 == Status::Open {
            // Not onto C, which would press it again.
            let share = (law.cohesion / tangential_norm(&within)).min(1.0);
            within = within.map(|c| share * c);
            within[0] = 0.0;
        } else if tangential_norm(&within) > law.limit(within[0]) * (1.0 + RIM) || within[0] < 0.0 {
            within = project(&within, law).0;
        }
        within
    };
    #[expect(clippy::float_cmp, reason = "a reaction inside keeps its bits")]
    let moves = |&i: &usize| inside(i) != r[i];
    let Some(first) = (0..r.len()).find(moves) else {
        return Cow::Borrowed(r);
    };
    let mut within = r.to_vec();
    (first..r.len()).for_each(|i| within[i] = inside(i));
    Cow::Owned(within)
}
