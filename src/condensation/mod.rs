//! From bodies and their contacts to the reduced problem, and back to displacements.
//!
//! The stiffness `K` passes through four types, each made from the one before it:
//!
//! 1. [`ProblemArrays`](condense::ProblemArrays): the arrays of the caller, borrowed.
//! 2. [`SortedProblem`](condense::SortedProblem): checked, supports removed, one matrix of
//!    each body.
//! 3. [`AnalysedBody`](analysed::AnalysedBody): the elimination order and its costs are
//!    known.
//! 4. [`Body`](body::Body): factored, and condensed onto its contacts. What can move, `bodies`
//!    decides.
//!
//! [`Condensed`](condense::Condensed) has all bodies and `W`.
//! [`Problem`](problem::Problem) is that, or the candidates of a working set.

pub mod analysed;
pub mod assemble;
pub mod bodies;
pub mod body;
pub mod candidates;
pub mod condense;
pub mod contact_stiffness;
pub mod forecast;
pub mod ordered;
pub mod pattern_cache;
pub mod problem;
pub mod stats;
pub mod surface;
mod tuning;
