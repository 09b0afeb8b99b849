//! A panic is a fault of this crate. It is caught where work is handed to it from
//! outside, so that a caller in another language gets an error and keeps its process.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a panic said.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a fault of bipot_rs, not of its input: {0}; please report it, with the problem that \
     was being solved"
)]
pub struct Panicked(pub String);

/// Runs `work`, also where it spreads over threads, and catches its panic.
///
/// What `work` changed when it panicked is to be thrown away, or never seen: a load
/// path moves on only after a step, and what is made once is made whole or not at all.
///
/// # Errors
/// [`Panicked`].
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| {
        let text = payload.downcast_ref::<&str>().map(ToString::to_string);
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
        Panicked(text.unwrap_or_else(|| "it did not say why".to_owned()))
    })
}
