//! The default method: rounds of stages. Gauss–Seidel sweeps find the statuses, Newton finds the
//! digits; the stages that follow are for problems where these two fail.
//!
//! | stage | in rounds: supported, floating, many | gives up | next |
//! |---|---|---|---|
//! | sweeps | all | after 5 or one that changes no status, 20, 40, … 1280 sweeps, or the cost of two Newton steps | the point |
//! | Newton | all | 40 steps, or no decrease in a step | the point, if better |
//! | no reactions | –, 2, 2 if nothing loads floating bodies | | the motion that opens all contacts |
//! | start from zero | –, 2, 2 if floating | | the point zero, once |
//! | all statuses | 3, 3, – | more than 6 contacts, or not plane | the answer, or the proof that there is none |
//! | proximal points | from 2, from 3, from 1 | 60 outer steps | the point, if much better |
//! | convex | 2, 2, 1 | not the law of a potential (β = μ), or W not symmetric | the point, if much better |
//! | interior point | from 5, from 6, from 1 | 260 steps a path, each path once | the point, without sweeps |
//!
//! With cohesion or dilatancy there are no statuses to try and no interior points.
//! After the first round of floating bodies statics is asked: a proof that no reactions balance
//! the loads ends the method.
//!
//! *Floating* are bodies that only contact holds; *many* contacts have a sparse `W`. Any stage
//! ends the method at a solution or a limit of the caller: the monitor checks each point. If the
//! rounds improve nothing for 5000 iterations, [`solve`](crate::solver::solve::solve) tries the
//! statuses of all plane contacts that can be enumerated (`fallback.rs`).
//!
//! Decisions count work in products with `W`, not time, so that runs repeat bit for bit.

use crate::reduced::best_motion::best_motion;
use crate::reduced::reduced::Reduced;
use crate::solver::associated;
use crate::solver::at_rest;
use crate::solver::auto::Turn::{From, Never, Once};
use crate::solver::enumerate;
use crate::solver::gauss_seidel::{GaussSeidelPoint, Sweeper};
use crate::solver::interior;
use crate::solver::monitor::Monitor;
use crate::solver::newton::compliance_form::Solved;
use crate::solver::newton::newton;
use crate::solver::outcome::Ended;
use crate::solver::proximal;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// The rounds of a stage.
#[derive(Clone, Copy, Debug)]
enum Turn {
    Never,
    Once(usize),
    From(usize),
}

impl Turn {
    fn comes(self, round: usize) -> bool {
        match self {
            Never => false,
            Once(only) => round == only,
            From(first) => round >= first,
        }
    }
}

/// Runs until the monitor stops it.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    let mut chain = Chain::new(problem, start, monitor)?;
    let floats = !problem.rigid.modes.is_empty();
    let column = if chain.many { 2 } else { usize::from(floats) };
    for round in 1.. {
        for (stage, turns) in Chain::STAGES {
            if turns[column].comes(round) {
                stage(&mut chain, monitor)?;
            }
        }
        if floats && round == 1 {
            // Without balanced reactions each further round would be in vain.
            let _ = at_rest::ask(problem, monitor, monitor.seconds_left())?;
        }
        chain.end_round();
    }
    Ok(())
}

/// What the stages pass on.
struct Chain<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    start: &'p Start<D>,
    sweeper: Sweeper<'p, D>,
    point: GaussSeidelPoint<D>,
    /// Sweeps of this round, and of the next one with sweeps.
    sweeps: usize,
    next_sweeps: usize,
    /// Attempts with proximal points so far, and the next interior-point path.
    attempts: usize,
    path: usize,
    /// Whether a programme or an interior-point path has given the point.
    resumed: bool,
    /// Whether Newton steps take so long that the other stages come first.
    many: bool,
}

/// What a stage does with the point of the chain.
type Stage<'p, const D: usize> = fn(&mut Chain<'p, D>, &mut Monitor<D>) -> Result<(), Ended>;

