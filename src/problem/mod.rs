//! All contacts together, and no algorithm.

pub mod analysed;
pub mod assemble;
pub mod balance;
pub mod bodies;
pub mod body;
pub mod border;
pub mod candidates;
pub mod compliance;
pub mod condense;
pub mod forecast;
pub mod island;
pub mod memory;
mod null_space;
pub mod overlap;
pub mod patterns;
pub mod reduced;
pub mod residual;
pub mod rigid_motions;
pub mod sparse;
pub mod stats;
pub mod stretch;
pub mod surface;
