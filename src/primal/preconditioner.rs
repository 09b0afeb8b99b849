//! Preconditioners of the Newton systems.
//!
//! **One body**: multigrid for the symmetric part `P` of the system. It must follow the
//! statuses: one that was made for others costs several times as many iterations. Only what
//! depends on the nodes of changed contacts is computed anew ([`Following`]).
//!
//! **Contacts between bodies**: multigrid for the bodies glued together at all contacts, made
//! once, between two exact solutions on the interface, which follow the statuses ([`Filter`]):
//!
//! ```text
//! x = P_cc⁻¹ b_c;   x ← x + M (b − P x);   x_c ← x_c + P_cc⁻¹ (b − P x)_c
//! ```
//!
//! Where most contacts slip or are open, gluing is far from the truth, and `M` is multigrid for
//! `P`.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::amg::following::Following;
use crate::linalg::amg::multigrid::Multigrid;
use crate::linalg::amg::settings::CycleSettings;
use crate::linalg::parallel::zero_where;
use crate::linalg::small::add_scaled;
use crate::primal::filter::Filter;
use crate::primal::interface::Interface;
use crate::primal::problem::Primal;
use crate::primal::tangent::Tangent;
use crate::primal::tuning;

/// The preconditioner of one load step.
#[derive(Debug)]
pub(super) struct Preconditioner<'p, const D: usize> {
    problem: &'p Primal<D>,
    cycle: CycleSettings,
    /// What the parts that follow the statuses were made for.
    statuses: Vec<Status>,
    held: Vec<bool>,
    /// The hierarchy of one body for these statuses.
    following: Option<Following>,
    /// The hierarchy of joined bodies for these statuses.
    multigrid: Option<Multigrid>,
    joined: Option<Joined<D>>,
    /// Memory of the largest hierarchy, with what contacts between bodies need.
    pub(super) bytes: usize,
}

/// What contacts between bodies need in addition.
#[derive(Debug)]
struct Joined<const D: usize> {
    interface: Arc<Interface>,
    filter: Option<Filter<D>>,
    glued: Option<Multigrid>,
    /// Whether the last solution with the glued bodies was slow.
    slow: bool,
    /// Places that the hierarchy holds.
    held: Vec<bool>,
    residual: Vec<f64>,
    correction: Vec<f64>,
}

impl<'p, const D: usize> Preconditioner<'p, D> {
    /// `following` is the hierarchy of an earlier load step of one body, if there is one.
    pub(super) fn new(problem: &'p Primal<D>, following: Option<Following>) -> Self {
        let joined = problem.interface.as_ref().map(|interface| Joined {
            interface: Arc::clone(interface),
            filter: None,
            glued: interface
                .glued
                .lock()
                .map_or(None, |mut glued| glued.take()),
            slow: false,
            held: Vec::new(),
            residual: Vec::new(),
            correction: Vec::new(),
        });
        Self {
            problem,
            cycle: CycleSettings::default(),
            statuses: Vec::new(),
            held: Vec::new(),
            following,
            multigrid: None,
            joined,
            bytes: 0,
        }
    }

    /// Makes it for the symmetric part of `tangent`, unless it was made for these statuses.
    pub(super) fn prepare(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        let same = self.statuses == statuses && self.held == tangent.held;
        if !same {
            // The memory of the old hierarchy serves the new one.
            self.multigrid = None;
            self.statuses = statuses.to_vec();
            self.held.clone_from(&tangent.held);
        }
        if self.joined.is_some() {
            return self.prepare_joined(tangent, same, stop);
        }
        if same && self.following.is_some() {
            return Ok(());
        }
        let mut following = if let Some(following) = self.following.take() {
            following
        } else {
            self.cycle.spectrum = self.problem.stiffness.spectrum();
            self.problem.hierarchy(&self.cycle, stop)?
        };
        following.update(
            &self.problem.about_nodes(Some(following.nodes_read())),
            &tangent.held,
            &tangent.springs(&self.problem.contacts.frames),
            stop,
        )?;
        self.bytes = self.bytes.max(following.bytes());
        self.following = Some(following);
        Ok(())
    }

