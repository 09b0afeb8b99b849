//! Sparse matrices: analysis, partial factorisation, solves.

pub mod arena;
pub mod blocks;
pub mod csc;
pub mod multifrontal;
mod ordering;
pub mod reach;
pub mod rows;
mod solves;
pub mod sparse_lu;
pub mod supervariables;
pub mod symbolic;
mod task_tree;
mod tree;
mod tree_solves;
mod tuning;