impl<'p, const D: usize> Chain<'p, D> {
    /// The stages of a round in their order; rounds for supported bodies, for floating ones, and for
    /// many contacts. The median / mean number of products to η = 1e-10 on the sets of
    /// `benches/problems.py`, seeds 0–149:
    ///
    /// | proximal points from round | held | floating | rigid, unsolved |
    /// |---|---|---|---|
    /// | 1 | 16 / 39 | 31 / 149 | 1 of 150 |
    /// | 2 | 16 / 30 | 31 / 122 | 0 |
    /// | 3 | 16 / 30 | 31 / 84 | 2 |
    /// | never | 16 / 30 | 31 / 46 | 30 |
    const STAGES: [(Stage<'p, D>, [Turn; 3]); 8] = [
        (Self::sweep, [From(1), From(1), From(1)]),
        (Self::make_newton_steps, [From(1), From(1), From(1)]),
        (Self::open_all, [Never, Once(2), Once(2)]),
        (Self::start_from_zero, [Never, Once(2), Once(2)]),
        (Self::try_statuses, [Once(3), Once(3), Never]),
        (Self::move_proximal_points, [From(2), From(3), From(1)]),
        (Self::solve_convex, [Once(2), Once(2), Once(1)]),
        (Self::follow_interior_path, [From(5), From(6), From(1)]),
    ];

    fn new(
        problem: &'p Reduced<'p, D>,
        start: &'p Start<D>,
        monitor: &mut Monitor<D>,
    ) -> Result<Self, Ended> {
        let sweeper = Sweeper::new(problem, start);
        let mut point = sweeper.start(start, monitor);
        let _ = sweeper.look(&point, monitor, false)?;
        if !start.closed.is_empty() {
            // In a load step, closed contacts start as sticking and open contacts as open. Most
            // of them keep this status, and of several solutions the path keeps its own.
            let closed = |node: usize| start.closed[node];
            if let Some(held) = newton::held_at(problem, closed, monitor)? {
                point = sweeper.point(held.r, &held.rigid);
                monitor.count(1.0);
                let _ = sweeper.look(&point, monitor, true)?;
            }
        }
        let whole = problem.compliance.whole();
        Ok(Self {
            problem,
            start,
            sweeper,
            point,
            // With a start value, Newton comes first.
            sweeps: if start.reaction.is_empty() {
                tuning::first_sweeps()
            } else {
                0
            },
            next_sweeps: tuning::next_sweeps(),
            attempts: 0,
            path: 0,
            resumed: false,
            many: problem.contacts() >= tuning::many_contacts()
                && whole.is_ok_and(|whole| whole.is_some()),
        })
    }

    /// The sweeps of a round. Before the first Newton attempt they end once statuses have
    /// settled, which Newton's method needs and digits it finds faster, but are worth at least two
    /// Newton steps.
    fn sweep(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        let first = self.next_sweeps == tuning::next_sweeps();
        self.sweeper
            .run(&mut self.point, monitor, self.sweeps, first)?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small cost"
        )]
        let whole = |cost: f64| cost as usize;
        if self.sweeps == 0 || whole(newton::most_step_cost(self.problem)) <= self.sweeps {
            return Ok(());
        }
        let step = whole(newton::step_cost(self.problem, &self.sweeper.law(&self.point)).0);
        if step > self.sweeps {
            let more = step.saturating_mul(2) - self.sweeps;
            self.sweeper.run(&mut self.point, monitor, more, false)?;
        }
        Ok(())
    }

    fn make_newton_steps(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        let rigid = self.sweeper.rigid_motion(&self.point);
        if let Some(better) = newton::run(self.problem, &self.point.r, &rigid, monitor)? {
            self.take_if_better(better);
        }
        Ok(())
    }

    /// Nothing presses floating bodies without loads: reactions of zero are a solution with any
    /// motion that leaves no penetration. An iteration would have to find the border of where
    /// these motions begin, at which pressures vanish.
    fn open_all(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        if self.problem.rigid.load.iter().any(|&e| e != 0.0) {
            return Ok(());
        }
        let nothing = vec![[0.0; D]; self.problem.contacts()];
        let motion = best_motion(self.problem, &nothing);
        monitor.look_at(&nothing, &motion, true)
    }

    /// The bilateral start of floating bodies may be near a minimum of the merit that is no
    /// solution.
    #[expect(clippy::unnecessary_wraps, reason = "it is a stage")]
    fn start_from_zero(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        if !self.problem.rigid.modes.is_empty() && self.start.closed.is_empty() {
            self.point = self.sweeper.start(&Start::default(), monitor);
        }
        Ok(())
    }

    /// All statuses of a few plane contacts: a solution or a proof that there is none ends the
    /// method.
    fn try_statuses(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        let problem = self.problem;
        if problem.contacts() > tuning::few_contacts() {
            return Ok(());
        }
        let Some(few) = enumerate::few(problem, monitor.stop())? else {
            return Ok(());
        };
        if few.proves_none(problem) {
            return Err(monitor.exhaust_statuses());
        }
        for (r, rigid) in few.answers {
            monitor.look_at(&r, &rigid, true)?;
        }
        Ok(())
    }

    fn move_proximal_points(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        // Many contacts: half of the steps that they need themselves; between two interior-point
        // paths more, because they then complete most attempts.
        let most = match (self.many, self.attempts) {
            (true, 0) => tuning::steps_before_interior(),
            (true, _) => tuning::steps_after_interior(),
            (false, _) => usize::MAX,
        };
        let rigid = self.sweeper.rigid_motion(&self.point);
        let attempt = (self.attempts, most);
        let end = proximal::run(self.problem, &self.point.r, &rigid, monitor, attempt)?;
        self.attempts += 1;
        self.take_if_better(end);
        Ok(())
    }

    fn solve_convex(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        if let Some(end) = associated::solve(self.problem, monitor)? {
            let end = self.sweeper.point(end.r, &end.rigid);
            let _ = self.sweeper.look(&end, monitor, true)?;
            if self.sweeper.residual(&end) < self.sweeper.residual(&self.point) {
                (self.point, self.resumed) = (end, true);
            }
        }
        Ok(())
    }

    /// Continues from its end for any η: if it was lost there, no later point helps.
    fn follow_interior_path(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        if !enumerate::is_coulomb(self.problem) {
            return Ok(()); // its cone is Coulomb's
        }
        if let Some(end) = interior::run(self.problem, &mut self.path, monitor)? {
            self.point = self.sweeper.point(end.r, &end.rigid);
            self.resumed = true;
        }
        Ok(())
    }

    /// Continues from the result of another method if this has reduced η enough. Otherwise
    /// sweeps that were about to find the statuses would lose them.
    fn take_if_better(&mut self, end: Solved<D>) {
        let end = self.sweeper.point(end.r, &end.rigid);
        if self.sweeper.residual(&end) <= tuning::gain() * self.sweeper.residual(&self.point) {
            self.point = end;
        }
    }

    fn end_round(&mut self) {
        if std::mem::take(&mut self.resumed) {
            self.sweeps = 0;
        } else {
            self.sweeps = self.next_sweeps;
            self.next_sweeps = (2 * self.next_sweeps).min(tuning::most_sweeps());
        }
    }
}
