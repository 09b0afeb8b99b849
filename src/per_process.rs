//! A lock that a forked child does not inherit.
//!
//! In a child made by `fork` while another thread holds a mutex, this mutex stays locked: the
//! thread that would release it exists only in the parent. Each process therefore uses a lock
//! of its own, found by its id, and does not touch those of its ancestors.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Number of ancestors with the process itself: the length of a chain of forks.
const GENERATIONS: usize = 256;

/// A list behind a lock; it is empty at first in each process.
#[derive(Debug)]
pub(crate) struct PerProcess<T> {
    slots: [Slot<T>; GENERATIONS],
}

#[derive(Debug)]
struct Slot<T> {
    /// The id of its process; 0 if it has none.
    process: AtomicU32,
    list: Mutex<Vec<T>>,
}

impl<T> PerProcess<T> {
    pub(crate) const fn new() -> Self {
        Self {
            slots: [const {
                Slot {
                    process: AtomicU32::new(0),
                    list: Mutex::new(Vec::new()),
                }
            }; GENERATIONS],
        }
    }

    /// Locks the list of this process. `None` if there have been so many generations that no
    /// lock is left.
    pub(crate) fn lock(&self) -> Option<MutexGuard<'_, Vec<T>>> {
        let process = std::process::id();
        // Slots fill from the left and are never released. The first one that is free or that
        // of this process is ours, in any order of threads.
        let own = self.slots.iter().find(|slot| {
            let taken =
                slot.process
                    .compare_exchange(0, process, Ordering::AcqRel, Ordering::Acquire);
            taken.is_ok() || taken == Err(process)
        })?;
        Some(own.list.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
