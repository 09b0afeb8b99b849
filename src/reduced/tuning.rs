//! The fitted constants of reduced problems and their certificate.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! products with `W` to η = 1e-10, for seeds 0 and 1 of the random sets of
//! `benches/problems.py`. Where it is missing, neither changes it, as a rule because these sets
//! do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // compliance.rs
    /// A matrix with as many contacts is stored and factored as a sparse matrix if it has at most one
    /// block in [`sparse_share`]: sparse work takes longer for each number than dense work.
    sparse_contacts: usize = 64;
    sparse_share: usize = 6;

    // best_motion.rs
    /// Factor from one threshold to the next, below the ten by which η may exceed the least.
    next_threshold: f64 = 3.0;
    /// Steps to the least distance, and steps for `F`: nine and nineteen were the most in 300 random
    /// problems. A motion after too few is still a motion, whose η is an upper bound.
    motion_steps: usize = 40;
    /// Motions with weights from the motion before.
    motion_weightings: usize = 4;

    // residual.rs
    /// Largest rigid motion of a solution, relative to the displacement that it cancels: contacts
    /// may stand such that a rotation moves them ten thousand times less than the body.
    longest_motion: f64 = 1e4;
}
