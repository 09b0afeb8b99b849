//! Semismooth Newton, (19) and (20), and iterative refinement with it.

pub mod compliance_form;
pub mod linearisation;
pub mod newton;
pub mod refine;
pub(crate) mod search;
pub mod stiffness_form;
