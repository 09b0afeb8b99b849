//! A body with its elimination order.

use std::sync::Arc;

use crate::bodies::geometry::Geometry;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::linalg::sparse::symbolic::{Counts, Symbolic};

/// What a body is before and after its factorisation.
#[derive(Clone, Debug)]
pub struct OrderedBody {
    /// Its degrees of freedom in the numbering of the caller.
    pub(super) dofs: Vec<usize>,
    /// `K` in the unit of the body, `unit K`.
    pub(super) stiffness: OwnedMatrix,
    /// A power of two that makes the stiffness of order one: square roots of pivots then round
    /// equally in all units that differ by powers of two.
    pub(super) unit: f64,
    /// The unknowns of `S`, as local numbers.
    pub(super) kept: Vec<usize>,
    /// The positions of all degrees of freedom, if known.
    pub(super) geometry: Option<Arc<Geometry>>,
    pub(super) symbolic: Arc<Symbolic>,
    /// Whether it was ordered, because no analysis of its pattern was known.
    pub(super) was_ordered: bool,
}

impl OrderedBody {
    /// Its degrees of freedom in the numbering of the caller.
    pub fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    /// The cost of the factorisation.
    pub fn counts(&self) -> &Counts {
        self.symbolic.counts()
    }

    /// The part of forces on all degrees of freedom on this body, in its unit.
    pub(super) fn scale_forces(&self, force: &[f64]) -> Vec<f64> {
        self.dofs.iter().map(|&i| self.unit * force[i]).collect()
    }

    /// The kept part of values at the local degrees of freedom.
    pub(super) fn at_contacts(&self, local: &[f64]) -> Vec<f64> {
        self.kept.iter().map(|&i| local[i]).collect()
    }

    /// The diagonal of `unit K` at the kept unknowns.
    pub(super) fn kept_diagonal(&self) -> impl Iterator<Item = f64> + '_ {
        self.kept.iter().map(|&i| self.stiffness.diagonal(i))
    }
}
