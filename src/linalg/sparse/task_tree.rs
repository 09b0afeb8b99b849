//! Runs the tasks of a tree in the current rayon pool.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::Scope;

use crate::linalg::sparse::symbolic::{Symbolic, Task};

/// Calls `work` for every task after its children. If it returns false, the tasks above are
/// omitted.
pub(crate) fn upwards(symbolic: &Symbolic, work: &(impl Fn(usize) -> bool + Sync)) {
    let tasks = &symbolic.tasks;
    // Number of unfinished children of each task.
    let waiting: Vec<AtomicUsize> = tasks
        .iter()
        .map(|t| AtomicUsize::new(t.children.len()))
        .collect();
    let waiting = &waiting;
    rayon::scope(|scope| {
        // A thread takes its own newest task first. Started from the end, a single thread works
        // in postorder, whose memory was counted.
        for start in (0..tasks.len())
            .rev()
            .filter(|&t| tasks[t].children.is_empty())
        {
            scope.spawn(move |_| climb(tasks, waiting, start, work));
        }
    });
}

/// Works on a task, and on its ancestors as long as this was their last child. It is a loop,
/// because the tree may be too deep for a recursion.
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

/// Calls `work` for every task before its children, which receive its result; the roots receive
/// `first`.
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
