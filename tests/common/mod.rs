//! Bodies, problems and arithmetic that several tests use.

pub(crate) mod cases;
pub(crate) mod double_double;
pub(crate) mod elasticity;

use std::sync::atomic::AtomicBool;

use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Stops nothing.
pub(crate) static GO: AtomicBool = AtomicBool::new(false);

/// The same work on so many threads.
pub(crate) fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = bipot_rs::threads::pool(threads);
    pool.expect("threads start").install(work)
}

pub(crate) fn minus<const D: usize>(a: &[f64; D], b: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|k| a[k] - b[k])
}

pub(crate) fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

/// Numbers of size one.
pub(crate) fn random(count: usize, seed: u64) -> Vec<f64> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}
