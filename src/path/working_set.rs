//! The load path on a working set of the candidates. The set grows in each step until no
//! contact outside penetrates. The solution is then one for all candidates, because an open
//! contact with `v_n ≥ 0` satisfies the law with `r = 0`.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::condensation::bodies::Loaded;
use crate::condensation::candidates::{Candidates, View};
use crate::condensation::problem::Problem;
use crate::error::Error;
use crate::law::cone::Status;
use crate::path::stepping::{LoadPath, State, Step, incremental};
use crate::path::tuning;
use crate::solver::{Outcome, Settings, Solution};

/// The working set of a step. With it and the state, another path continues bitwise equally.
#[derive(Clone, Debug, Default)]
pub struct Set {
    /// Contacts, ascending.
    pub members: Vec<usize>,
    /// Rigid motions in the amounts of the bodies condensed onto all contacts; empty if they
    /// are those of the state.
    pub motion: Vec<f64>,
    /// Whether the inverse of their `W` has been made, so that its cost is not counted again.
    pub inverse: bool,
}

/// A load path in progress, with all candidates.
#[derive(Clone, Debug, Default)]
pub struct WorkingSetPath<const D: usize> {
    /// Rigid motions in the amounts of the bodies of the candidates.
    state: Option<State<D>>,
    view: Option<View<D>>,
    /// The same rigid motions in the amounts of the bodies of the view, if these differ.
    carried: Option<Vec<f64>>,
    /// The initial set, if another path gives one.
    first: Option<Set>,
}

impl<const D: usize> WorkingSetPath<D> {
    /// Starts from a state and its working set, or from the unloaded bodies.
    pub fn new(state: Option<State<D>>, first: Option<Set>) -> Self {
        Self {
            state,
            view: None,
            carried: None,
            first,
        }
    }

    /// Rounds the state as if the caller had stored and returned it.
    pub fn restate(&mut self, change: impl FnOnce(&mut State<D>)) {
        if let Some(state) = &mut self.state {
            change(state);
        }
    }

    /// The working set of the last step; `None` if it was all contacts from the start.
    pub fn set(&self) -> Option<Set> {
        self.view.as_ref().map(|view| Set {
            members: view.members.clone(),
            motion: self.carried.clone().unwrap_or_default(),
            inverse: view.problem.compliance().inverse_known() == Some(true),
        })
    }

