//! A thread pool of this crate, one for each process and size.
//!
//! Rayon's global pool never returns in a forked child: its workers exist only in the parent.
//! Pools are therefore stored for each process. An inherited pool is never dropped, because
//! that would wait for threads that do not exist.

use std::sync::{Arc, OnceLock};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::Error;
use crate::per_process::PerProcess;

/// More than any machine has cores: a typing mistake must not fill the memory with stacks.
pub const MOST: usize = 1024;

struct CachedPool {
    threads: usize,
    pool: Arc<ThreadPool>,
}

static POOLS: PerProcess<CachedPool> = PerProcess::new();
/// The system reads files for it: longer than a small problem takes.
static CORES: OnceLock<usize> = OnceLock::new();

/// The number of threads to use: `asked`, else `BIPOT_NUM_THREADS`, else
/// `RAYON_NUM_THREADS`, else the cores this process might
/// run on when it first asked.
///
/// An empty variable counts as missing, and so does 0 in `RAYON_NUM_THREADS`, the default of
/// rayon.
pub fn count(asked: Option<usize>) -> Result<usize, Error> {
    if let Some(number) = asked {
        // A number costs less than its text.
        if (1..=MOST).contains(&number) {
            return Ok(number);
        }
        return within("num_threads", &number.to_string());
    }
    for (name, default) in [("BIPOT_NUM_THREADS", ""), ("RAYON_NUM_THREADS", "0")] {
        if let Some(text) = std::env::var_os(name) {
            let text = text.to_string_lossy();
            let text = text.trim();
            if !text.is_empty() && text != default {
                return within(name, text);
            }
        }
    }
    let cores = || std::thread::available_parallelism().map_or(1, Into::into);
    Ok(*CORES.get_or_init(cores))
}

/// Does `work`, in a pool if it is of `many` tasks: one needs no other thread.
pub fn install<T: Send>(
    asked: Option<usize>,
    many: bool,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Error> {
    let threads = count(asked)?;
    if many {
        Ok(pool(threads)?.install(work))
    } else {
        Ok(work())
    }
}

fn within(what: &'static str, text: &str) -> Result<usize, Error> {
    text.parse()
        .ok()
        .filter(|number| (1..=MOST).contains(number))
        .ok_or_else(|| Error::ThreadCount {
            what,
            found: text.to_owned(),
            most: MOST,
        })
}

/// The pool of this process with `threads` workers, made on first use.
pub fn pool(threads: usize) -> Result<Arc<ThreadPool>, Error> {
    let mut pools = POOLS.lock().ok_or(Error::Threads { threads })?;
    if let Some(entry) = pools.iter().find(|entry| entry.threads == threads) {
        return Ok(Arc::clone(&entry.pool));
    }
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("bipot-{i}"))
        .build()
        .map(Arc::new)
        .map_err(|_| Error::Threads { threads })?;
    pools.push(CachedPool {
        threads,
        pool: Arc::clone(&pool),
    });
    Ok(pool)
}
