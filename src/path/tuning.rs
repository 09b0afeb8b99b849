//! The fitted constants of load paths.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! products with `W` of two shipped scenes. Where it is missing, neither changes it, as a rule
//! because these sets do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // working_set.rs
    /// Contacts that may always be added together.
    added_at_once: usize = 256;
    /// Above one candidate in so many, `W` of all candidates costs less.
    all_candidates_above: usize = 3;
}
