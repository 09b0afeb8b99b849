//! The law of one contact: no assembled matrix, no second node.

pub mod alart_curnier;
pub mod bipotential;
pub mod cone;
pub mod face;
pub mod frame;
pub mod one_node;
mod sliding;
