//! Dense kernels. Only this folder uses faer.
//!
//! All matrices are column-major slices of finite numbers: a slice that is not whole columns, or
//! has not the length of its matrix, is a panic. faer runs on one thread. The tiles are cut here, at
//! fixed places, so that results have the same bits for any number of threads.

mod cholesky;
mod eigen;
mod inverse;
mod kernels;
mod layout;
mod lu;
mod panel;
mod product;
mod substitution;

pub use cholesky::{cholesky, solve_lower, solve_lower_transpose};
pub use eigen::symmetric_eigen;
pub use inverse::invert_from_cholesky;
pub use lu::{
    lu_lower, lu_panel, lu_rest, lu_solve, lu_solve_lower_transposed, lu_solve_transposed,
    lu_solve_upper, lu_update, lu_upper,
};
pub use product::{Op, matmul};

pub(crate) use layout::{mirror_lower, mirror_upper};
pub(crate) use panel::{factor_panel, rank_update};
pub(crate) use substitution::{backward, forward};
