//! Refuses what cannot fit, with the figure, before it is allocated.

use crate::error::Error;

/// How much may be taken: as much as the machine has, or less by the caller's wish.
#[derive(Clone, Copy, Debug, Default)]
pub struct Budget {
    /// Bytes, the caller's limit.
    pub limit: Option<u128>,
}

impl Budget {
    /// Of `bytes` some may be `held` already.
    ///
    /// # Errors
    /// [`Error::Memory`] when `what` needs more than there is, [`Error::MemoryLimit`]
    /// when it needs more than the caller allows.
    pub fn check(self, what: &'static str, bytes: u128, held: u128) -> Result<(), Error> {
        match self.limit {
            Some(limit) if bytes > limit => Err(Error::MemoryLimit { what, bytes, limit }),
            _ => check(what, bytes.saturating_sub(held)),
        }
    }
}

/// Bytes that this machine can still give, where it tells (Linux).
fn available() -> Option<u128> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kilobytes: u128 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(1024 * kilobytes)
}

/// # Errors
/// [`Error::Memory`] when `what` needs more than there is.
pub fn check(what: &'static str, bytes: u128) -> Result<(), Error> {
    match available() {
        Some(available) if bytes > available => Err(Error::Memory {
            what,
            bytes,
            available,
        }),
        _ => Ok(()),
    }
}
