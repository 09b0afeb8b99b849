//! The rate of one front by its size: `p` pivots eliminated from a dense matrix with `u` rows
//! left, compared with the rate of a product of this size.
//!
//! `cargo bench --bench fronts`; one thread.
#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a table of rates; a bench may fail"
)]

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use bipot_rs::linalg::dense::{Op, matmul};
use bipot_rs::linalg::sparse::csc::Symmetric;
use bipot_rs::linalg::sparse::multifrontal::Factor;
use bipot_rs::linalg::sparse::symbolic::{Options, Symbolic};

/// Least seconds of one call in batches of some milliseconds.
fn seconds(mut work: impl FnMut()) -> f64 {
    let mut batch = |calls: u32| {
        let begin = Instant::now();
        (0..calls).for_each(|_| work());
        begin.elapsed().as_secs_f64() / f64::from(calls)
    };
    let one = batch(1).max(1e-7);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small count"
    )]
    let calls = (5e-3 / one).clamp(1.0, 1e4) as u32;
    (0..7).map(|_| batch(calls)).fold(f64::INFINITY, f64::min)
}

/// `n I` and small entries that differ, by columns.
fn dense(n: usize) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
    let pointers = (0..=n).map(|j| j * n).collect();
    let rows = (0..n * n).map(|k| k % n).collect();
    let value = |k: usize| {
        let (i, j) = (k / n, k % n);
        if i == j {
            n as f64
        } else {
            1.0 / (1 + i + j) as f64
        }
    };
    (pointers, rows, (0..n * n).map(value).collect())
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    println!(
        "{:>7} {:>7} {:>10} {:>9} {:>11} {:>11} {:>7}",
        "pivots", "rows", "kflop", "µs", "Gflop/s", "G, Gflop/s", "share"
    );
    pool.unwrap().install(|| {
        for pivots in [6, 12, 24, 48, 96, 192, 384] {
            for rows in [24, 96, 384] {
                let n = pivots + rows;
                let (pointers, indices, values) = dense(n);
                let k = Symmetric::new(n, &pointers, &indices, &values).unwrap();
                let kept: Vec<usize> = (pivots..n).collect();
                let options = Options { coordinates: None };
                let symbolic = Arc::new(Symbolic::analyse(&k, &kept, &options).unwrap());
                let stop = AtomicBool::new(false);
                let front = seconds(|| {
                    drop(Factor::new(Arc::clone(&symbolic), &k, &stop).unwrap());
                });
                let a: Vec<f64> = (0..pivots * rows).map(|i| (i % 97) as f64).collect();
                let mut c = vec![0.0; rows * rows];
                let product = seconds(|| {
                    let size = (rows, rows, pivots);
                    let (left, right) = (Op::Transposed, Op::Plain);
                    matmul(&mut c, size, 1.0, &a, left, &a, right, 0.0);
                });
                let flops = symbolic.counts().flops;
                let of_product = 2.0 * (pivots * rows * rows) as f64 / product;
                println!(
                    "{pivots:>7} {rows:>7} {:>10.0} {:>9.1} {:>11.1} {:>11.1} {:>5.0} %",
                    flops / 1e3,
                    1e6 * front,
                    flops / front / 1e9,
                    of_product / 1e9,
                    100.0 * flops / front / of_product,
                );
            }
        }
    });
}
