//! The methods of the paper, and those that it is compared with. The default method needs none of
//! them.

pub mod multipliers;
pub mod pivoting;
pub mod principles;
pub mod uzawa;
