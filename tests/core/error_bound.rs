//! Verified Cholesky factors below a matrix, their ellipsoids, and the error bounds made with
//! them.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;

use crate::common::GO;
use crate::common::cases::Case;
use bipot_rs::linalg::small::dot_long as dot;
use bipot_rs::linalg::verified_cholesky::{VerifiedCholesky, is_definite};
use bipot_rs::proof::error_bound::{BoundKind, Prepared, Reason};
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::solver::Method;
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

/// Points on the border of `dᵀAd + e·d ≤ 0` lie in what is said of them, and some of
/// them near its border.
#[test]
fn an_ellipsoid_contains_its_points_tightly() {
    for seed in 0..40 {
        let mut rng = StdRng::seed_from_u64(seed);
        let n = rng.random_range(1..=6);
        let a = random_matrix(&mut rng, n, 0.3);
        let e: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
        let below = VerifiedCholesky::new(a.clone(), n, 0.0, &GO)
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
    let diagonal = |last: f64| vec![1.0, 0.0, 0.0, last];
    assert!(is_definite(diagonal(1e-3), 2, 0.9e-3, &GO).unwrap());
    assert!(!is_definite(diagonal(1e-3), 2, 1.1e-3, &GO).unwrap());
    // Positive, but by less than rounding of the largest may have made.
    assert!(!is_definite(diagonal(1e-16), 2, 0.0, &GO).unwrap());
    assert!(!is_definite(vec![f64::NAN], 1, 0.0, &GO).unwrap());
    // By more than that.
    assert!(is_definite(diagonal(1e-14), 2, 0.0, &GO).unwrap());
}

/// An error of the right side widens the ellipsoid by what it can do.
#[test]
fn an_uncertain_side_is_covered() {
    let mut rng = StdRng::seed_from_u64(5);
    let a = random_matrix(&mut rng, 4, 0.5);
    let below = VerifiedCholesky::new(a, 4, 0.0, &GO).unwrap().unwrap();
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

/// The bound of a point that is off by a known amount: it contains the solution, number by
/// number and in energy, and is not much larger than the error. Counts the kinds.
fn solution_is_within_its_bound<const D: usize>(mu: f64, seed: u64, kinds: &mut [usize; 3]) {
    let case = Case::<D>::held(5, mu, seed);
    let problem = case.problem();
    let solution = case.solve(Method::Auto);
    let exact = solution.reaction;
    let bounds = Prepared::new(&problem, &GO).unwrap();
    let mut rng = StdRng::seed_from_u64(seed);
    for size in [1e-2, 1e-5, 1e-8] {
        let mut point = exact.clone();
        // Without friction no solution has a tangential reaction.
        let components = if mu > 0.0 { D } else { 1 };
        for r in &mut point {
            for value in &mut r[..components] {
                *value += size * rng.random_range(-1.0..1.0);
            }
        }
        let bound = bounds.bound(&problem, (&point, &[]), None, &GO).unwrap();
        kinds[match bound.kind {
            BoundKind::Global => 0,
            BoundKind::Local => 1,
            BoundKind::NotAvailable(reason) => {
                assert!(matches!(reason, Reason::Friction(_)), "{reason:?}");
                assert!(!bounds.unique() && bound.energy.is_infinite());
                2
            }
        }] += 1;
        if matches!(bound.kind, BoundKind::NotAvailable(_)) {
            continue;
        }
        assert_eq!(bounds.unique(), bound.kind == BoundKind::Global);
        assert!(bound.energy <= bound.alone_within);
        let off: Vec<[f64; D]> = (0..5)
            .map(|i| std::array::from_fn(|k| point[i][k] - exact[i][k]))
            .collect();
        let mut moved = off.clone();
        problem.compliance.product(&off, &mut moved);
        // The solution has η = 1e-12, and W a condition of some tens.
        let slack = 1e-10;
        let within = |off: &[[f64; D]], most: &[[f64; D]]| {
            let pairs = off.as_flattened().iter().zip(most.as_flattened());
            pairs.into_iter().all(|(x, most)| x.abs() <= most + slack)
        };
        assert!(within(&off, &bound.reaction) && within(&moved, &bound.relative_displacement));
        let energy = dot(off.as_flattened(), moved.as_flattened()).sqrt();
        assert!(energy <= bound.energy + slack);
        // It falls with the change: to some tens of it, to some hundreds in a ball that is tried.
        let most = if bounds.unique() { 2e2 } else { 1e4 };
        assert!(bound.energy <= most * size, "{:e}", bound.energy);
        if let Some(by_gap) = bound.energy_by_gap {
            assert!(energy <= by_gap + slack);
        }
    }
}

#[test]
fn bounds_contain_the_solution() {
    let mut kinds = [0; 3];
    for seed in 0..12 {
        for mu in [0.0, 0.6, 8.0, 40.0] {
            solution_is_within_its_bound::<2>(mu, seed, &mut kinds);
            solution_is_within_its_bound::<3>(mu, seed, &mut kinds);
        }
    }
    assert!(kinds.iter().all(|&n| n > 10), "{kinds:?}");
}

/// Each reason by a problem that has nothing else.
#[test]
fn no_bound_without_a_reason() {
    let told = |w: [f64; 16], q: f64, r: [[f64; 2]; 2]| {
        let mut case = Case::<2>::held(2, 0.3, 1);
        case.compliance = Compliance::from_dense(2, Cow::Owned(w.to_vec())).unwrap();
        case.q = vec![[q, 0.0], [-1.0, 0.5]];
        let problem = case.problem();
        let bounds = Prepared::new(&problem, &GO).unwrap();
        let bound = bounds.bound(&problem, (&r, &[]), None, &GO).unwrap();
        match bound.kind {
            BoundKind::NotAvailable(reason) => reason.told(),
            kind => (kind.name(), 0),
        }
    };
    let diagonal = |d: [f64; 4]| std::array::from_fn(|k| if k % 5 == 0 { d[k / 5] } else { 0.0 });
    let (free, pressed) = ([[0.0; 2], [1.0, 0.0]], [[1.0, 0.0]; 2]);
    for (w, q, r, expected) in [
        ([1.0; 4], 1.0, free, ("global", 0)),
        ([0.0, 0.0, 1.0, 1.0], -1.0, free, ("no answer", 0)),
        ([0.0, 0.0, 1.0, 1.0], 0.0, free, ("touching", 0)),
        ([0.0, 0.0, 1.0, 1.0], 1.0, free, ("global", 0)),
        ([0.0, 0.0, 1.0, 1.0], 1.0, pressed, ("impossible", 0)),
        ([1.0, 1.0, 1.0, 0.0], 1.0, free, ("led", 1)),
        ([1.0, 1.0, 1.0, -1.0], 1.0, free, ("not definite", 0)),
        ([1.0; 4], 1.0, [[0.0; 2], [1e300, 0.0]], ("range", 0)),
    ] {
        assert_eq!(told(diagonal(w), q, r), expected);
    }
}
