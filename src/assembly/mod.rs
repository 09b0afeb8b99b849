//! Stiffness of a mesh of elastic cells, in compressed rows.
//!
//! The pattern has a block for each two nodes that share a cell. A row sums the matrices of its
//! cells in the order of the cells, whichever thread adds them: the bits of K do not depend on
//! the number of threads, and K is symmetric to the last bit.
//!
//! [`inspection`] looks at any K: the bodies, their surfaces and their stiffness.

pub mod cells;
pub mod element;
pub mod inspection;
pub mod pattern;
mod shapes;
pub mod stiffness;
mod sum;
