//! What is proved of the answer of a solver: how far it is off, and whether it is the
//! only one. No solver uses any of it.

pub mod contraction;
pub mod error_bound;
pub mod fixed_point_index;
pub mod monotonicity;
pub mod uniqueness;
pub mod weights;
