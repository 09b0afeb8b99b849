//! A load path in the displacements. The state changes only after a step has converged.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::Error;
use crate::law::bipotential;
use crate::law::cone::Status;
use crate::linalg::amg::following::Following;
use crate::path::stepping::{State, Step, incremental};
use crate::primal::newton::{Begin, Errors, Newton, Reason};
use crate::primal::problem::Primal;
use crate::solver::{Outcome, Settings, Solution};

/// A load path in progress. Without a state it starts from the unloaded bodies.
#[derive(Debug, Default)]
pub struct PrimalPath<const D: usize> {
    state: Option<State<D>>,
    /// Displacements after the last step, if they are known; empty else.
    displacement: Vec<f64>,
    hierarchy: Option<Following>,
}

/// A step, with its displacements and the work that it took.
#[derive(Clone, Debug)]
pub struct PrimalStep<const D: usize> {
    pub step: Step<D>,
    pub displacement: Vec<f64>,
    pub newton: usize,
    pub krylov: usize,
    pub reason: Option<Reason>,
    /// Estimated relative errors, if it converged.
    pub errors: Option<Errors>,
    /// Memory of the largest hierarchy.
    pub bytes: usize,
}

impl<const D: usize> PrimalPath<D> {
    /// Starts from a state, or from the unloaded bodies. `displacement` are those of the
    /// state, as a start value.
    #[must_use]
    pub fn new(state: Option<State<D>>, displacement: Vec<f64>) -> Self {
        Self {
            state,
            displacement,
            hierarchy: None,
        }
    }

    /// Makes a step to the total loads; the state changes only if it converges. All steps of a
    /// path have the same bodies and contacts.
    ///
    /// # Errors
    /// Wrong loads, [`Error::ContradictoryContact`], [`Error::Interrupted`]. The state does not
    /// change then.
    pub fn advance(
        &mut self,
        problem: &Primal<D>,
        load: &[f64],
        prescribed: &[f64],
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<PrimalStep<D>, Error> {
        let started = Instant::now();
        let force = problem.force(load, prescribed)?;
        let offsets = problem.frames.offsets(&problem.gap, prescribed);
        for (node, (frame, v)) in problem.frames.list.iter().zip(&offsets).enumerate() {
            if !frame.free[0] && v[0] < 0.0 {
                let penetration = -v[0];
                return Err(Error::ContradictoryContact { node, penetration });
            }
        }
        let offset = incremental(&offsets, self.state.as_ref());
        let y = if self.displacement.is_empty() {
            vec![0.0; problem.order()]
        } else {
            problem.unknowns(&self.displacement)
        };
        let closed = self.state.as_ref().map(|state| {
            let open = state.status.iter().map(|&s| s != Status::Open);
            open.collect()
        });
        let newton = Newton::new(problem, settings, stop, self.hierarchy.take());
        let solved = newton.run(Begin {
            y,
            closed,
            force: &force,
            offset: &offset,
        })?;
        self.hierarchy = solved.hierarchy;
        let (point, judged) = (solved.point, solved.judged);
        let slip = point.v.clone();
        let mut total = point.v.clone();
        if let Some(state) = &self.state {
            for (v, before) in total.iter_mut().zip(&state.relative_displacement) {
                for k in 1..D {
                    v[k] += before[k];
                }
            }
        }
        let nodes = judged.reaction.iter().zip(&point.v).zip(&problem.mu);
        let gap = nodes.map(|((r, v), &mu)| bipotential::gap(r, v, mu));
        let status = judged.reaction.iter().zip(&judged.certificate.status);
        let status = status.map(|(r, &status)| {
            if r.iter().all(|&c| c == 0.0) {
                Status::Open
            } else {
                status
            }
        });
        #[expect(clippy::cast_precision_loss, reason = "a count of products")]
        let work = (solved.krylov + solved.newton) as f64;
        let solution = Solution {
            bipotential_gap: gap.collect(),
            status: status.collect(),
            reaction: judged.reaction.clone(),
            relative_displacement: total,
            outcome: solved.outcome,
            residual: judged.residual(),
            tolerance: judged.tolerance(settings.tol),
            floor: judged.floor(),
            iterations: solved.newton,
            work,
            history: solved.history,
            seconds: started.elapsed().as_secs_f64(),
            ..Solution::default()
        };
        let displacement = problem.displacement(&point.y, prescribed);
        if solution.outcome == Outcome::Converged {
            self.state = Some(State {
                reaction: solution.reaction.clone(),
                relative_displacement: solution.relative_displacement.clone(),
                status: solution.status.clone(),
                rigid: Vec::new(),
            });
            self.displacement.clone_from(&displacement);
        }
        Ok(PrimalStep {
            step: Step { solution, slip },
            displacement,
            newton: solved.newton,
            krylov: solved.krylov,
            reason: solved.reason,
            errors: solved.errors,
            bytes: solved.bytes,
        })
    }
}
