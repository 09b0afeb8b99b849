//! Catches panics where another language calls this crate: the caller gets an error, and its
//! process goes on.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// The message of a panic.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "internal error of bipot_rs, not a mistake in its input: {0}; please report it together \
     with the problem"
)]
pub struct Panicked(pub String);

/// Runs `work` and catches its panic, also a panic in another thread.
///
/// Data that `work` was changing may be incomplete after a panic: the caller must drop it or
/// keep it unreachable. A load path advances only after a complete step, and a cached value is
/// stored only when it is complete.
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| {
        let text = payload.downcast_ref::<&str>().map(ToString::to_string);
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
        Panicked(text.unwrap_or_else(|| "no message".to_owned()))
    })
}
