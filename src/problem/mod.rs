//! All contacts together, and no algorithm.

pub mod compliance;
//pub mod condense;
pub mod reduced;
pub mod residual;
