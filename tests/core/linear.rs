//! Dense linear algebra of the Newton steps: LU, GMRES, and sums in twice the precision.

#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "orders of matrices; a helper of a test may fail"
)]

use std::convert::Infallible;
use std::sync::atomic::AtomicBool;

use crate::common::{GO, bits, with_threads};
use bipot_rs::error::Error;
use bipot_rs::linalg::compensated::{Sum, dot};
use bipot_rs::linalg::flexible_gmres::{self, Limits};
use bipot_rs::linalg::gmres::{self, GmresSolution};
use bipot_rs::linalg::jacobi::{combine, orthogonalise};
use bipot_rs::linalg::lu::Lu;
use bipot_rs::linalg::small::norm;
use rand::{RngExt, SeedableRng, rngs::StdRng, seq::SliceRandom};

const EPS: f64 = f64::EPSILON;

fn vector(n: usize, rng: &mut StdRng) -> Vec<f64> {
    (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn times(a: &[f64], x: &[f64]) -> Vec<f64> {
    let rows = a.chunks_exact(x.len().max(1));
    rows.map(|row| dot(row, x).value()).collect()
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    norm(&a.iter().zip(b).map(|(x, y)| x - y).collect::<Vec<_>>())
}

fn factored(a: &[f64], n: usize) -> Option<Lu> {
    Lu::new(a.to_vec(), n, &GO).unwrap()
}

#[test]
fn lu_leaves_a_residual_of_rounding() {
    let mut rng = StdRng::seed_from_u64(1);
    // Below, at and above the width of a panel, 64, and of several.
    for n in [
        1, 2, 3, 7, 31, 63, 64, 65, 100, 127, 128, 129, 200, 256, 300,
    ] {
        let a = vector(n * n, &mut rng);
        let b = vector(n, &mut rng);
        let lu = factored(&a, n).unwrap();
        assert_eq!(lu.order(), n);
        let mut x = b.clone();
        lu.solve(&mut x);
        // Backward error of elimination with pivoting: n ε ‖A‖ ‖x‖ times the growth of
        // the entries, below n^(2/3) for random matrices; the Frobenius norm that
        // stands for ‖A‖ is √n/2 times it.
        let bound = n as f64 * EPS * norm(&a) * norm(&x);
        let left = apart(&times(&a, &x), &b);
        assert!(left <= bound, "{n}: {left:e} {bound:e}");
    }
}

#[test]
fn lu_has_the_same_bits_on_any_number_of_threads() {
    for n in [300, 451] {
        let mut rng = StdRng::seed_from_u64(n as u64);
        let (a, b) = (vector(n * n, &mut rng), vector(n, &mut rng));
        let run = |threads| {
            let lu = with_threads(threads, || factored(&a, n)).unwrap();
            let mut x = b.clone();
            lu.solve(&mut x);
            (lu.sign().to_bits(), bits(&x))
        };
        assert_eq!(run(1), run(2));
        assert_eq!(run(1), run(3));
    }
}

/// Whether a permutation is odd, by the number of its cycles.
fn is_odd(permutation: &[usize]) -> bool {
    let mut seen = vec![false; permutation.len()];
    let mut odd = false;
    for first in 0..permutation.len() {
        let mut at = first;
        while !seen[at] {
            seen[at] = true;
            at = permutation[at];
            odd ^= at != first;
        }
    }
    odd
}

#[test]
fn lu_knows_the_sign_of_the_determinant() {
    let mut rng = StdRng::seed_from_u64(2);
    let mut signs = [0; 2];
    for n in [1, 2, 3, 4, 5, 64, 65, 130, 200] {
        for _ in 0..6 {
            // A permutation with signs, then reflections: each turns the sign over,
            // and none changes a length, so that no pivot is near to zero.
            let mut columns: Vec<usize> = (0..n).collect();
            columns.shuffle(&mut rng);
            let mut negative = is_odd(&columns);
            let mut a = vec![0.0; n * n];
            for (row, &column) in columns.iter().enumerate() {
                let sign: bool = rng.random();
                negative ^= sign;
                a[row * n + column] = if sign { -1.0 } else { 1.0 };
            }
            for _ in 0..rng.random_range(0..4) {
                let w = vector(n, &mut rng);
                let squares = norm(&w).powi(2);
                for row in a.chunks_exact_mut(n) {
                    let along = dot(row, &w).value() * 2.0 / squares;
                    for (value, w) in row.iter_mut().zip(&w) {
                        *value -= along * w;
                    }
                }
                negative ^= true;
            }
            let expected = if negative { -1.0_f64 } else { 1.0 };
            assert_eq!(
                factored(&a, n).unwrap().sign().to_bits(),
                expected.to_bits(),
                "{n}"
            );
            signs[usize::from(negative)] += 1;
        }
    }
    assert!(signs.iter().all(|&count| count > 10), "{signs:?}");
    assert_eq!(
        factored(&[], 0).unwrap().sign().to_bits(),
        1.0_f64.to_bits()
    );
}

#[test]
fn lu_has_no_factors_of_a_singular_matrix() {
    assert!(factored(&[0.0], 1).is_none());
    assert!(factored(&[1.0, 2.0, 2.0, 4.0], 2).is_none());
    assert!(factored(&[f64::NAN], 1).is_none());
    let mut rng = StdRng::seed_from_u64(3);
    for n in [3, 64, 65, 150] {
        // A row that is a sum of two others, and one that repeats another, to the bit
        // and to rounding.
        let mut a = vector(n * n, &mut rng);
        for j in 0..n {
            a[(n - 1) * n + j] = a[j] + a[n + j];
        }
        assert!(factored(&a, n).is_none(), "{n}");
        a = vector(n * n, &mut rng);
        a.copy_within(0..n, n * (n / 2));
        assert!(factored(&a, n).is_none(), "{n}");
        // What is away from singular by more than rounding is factored: a change of
        // 1e-9 in a row is a million times n² ε.
        a[n * (n / 2)] += 1e-9;
        assert!(factored(&a, n).is_some(), "{n}");
    }
}

#[test]
fn lu_can_be_stopped() {
    let stopped = Lu::new(vec![1.0], 1, &AtomicBool::new(true));
    assert_eq!(stopped.unwrap_err(), Error::Interrupted);
}

/// GMRES on a matrix by rows, preconditioned by the diagonal `m`.
fn krylov(a: &[f64], m: &[f64], b: &[f64], tol: f64, most: usize) -> GmresSolution {
    let apply = |x: &[f64]| Ok::<_, Infallible>(times(a, x));
    let precondition = |x: &mut [f64]| {
        for (value, m) in x.iter_mut().zip(m) {
            *value /= m;
        }
    };
    gmres::solve(&apply, &precondition, b, tol, most).unwrap()
}

/// A matrix with its spectrum right of one: `G + I √n`, or `G Gᵀ/n + I`.
fn matrix(n: usize, symmetric: bool, rng: &mut StdRng) -> Vec<f64> {
    let g = vector(n * n, rng);
    let mut a = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            a[i * n + j] = if symmetric {
                dot(&g[i * n..(i + 1) * n], &g[j * n..(j + 1) * n]).value() / n as f64
            } else {
                g[i * n + j]
            };
        }
        a[i * n + i] += if symmetric { 1.0 } else { (n as f64).sqrt() };
    }
    a
}

