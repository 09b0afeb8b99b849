//! Long work off the interpreter's lock, stopped by Ctrl-C within a tenth of a second.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use pyo3::prelude::*;

use crate::error::Error;
use crate::panics::caught;
use crate::threads;

/// How often the calling thread looks for a signal.
const LOOK: Duration = Duration::from_millis(50);

/// Runs `work` in the pool of `num_threads`, the interpreter released; the
/// calling thread looks for signals meanwhile and raises the flag it is given.
///
/// # Errors
/// What `work` returns, or the exception of the signal; of a panic a `RuntimeError`.
pub(super) fn run<T: Send>(
    py: Python<'_>,
    num_threads: Option<usize>,
    work: impl FnOnce(&AtomicBool) -> Result<T, Error> + Send,
) -> PyResult<T> {
    watch(py, num_threads, &|_| Ok(()), work)
}

/// [`run`], with `tell` called as often as signals are looked for; an exception
/// from it stops the work as a signal does.
///
/// # Errors
/// What `work` returns, or the exception of the signal or of `tell`.
pub(super) fn watch<T: Send>(
    py: Python<'_>,
    num_threads: Option<usize>,
    tell: &(dyn Fn(Python<'_>) -> PyResult<()> + Sync),
    work: impl FnOnce(&AtomicBool) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let pool = threads::pool(threads::count(num_threads)?)?;
    let stop = AtomicBool::new(false);
    let look = |py: Python<'_>| {
        py.check_signals()?;
        tell(py)
    };
    let mut signal = None;
    let result = py.detach(|| {
        // A worker of the pool does the work: a thread of its own would cost a
        // small problem more than its solution.
        pool.in_place_scope(|scope| {
            let (done, finished) = mpsc::channel();
            let stop = &stop;
            scope.spawn(move |_| {
                // The receiver outlives this task.
                let _ = done.send(caught(|| work(stop)));
            });
            loop {
                match finished.recv_timeout(LOOK) {
                    Ok(result) => return Some(result),
                    // Not sent: the task was never run.
                    Err(mpsc::RecvTimeoutError::Disconnected) => return None,
                    Err(mpsc::RecvTimeoutError::Timeout) => {}
                }
                if signal.is_none()
                    && let Err(raised) = Python::attach(look)
                {
                    signal = Some(raised);
                    stop.store(true, Ordering::Relaxed);
                }
            }
        })
    });
    match (signal, result) {
        (Some(raised), _) => Err(raised),
        (None, Some(result)) => Ok(result??),
        (None, None) => Err(Error::Interrupted.into()),
    }
}
