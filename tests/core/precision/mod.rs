//! Condensation compared with twice the precision and with exact fractions: S of many kinds of
//! matrices, to the digits that the data determine.
#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "numbers of unknowns are small; a helper of a test may fail"
)]

mod chains;
pub(crate) mod comparison;
mod definite;
mod elements;
mod graphs;
mod loads;
pub(crate) mod matrices;
mod meshes;
mod oracle;
mod rational;
mod subsets;