#[test]
fn gmres_converges_to_the_tolerance() {
    let mut rng = StdRng::seed_from_u64(4);
    for symmetric in [true, false] {
        for n in [1, 5, 40, 150] {
            let a = matrix(n, symmetric, &mut rng);
            let b = vector(n, &mut rng);
            let ones = vec![1.0; n];
            for tol in [1e-3, 1e-8, 1e-13] {
                let found = krylov(&a, &ones, &b, tol, n);
                let left = apart(&times(&a, &found.x), &b) / norm(&b);
                // The recurrence keeps what is left to some roundings of a product.
                assert!((left - found.residual).abs() <= 100.0 * EPS, "{n} {left:e}");
                assert!(found.residual <= tol && found.products <= n);
            }
            // Spectra this narrow need far fewer products than unknowns.
            assert!(n < 150 || krylov(&a, &ones, &b, 1e-8, n).products < n / 3);
        }
    }
}

#[test]
fn gmres_is_done_when_its_space_holds_the_solution() {
    let mut rng = StdRng::seed_from_u64(5);
    let n = 30;
    // Three distinct eigenvalues: a polynomial of degree three ends it.
    let mut a = vec![0.0; n * n];
    (0..n).for_each(|i| a[i * n + i] = [1.0, 3.0, -2.0][i % 3]);
    let b = vector(n, &mut rng);
    let found = krylov(&a, &vec![1.0; n], &b, 1e-13, 100);
    assert_eq!(found.products, 3);
    assert!(apart(&times(&a, &found.x), &b) <= 1e-13 * norm(&b));
    // A cyclic shift leaves the residual at one until the last product.
    let mut shift = vec![0.0; n * n];
    (0..n).for_each(|i| shift[i * n + (i + 1) % n] = 1.0);
    let mut unit = vec![0.0; n];
    unit[0] = 1.0;
    let ones = vec![1.0; n];
    let cut = krylov(&shift, &ones, &unit, 1e-13, n - 1);
    assert_eq!(
        (cut.products, cut.residual.to_bits()),
        (n - 1, 1.0_f64.to_bits())
    );
    let found = krylov(&shift, &ones, &unit, 1e-13, 100);
    assert_eq!(found.products, n);
    assert!(apart(&times(&shift, &found.x), &unit) <= 1e-13);
}

