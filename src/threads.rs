//! Our own pool of threads, one a process and a size.
//!
//! Rayon's global pool hangs for ever in a forked child: its workers exist only
//! in the parent. Pools are therefore kept by process id; an inherited one is
//! leaked, because dropping it would wait for threads that are not there.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::Error;

struct Entry {
    process: u32,
    threads: usize,
    pool: Arc<ThreadPool>,
}

static POOLS: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

/// The number of threads to use: `asked`, else `BIPOT_NUM_THREADS`, else
/// `RAYON_NUM_THREADS`, else the cores this process may run on.
#[must_use]
pub fn count(asked: Option<usize>) -> usize {
    let positive = |n: &usize| *n > 0;
    let from = |name: &str| {
        std::env::var(name)
            .ok()
            .and_then(|text| text.trim().parse().ok())
            .filter(positive)
    };
    asked
        .filter(positive)
        .or_else(|| from("BIPOT_NUM_THREADS"))
        .or_else(|| from("RAYON_NUM_THREADS"))
        .or_else(|| std::thread::available_parallelism().ok().map(Into::into))
        .unwrap_or(1)
}

/// More threads than any machine is good for; asked for many more, the operating
/// system starts tens of thousands before it refuses.
const MOST: usize = 1024;

/// The pool of this process with `threads` workers, built at first use.
///
/// # Errors
/// [`Error::Setting`] for more threads than 1024, [`Error::Threads`] when the operating
/// system gives none.
pub fn pool(threads: usize) -> Result<Arc<ThreadPool>, Error> {
    if threads > MOST {
        #[expect(clippy::cast_precision_loss, reason = "for a message")]
        return Err(Error::Setting {
            what: "num_threads",
            found: threads as f64,
            expected: "1 to 1024",
        });
    }
    let process = std::process::id();
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if pools.iter().any(|entry| entry.process != process) {
        std::mem::forget(std::mem::take(&mut *pools));
    }
    if let Some(entry) = pools.iter().find(|entry| entry.threads == threads) {
        return Ok(Arc::clone(&entry.pool));
    }
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("bipot-{i}"))
        .build()
        .map(Arc::new)
        .map_err(|_| Error::Threads { threads })?;
    pools.push(Entry {
        process,
        threads,
        pool: Arc::clone(&pool),
    });
    Ok(pool)
}
