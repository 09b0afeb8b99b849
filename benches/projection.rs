//! The projection onto `K_μ`: nodes per second in 2 and 3 dimensions, on one thread and on all,
//! compared with a copy of the same arrays, which is limited by memory.

use std::hint::black_box;

use bipot_rs::law::cone::project;
use bipot_rs::threads;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rayon::prelude::*;

const NODES: usize = 1 << 20;
const CHUNK: usize = 4096;

/// A third of the nodes each open, slipping and sticking, in no order: the
/// branches are as hard to foresee as they come.
fn nodes<const D: usize>() -> Vec<[f64; D]> {
    let mut rng = StdRng::seed_from_u64(7);
    let mut node = |_| {
        let mut tau: [f64; D] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        tau[0] = rng.random_range(-1.0..1.0);
        tau
    };
    (0..NODES).map(&mut node).collect()
}

fn of_dimension<const D: usize>(criterion: &mut Criterion) {
    let tau = nodes::<D>();
    let mut out = vec![[0.0; D]; NODES];
    let mut group = criterion.benchmark_group(format!("project {D}D"));
    group.throughput(Throughput::Elements(NODES as u64));
    group.sample_size(20);
    for count in [1, threads::count(None).unwrap_or(1)] {
        let Ok(pool) = threads::pool(count) else {
            continue;
        };
        group.bench_function(BenchmarkId::new("threads", count), |bencher| {
            bencher.iter(|| {
                pool.install(|| {
                    out.par_chunks_mut(CHUNK)
                        .zip(tau.par_chunks(CHUNK))
                        .for_each(|(out, tau)| {
                            for (r, tau) in out.iter_mut().zip(tau) {
                                *r = project(tau, 0.4).0;
                            }
                        });
                });
                black_box(&mut out);
            });
        });
        group.bench_function(BenchmarkId::new("copy, threads", count), |bencher| {
            bencher.iter(|| {
                pool.install(|| {
                    out.par_chunks_mut(CHUNK)
                        .zip(tau.par_chunks(CHUNK))
                        .for_each(|(out, tau)| out.copy_from_slice(tau));
                });
                black_box(&mut out);
            });
        });
    }
    group.finish();
}

fn projection(criterion: &mut Criterion) {
    of_dimension::<2>(criterion);
    of_dimension::<3>(criterion);
}

criterion_group!(benches, projection);
criterion_main!(benches);
