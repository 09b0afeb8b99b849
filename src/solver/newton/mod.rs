//! Semismooth Newton, (19) and (20), and refinement by it.

pub mod compliance_form;
pub mod linearisation;
pub mod newton;
pub mod refine;
pub mod stiffness_form;
