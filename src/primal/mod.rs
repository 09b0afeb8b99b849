//! Newton on the displacements, with a multigrid preconditioner: no factor of `K` and no `W`.
//!
//! The unknowns are the displacements themselves, in the variables of [`frames`]: the relative
//! displacement `v` of each contact, and the displacements of all other nodes. Then
//! `r = B_sᵀ⁻¹ (K u − f)` at the contacts, and every other row of `K u − f` must be zero. Time
//! and memory grow in proportion to the entries of `K`.
//!
//! A contact may join deformable bodies, with a pair of nodes or, by mortar, with many. One of
//! its nodes gives its place to `v` (`own_nodes`), the others are masters and feel their part
//! of `r`. `interface` has the rows of `Tᵀ K T` that this changes, and `preconditioner` says
//! what such contacts need besides multigrid.
//!
//! `newton` and `load_step` leave products, linear systems and long vectors to an `engine`:
//! `local` is the one of this crate.

pub mod certificate;
pub mod contacts;
pub mod engine;
mod filter;
pub mod frames;
mod interface;
pub mod linearised;
pub mod linearised_laws;
pub mod load_step;
pub mod local;
pub mod multiplied_law;
pub mod newton;
pub mod nodes;
pub mod own_nodes;
pub mod path;
mod preconditioner;
pub mod problem;
pub mod stiffness_rows;
mod supports;
pub mod tangent;
pub mod transformation;
mod tuning;
