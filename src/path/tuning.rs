//! The fitted constants of load paths. `benches/tuning.py` prints what half and twice each value
//! does.

use crate::fitted::fitted;

fitted! {
    // working_set.rs
    /// Contacts that may always be added together.
    added_at_once: usize = 256;
    /// Above one candidate in so many, `W` of all candidates costs less.
    all_candidates_above: usize = 3;
}
