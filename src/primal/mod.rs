//! Newton on the displacements, with a multigrid preconditioner: no factor of `K` and no `W`.
//!
//! The unknowns are the displacements themselves, in the variables of [`frames`]: the relative
//! displacement `v` of each contact, and the displacements of all other nodes. Then
//! `r = B_sᵀ⁻¹ (K u − f)` at the contacts, and every other row of `K u − f` must be zero. Time
//! and memory grow in proportion to the entries of `K`.

pub mod certificate;
mod filter;
pub mod frames;
mod interface;
pub mod newton;
pub mod nodes;
mod own_nodes;
pub mod path;
mod preconditioner;
pub mod problem;
mod tangent;
