//! The tests of the core, in one binary: faer is generic, and each binary would
//! compile its kernels again.

mod amg;
mod assembly;
mod balance;
mod cohesion;
#[path = "../common/mod.rs"]
mod common;
mod condensation;
mod elliptic;
mod error_bound;
mod law;
mod linear;
mod many_bodies;
mod multipliers;
mod newton_forms;
mod one_node;
mod precision;
mod primal;
mod principles;
mod redundant;
mod refactor;
mod several_answers;
mod solvers;
mod sparse;
mod tangents;
mod tasks;
