//! Contact with Coulomb friction of elastic bodies, quasi-static, in small
//! displacements, by the bipotential of de Saxcé and Feng [dSF91].
//!
//! For a stiffness `K` and contacts `v = B u + g` of any finite-element code:
//!
//! ```text
//! K u = f + Bᵀ r      v = B u + g      K*_μ ∋ v + μ‖v_t‖ n  ⊥  r ∈ K_μ
//! ```
//!
//! `K` is condensed once onto the contact set, and a contact problem in the
//! reactions `r` alone is solved at each load step. Numbers in parentheses are
//! equations of `docs/theory.md`, which also fixes signs and units.
//!
//! The layers, each of which uses only the earlier ones: [`error`], [`panics`], [`threads`],
//! [`tasks`], [`linalg`] (no mechanics), [`bodies`] (what can move), [`assembly`] (stiffness of meshes), [`law`] (one contact), [`equilibrium`] (whether reactions balance the loads), [`reduced`] (all contacts in the
//! reactions, no algorithm), [`condensation`] (from bodies to the reduced problem and back),
//! [`solver`] (algorithms on the reduced problem), [`proof`] (proofs about their solutions),
//! [`path`] (load steps, also with many more candidates than contacts), [`primal`] (load steps in
//! the displacements, for large bodies), and `python` (with the
//! feature of this name).

// A result that is not needed is given up by `let _ =`.
#![warn(unused_results)]

pub mod assembly;
pub mod bodies;
pub mod condensation;
pub mod equilibrium;
pub mod error;
mod fitted;
pub mod law;
pub mod linalg;
pub mod panics;
pub mod path;
mod per_process;
pub mod primal;
pub mod proof;
pub mod reduced;
pub mod solver;
pub mod tasks;
pub mod threads;

#[cfg(feature = "python")]
mod python;

pub use error::Error;
