//! Work on all threads of the pool, in tasks that the caller cuts at fixed places: results then
//! have the same bits for any number of threads.
//!
//! Rayon's iterators are compiled again for each closure, at some thousand instructions each.
//! Here only [`for_each_index`] calls rayon, and it is compiled once.
//!
//! A thread that is not of a pool does all work itself: rayon would give it to its global pool,
//! which never returns in a forked child.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Does both, on two threads of the pool if this is one of its threads.
pub fn join(first: impl FnOnce() + Send, second: impl FnOnce() + Send) {
    if rayon::current_thread_index().is_some() {
        let _ = rayon::join(first, second);
    } else {
        first();
        second();
    }
}

/// Calls `work` with each number below `count`, `together` numbers in one task.
pub fn for_each_index(count: usize, together: usize, work: &(dyn Fn(usize) + Sync)) {
    fn halves(numbers: Range<usize>, together: usize, work: &(dyn Fn(usize) + Sync)) {
        if numbers.len() <= together {
            numbers.for_each(work);
            return;
        }
        let (start, end) = (numbers.start, numbers.end);
        let middle = start.midpoint(end);
        join(
            || halves(start..middle, together, work),
            || halves(middle..end, together, work),
        );
    }
    halves(0..count, together.max(1), work);
}

/// Calls `work` with each item and its number, each in a task of its own.
pub fn for_each<I: Send>(items: impl IntoIterator<Item = I>, work: impl Fn(usize, I) + Sync) {
    for_each_together(items, 1, work);
}

/// [`for_each`] with several items in one task.
pub fn for_each_together<I: Send>(
    items: impl IntoIterator<Item = I>,
    together: usize,
    work: impl Fn(usize, I) + Sync,
) {
    let items: Vec<I> = items.into_iter().collect();
    if items.len() <= together || rayon::current_thread_index().is_none() {
        let items = items.into_iter().enumerate();
        return items.for_each(|(number, item)| work(number, item));
    }
    let items: Vec<Mutex<Option<I>>> = items.into_iter().map(|i| Mutex::new(Some(i))).collect();
    for_each_index(items.len(), together, &|number| {
        let item = lock(&items[number]).take();
        if let Some(item) = item {
            work(number, item);
        }
    });
}

/// [`for_each`] with memory from `make`, of which each task has one alone.
pub fn for_each_with<I: Send, M: Send>(
    items: impl IntoIterator<Item = I>,
    make: impl Fn() -> M + Sync,
    work: impl Fn(&mut M, usize, I) + Sync,
) {
    let idle = Mutex::new(Vec::new());
    for_each(items, |number, item| {
        let memory = lock(&idle).pop();
        let mut memory = memory.unwrap_or_else(&make);
        work(&mut memory, number, item);
        lock(&idle).push(memory);
    });
}

/// The results for each item and its number, in their order.
pub fn map<I: Send, T: Send>(
    items: impl IntoIterator<Item = I>,
    work: impl Fn(usize, I) -> T + Sync,
) -> Vec<T> {
    let items: Vec<I> = items.into_iter().collect();
    let mut results: Vec<Option<T>> = items.iter().map(|_| None).collect();
    for_each(items.into_iter().zip(&mut results), |number, (item, to)| {
        *to = Some(work(number, item));
    });
    results.into_iter().flatten().collect()
}

/// The results for each number below `count`, in their order, for cheap work.
pub fn collect<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    /// Numbers in one task.
    const TOGETHER: usize = 1024;
    let parts = map((0..count).step_by(TOGETHER), |_, first| {
        let numbers = first..count.min(first + TOGETHER);
        numbers.map(&work).collect::<Vec<T>>()
    });
    parts.into_iter().flatten().collect()
}

/// A lock that ignores a panic in another thread: the panic is passed on, and the data are then
/// never read.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The data of a lock, if no other thread can use it.
pub(crate) fn inner<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
