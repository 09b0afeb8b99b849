//! Sparse and dense linear algebra, without mechanics.
//!
//! Its main function is the partial factorisation: it eliminates the interior of a symmetric
//! matrix and stops at the kept unknowns. The remaining matrix is the Schur complement `S`.
//!
//! Lengths are checked at the border of the package: here a slice of a wrong length panics.

pub mod amg;
pub mod compensated;
pub mod conjugate_gradients;
pub mod dense;
pub mod flexible_gmres;
pub mod gmres;
pub mod jacobi;
mod krylov_triangle;
pub mod least_squares;
pub mod lu;
mod packed;
pub mod pages;
pub mod parallel;
pub mod power_of_two;
pub mod random_signs;
pub mod real;
pub mod small;
pub mod sparse;
pub mod union;
pub mod verified_cholesky;
