//! Runs long work without the interpreter lock; Ctrl-C stops it within a tenth of a second.

use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::error::Error;
use crate::panics::caught;
use crate::threads;

/// Interval at which the calling thread checks for signals.
const LOOK: Duration = Duration::from_millis(50);

/// Runs `work` in the pool of `num_threads` without the interpreter lock. The calling thread
/// checks for signals and then sets the flag.
pub(super) fn run<T: Send>(
    py: Python<'_>,
    num_threads: Option<usize>,
    work: impl FnOnce(&AtomicBool) -> Result<T, Error> + Send,
) -> PyResult<T> {
    watch(py, num_threads, &|_| Ok(()), work)
}

/// [`run`], calling `tell` as often as it checks for signals. An exception from `tell` stops
/// the work too.
pub(super) fn watch<T: Send>(
    py: Python<'_>,
    num_threads: Option<usize>,
    tell: &(dyn Fn(Python<'_>) -> PyResult<()> + Sync),
    work: impl FnOnce(&AtomicBool) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let pool = threads::pool(threads::count(num_threads)?)?;
    let stop = AtomicBool::new(false);
    let (mut work, mut result) = (Some(work), None);
    let mut task = || result = work.take().map(|work| caught(|| work(&stop)));
    let signal = run_task(py, &pool, &stop, tell, &mut task);
    match (signal, result) {
        (Some(raised), _) => Err(raised),
        (None, Some(result)) => Ok(result??),
        (None, None) => Err(Error::Interrupted.into()),
    }
}

thread_local! {
    /// When [`look_here`] last looked, and the exception that it found.
    static LOOKED: Cell<Option<Instant>> = const { Cell::new(None) };
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// Runs `work` on the calling thread: to wake another takes longer than a small problem. `work`
/// calls [`look_here`] from time to time.
pub(super) fn here<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Result<T, Error> + Send,
) -> PyResult<T> {
    LOOKED.set(Some(Instant::now()));
    let result = py.detach(|| caught(|| work(&AtomicBool::new(false))));
    RAISED.take().map_or_else(|| Ok(result??), Err)
}

/// Whether a signal asks to stop; [`here`] then raises its exception.
pub(super) fn look_here() -> bool {
    let now = Instant::now();
    if LOOKED.get().is_some_and(|looked| now - looked < LOOK) {
        return false;
    }
    LOOKED.set(Some(now));
    let raised = Python::attach(|py| py.check_signals().err());
    let stop = raised.is_some();
    RAISED.set(raised);
    stop
}

/// Runs short `work` without the interpreter lock, in a pool if it is of `many` tasks.
pub(super) fn in_pool<T: Send>(
    py: Python<'_>,
    many: bool,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    Ok(py.detach(|| caught(|| threads::install(None, many, work)))??)
}

/// Runs `task` in the pool, and returns the exception that was raised meanwhile. It is not
/// generic: rayon and the channel are compiled once, not for every type of a result.
fn run_task(
    py: Python<'_>,
    pool: &ThreadPool,
    stop: &AtomicBool,
    tell: &(dyn Fn(Python<'_>) -> PyResult<()> + Sync),
    task: &mut (dyn FnMut() + Send),
) -> Option<PyErr> {
    let look = |py: Python<'_>| {
        py.check_signals()?;
        tell(py)
    };
    py.detach(|| {
        // A worker of the pool does the work: starting a thread would take longer than a small
        // problem.
        pool.in_place_scope(|scope| {
            let (running, ended) = mpsc::channel::<()>();
            scope.spawn(move |_| {
                task();
                drop(running);
            });
            let mut signal = None;
            while ended.recv_timeout(LOOK) == Err(mpsc::RecvTimeoutError::Timeout) {
                if signal.is_none()
                    && let Err(raised) = Python::attach(look)
                {
                    signal = Some(raised);
                    stop.store(true, Ordering::Relaxed);
                }
            }
            signal
        })
    })
}
