//! Verified Cholesky factors below a matrix, and their ellipsoids.

use std::sync::atomic::AtomicBool;

use bipot_rs::linalg::verified_cholesky::{VerifiedCholesky, is_definite};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// `G Gᵀ + ridge`, column by column.
fn random_matrix(rng: &mut StdRng, n: usize, ridge: f64) -> Vec<f64> {
    let g: Vec<f64> = (0..n * n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let mut a = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            let product: f64 = (0..n).map(|k| g[i * n + k] * g[j * n + k]).sum();
            a[j * n + i] = product + if i == j { ridge } else { 0.0 };
        }
    }
    a
}

fn product(a: &[f64], x: &[f64]) -> Vec<f64> {
    let n = x.len();
    let row = |i: usize| (0..n).map(|j| a[j * n + i] * x[j]).sum();
    (0..n).map(row).collect()
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Points on the border of `dᵀAd + e·d ≤ 0` lie in what is said of them, and some of
/// them near its border.
#[test]
fn an_ellipsoid_contains_its_points_tightly() {
    let stop = AtomicBool::new(false);
    for seed in 0..40 {
        let mut rng = StdRng::seed_from_u64(seed);
        let n = rng.random_range(1..=6);
        let a = random_matrix(&mut rng, n, 0.3);
        let e: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
        let below = VerifiedCholesky::new(a.clone(), n, 0.0, &stop)
            .unwrap()
            .unwrap();
        let ellipsoid = below.ellipsoid(&e, &vec![0.0; n]);
        let widths = below.widths();
        let mut reached = vec![0.0_f64; n];
        for _ in 0..4000 {
            // Along x the border is at d = −(e·x / xᵀAx) x.
            let x: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
            let step = -dot(&e, &x) / dot(&x, &product(&a, &x));
            for j in 0..n {
                let off = (step * x[j] + ellipsoid.centre[j]).abs();
                let most = ellipsoid.radius * widths[j];
                // Rounding of this test's own products, of numbers of order one.
                assert!(off <= most * (1.0 + 1e-12), "{off} {most}");
                reached[j] = reached[j].max(off / most);
            }
        }
        // Random directions come near each of at most six tangent planes.
        assert!(reached.iter().all(|&r| r > 0.5), "{reached:?}");
    }
}

/// What a matrix may be off by is subtracted, and so is rounding.
#[test]
fn a_matrix_is_definite_only_beyond_its_error() {
    let stop = AtomicBool::new(false);
    let diagonal = |last: f64| vec![1.0, 0.0, 0.0, last];
    assert!(is_definite(diagonal(1e-3), 2, 0.9e-3, &stop).unwrap());
    assert!(!is_definite(diagonal(1e-3), 2, 1.1e-3, &stop).unwrap());
    // Positive, but by less than rounding of the largest may have made.
    assert!(!is_definite(diagonal(1e-16), 2, 0.0, &stop).unwrap());
    assert!(!is_definite(vec![f64::NAN], 1, 0.0, &stop).unwrap());
    // By more than that.
    assert!(is_definite(diagonal(1e-14), 2, 0.0, &stop).unwrap());
}

/// An error of the right side widens the ellipsoid by what it can do.
#[test]
fn an_uncertain_side_is_covered() {
    let stop = AtomicBool::new(false);
    let mut rng = StdRng::seed_from_u64(5);
    let a = random_matrix(&mut rng, 4, 0.5);
    let below = VerifiedCholesky::new(a, 4, 0.0, &stop).unwrap().unwrap();
    let e = [0.3, -0.2, 0.1, 0.7];
    let error = [1e-3, 2e-3, 0.0, 1e-3];
    let wide = below.ellipsoid(&e, &error);
    for signs in 0..16 {
        let sign = |j: usize| if signs >> j & 1 == 0 { 1.0 } else { -1.0 };
        let moved: Vec<f64> = (0..4).map(|j| e[j] + sign(j) * error[j]).collect();
        let exact = below.ellipsoid(&moved, &[0.0; 4]);
        let widths = below.widths();
        for (j, width) in widths.iter().enumerate() {
            let shift = (exact.centre[j] - wide.centre[j]).abs();
            assert!(shift + exact.radius * width <= wide.radius * width * (1.0 + 1e-12));
        }
    }
}
