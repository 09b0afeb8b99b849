//! Checks the reference itself: twice the precision against whole numbers and fractions.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::comparison::{compare, reach};
use super::rational::{self, whole};
use crate::common::double_double::{self, Double};

/// `|a − b| / |b|`.
fn apart(a: Double, b: Double) -> f64 {
    (a - b).high.abs() / b.high.abs()
}

/// Roundings of twice the precision: 2⁻¹⁰⁴, and a few at once.
const DOUBLE: f64 = 64.0 * f64::EPSILON * f64::EPSILON;

#[test]
fn double_double_numbers_have_twice_the_precision() {
    let mut random = StdRng::seed_from_u64(1);
    for _ in 0..2000 {
        let mut number = |bits: u32| random.random_range(1_i64 << (bits - 1)..1 << bits);
        let (a, b, c) = (number(53), number(53), number(30));
        let product = i128::from(a) * i128::from(b);
        let found = Double::from(a as f64) * Double::from(b as f64);
        // 106 bits: two doubles hold it without rounding.
        assert!((found - whole(product)).high.abs() <= 0.0);
        let sum = whole(product) + whole(i128::from(c));
        assert!(apart(sum, whole(product + i128::from(c))) < DOUBLE);
        let back = whole(product) / whole(i128::from(b));
        assert!(apart(back, whole(i128::from(a))) < DOUBLE);
    }
}

/// Hilbert's matrix times the least common multiple of its denominators is one of
/// whole numbers, and its inverse is known: keeping one unknown, S is one over
/// the inverse's diagonal.
#[test]
fn hilberts_matrix_is_condensed_to_twenty_digits() {
    let n = 8;
    let multiple = 360_360_i128; // of 1 to 15
    let dense: Vec<f64> = (0..n * n)
        .map(|at| (multiple / (at / n + at % n + 1) as i128) as f64)
        .collect();
    let choose = |n: usize, k: usize| (0..k).fold(1, |c, i| c * (n - i) as i128 / (i + 1) as i128);
    for kept in 0..n {
        let i = kept + 1;
        let diagonal =
            (2 * i as i128 - 1) * (choose(n + i - 1, n - i) * choose(2 * i - 2, i - 1)).pow(2);
        let exact = whole(multiple) / whole(diagonal);
        let found = double_double::schur(n, &dense, &[kept]);
        // The condition is 1.5e10: of 32 digits 20 are left.
        assert!(apart(found[0], exact) < 1e-20, "{kept}");
    }
}

#[test]
fn fractions_and_twice_the_precision_agree() {
    let mut random = StdRng::seed_from_u64(2);
    for n in 2..=8 {
        for _ in 0..20 {
            let dense = gram(n, &mut random);
            let kept = rational::members(n, random.random_range(1..1 << n));
            let exact = rational::schur(n, &dense, &kept);
            let found = double_double::schur(n, &rational::as_floats(&dense), &kept);
            let scale = reach(n, &rational::as_floats(&dense), &kept);
            let m = kept.len();
            for at in 0..m * m {
                // As for S, with the roundings of twice the precision.
                let error = (found[at] - exact[at].rounded()).high.abs();
                assert!(error <= DOUBLE * scale[at / m] * scale[at % m]);
            }
        }
    }
}

/// A wrong entry is seen, and so is one that is no number.
#[test]
fn the_comparison_sees_a_wrong_entry() {
    let exact = [4.0, 1.0, 1.0, 9.0].map(Double::from);
    let reach = [2.0, 3.0];
    let right = compare(&[4.0, 1.0, 1.0, 9.0], &exact, &reach);
    assert!(right.roundings + right.of_largest + right.of_diagonal <= 0.0);
    let off = 6.0 * f64::EPSILON;
    let wrong = compare(&[4.0, 1.0 + off, 1.0, 9.0], &exact, &reach);
    assert!((wrong.roundings - 1.0).abs() < 1e-12); // 6 ε by 2 · 3 ε
    assert!((wrong.of_diagonal - f64::EPSILON).abs() < 1e-12 * f64::EPSILON);
    assert!((wrong.of_largest - off / 9.0).abs() < 1e-12 * off);
    let none = compare(&[4.0, f64::NAN, 1.0, 9.0], &exact, &reach);
    assert!(none.roundings.is_infinite() && none.of_largest.is_infinite());
}

/// `AᵀA + I` of small whole numbers.
pub(crate) fn gram(n: usize, random: &mut StdRng) -> Vec<i64> {
    let a: Vec<i64> = (0..n * n).map(|_| random.random_range(-3..=3)).collect();
    let entry = |i: usize, j: usize| -> i64 {
        let dot: i64 = (0..n).map(|k| a[k * n + i] * a[k * n + j]).sum();
        dot + i64::from(i == j)
    };
    (0..n * n).map(|at| entry(at / n, at % n)).collect()
}
