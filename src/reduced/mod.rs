//! The contact problem in the reactions, `v = W r + q`, without any algorithm.

pub mod best_motion;
pub mod compliance;
pub mod elliptic_scaling;
pub mod existence;
mod gram;
pub mod island;
pub mod memory;
pub mod reduced;
pub mod residual;
pub mod rigid_motions;
pub mod rotation;
mod rounding;
mod tuning;
