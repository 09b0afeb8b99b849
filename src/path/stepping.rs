//! The load path, (21)–(23): one reduced problem for each step. `q` contains the slip of the
//! last step. The state changes only after a step has converged.

use std::sync::atomic::AtomicBool;

use crate::condensation::bodies::Loaded;
use crate::condensation::body::{DIGITS, drop_rounding};
use crate::condensation::condense::Condensed;
use crate::error::Error;
use crate::law::cone::Status;
use crate::reduced::existence;
use crate::reduced::reduced::Reduced;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::newton::refine::{RefinedPoint, forward_change};
use crate::solver::{self, Outcome, Settings, Solution, Start};

/// The state after a step.
#[derive(Clone, Debug, Default)]
pub struct State<const D: usize> {
    pub reaction: Vec<[f64; D]>,
    /// Total, `B u + gap`.
    pub relative_displacement: Vec<[f64; D]>,
    pub status: Vec<Status>,
    pub rigid: Vec<f64>,
}

impl<const D: usize> State<D> {
    /// The state after a step with this solution, whose relative displacement is the total one.
    pub fn after(solution: &Solution<D>) -> Self {
        Self {
            reaction: solution.reaction.clone(),
            relative_displacement: solution.relative_displacement.clone(),
            status: solution.status.clone(),
            rigid: solution.rigid_motion.clone(),
        }
    }
}

/// A load path in progress. Without a state it starts from the unloaded body.
#[derive(Clone, Debug, Default)]
pub struct LoadPath<const D: usize> {
    state: Option<State<D>>,
}

/// A step, converged or not.
#[derive(Clone, Debug)]
pub struct Step<const D: usize> {
    /// `relative_displacement` is the total one.
    pub solution: Solution<D>,
    /// Increment of the tangential part in the step; components `(t1[, t2])` have the indices 1
    /// and up.
    pub slip: Vec<[f64; D]>,
}

/// `q` of a step: the total free displacement minus the earlier slip, (22).
pub fn incremental<const D: usize>(q: &[[f64; D]], state: Option<&State<D>>) -> Vec<[f64; D]> {
    let mut q = q.to_vec();
    if let Some(state) = state {
        for (free, before) in q.iter_mut().zip(&state.relative_displacement) {
            for k in 1..D {
                free[k] -= before[k];
            }
        }
    }
    q
}

/// The total relative displacement after a step, from its `v`: the inverse of [`incremental`].
pub fn total<const D: usize>(v: &[[f64; D]], state: Option<&State<D>>) -> Vec<[f64; D]> {
    let mut total = v.to_vec();
    if let Some(state) = state {
        for (v, before) in total.iter_mut().zip(&state.relative_displacement) {
            for k in 1..D {
                v[k] += before[k];
            }
        }
    }
    total
}

/// `v` of a step from the total one as in (22), and the rounding of the subtraction.
pub fn increment<const D: usize>(
    total: &[[f64; D]],
    state: Option<&State<D>>,
) -> (Vec<[f64; D]>, Vec<[f64; D]>) {
    let v = incremental(total, state);
    let mut rounding = vec![[0.0; D]; v.len()];
    if state.is_some() {
        for (error, v) in rounding.iter_mut().zip(&v) {
            for k in 1..D {
                error[k] = f64::EPSILON * v[k].abs();
            }
        }
    }
    (v, rounding)
}

/// The reduced problem of a step to the total loads. `state` has the relative displacement
/// after the step before.
pub fn reduced_step<'a, const D: usize>(
    problem: &'a Condensed<D>,
    load: &[f64],
    prescribed: &[f64],
    state: Option<&State<D>>,
) -> Result<Reduced<'a, D>, Error> {
    let free = problem.free_part(load, prescribed)?;
    let q = incremental(&free.q, state);
    Reduced::new(problem.compliance(), &q, problem.law(), &free.rigid)
}

/// The problem without loads on rigid motions that are rounding; `None` if there are none.
fn without_rounding<'a, const D: usize>(
    problem: &'a Condensed<D>,
    reduced: &Reduced<'a, D>,
    load: &[f64],
    prescribed: &[f64],
) -> Result<Option<Reduced<'a, D>>, Error> {
    if reduced.rigid.load.iter().all(|&e| e == 0.0) {
        return Ok(None);
    }
    let rounding = if reduced.load_rounding.is_empty() {
        problem.bodies().load_rounding(load, prescribed)?
    } else {
        reduced.load_rounding.clone()
    };
    let mut kept = reduced.rigid.load.clone();
    if !drop_rounding(&mut kept, &rounding) {
        return Ok(None);
    }
    let mut without = reduced.with_load(kept);
    without.load_rounding = rounding;
    Ok(Some(without))
}

