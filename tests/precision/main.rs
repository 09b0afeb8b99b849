//! Condensation against twice the precision and against exact fractions: S of
//! every shape of matrix, to the digits that its data determine.
#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "numbers of unknowns are small; a helper of a test may fail"
)]

mod chains;
mod comparison;
mod definite;
mod elements;
mod graphs;
mod loads;
mod matrices;
mod meshes;
mod oracle;
mod rational;
mod subsets;

#[path = "../common/double_double.rs"]
mod double_double;
