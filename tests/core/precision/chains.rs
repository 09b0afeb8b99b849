//! Many unknowns, known answers: springs in series, hubs, and many pieces.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::comparison::schur;
use super::matrices::{Entries, Sparse, shuffle};

/// Least common multiple of the stiffnesses 1 to 9.
const MULTIPLE: u64 = 2520;

/// A chain of springs of whole stiffness, the unknowns numbered in this order.
fn chain(stiffness: &[u64], order: &[usize]) -> Sparse {
    let mut entries = Entries::default();
    for (pair, &k) in order.windows(2).zip(stiffness) {
        entries.spring(pair[0], pair[1], k as f64);
    }
    entries.matrix(order.len())
}

/// Springs in series, `1/Σ 1/k`: whole numbers up to the one division.
fn series(stiffness: &[u64]) -> f64 {
    let flexibility: u64 = stiffness.iter().map(|k| MULTIPLE / k).sum();
    MULTIPLE as f64 / flexibility as f64
}

#[test]
fn springs_in_series() {
    let mut random = StdRng::seed_from_u64(9);
    let n = 20_001;
    let stiffness: Vec<u64> = (1..n).map(|_| random.random_range(1..10)).collect();
    for (step, shuffled) in [(n - 1, false), (n - 1, true), (100, true), (40, false)] {
        let mut order: Vec<usize> = (0..n).collect();
        if shuffled {
            shuffle(&mut order, &mut random);
        }
        let kept: Vec<usize> = (0..n).step_by(step).map(|at| order[at]).collect();
        let s = schur(&chain(&stiffness, &order), &kept);
        let m = kept.len();
        let links: Vec<f64> = stiffness.chunks(step).map(series).collect();
        let mut worst = 0.0_f64;
        for i in 0..m {
            for j in 0..m {
                let left = if i > 0 { links[i - 1] } else { 0.0 };
                let right = links.get(i).copied().unwrap_or(0.0);
                let exact = match j.abs_diff(i) {
                    0 => left + right,
                    1 => -links[i.min(j)],
                    _ => 0.0,
                };
                worst = worst.max((s[i * m + j] - exact).abs());
            }
        }
        // A rounding of the stiffest spring for each one taken away, were they
        // all alike: no more, for what is left is always a chain of springs.
        assert!(
            worst <= 9.0 * step as f64 * f64::EPSILON,
            "{step}: {worst:e}"
        );
    }
}

/// A hub that touches all others, with these stiffnesses of its own and theirs.
fn hub(n: usize, at: usize) -> Sparse {
    let mut entries = Entries::default();
    for i in 0..n {
        if i == at {
            entries.add(i, i, n as f64);
        } else {
            entries.add(i, i, own(i));
            entries.add(at, i, 1.0);
        }
    }
    entries.matrix(n)
}

fn own(i: usize) -> f64 {
    [2.0, 4.0, 8.0][i % 3]
}

/// `n − Σ 1/own`, a sum of eighths and so exact, over what is not kept.
fn hub_left(n: usize, at: usize, kept: &[usize]) -> f64 {
    let rest = (0..n).filter(|i| *i != at && !kept.contains(i));
    n as f64 - rest.map(|i| 1.0 / own(i)).sum::<f64>()
}

#[test]
fn a_hub_kept_or_taken_away() {
    let n = 20_000;
    // Every sum has n terms that are a rounding of n at most.
    let rounding = n as f64 * f64::EPSILON;
    for at in [0, n / 2, n - 1] {
        let k = hub(n, at);
        let s = schur(&k, &[at]);
        let exact = hub_left(n, at, &[]);
        assert!((s[0] - exact).abs() <= rounding * n as f64);

        let kept = [n / 3, 7, n - 5];
        let s = schur(&k, &kept);
        let hub = hub_left(n, at, &kept);
        for (i, &a) in kept.iter().enumerate() {
            for j in 0..3 {
                let exact = if i == j { own(a) } else { 0.0 } - 1.0 / hub;
                let found = s[i * 3 + j];
                // The hub's rounding, in the quotient; and one of the diagonal.
                let allowed = rounding / hub + 2.0 * f64::EPSILON * own(a);
                assert!((found - exact).abs() <= allowed, "{found} {exact}");
            }
        }

        // The hub and some spokes kept: nothing touches the spokes.
        let kept = [at, n / 3, 7];
        let s = schur(&k, &kept);
        assert!((s[0] - hub_left(n, at, &kept)).abs() <= rounding * n as f64);
        assert_eq!(s[1..], [1.0, 1.0, 1.0, own(n / 3), 0.0, 1.0, 0.0, own(7)]);
    }
}

/// A thousand chains of twenty, held at one end, of which a hundred have a kept
/// unknown and ten are kept whole.
#[test]
fn a_thousand_pieces() {
    let (pieces, each) = (1000, 20);
    let mut entries = Entries::default();
    let mut kept = Vec::new();
    for piece in 0..pieces {
        let first = piece * each;
        entries.add(first, first, 1.0);
        for i in first + 1..first + each {
            entries.spring(i - 1, i, 1.0);
        }
        match piece % 100 {
            0 => kept.extend(first..first + each),
            k if k % 11 == 5 => kept.push(first + each - 1),
            _ => {}
        }
    }
    let k = entries.matrix(pieces * each);
    let s = schur(&k, &kept);
    let m = kept.len();
    let view = k.view();
    let dense = |i: usize, j: usize| view.column(j).find(|e| e.0 == i).map_or(0.0, |e| e.1);
    for (a, &i) in kept.iter().enumerate() {
        for (b, &j) in kept.iter().enumerate() {
            let found = s[a * m + b];
            if i / each % 100 == 0 || i != j {
                assert_eq!(found.to_bits(), dense(i, j).to_bits());
            } else {
                // Twenty unit springs in series, a rounding each.
                assert!((found - 1.0 / each as f64).abs() <= 20.0 * f64::EPSILON);
            }
        }
    }
}
