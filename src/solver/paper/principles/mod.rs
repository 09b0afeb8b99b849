//! The principles of [dSF91] and the convex problems that they solve in turn.

pub mod alternating_principles;
pub mod convex;
pub mod displacement_principle;
pub mod minimising_sequence;
pub mod stress_principle;
