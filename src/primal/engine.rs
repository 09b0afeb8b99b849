//! What Newton's method needs of an engine: products with `A = Tᵀ K T`, linear systems, and a
//! few sums over long vectors.
//!
//! Vectors are opaque: they may be distributed over processes. Values at the contacts are the
//! same on all processes, to the bit, so that all of them take the same decisions. Where they
//! could not agree by themselves, as on elapsed time, the engine decides.

use std::time::Instant;

use crate::error::Error;
use crate::law::cone::Status;
use crate::primal::tangent::Tangent;

/// The solution of a linear system.
#[derive(Debug)]
pub struct Correction<V> {
    /// With its known part.
    pub dy: V,
    /// Products with the matrix.
    pub products: usize,
    /// Whether the tolerance was reached.
    pub reached: bool,
}

/// Sizes of the terms of `A y`.
#[derive(Clone, Debug)]
pub struct Terms<const D: usize> {
    /// Of all rows, the Euclidean norm.
    pub norm: f64,
    /// At the contacts.
    pub at_contacts: Vec<[f64; D]>,
}

/// An engine. All methods are called by all processes, in the same order.
pub trait Engine<const D: usize> {
    /// Values of all unknowns. A clone keeps its values.
    type Vector: Clone;
    /// An error of the engine.
    type Error: From<Error>;

    /// The places of the contacts that have an unknown, in the numbering of their frames.
    fn free(&self) -> &[bool];

    /// The contacts of each body without a support.
    fn floating(&self) -> Vec<Vec<usize>>;

    /// Whether a motion may be too soft for the preconditioner.
    fn may_be_soft(&mut self) -> Result<bool, Self::Error>;

    /// Whether supports, springs and contacts with these statuses hold every rigid motion, as far
    /// as the engine can tell.
    fn is_held(&self, tangent: &Tangent<D>, statuses: &[Status]) -> bool;

    /// `A y`.
    fn product(&mut self, y: &Self::Vector) -> Result<Self::Vector, Self::Error>;

    /// `y + s x`.
    fn add(
        &mut self,
        y: Self::Vector,
        s: f64,
        x: &Self::Vector,
    ) -> Result<Self::Vector, Self::Error>;

    /// `A y − f`, in twice the precision where the engine has it.
    fn unbalanced(
        &mut self,
        y: &Self::Vector,
        force: &Self::Vector,
    ) -> Result<Self::Vector, Self::Error> {
        let product = self.product(y)?;
        self.add(product, -1.0, force)
    }

    /// The values at the contacts; zero for a component without an unknown.
    fn at_contacts(&mut self, y: &Self::Vector) -> Result<Vec<[f64; D]>, Self::Error>;

    /// Euclidean norm.
    fn norm(&mut self, y: &Self::Vector) -> Result<f64, Self::Error>;

    /// Largest magnitude.
    fn largest(&mut self, y: &Self::Vector) -> Result<f64, Self::Error>;

    /// Norm of `e` after the reactions are subtracted at the unknowns of the contacts.
    fn imbalance(&mut self, e: &Self::Vector, reaction: &[[f64; D]]) -> Result<f64, Self::Error>;

    /// `|Tᵀ| |K| |T y|`.
    fn terms(&mut self, y: &Self::Vector) -> Result<Terms<D>, Self::Error>;

    /// Solves the system of a Newton step to the relative residual `tol`. `e` is `A y − f` at
    /// its point. `None` if there is no preconditioner.
    fn correction(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        e: &Self::Vector,
        tol: f64,
    ) -> Result<Option<Correction<Self::Vector>>, Self::Error>;

    /// The correction by one application of the preconditioner; `None` if there is none.
    fn estimate(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        e: &Self::Vector,
    ) -> Result<Option<Self::Vector>, Self::Error>;

    /// Whether more than `seconds` have passed since `start`.
    fn is_late(&mut self, start: Instant, seconds: f64) -> Result<bool, Self::Error>;
}