    fn prepare_joined(
        &mut self,
        tangent: &Tangent<D>,
        same: bool,
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        let Some(joined) = &mut self.joined else {
            return Ok(());
        };
        let known = &self.problem.stiffness;
        let rows = &joined.interface.rows;
        if !same || joined.filter.is_none() {
            joined.filter = None;
            joined.filter = Some(Filter::new(
                rows,
                tangent.springs_of_nodes(),
                &tangent.held,
                known.nodes.coordinates.as_deref(),
                stop,
            )?);
        }
        let loose = self
            .statuses
            .iter()
            .filter(|&&s| s != Status::Stick)
            .count();
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let share = loose as f64 / self.statuses.len().max(1) as f64;
        let follow = share > tuning::loose_share() || joined.slow;
        joined.held.clone_from(&tangent.held);
        if !follow {
            self.multigrid = None;
            for (_, frame) in self.problem.contacts.frames.with_node() {
                joined.held[D * frame.node..D * (frame.node + 1)].fill(true);
            }
            if joined.glued.is_none() {
                joined.glued = Some(Multigrid::new(
                    known.matrix.with_rows(rows, &joined.held),
                    known.about_nodes(joined.interface.bodies.clone(), None),
                    &joined.held,
                    // Whatever happened in this step: later ones use it too.
                    &CycleSettings::default(),
                    stop,
                )?);
            }
        } else if self.multigrid.is_none() {
            let mut matrix = known.matrix.with_rows(rows, &tangent.held);
            for (node, spring) in tangent.springs_of_nodes() {
                matrix.add_to_diagonal_block(node, spring.as_slice());
            }
            self.multigrid = Some(Multigrid::new(
                matrix,
                self.problem.about_nodes(None),
                &tangent.held,
                &self.cycle,
                stop,
            )?);
        }
        let hierarchies = [&joined.glued, &self.multigrid].into_iter().flatten();
        let bytes = hierarchies.map(Multigrid::bytes).sum::<usize>()
            + joined.filter.as_ref().map_or(0, Filter::bytes)
            + rows.bytes();
        self.bytes = self.bytes.max(bytes);
        Ok(())
    }

    /// `x ≈ P⁻¹ b`; `b` is zero at held places, `x` may be anything there.
    pub(super) fn apply(&mut self, b: &[f64], x: &mut [f64]) {
        let Some(joined) = &mut self.joined else {
            if let Some(following) = &mut self.following {
                following.apply(self.cycle.degree, b, x);
            }
            return;
        };
        let hierarchy = self.multigrid.as_mut().or(joined.glued.as_mut());
        let (Some(filter), Some(hierarchy)) = (&joined.filter, hierarchy) else {
            return;
        };
        let rows = &joined.interface.rows;
        let (residual, correction) = (&mut joined.residual, &mut joined.correction);
        residual.clear();
        residual.extend_from_slice(b);
        correction.resize(b.len(), 0.0);
        x.fill(0.0);
        let own = filter.solve(b);
        filter.add(&own, x);
        filter.subtract_columns(rows, x, residual);
        zero_where(&joined.held, true, residual);
        hierarchy.apply(residual, correction);
        zero_where(&joined.held, true, correction);
        add_scaled(x, 1.0, correction);
        residual.copy_from_slice(b);
        filter.subtract_rows(rows, x, residual);
        let own = filter.solve(residual);
        filter.add(&own, x);
    }

    /// The hierarchy of one body, for the next load step.
    pub(super) fn hierarchy(&mut self) -> Option<Following> {
        self.following.take()
    }

    /// Learns from the iterations of a linear system.
    pub(super) fn solved_in(&mut self, iterations: usize) {
        if let Some(joined) = &mut self.joined
            && self.multigrid.is_none()
        {
            joined.slow |= iterations > tuning::slow_glued();
        } else if iterations > tuning::slow_iterations()
            && self.cycle.degree < tuning::stronger_degree()
        {
            self.cycle.degree = tuning::stronger_degree();
            if let Some(multigrid) = &mut self.multigrid {
                multigrid.set_degree(tuning::stronger_degree());
            }
        }
    }
}

impl<const D: usize> Drop for Preconditioner<'_, D> {
    /// Leaves the hierarchy of the glued bodies to the next load step.
    fn drop(&mut self) {
        if let Some(joined) = &mut self.joined
            && let Ok(mut free) = joined.interface.glued.lock()
        {
            *free = joined.glued.take();
        }
    }
}
