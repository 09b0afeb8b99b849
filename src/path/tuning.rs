//! The fitted constants of load paths.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! products with `W` of two shipped scenes.

use crate::fitted::fitted;

fitted! {
    // working_set.rs
    /// Contacts that may always be added together.
    /// Half, twice: same, same.
    added_at_once: usize = 256;
    /// Above one candidate in so many, `W` of all candidates costs less.
    /// Half, twice: same, same.
    all_candidates_above: usize = 3;
}
