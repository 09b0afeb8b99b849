//! Proofs about the result of a solver: its error, and whether the solution is unique. No
//! solver uses this.

pub mod contraction;
pub mod error_bound;
pub mod fixed_point_index;
pub mod monotonicity;
mod tuning;
pub mod uniqueness;
pub mod weights;
