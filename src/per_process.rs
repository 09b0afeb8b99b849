//! A lock that a forked child does not inherit.
//!
//! A child made by `fork` while another thread holds a mutex has that mutex for
//! ever locked: the thread that would release it exists only in the parent.
//! Each process therefore takes a lock of its own, by its id, and leaves those
//! of its ancestors alone.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Ancestors and the process itself: a chain of forks, not the number of children.
const GENERATIONS: usize = 256;

/// A list behind a lock, empty at first in every process.
#[derive(Debug)]
pub(crate) struct PerProcess<T> {
    slots: [Slot<T>; GENERATIONS],
}

#[derive(Debug)]
struct Slot<T> {
    /// 0 while nobody's.
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

    /// Locks the list of this process. `None` in a descendant of so many
    /// generations that no lock is left.
    pub(crate) fn lock(&self) -> Option<MutexGuard<'_, Vec<T>>> {
        let process = std::process::id();
        // Slots fill from the left and are never given up, so the first that is
        // free or ours is ours, whichever thread comes first.
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
        // What a fork copies: the slot of the parent, locked by a thread of it.
        let parent = &LIST.slots[0];
        parent.process.store(u32::MAX, Ordering::Release);
        let _held = parent.list.lock().unwrap();
        LIST.lock().unwrap().push(7);
        assert_eq!(*LIST.lock().unwrap(), [7]);
        let owner = LIST.slots[1].process.load(Ordering::Acquire);
        assert_eq!(owner, std::process::id());
    }
}
