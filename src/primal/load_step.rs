//! One load step in the displacements, by any engine.

use std::time::Instant;

use crate::error::Error;
use crate::law::bipotential;
use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::path::stepping::{State, Step, incremental};
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
        (solution.outcome == Outcome::Converged).then(|| State {
            reaction: solution.reaction.clone(),
            relative_displacement: solution.relative_displacement.clone(),
            status: solution.status.clone(),
            rigid: Vec::new(),
        })
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
    let mut total = point.v.clone();
    if let Some(state) = start.state {
        for (v, before) in total.iter_mut().zip(&state.relative_displacement) {
            for k in 1..D {
                v[k] += before[k];
            }
        }
    }
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
        relative_displacement: total,
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

/// The load step once more, where its statuses did not settle: with linear systems that are solved
/// well, which soft bodies beside stiff ones need, and if that is not enough with friction that
/// grows from none to that of the law, each share from the solution of the last one. What
/// `stalled` if that fails too.
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
    let (mut reached, mut increment) = (None, 1.0);
    loop {
        let share = f64::min(reached.unwrap_or(0.0) + increment, 1.0);
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
        let mut solved = Newton::new(engine, &part, &left).run(begin(y.clone(), !whole))?;
        newton += solved.newton;
        krylov += solved.krylov;
        let settled = solved.outcome == Outcome::Converged;
        if settled && !whole {
            y = solved.point.y;
            increment = reached.map_or(tuning::first_share(), |_| 2.0 * increment);
            reached = Some(share);
        } else if solved.outcome == Outcome::Stalled && reached.is_none() && increment > 0.0 {
            increment = 0.0;
        } else if solved.outcome == Outcome::Stalled
            && reached.is_some()
            && increment > tuning::least_share()
        {
            increment *= 0.25;
        } else {
            if solved.outcome == Outcome::Stalled {
                solved = stalled;
            }
            return Ok(SolvedStep {
                newton,
                krylov,
                ..solved
            });
        }
    }
}
