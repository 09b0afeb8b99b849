//! The fitted constants of condensation.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! products with `W` of two shipped scenes with many candidates. Where it is missing, neither
//! changes it, as a rule because these sets do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // condense.rs
    /// Analyses are looked up for at most this many bodies: many bodies are small, and ordering
    /// them is faster than the search.
    searched_bodies: usize = 16;

    // bodies.rs
    /// A body with less work [flop] uses one thread, and several such bodies run in parallel; a
    /// larger one uses all threads and all memory.
    serial_flops: f64 = 1e9;

    // candidates.rs
    /// With at most this many degrees of freedom in the contact set of a body, all are kept: their
    /// `W` takes a fraction of the time of the factor.
    all_kept: usize = 600;
    /// If more than one candidate in so many touches at the start, all are kept.
    one_touches_in: usize = 4;
    /// Contacts of each body that are kept to hold it, if its supports do not.
    pins: usize = 12;

    // body.rs
    /// Largest number of corrections of displacements.
    most_corrections: usize = 30;
}
