//! Refuses work that needs too much memory, before any memory is allocated.

use crate::error::Error;

/// A limit of memory: that of the machine, or a smaller one of the caller.
#[derive(Clone, Copy, Debug, Default)]
pub struct Budget {
    /// The limit of the caller, in bytes.
    pub limit: Option<u128>,
}

impl Budget {
    /// Checks `bytes`, of which `held` are allocated already.
    pub fn check(self, what: &'static str, bytes: u128, held: u128) -> Result<(), Error> {
        match self.limit {
            Some(limit) if bytes > limit => Err(Error::MemoryLimit { what, bytes, limit }),
            _ => check(what, bytes.saturating_sub(held)),
        }
    }
}

/// Free bytes of this machine, if known (Linux).
fn available() -> Option<u128> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kilobytes: u128 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(1024 * kilobytes)
}

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
