//! Sparse and dense linear algebra; knows no mechanics.
//!
//! The one idea is the partial factorisation: eliminate the interior of a
//! symmetric matrix, stop at the kept unknowns, and what is left there is `S`.

pub mod below;
pub mod binary;
pub mod blocks;
pub mod csc;
pub mod dense;
pub mod exact;
pub mod gmres;
pub mod jacobi;
pub mod least_squares;
pub mod lu;
pub mod multifrontal;
pub mod nonnegative;
mod ordering;
mod packed;
pub mod pages;
mod quotient;
pub mod reach;
mod region;
pub mod signs;
pub mod small;
mod solves;
pub mod sparse_lu;
mod sweep;
pub mod symbolic;
mod tree;
pub mod union;
mod walk;
