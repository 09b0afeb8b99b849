//! The contact problem in the reactions alone, `v = W r + q`, and no algorithm.

pub mod balance;
pub mod compliance;
pub mod elliptic_scaling;
pub mod existence;
pub mod island;
pub mod memory;
pub mod reduced;
pub mod residual;
pub mod validate;
