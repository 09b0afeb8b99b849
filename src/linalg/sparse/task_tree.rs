//! Working through the tree of tasks, in the rayon pool that is installed.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::Scope;

use crate::linalg::sparse::symbolic::{Symbolic, Task};

/// Does `work` on every task after its children; where it returns false, not on
/// those above.
pub(crate) fn upwards(symbolic: &Symbolic, work: &(impl Fn(usize) -> bool + Sync)) {
    let tasks = &symbolic.tasks;
    // Children that each task still waits for.
    let waiting: Vec<AtomicUsize> = tasks
        .iter()
        .map(|t| AtomicUsize::new(t.children.len()))
        .collect();
    let waiting = &waiting;
    rayon::scope(|scope| {
        // A thread takes its own newest task first: started from the end, one
        // thread alone works in postorder, whose memory was counted.
        for start in (0..tasks.len())
            .rev()
            .filter(|&t| tasks[t].children.is_empty())
        {
            scope.spawn(move |_| climb(tasks, waiting, start, work));
        }
    });
}

/// Works on a task, and on those above it as long as it is the last of the
/// children to finish. A loop, not a recursion: the tree may be deep.
fn climb(
    tasks: &[Task],
    waiting: &[AtomicUsize],
    start: usize,
    work: &(impl Fn(usize) -> bool + Sync),
) {
    let mut number = start;
    while work(number) {
        match tasks[number].parent {
            Some(parent) if waiting[parent].fetch_sub(1, Ordering::AcqRel) == 1 => {
                number = parent;
            }
            _ => return,
        }
    }
}

/// Does `work` on every task before its children, which are given what it
/// returns; the roots are given `first`.
pub(crate) fn downwards<T: Clone + Send + Sync>(
    symbolic: &Symbolic,
    first: &T,
    work: &(impl Fn(usize, T) -> T + Sync),
) {
    rayon::scope(|scope| {
        for &root in &symbolic.roots {
            let given = first.clone();
            scope.spawn(move |scope| descend(scope, symbolic, root, given, work));
        }
    });
}

fn descend<'s, T: Clone + Send + Sync + 's>(
    scope: &Scope<'s>,
    symbolic: &'s Symbolic,
    number: usize,
    given: T,
    work: &'s (impl Fn(usize, T) -> T + Sync),
) {
    let left = work(number, given);
    let children = symbolic.tasks[number].children.clone();
    for &child in &symbolic.task_children[children] {
        let given = left.clone();
        scope.spawn(move |scope| descend(scope, symbolic, child, given, work));
    }
}

/// A lock that a panic elsewhere does not close: the panic is passed on by
/// rayon, and what the lock guards is then never read.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a lock guards, when nobody else can.
pub(crate) fn inner<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