    /// Makes a step to the total loads; the state changes only if it converges.
    pub fn advance(
        &mut self,
        problem: &Problem<D>,
        load: &[f64],
        prescribed: &[f64],
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Step<D>, Error> {
        let loads = (load, prescribed);
        let step = match problem {
            Problem::Whole(whole) => {
                let mut path = LoadPath::new(self.state.take());
                let step = path.advance(whole, load, prescribed, settings, stop);
                self.state = path.into_state();
                return step;
            }
            Problem::Growing { candidates, .. } => {
                self.grow(problem, candidates, loads, settings, stop)?
            }
        };
        if step.solution.outcome == Outcome::Converged {
            self.state = Some(State::after(&step.solution));
        }
        Ok(step)
    }

    /// Makes the step on views that grow until no contact outside penetrates.
    fn grow(
        &mut self,
        problem: &Problem<D>,
        candidates: &Candidates<D>,
        loads: (&[f64], &[f64]),
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Step<D>, Error> {
        let mut view = match self.view.take() {
            Some(mut view) => {
                // The view has the gaps of an earlier step.
                let gap = pick(&problem.surface().gap, &view.members);
                view.problem = view.problem.with_gap(gap);
                view
            }
            None => self.make_first_view(problem, candidates, stop)?,
        };
        let began = Instant::now();
        let mut spent = Solution::<D>::default();
        loop {
            let left = Settings {
                max_iterations: settings.max_iterations.saturating_sub(spent.iterations),
                max_seconds: (settings.max_seconds - spent.seconds).max(0.0),
                ..*settings
            };
            let (step, reaction) =
                self.step_on_view(problem, &view, loads, &left, &mut spent, stop)?;
            let (asked, total) =
                find_penetrating(problem, candidates, &view.members, &step, loads)?;
            spent.seconds = began.elapsed().as_secs_f64();
            let in_time =
                spent.seconds < settings.max_seconds && spent.iterations < settings.max_iterations;
            // If some contacts give no solution, or one that K does not confirm, all others are
            // added.
            let all_wanted = asked.is_empty()
                && view.members.len() < problem.contacts()
                && !is_settled(problem, &view.members, &step, &total);
            if in_time && (all_wanted || !asked.is_empty()) {
                view = widen(problem, candidates, &view, asked, stop)?;
                continue;
            }
            let mut step = self.spread(step, &view.members, reaction, &total, spent);
            let claims = [Outcome::Converged, Outcome::NoEquilibrium];
            if !asked.is_empty() && claims.contains(&step.solution.outcome) {
                step.solution.outcome = if spent_time(&step.solution, settings) {
                    Outcome::TimeLimit
                } else {
                    Outcome::IterationLimit
                };
            }
            self.view = Some(view);
            return Ok(step);
        }
    }

    /// The step on the members of a view, and the reactions of all contacts; its work is added to
    /// what was `spent`.
    fn step_on_view(
        &mut self,
        problem: &Problem<D>,
        view: &View<D>,
        loads: (&[f64], &[f64]),
        left: &Settings,
        spent: &mut Solution<D>,
        stop: &AtomicBool,
    ) -> Result<(Step<D>, Vec<[f64; D]>), Error> {
        let members = &view.members;
        let shared = Arc::ptr_eq(view.problem.bodies(), problem.bodies());
        let mut before = self.state.as_ref().map(|state| at(state, members));
        if let (false, Some(state)) = (shared, &mut before) {
            let start = self.carried.clone();
            let start = start.filter(|a| a.len() == state.rigid.len());
            state.rigid = start.unwrap_or_else(|| vec![0.0; state.rigid.len()]);
        }
        let mut step = LoadPath::new(before)
            .advance(&view.problem, loads.0, loads.1, left, stop)
            .map_err(|error| renumber(error, members))?;
        let solution = &mut step.solution;
        spent.iterations += solution.iterations;
        let work = spent.work;
        let history = solution.history.iter();
        let history = history.map(|&(w, eta)| (work + w, eta));
        spent.history.extend(history);
        spent.work += solution.work;
        let reaction = spread(problem.contacts(), members, &solution.reaction, [0.0; D]);
        if !shared {
            let own = std::mem::take(&mut solution.rigid_motion);
            solution.rigid_motion = amounts(problem, view, loads, &reaction, &own)?;
            self.carried = Some(own);
        }
        Ok((step, reaction))
    }

    /// The initial view, with a given set or a new one.
    fn make_first_view(
        &mut self,
        problem: &Problem<D>,
        candidates: &Candidates<D>,
        stop: &AtomicBool,
    ) -> Result<View<D>, Error> {
        let known = self.first.take().unwrap_or_else(|| Set {
            members: self.seed_members(candidates),
            ..Set::default()
        });
        let view = if known.members.len() == problem.contacts() {
            all(problem, stop)?
        } else {
            match candidates.view(known.members, problem.law(), None) {
                // The initial contacts do not resist a motion that other contacts resist.
                Err(Error::FloatingBody { .. }) => all(problem, stop)?,
                made => made?,
            }
        };
        if !known.motion.is_empty() {
            self.carried = Some(known.motion);
        }
        if known.inverse {
            let _ = view.problem.compliance().make_inverse(stop)?;
        }
        Ok(view)
    }

    /// A new set: the seeds, and the contacts closed in the state before.
    fn seed_members(&self, candidates: &Candidates<D>) -> Vec<usize> {
        let mut members = candidates.seeds().to_vec();
        if let Some(state) = &self.state {
            let closed = |&i: &usize| state.status[i] != Status::Open;
            members.extend((0..state.status.len()).filter(closed));
            members.sort_unstable();
            members.dedup();
        }
        members
    }

    /// A step of the members as one of all candidates.
    fn spread(
        &self,
        step: Step<D>,
        members: &[usize],
        reaction: Vec<[f64; D]>,
        total: &[[f64; D]],
        spent: Solution<D>,
    ) -> Step<D> {
        let contacts = total.len();
        let mut v = total.to_vec();
        for (&i, own) in members.iter().zip(&step.solution.relative_displacement) {
            v[i] = *own;
        }
        let mut slip = incremental(&v, self.state.as_ref());
        for (&i, own) in members.iter().zip(&step.slip) {
            slip[i] = *own;
        }
        let solution = step.solution;
        Step {
            slip,
            solution: Solution {
                reaction,
                relative_displacement: v,
                status: spread(contacts, members, &solution.status, Status::Open),
                opened: spread(contacts, members, &solution.opened, true),
                bipotential_gap: spread(contacts, members, &solution.bipotential_gap, 0.0),
                iterations: spent.iterations,
                seconds: spent.seconds,
                history: spent.history,
                work: spent.work,
                // Nothing is known of the displacements of other contacts along it.
                sequence: solution.sequence.filter(|_| members.len() == contacts),
                ..solution
            },
        }
    }
}

/// The problem of the contacts with a reaction, or of all contacts if `W` of all is formed.
pub fn around<const D: usize>(
    problem: &Problem<D>,
    reaction: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<View<D>, Error> {
    let carries = |&i: &usize| reaction[i].iter().any(|&r| r != 0.0);
    with(problem, (0..reaction.len()).filter(carries), stop)
}

/// The problem of some contacts and of the initial ones, or of all contacts if `W` of all is
/// formed.
pub fn with<const D: usize>(
    problem: &Problem<D>,
    contacts: impl Iterator<Item = usize>,
    stop: &AtomicBool,
) -> Result<View<D>, Error> {
    let Problem::Growing { candidates, law } = problem else {
        return all(problem, stop);
    };
    let mut members = candidates.seeds().to_vec();
    members.extend(contacts);
    members.sort_unstable();
    members.dedup();
    match candidates.view(members, law, None) {
        Err(Error::FloatingBody { .. }) => all(problem, stop),
        made => made,
    }
}

/// All candidates, with `W` of all of them.
fn all<const D: usize>(problem: &Problem<D>, stop: &AtomicBool) -> Result<View<D>, Error> {
    Ok(View {
        members: (0..problem.contacts()).collect(),
        problem: problem.whole(stop)?,
    })
}

/// A view with the contacts `asked` too; with all contacts if none is asked.
fn widen<const D: usize>(
    problem: &Problem<D>,
    candidates: &Candidates<D>,
    view: &View<D>,
    mut asked: Vec<usize>,
    stop: &AtomicBool,
) -> Result<View<D>, Error> {
    let members = &view.members;
    let none = asked.is_empty();
    asked.truncate(tuning::added_at_once().max(2 * members.len()));
    let mut members: Vec<usize> = members.iter().copied().chain(asked).collect();
    members.sort_unstable();
    if none || tuning::all_candidates_above() * members.len() >= problem.contacts() {
        all(problem, stop)
    } else {
        candidates.view(members, problem.law(), Some(view))
    }
}

/// Whether the members give a solution that K confirms, or prove that there is none.
fn is_settled<const D: usize>(
    problem: &Problem<D>,
    members: &[usize],
    step: &Step<D>,
    total: &[[f64; D]],
) -> bool {
    let solution = &step.solution;
    match solution.outcome {
        Outcome::Converged => !differs(problem, members, &solution.relative_displacement, total),
        outcome => outcome == Outcome::NoEquilibrium,
    }
}

/// Whether the relative displacements of the members with `W` differ from those with `K`.
fn differs<const D: usize>(
    problem: &Problem<D>,
    members: &[usize],
    own: &[[f64; D]],
    total: &[[f64; D]],
) -> bool {
    /// Relative to the largest terms: far above the rounding of an accurate `W`.
    const DIFFERENT: f64 = 1e-9;
    let gap = &problem.surface().gap;
    let (mut apart, mut size) = (0.0_f64, 0.0_f64);
    for (&i, own) in members.iter().zip(own) {
        for ((a, b), g) in own.iter().zip(&total[i]).zip(&gap[i]) {
            apart = apart.max((a - b).abs());
            // A sticking contact has v = 0: it has moved by u.
            size = size.max((b - g).abs()).max(g.abs());
        }
    }
    apart > DIFFERENT * size
}

/// Contacts to add after a step of the members, the worst first, and the total relative
/// displacement of all contacts.
fn find_penetrating<const D: usize>(
    problem: &Problem<D>,
    candidates: &Candidates<D>,
    members: &[usize],
    step: &Step<D>,
    (load, prescribed): (&[f64], &[f64]),
) -> Result<(Vec<usize>, Vec<[f64; D]>), Error> {
    let solution = &step.solution;
    if members.len() == problem.contacts() {
        return Ok((Vec::new(), solution.relative_displacement.clone()));
    }
    let reaction = spread(problem.contacts(), members, &solution.reaction, [0.0; D]);
    let state = Loaded {
        load,
        prescribed,
        reaction: &reaction,
        rigid: &solution.rigid_motion,
    };
    let total = problem
        .bodies()
        .relative_displacement(problem.surface(), state)?;
    let mut outside = vec![true; problem.contacts()];
    for &i in members {
        outside[i] = false;
    }
    if solution.outcome != Outcome::NoEquilibrium {
        return Ok((worst(&outside, |i| total[i][0]), total));
    }
    if solution.free_motion.is_empty() {
        // Trying all statuses of some contacts proves nothing about the others.
        return Ok((worst(&outside, |_| -1.0), total));
    }
    // A proof for all contacts, unless the motion closes some of the others.
    let d = candidates.motion(&solution.free_motion)?;
    let law = problem.law();
    let runs_into = |i: usize| {
        let slides = d[i][1..].iter().map(|t| t * t).sum::<f64>().sqrt();
        (d[i][0] - law[i].mu * slides).min(total[i][0])
    };
    Ok((worst(&outside, runs_into), total))
}

/// The rigid motions of a solution with bodies condensed onto all contacts, in the amounts of
/// the bodies of the candidates: from the difference of their displacements.
fn amounts<const D: usize>(
    problem: &Problem<D>,
    view: &View<D>,
    (load, prescribed): (&[f64], &[f64]),
    reaction: &[[f64; D]],
    own: &[f64],
) -> Result<Vec<f64>, Error> {
    let bodies = problem.bodies();
    let none = vec![0.0; own.len()];
    let with = |rigid| Loaded {
        load,
        prescribed,
        reaction,
        rigid,
    };
    if own.is_empty() {
        return Ok(none);
    }
    let u = view.problem.displacement(with(own))?;
    let still = problem.displacements(&[with(&none)])?;
    let moved: Vec<f64> = u.iter().zip(&still[0]).map(|(a, b)| a - b).collect();
    Ok(bodies
        .list
        .iter()
        .flat_map(|body| body.motion_amounts(&moved))
        .collect())
}

fn spent_time<const D: usize>(solution: &Solution<D>, settings: &Settings) -> bool {
    solution.seconds >= settings.max_seconds
}

/// The state of some contacts.
pub fn at<const D: usize>(state: &State<D>, members: &[usize]) -> State<D> {
    State {
        reaction: pick(&state.reaction, members),
        relative_displacement: pick(&state.relative_displacement, members),
        status: pick(&state.status, members),
        rigid: state.rigid.clone(),
    }
}

/// Values of some contacts; empty if there are none.
pub fn pick<T: Copy>(values: &[T], members: &[usize]) -> Vec<T> {
    members
        .iter()
        .filter_map(|&i| values.get(i).copied())
        .collect()
}

fn spread<T: Copy>(contacts: usize, members: &[usize], values: &[T], other: T) -> Vec<T> {
    let mut all = vec![other; contacts];
    for (&i, value) in members.iter().zip(values) {
        all[i] = *value;
    }
    all
}

/// Contacts with a negative number, the most negative first.
fn worst(among: &[bool], of: impl Fn(usize) -> f64) -> Vec<usize> {
    let mut found: Vec<(f64, usize)> = (0..among.len())
        .filter(|&i| among[i])
        .map(|i| (of(i), i))
        .filter(|(depth, _)| *depth < 0.0)
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, i)| i).collect()
}

fn renumber(error: Error, members: &[usize]) -> Error {
    match error {
        Error::ContradictoryContact { node, penetration } => Error::ContradictoryContact {
            node: members[node],
            penetration,
        },
        other => other,
    }
}
