//! From bodies and their contacts to the reduced problem, and back to displacements.

pub mod analysed;
pub mod assemble;
pub mod bodies;
pub mod body;
pub mod candidates;
pub mod condense;
pub mod forecast;
mod null_space;
pub mod pattern_cache;
pub mod problem;
pub mod rigid_motions;
pub mod sparse;
pub mod stats;
pub mod surface;
