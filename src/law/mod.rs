//! The law of one contact: no assembled matrix, no other contact.

pub mod alart_curnier;
pub mod bipotential;
pub mod cone;
pub mod contact_law;
pub mod elliptic;
pub mod face;
pub mod frozen;
pub mod one_node;
pub mod plastic_point;
pub mod second_order;
mod sliding;
mod slip_multiplier;
