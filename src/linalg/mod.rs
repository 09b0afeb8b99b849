//! Sparse and dense linear algebra; knows no mechanics.
//!
//! The one idea is the partial factorisation: eliminate the interior of a
//! symmetric matrix, stop at the kept unknowns, and what is left there is `S`.

pub mod compensated;
pub mod dense;
pub mod gmres;
pub mod jacobi;
pub mod least_squares;
pub mod lu;
pub mod nonnegative;
mod packed;
pub mod pages;
pub mod power_of_two;
pub mod random_signs;
pub mod small;
pub mod sparse;
pub mod union;
pub mod verified_cholesky;
