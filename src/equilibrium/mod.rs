//! Statics: whether reactions in their cones balance the loads, and the largest load that they
//! balance.
//!
//! `Rᵀ r + e = 0` with `r_i ∈ C_i = {r : ‖r_t‖ ≤ c + μ r_n, r_n ≥ 0}` is a convex programme
//! ([`programme`], over the crate Clarabel). What its solver says of its own result is never used:
//! reactions are measured, and a motion that excludes them is checked without rounding
//! ([`proof`]).

pub mod decide;
pub mod minimise;
pub mod multiplier;
mod part;
pub mod programme;
mod proof;
mod repair;
pub mod statics;
