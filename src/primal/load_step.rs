//! One load step in the displacements, by any engine.

use std::time::Instant;

use crate::error::Error;
use crate::law::bipotential;
use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::path::stepping::{State, Step, incremental, total};
use crate::primal::certificate::contacts_alone;
use crate::primal::contacts::Contacts;
use crate::primal::engine::Engine;
use crate::primal::newton::{Begin, Errors, Newton, Reason, SolvedStep};
use crate::primal::tuning;
use crate::solver::{Outcome, Settings, Solution};

/// Where a load step starts.
#[derive(Debug)]
pub struct Start<'a, V, const D: usize> {
    /// `None` for the unloaded bodies.
    pub state: Option<&'a State<D>>,
    /// The unknowns of that state, as a start value.
    pub y: V,
    /// Whether these unknowns are near the solution, so that they have its statuses.
    pub near: bool,
    /// As in [`Begin`].
    pub draft: bool,
}

/// A load step, converged or not, with the work that it took.
#[derive(Debug)]
pub struct Made<V, const D: usize> {
    pub step: Step<D>,
    /// The unknowns at its end.
    pub y: V,
    pub newton: usize,
    pub krylov: usize,
    pub reason: Option<Reason>,
    /// Estimated relative errors, if it converged and no motion is free.
    pub errors: Option<Errors>,
}

impl<V, const D: usize> Made<V, D> {
    /// The state after the step, if it converged.
    pub fn state(&self) -> Option<State<D>> {
        let solution = &self.step.solution;
        (solution.outcome == Outcome::Converged).then(|| State::after(solution))
    }
}

/// Makes a step to the total loads: `force` are those of the free unknowns.
pub fn advance<const D: usize, E: Engine<D>>(
    engine: &mut E,
    contacts: &Contacts<D>,
    start: Start<'_, E::Vector, D>,
    (force, prescribed): (&E::Vector, &[f64]),
    settings: &Settings,
) -> Result<Made<E::Vector, D>, E::Error> {
    let started = Instant::now();
    let offsets = contacts.frames.offsets(&contacts.gap, prescribed);
    for (node, (frame, v)) in contacts.frames.list.iter().zip(&offsets).enumerate() {
        if !frame.free[0] && v[0] < 0.0 {
            let penetration = -v[0];
            return Err(Error::ContradictoryContact { node, penetration }.into());
        }
    }
    let offset = incremental(&offsets, start.state);
    let closed = start.state.map(|state| {
        let open = state.status.iter().map(|&s| s != Status::Open);
        open.collect()
    });
    let begin = Begin {
        y: start.y,
        near: start.near,
        draft: start.draft,
        careful: false,
        closed,
        force,
        offset: &offset,
    };
    let mut solved = Newton::new(engine, contacts, settings).run(begin)?;
    if solved.reason == Some(Reason::Statuses) {
        let begin = |y, draft| Begin {
            y,
            near: true,
            draft: draft || start.draft,
            careful: true,
            closed: None,
            force,
            offset: &offset,
        };
        solved = settle_statuses(engine, contacts, solved, begin, settings)?;
    }
    let (point, judged) = (solved.point, solved.judged);
    let nodes = judged.reaction.iter().zip(&point.v).zip(&contacts.law);
    let gap = nodes.map(|((r, v), law)| bipotential::gap(r, v, *law));
    let status = judged.reaction.iter().zip(&judged.certificate.status);
    let status = status.map(|(r, &status)| {
        if r.iter().all(|&c| c == 0.0) {
            Status::Open
        } else {
            status
        }
    });
    let reduced = contacts_alone(contacts, &judged.reaction, &point.v)?;
    let opened = (judged.certificate).opened(&reduced, settings.tol);
    #[expect(clippy::cast_precision_loss, reason = "a count of products")]
    let work = (solved.krylov + solved.newton) as f64;
    let solution = Solution {
        bipotential_gap: gap.collect(),
        status: status.collect(),
        opened,
        residual: judged.residual(),
        tolerance: judged.tolerance(settings.tol),
        floor: judged.floor(),
        reaction: judged.reaction,
        relative_displacement: total(&point.v, start.state),
        outcome: solved.outcome,
        iterations: solved.newton,
        work,
        history: solved.history,
        seconds: started.elapsed().as_secs_f64(),
        ..Solution::default()
    };
    Ok(Made {
        step: Step {
            solution,
            slip: point.v,
        },
        y: point.y,
        newton: solved.newton,
        krylov: solved.krylov,
        reason: solved.reason,
        errors: solved.errors,
    })
}

