//! An interior-point method for large sets of rigid bodies with more reactions than motions:
//! (20b) and (20c) of `docs/theory.md`. It leads to the middle of the set of reactions that are
//! solutions. From there Newton and proximal points, which fail where reactions are not
//! determined, find the last digits.

mod factors;
mod path;
mod system;

pub use path::run;