#[test]
fn flexible_gmres_believes_no_residual_below_its_basis() {
    let mut rng = StdRng::seed_from_u64(9);
    let limits = Limits {
        tol: 1e-13,
        restart: 40,
        most: 100,
    };
    for n in [2, 3, 4] {
        // The space of n directions is whole: the recurrence says zero, and the basis in single
        // precision leaves some 1e-8.
        let mut a = vector(n * n, &mut rng);
        (0..n).for_each(|i| a[i * n + i] += 3.0);
        let b = vector(n, &mut rng);
        let found = flexible_gmres::solve(
            |x, y| y.copy_from_slice(&times(&a, x)),
            |r, z| z.copy_from_slice(r),
            &b,
            limits,
            &GO,
        )
        .unwrap();
        let residual = apart(&times(&a, &found.x), &b);
        assert!(
            found.reached && residual <= 1e-13 * norm(&b),
            "{residual:e}"
        );
    }
}

#[test]
fn gmres_preconditions_on_the_right() {
    let mut rng = StdRng::seed_from_u64(6);
    let n = 40;
    let diagonal: Vec<f64> = (0..n).map(|k| 10.0_f64.powi(k % 7 - 3)).collect();
    let n = diagonal.len();
    let mut a = vec![0.0; n * n];
    (0..n).for_each(|i| a[i * n + i] = diagonal[i]);
    let b = vector(n, &mut rng);
    let found = krylov(&a, &diagonal, &b, 1e-14, 100);
    assert_eq!(found.products, 1);
    let size = norm(&b);
    for ((x, d), b) in found.x.iter().zip(&diagonal).zip(&b) {
        // Scaled to length one and back: some roundings.
        assert!((x * d - b).abs() <= 8.0 * EPS * size);
    }
    // What it minimises and reports is ‖b − A x‖, whatever the preconditioner: one on
    // the left would report another length.
    let a = matrix(n, false, &mut rng);
    for products in [1, 3, 9] {
        let cut = krylov(&a, &diagonal, &b, 1e-14, products);
        assert_eq!(cut.products, products);
        let left = apart(&times(&a, &cut.x), &b) / norm(&b);
        assert!((left - cut.residual).abs() <= 1000.0 * EPS, "{left:e}");
        assert!(cut.residual > 1e-3);
    }
}

