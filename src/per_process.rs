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

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::PerProcess;

    static LIST: PerProcess<u8> = PerProcess::new();

    #[test]
    fn a_lock_held_by_another_process_is_left_alone() {
        // The state after a fork: the slot of the parent, locked by one of its threads.
        let parent = &LIST.slots[0];
        parent.process.store(u32::MAX, Ordering::Release);
        let _held = parent.list.lock().unwrap();
        LIST.lock().unwrap().push(7);
        assert_eq!(*LIST.lock().unwrap(), [7]);
        let owner = LIST.slots[1].process.load(Ordering::Acquire);
        assert_eq!(owner, std::process::id());
    }
}
