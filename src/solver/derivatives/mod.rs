//! The systems of the derivatives of a solution, (33) and (34). No method of solution uses them.

pub mod tangent_stiffness_form;
pub mod tangent_system;
