//! Sparse matrices: analysis, partial factorisation, solves.

pub mod blocks;
pub mod csc;
pub mod multifrontal;
mod ordering;
mod quotient;
pub mod reach;
mod region;
mod solves;
pub mod sparse_lu;
mod sweep;
pub mod symbolic;
mod tree;
mod walk;