/// What is tried where the statuses of a load step do not settle.
#[derive(Clone, Copy)]
enum Phase {
    /// The law itself, with linear systems that are solved well, which soft bodies beside stiff ones
    /// need.
    Careful,
    Frictionless,
    /// More than a share of the friction of the law, from its solution.
    Growing {
        reached: f64,
        increment: f64,
    },
}

impl Phase {
    fn share(self) -> f64 {
        match self {
            Self::Careful => 1.0,
            Self::Frictionless => 0.0,
            Self::Growing { reached, increment } => f64::min(reached + increment, 1.0),
        }
    }

    fn next(self, outcome: Outcome) -> Option<Self> {
        let reached = self.share();
        let growing = |reached, increment| Some(Self::Growing { reached, increment });
        match (self, outcome) {
            (_, Outcome::Converged) if reached >= 1.0 => None,
            (Self::Growing { increment, .. }, Outcome::Converged) => {
                growing(reached, 2.0 * increment)
            }
            (_, Outcome::Converged) => growing(reached, tuning::first_share()),
            (Self::Careful, Outcome::Stalled) => Some(Self::Frictionless),
            (Self::Growing { reached, increment }, Outcome::Stalled)
                if increment > tuning::least_share() =>
            {
                growing(reached, 0.25 * increment)
            }
            _ => None,
        }
    }
}

/// The load step once more, by phases. What `stalled` if they stall too.
fn settle_statuses<'a, const D: usize, E: Engine<D>>(
    engine: &mut E,
    contacts: &Contacts<D>,
    stalled: SolvedStep<E::Vector, D>,
    begin: impl Fn(E::Vector, bool) -> Begin<'a, E::Vector, D>,
    settings: &Settings,
) -> Result<SolvedStep<E::Vector, D>, E::Error>
where
    E::Vector: 'a,
{
    let started = Instant::now();
    let (mut newton, mut krylov) = (stalled.newton, stalled.krylov);
    let mut y = stalled.point.y.clone();
    let mut phase = Phase::Careful;
    loop {
        let share = phase.share();
        let law = contacts.law.iter().map(|law| ContactLaw {
            mu: share * law.mu,
            dilatancy: share * law.dilatancy,
            ..*law
        });
        let part = Contacts {
            law: law.collect(),
            ..contacts.clone()
        };
        let whole = share >= 1.0;
        let least = if whole {
            0.0
        } else {
            tuning::tolerance_of_share()
        };
        let left = Settings {
            tol: settings.tol.max(least),
            max_iterations: settings.max_iterations.saturating_sub(newton),
            max_seconds: settings.max_seconds - started.elapsed().as_secs_f64(),
            ..*settings
        };
        let solved = Newton::new(engine, &part, &left).run(begin(y.clone(), !whole))?;
        newton += solved.newton;
        krylov += solved.krylov;
        let Some(next) = phase.next(solved.outcome) else {
            let last = if solved.outcome == Outcome::Stalled {
                stalled
            } else {
                solved
            };
            return Ok(SolvedStep {
                newton,
                krylov,
                ..last
            });
        };
        if solved.outcome == Outcome::Converged {
            y = solved.point.y;
        }
        phase = next;
    }
}