#[test]
fn gmres_with_zero_right_side_and_with_singular_matrices() {
    let zero = krylov(&[2.0, 1.0, 1.0, 3.0], &[1.0; 2], &[0.0; 2], 1e-10, 10);
    assert_eq!((zero.x, zero.products), (vec![0.0; 2], 0));
    assert_eq!(krylov(&[], &[], &[], 1e-10, 10).products, 0);
    // Nothing moves: nothing is claimed.
    let still = krylov(&[0.0; 4], &[1.0; 2], &[1.0, 2.0], 1e-10, 10);
    assert_eq!(still.x, vec![0.0; 2]);
    assert_eq!(still.residual.to_bits(), 1.0_f64.to_bits());
    // A right side that the matrix reaches is reached, one that it does not is not.
    let flat = [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0];
    let found = krylov(&flat, &[1.0; 3], &[1.0, -4.0, 0.0], 1e-13, 10);
    assert!(apart(&found.x, &[1.0, -2.0, 0.0]) <= 8.0 * EPS);
    let missed = krylov(&flat, &[1.0; 3], &[1.0, 1.0, 1.0], 1e-13, 10);
    // What is left at the least is the third component, 1/√3 of the right side.
    assert!(missed.residual >= 3.0_f64.sqrt().recip(), "{missed:?}");
}

#[test]
fn gmres_never_claims_to_reach_what_a_singular_matrix_cannot() {
    for seed in 0..50 {
        let mut rng = StdRng::seed_from_u64(seed);
        let n = 4 + usize::try_from(seed).unwrap();
        // The last row is the sum of the others, to the bit; the right side is 1/√n of
        // its length away from what such a matrix reaches.
        let mut a = matrix(n, false, &mut rng);
        for value in &mut a {
            *value = (*value * 1024.0).round();
        }
        let (rows, last) = a.split_at_mut((n - 1) * n);
        for (j, value) in last.iter_mut().enumerate() {
            *value = rows.iter().skip(j).step_by(n).sum();
        }
        let mut b = vec![0.0; n];
        b[n - 1] = 1.0;
        let found = krylov(&a, &vec![1.0; n], &b, 1e-10, 2 * n);
        assert!(
            found.residual >= 0.99 / (n as f64).sqrt(),
            "{n}: {}",
            found.residual
        );
    }
}

#[test]
fn gmres_gives_back_the_error_of_a_product() {
    let apply = |_: &[f64]| Err::<Vec<f64>, _>(Error::Interrupted);
    let ended = gmres::solve(&apply, &|_| (), &[1.0], 1e-10, 10);
    assert_eq!(ended.unwrap_err(), Error::Interrupted);
}

#[test]
fn what_is_not_zero_has_a_length() {
    for size in [5e-324, 1e-300, 1e-170, 1.0, 1e170, 1e300] {
        let length = norm(&[3.0 * size, 0.0, -4.0 * size]);
        // A denormal number has one digit.
        let rounding = (4.0 * EPS * size).max(5e-324);
        assert!((length - 5.0 * size).abs() <= rounding, "{size}");
    }
    assert!(!(norm(&[]) > 0.0) && !(norm(&[0.0, -0.0]) > 0.0));
    assert!(norm(&[1.0, f64::NEG_INFINITY]).is_infinite());
    assert!(norm(&[1.0, f64::NAN]).is_nan());
}

#[test]
fn small_singular_values_keep_their_digits() {
    // Columns (1, 0, 0), (1, 1e-12, 0): the singular values are √2 and 1e-12/√2, with a
    // relative error of 1e-12; from Aᵀ A the smaller one would be 0.
    let mut columns = vec![vec![1.0, 0.0, 0.0], vec![1.0, 1e-12, 0.0]];
    let before = columns.clone();
    let amounts = orthogonalise(&mut columns);
    let mut sizes: Vec<f64> = columns.iter().map(|c| norm(c)).collect();
    sizes.sort_by(f64::total_cmp);
    assert!((sizes[0] / (1e-12 / 2.0_f64.sqrt()) - 1.0).abs() < 1e-11);
    assert!((sizes[1] / 2.0_f64.sqrt() - 1.0).abs() < 1e-15);
    for (column, amounts) in columns.iter().zip(&amounts) {
        assert!(apart(column, &combine(&before, amounts)) < 2e-15);
    }
}

