//! The kernels of the contact solvers: one contact exactly, the product with `W`,
//! and iterations of every method on one problem.
//!
//! Work is counted in products with `W`. The rate of a method is the bytes of `W` times the
//! products counted, per second; the difference to the rate of the product alone is the cost of
//! everything else. Iterations start from zero and end before convergence; the time includes the
//! certificate of the last point.

#![expect(clippy::unwrap_used, reason = "a bench may fail")]
#![expect(clippy::print_stderr, reason = "what a time was spent on")]
#![expect(clippy::cast_precision_loss, reason = "rates, and places on a grid")]

use std::borrow::Cow;
use std::hint::black_box;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use bipot_rs::law::cone::Status;
use bipot_rs::law::contact_law::ContactLaw;
use bipot_rs::law::one_node::{self, Habit};
use bipot_rs::linalg::small::Block;
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::{Reduced, Rigid};
use bipot_rs::solver::{Method, Settings, Solution, Start, solve};
use bipot_rs::threads;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Nodes a side of a square contact area: 100, 400 and 900 contacts.
const SIDES: [usize; 3] = [10, 20, 30];

const ITERATIONS: usize = 20;
/// Newton's method converges in more, and its steps are dear.
const NEWTON_ITERATIONS: usize = 3;

/// Contacts on a square grid whose responses fade with distance, normal and
/// tangents coupled: positive definite, as both factors of the product are.
fn grid(side: usize) -> (Vec<f64>, Vec<[f64; 3]>) {
    const OWN: [[f64; 3]; 3] = [[1.0, 0.2, -0.1], [0.2, 0.8, 0.1], [-0.1, 0.1, 0.8]];
    let m = 3 * side * side;
    let place = |i: usize| [(i / 3 / side) as f64, (i / 3 % side) as f64];
    let fading = |i: usize, j: usize| {
        let ([a, b], [c, d]) = (place(i), place(j));
        (-(a - c).hypot(b - d)).exp()
    };
    let w = (0..m * m).map(|k| fading(k / m, k % m) * OWN[k / m % 3][k % m % 3]);
    let mut rng = StdRng::seed_from_u64(4);
    // Pressed but for a few, and dragged by about the friction limit.
    let free = |_| [-1.0, 0.3, 0.0].map(|c| c + rng.random_range(-0.2..0.2));
    (w.collect(), (0..side * side).map(free).collect())
}

/// Cold random problems, a third each open, slipping and sticking, in random order.
fn contacts<const D: usize>() -> Vec<(Block<D>, [f64; D], f64)> {
    const NODES: usize = 1 << 15;
    let mut rng = StdRng::seed_from_u64(18);
    let mut found = Vec::with_capacity(NODES);
    let mut wanted = Status::Open;
    while found.len() < NODES {
        let mut g = Block::<D>::zeros();
        g.iter_mut().for_each(|x| *x = rng.random_range(-1.0..1.0));
        let w = g * g.transpose() + Block::identity() * 0.01;
        let q: [f64; D] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        let mu = 0.1 * 20.0_f64.powf(rng.random());
        if one_node::solve(&w, &q, mu, Habit::None).is_some_and(|(_, s)| s == wanted) {
            found.push((w, q, mu));
            wanted = [Status::Open, Status::Slip, Status::Stick][rng.random_range(0..3)];
        }
    }
    found
}

fn one_node_of<const D: usize>(criterion: &mut Criterion) {
    let contacts = contacts::<D>();
    let mut group = criterion.benchmark_group("one node");
    group.throughput(Throughput::Elements(contacts.len() as u64));
    group.bench_function(BenchmarkId::from_parameter(format!("{D}D")), |bencher| {
        bencher.iter(|| {
            let normal = |(w, q, mu): &(Block<D>, [f64; D], f64)| {
                one_node::solve(w, q, *mu, Habit::None).map_or(0.0, |(r, _)| r[0])
            };
            black_box(contacts.iter().map(normal).sum::<f64>())
        });
    });
    group.finish();
}

fn one_node(criterion: &mut Criterion) {
    one_node_of::<2>(criterion);
    one_node_of::<3>(criterion);
}

fn product(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("product with W");
    for side in SIDES {
        let (w, q) = grid(side);
        let compliance = Compliance::<3>::from_dense(q.len(), Cow::Borrowed(&w)).unwrap();
        let mut v = q.clone();
        group.throughput(Throughput::Bytes(8 * w.len() as u64));
        for count in [1, threads::count(None).unwrap()] {
            let pool = threads::pool(count).unwrap();
            let name = BenchmarkId::new(format!("{count} threads"), q.len());
            group.bench_function(name, |bencher| {
                bencher.iter(|| pool.install(|| compliance.product(black_box(&q), &mut v)));
            });
        }
    }
    group.finish();
}

fn iterations(problem: &Reduced<3>, method: Method, count: usize) -> Solution<3> {
    let settings = Settings {
        method,
        tol: f64::MIN_POSITIVE,
        max_iterations: count,
        ..Settings::default()
    };
    solve(
        problem,
        &settings,
        &Start::default(),
        &AtomicBool::new(false),
    )
    .unwrap()
}

fn methods(criterion: &mut Criterion) {
    let pool = threads::pool(1).unwrap();
    for side in SIDES {
        let (w, q) = grid(side);
        let compliance = Compliance::from_dense(q.len(), Cow::Borrowed(&w)).unwrap();
        let mu = vec![0.3; q.len()];
        let problem = Reduced::new(
            &compliance,
            &q,
            &ContactLaw::coulomb(&mu),
            &Rigid::default(),
        )
        .unwrap();
        let mut group = criterion.benchmark_group("iterations, 1 thread");
        for (name, method) in Method::NAMES {
            let most = match method {
                Method::Auto => continue, // one of the others at any time
                Method::GaussSeidel
                | Method::Nesterov
                | Method::Uzawa
                | Method::UzawaTwoProjection => ITERATIONS,
                _ => NEWTON_ITERATIONS, // a system is solved in each
            };
            let seen = pool.install(|| iterations(&problem, method, most));
            let closed = seen.status.iter().filter(|&&s| s != Status::Open).count();
            eprintln!(
                "{name}, {} contacts: {} iterations, work {:.1}, {closed} closed, η {:.0e}",
                q.len(),
                seen.iterations,
                seen.work,
                seen.residual
            );
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "positive"
            )]
            let bytes = (8.0 * w.len() as f64 * seen.work) as u64;
            group.throughput(Throughput::Bytes(bytes));
            group.bench_function(BenchmarkId::new(name, q.len()), |bencher| {
                bencher.iter(|| pool.install(|| black_box(iterations(&problem, method, most))));
            });
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = one_node, product, methods
}
criterion_main!(benches);
