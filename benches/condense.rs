//! Seconds of each phase of a condensation, compared with the rate of faer's matrix product `G`
//! in the same process.
//!
//! `cargo bench --bench condense`; sizes above 51k unknowns in three dimensions
//! with `BIPOT_BENCH_LARGE=1`, threads with `BIPOT_NUM_THREADS`.
#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a table of rates; a bench may fail"
)]

#[path = "../tests/common/elasticity.rs"]
#[expect(dead_code, reason = "tests use the rest")]
mod elasticity;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use bipot_rs::linalg::dense::{Op, cholesky, invert_from_cholesky, matmul};
use bipot_rs::linalg::sparse::multifrontal::{Factor, Schur};
use bipot_rs::linalg::sparse::symbolic::{Options, Symbolic};
use elasticity::Grid;

/// Smallest of some repetitions: what the machine can do when left alone.
fn seconds<T>(times: usize, mut work: impl FnMut() -> T) -> (f64, T) {
    let mut run = || {
        let begin = Instant::now();
        let result = work();
        (begin.elapsed().as_secs_f64(), result)
    };
    let (mut best, mut result) = run();
    for _ in 1..times {
        // Freed first: two factors at once would need twice the memory.
        drop(result);
        let (seconds, next) = run();
        best = best.min(seconds);
        result = next;
    }
    (best, result)
}

fn product_rate() -> f64 {
    let n = 1500;
    let a: Vec<f64> = (0..n * n).map(|i| (i % 97) as f64).collect();
    let mut c = vec![0.0; n * n];
    let (best, ()) = seconds(3, || {
        matmul(&mut c, (n, n, n), 1.0, &a, Op::Plain, &a, Op::Plain, 0.0);
    });
    2.0 * (n as f64).powi(3) / best
}

fn row(name: &str, grid: Grid, with_coordinates: bool) {
    let body = grid.assemble();
    let (k, n, face, places) = (body.view(), body.n(), body.face(), body.places());
    let options = Options {
        coordinates: with_coordinates.then_some(&places),
    };
    let rate = product_rate();
    let (_, symbolic) = seconds(2, || {
        Arc::new(Symbolic::analyse(&k, &face, &options).unwrap())
    });
    let counts = symbolic.counts();
    let stop = AtomicBool::new(false);
    let times = if n < 100_000 { 4 } else { 2 };
    let (dropped, _) = seconds(times, || Schur::new(&symbolic, &k, &mut [], &stop).unwrap());
    let factored = |symbolic: &Arc<Symbolic>| Factor::new(Arc::clone(symbolic), &k, &stop).unwrap();
    // Each with an analysis of its own, and so in fresh memory; then in the same.
    let analysed = || Arc::new(Symbolic::analyse(&k, &face, &options).unwrap());
    let fresh = (0..times).map(|_| {
        let symbolic = analysed();
        seconds(1, || factored(&symbolic)).0
    });
    let numeric = fresh.fold(f64::INFINITY, f64::min);
    let (again, factor) = seconds(times + 1, || factored(&symbolic));
    let m = symbolic.kept();
    let mut inverse = factor.schur().to_vec();
    let (dense, ()) = seconds(3, || {
        inverse.copy_from_slice(factor.schur());
        cholesky(&mut inverse, m, &stop).unwrap();
        invert_from_cholesky(&mut inverse, m, &stop).unwrap();
    });
    let mut load = vec![1.0; n];
    let (solve, ()) = seconds(3, || {
        factor.condense(&mut load, 1);
        factor.recover(&mut load, 1);
    });
    println!(
        "{name:>10} {:>8} {m:>6} {:>9.3} {:>9.3} {numeric:>9.3} {again:>9.3} {dropped:>9.3} {dense:>9.3} {solve:>9.4} {:>9.1} {:>7.1} {:>6.0} % {:>8} {:>8} {:>8}  {}",
        n,
        counts.seconds_order,
        counts.seconds_symbolic,
        counts.flops / 1e9,
        rate / 1e9,
        100.0 * counts.flops / numeric / rate,
        counts.bytes_factor >> 20,
        counts.bytes_peak >> 20,
        counts.bytes_peak_dropped >> 20,
        counts.ordering,
    );
}

fn main() {
    let threads = std::env::var("BIPOT_NUM_THREADS")
        .ok()
        .and_then(|t| t.parse().ok());
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(1))
        .build()
        .unwrap();
    let large = std::env::var_os("BIPOT_BENCH_LARGE").is_some();
    let only = std::env::var("BIPOT_BENCH_ONLY").ok();
    println!(
        "{} threads; seconds, Gflop, Gflop/s of G, share of G, MB",
        pool.current_num_threads()
    );
    println!(
        "{:>10} {:>8} {:>6} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>7} {:>8} {:>8} {:>8} {:>8}",
        "body",
        "n",
        "m",
        "order",
        "symbolic",
        "S",
        "S again",
        "S alone",
        "W from S",
        "solve",
        "Gflop",
        "G",
        "share",
        "factor",
        "peak",
        "alone"
    );
    pool.install(|| {
        let rows = [
            ("cube 14", Grid::cube(14), false),
            ("cube 25", Grid::cube(25), false),
            ("square 316", Grid::square(316), false),
            ("cube 36", Grid::cube(36), true),
        ];
        for (name, make, is_large) in rows {
            if (large || !is_large) && only.as_ref().is_none_or(|o| name.contains(o.as_str())) {
                row(name, make, false);
                row(name, make, true);
            }
        }
    });
}
