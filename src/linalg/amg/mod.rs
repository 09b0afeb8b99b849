//! Smoothed aggregation: an algebraic multigrid preconditioner for elasticity.
//!
//! [`SymmetricBlocks`](symmetric_blocks::SymmetricBlocks) holds the stiffness by nodes,
//! [`Nodes`](nodes::Nodes) its near-null vectors, which the caller gives; [`soft_motions`]
//! completes them where no coordinates are known, and
//! [`Multigrid`](multigrid::Multigrid) is the preconditioner. Set-up, level by level:
//!
//! 1. [`inverse_diagonal`], [`spectrum`]: the smoother, block Jacobi with Chebyshev polynomials;
//! 2. [`aggregates`]: groups of neighbouring nodes;
//! 3. [`tentative`]: the near-null vectors, orthonormal in each group;
//! 4. [`prolongation`]: `P`, these vectors smoothed once;
//! 5. [`galerkin`]: the matrix of the next level, `Pᵀ A P`.
//!
//! [`Following`](following::Following) changes with the statuses of contacts: it computes anew
//! only what depends on the nodes of contacts that changed.
//!
//! The hierarchy is computed in single precision, and its matrices are stored in sixteen bits a
//! number ([`scaled_blocks`]): it only preconditions.

mod aggregates;
mod avx2;
mod avx512;
pub mod block_matrix;
pub mod block_rows;
pub mod changed_rows;
mod coarsest;
mod cycle;
pub mod following;
mod galerkin;
mod hierarchy;
mod inverse_diagonal;
mod level;
pub mod multigrid;
mod node_rows;
pub mod nodes;
mod prolongation;
pub mod scaled_blocks;
pub mod settings;
pub mod single_rows;
mod slots;
pub mod soft_motions;
mod spectrum;
pub mod symmetric_blocks;
mod tentative;
mod transfer;
mod tuning;
mod wide;
