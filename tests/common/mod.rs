//! Bodies, problems and arithmetic that several tests use.

pub(crate) mod bodies;
pub(crate) mod cases;
pub(crate) mod double_double;
pub(crate) mod elasticity;
