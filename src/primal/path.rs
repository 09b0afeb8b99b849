//! A load path in the displacements on one machine. The state changes only after a step has converged.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::following::Following;
use crate::path::stepping::State;
use crate::primal::load_step::{Made, Start, advance};
use crate::primal::local::Local;
use crate::primal::problem::Primal;
use crate::solver::Settings;

/// A load path in progress. Without a state it starts from the unloaded bodies.
#[derive(Debug, Default)]
pub struct PrimalPath<const D: usize> {
    state: Option<State<D>>,
    /// The state before the last step that converged.
    before: Option<State<D>>,
    /// Whether the last step is made once more.
    again: bool,
    /// Whether the errors of the next steps are not estimated.
    pub draft: bool,
    /// Displacements after the last step, if they are known; empty else.
    displacement: Vec<f64>,
    hierarchy: Option<Following>,
}

/// A step, with its displacements.
#[derive(Debug)]
pub struct PrimalStep<const D: usize> {
    pub made: Made<Vec<f64>, D>,
    pub displacement: Vec<f64>,
    /// Memory of the largest hierarchy.
    pub bytes: usize,
}

impl<const D: usize> PrimalPath<D> {
    /// Starts from a state, or from the unloaded bodies. `displacement` are those of the
    /// state, as a start value.
    pub fn new(state: Option<State<D>>, displacement: Vec<f64>) -> Self {
        Self {
            state,
            displacement,
            ..Self::default()
        }
    }

    /// The next step is the last one once more, from its displacements.
    pub fn retract(&mut self) {
        self.state.clone_from(&self.before);
        self.again = true;
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
        let force = problem.force(load, prescribed)?;
        let y = if self.displacement.is_empty() {
            vec![0.0; problem.order()]
        } else {
            problem.unknowns(&self.displacement)
        };
        let mut engine = Local::new(problem, stop, self.hierarchy.take());
        let values = force.values.clone();
        engine = engine.with_force(force);
        let start = Start {
            state: self.state.as_ref(),
            y,
            near: std::mem::take(&mut self.again),
            draft: self.draft,
        };
        let contacts = &problem.contacts;
        let loads = (&values, prescribed);
        let made = advance(&mut engine, contacts, start, loads, settings)?;
        let (hierarchy, bytes) = engine.into_hierarchy();
        self.hierarchy = hierarchy;
        let displacement = problem.displacement(&made.y, prescribed);
        if let Some(state) = made.state() {
            self.before = self.state.replace(state);
            self.displacement.clone_from(&displacement);
        }
        Ok(PrimalStep {
            made,
            displacement,
            bytes,
        })
    }
}