#[test]
fn sums_that_cancel_are_accurate() {
    let mut rng = StdRng::seed_from_u64(7);
    for _ in 0..200 {
        // Every large term comes with its opposite; what is left is known.
        let mut terms: Vec<f64> = (0..30)
            .map(|_| rng.random_range(-1.0..1.0) * 2.0_f64.powi(rng.random_range(0..40)))
            .collect();
        terms.extend(terms.clone().iter().map(|x| -x));
        let rest: f64 = rng.random_range(-1.0..1.0);
        terms.push(rest);
        terms.shuffle(&mut rng);
        let mut sum = Sum::default();
        for x in terms {
            sum.add(x);
        }
        // [ORO05, proposition 4.5]: ε |s| + (n ε)² Σ|x|, with Σ|x| below 60 · 2^40.
        let bound = EPS * rest.abs() + (61.0 * EPS).powi(2) * 60.0 * 2.0_f64.powi(40);
        assert!((sum.value() - rest).abs() <= bound);
    }
    let mut sum = Sum::new(1e100);
    for x in [1.0, -1e100] {
        sum.add(x);
    }
    assert_eq!(sum.value().to_bits(), 1.0_f64.to_bits());
    // A product whose rounding is the whole answer: (1 + ε)(1 − ε) − 1 = −ε².
    let mut sum = Sum::new(-1.0);
    sum.add_product(1.0 + EPS, 1.0 - EPS);
    assert_eq!(sum.value().to_bits(), (-EPS * EPS).to_bits());
}

#[test]
#[expect(
    clippy::cast_possible_truncation,
    reason = "integers that doubles hold"
)]
fn products_are_those_of_integers() {
    let mut rng = StdRng::seed_from_u64(8);
    let mut plain_is_wrong = 0;
    // Lengths with and without a rest of the four running sums.
    for n in (0..60).chain([400, 1003]) {
        let digits = |rng: &mut StdRng| rng.random_range(-(1_i64 << 50)..1 << 50);
        let mut a: Vec<i64> = (0..n).map(|_| digits(&mut rng)).collect();
        let mut b: Vec<i64> = (0..n).map(|_| digits(&mut rng)).collect();
        // The second half takes the first away, up to small numbers.
        for k in 0..n / 2 {
            a[n / 2 + k] = -a[k] + rng.random_range(-9..9);
            b[n / 2 + k] = b[k];
        }
        let exact: i128 = a
            .iter()
            .zip(&b)
            .map(|(&x, &y)| i128::from(x) * i128::from(y))
            .sum();
        let size: i128 = a
            .iter()
            .zip(&b)
            .map(|(&x, &y)| (i128::from(x) * i128::from(y)).abs())
            .sum();
        let real = |x: &[i64]| x.iter().map(|&x| x as f64).collect::<Vec<_>>();
        let (a, b) = (real(&a), real(&b));
        let error = |value: f64| (value as i128 - exact) as f64;
        let found = dot(&a, &b).value();
        // [ORO05, proposition 5.5]: ε |a·b| + (n ε)² |a|·|b|.
        let bound = EPS * (exact as f64).abs() + (n as f64 * EPS).powi(2) * size as f64;
        assert!(
            error(found).abs() <= bound,
            "{n}: {:e} {bound:e}",
            error(found)
        );
        let plain: f64 = a.iter().zip(&b).map(|(x, y)| x * y).sum();
        plain_is_wrong += usize::from(error(plain).abs() > bound);
    }
    assert!(plain_is_wrong > 30, "the sums hardly cancel");
}
