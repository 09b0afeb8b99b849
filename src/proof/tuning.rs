//! The fitted constants of proofs. They change which proofs are found and how sharp they are; a
//! proof that is found is one for any values.
//!
//! *Half, twice* is what half and twice the value change in the sum of `benches/tuning.py`: the
//! logarithms of the error bounds of solutions of random sets with seed 0, and, as *unsolved*,
//! the questions of uniqueness without an answer. Where it is missing, neither changes it, as a
//! rule because these sets do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // uniqueness.rs
    /// With at most this many plane contacts, 4⁶ leaves in milliseconds, all statuses are tried if
    /// both criteria decide nothing.
    few_contacts: usize = 6;
    /// A sparse island with more unknowns is not decided: both criteria form dense matrices, which
    /// the caller avoids with a sparse `W`.
    sparse_unknowns: usize = 3000;

    // weights.rs
    /// Below this κ, other weights improve a bound by less than they cost.
    /// Half, twice: −0.1 %, same.
    good_kappa: f64 = 0.5;
    /// With at most this many unknowns, each contact may get its own weights.
    weighted_unknowns: usize = 1000;
    /// Rounds of this search; each costs about five matrix products.
    weight_rounds: usize = 24;
    /// Longest step of the logarithm of a weight.
    /// Half, twice: −0.0 %, same.
    longest_logarithm: f64 = 1.5;
    /// Distance of the shift of the next round from the least eigenvalue, relative to that of this
    /// round: after a success, after a failure, and at least, relative to the eigenvalue.
    /// Half, twice: −0.0 %, −0.0 %.
    gap_fall: f64 = 0.3;
    gap_rise: f64 = 3.0;
    least_gap: f64 = 0.2;
    /// The search ends when a round improves the eigenvalue by a smaller share.
    weight_gain: f64 = 0.02;

    // error_bound/mod.rs
    /// Islands with more unknowns get no bound: it needs about ten dense matrices of this order.
    bounded_unknowns: usize = 3000;

    // island.rs
    /// With at most this many unknowns a ball is tried: each radius needs a factor.
    ball_unknowns: usize = 1000;
    /// Radius of the next ball, relative to the distance that the last one has proved.
    nearer_ball: f64 = 1.2;

    // monotonicity.rs
    /// Products of Lanczos's method for the estimate of an eigenvalue.
    /// Half, twice: +0.0 %, −0.0 %.
    lanczos_products: usize = 40;
}

/// Radii of balls to try, in lengths of `e`; with a larger radius less is known of the contacts.
/// Without the first one local bounds are up to four times as large; without the last one some
/// solutions near a change of status have none.
pub(crate) const RADII: [f64; 5] = [3.0, 12.0, 50.0, 200.0, 1000.0];

/// Margins above the estimate of an eigenvalue, which is too small; the last ones for clustered
/// eigenvalues. A smaller first one fails more often, each time for a factorisation; a larger one
/// makes each bound larger by its square root.
pub(crate) const MARGINS: [f64; 5] = [1.02, 1.1, 1.3, 2.0, 8.0];

/// [`MARGINS`] where a contraction is lost above 1.5.
pub(crate) const CONTRACTION_MARGINS: [f64; 3] = [1.02, 1.1, 1.5];