/// Relative changes of the reactions and the relative displacements of a step by the rounding
/// of the entries of `K`; zero for a problem that keeps its digits. `before` is as in
/// [`forward_error`](crate::solver::newton::refine::forward_error).
pub fn stiffness_rounding<const D: usize>(
    problem: &Condensed<D>,
    reduced: &Reduced<D>,
    (load, prescribed): (&[f64], &[f64]),
    point: &RefinedPoint<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<(f64, f64), Error> {
    if problem.stats().amplification <= DIGITS {
        return Ok((0.0, 0.0));
    }
    let compliance = problem.compliance();
    let u = problem.displacement(Loaded {
        load,
        prescribed,
        reaction: &compliance.scatter(&point.at.r),
        rigid: &point.at.rigid,
    })?;
    let samples = problem.bodies().stiffness_rounding(problem.surface(), &u)?;
    let wanders: Vec<_> = samples
        .iter()
        .map(|(v, e)| (compliance.gather(v), reduced.scaling.scale_load(e)))
        .collect();
    let moved = forward_change(reduced, point, &wanders, before, stop)?;
    // If the correction is not determined, no digit is known to be correct.
    Ok(moved.unwrap_or((1.0, 1.0)))
}

/// `v` of reactions, computed with `u` and `K`, because `W` may have lost digits.
pub fn evaluate<const D: usize>(
    problem: &Condensed<D>,
    reduced: &Reduced<D>,
    (load, prescribed): (&[f64], &[f64]),
    state: Option<&State<D>>,
    r: Vec<[f64; D]>,
    rigid: Vec<f64>,
) -> Result<RefinedPoint<D>, Error> {
    let compliance = problem.compliance();
    let total = problem.relative_displacement(Loaded {
        load,
        prescribed,
        reaction: &compliance.scatter(&r),
        rigid: &rigid,
    })?;
    let v = compliance.gather(&incremental(&total, state));
    Ok(RefinedPoint::new(reduced, EvaluatedPoint { r, v, rigid }))
}

impl<const D: usize> LoadPath<D> {
    /// Starts from a state, or from the unloaded bodies.
    pub fn new(state: Option<State<D>>) -> Self {
        Self { state }
    }

    /// The state of the path.
    pub fn into_state(self) -> Option<State<D>> {
        self.state
    }

    /// Makes a step to the total loads; the state changes only if it converges.
    ///
    /// # Errors
    /// Wrong loads, [`Error::ContradictoryContact`], [`Error::Interrupted`]. The state does not
    /// change then.
    pub fn advance(
        &mut self,
        problem: &Condensed<D>,
        load: &[f64],
        prescribed: &[f64],
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Step<D>, Error> {
        let mut reduced = reduced_step(problem, load, prescribed, self.state.as_ref())?;
        let compliance = problem.compliance();
        if let Some((node, penetration)) = reduced.contradiction {
            return Err(Error::ContradictoryContact { node, penetration });
        }
        let start = self
            .state
            .as_ref()
            .map_or_else(Start::default, |state| Start {
                reaction: compliance.gather(&state.reaction),
                rigid: state.rigid.clone(),
                closed: compliance
                    .gather(&state.status)
                    .iter()
                    .map(|&s| s != Status::Open)
                    .collect(),
            });
        let mut solution = solver::solve(&reduced, settings, &start, stop)?;
        if solution.outcome == Outcome::NoEquilibrium && !solution.free_motion.is_empty() {
            // The combination of work on several motions has the rounding of each.
            reduced.load_rounding = problem.bodies().load_rounding(load, prescribed)?;
            if !existence::works(&reduced, &solution.free_motion) {
                solution.outcome = Outcome::Stalled;
            }
        }
        if solution.outcome == Outcome::Stalled
            && let Some(without) = without_rounding(problem, &reduced, load, prescribed)?
        {
            let again = solver::solve(&without, settings, &start, stop)?;
            if again.outcome == Outcome::Converged {
                (reduced, solution) = (without, again);
            }
        }
        let doubtful = problem.stats().amplification > DIGITS;
        if solution.outcome == Outcome::Converged && doubtful {
            let loads = (load, prescribed);
            let state = self.state.as_ref();
            let evaluate = |r, rigid| evaluate(problem, &reduced, loads, state, r, rigid);
            match solution.refine(&reduced, settings, evaluate, stop) {
                // K itself has too few digits for these loads.
                Err(Error::NotBalanced { .. }) => solution.outcome = Outcome::Stalled,
                other => other?,
            }
        }
        let slip = solution.relative_displacement;
        solution.relative_displacement = total(&slip, self.state.as_ref());
        if solution.outcome == Outcome::Converged {
            self.state = Some(State::after(&solution));
        }
        Ok(Step { solution, slip })
    }
}
