//! Small matrices of whole numbers, every set of kept unknowns: S beside exact
//! fractions.

use rand::{SeedableRng, rngs::StdRng};

use super::comparison::{ROUNDINGS, compare, reach, schur};
use super::matrices::{Sparse, shuffle};
use super::oracle::gram;
use super::rational::{self, as_floats, members};

/// Springs of stiffness 1, 2, … between the pairs, and what holds each unknown.
fn springs(n: usize, pairs: &[(usize, usize)], ground: impl Fn(usize) -> i64) -> Vec<i64> {
    let mut k = vec![0; n * n];
    for (stiffness, &(i, j)) in (1..).zip(pairs) {
        k[i * n + i] += stiffness;
        k[j * n + j] += stiffness;
        k[i * n + j] -= stiffness;
        k[j * n + i] -= stiffness;
    }
    (0..n).for_each(|i| k[i * n + i] += ground(i));
    k
}

fn every_subset(name: &str, n: usize, dense: &[i64], random: &mut StdRng) -> f64 {
    let floats = as_floats(dense);
    let k = Sparse::from_dense(n, &floats);
    let mut most = 0.0_f64;
    for set in 0..1 << n {
        let mut kept = members(n, set);
        let interior = members(n, !set);
        if rational::minor(n, dense, &interior) == 0 {
            continue; // a motion is free: its refusal is tested elsewhere
        }
        shuffle(&mut kept, random);
        let exact: Vec<_> = rational::schur(n, dense, &kept)
            .into_iter()
            .map(rational::Fraction::rounded)
            .collect();
        let found = compare(&schur(&k, &kept), &exact, &reach(n, &floats, &kept));
        assert!(found.roundings <= ROUNDINGS, "{name}, {kept:?}: {found:?}");
        most = most.max(found.roundings);
    }
    most
}

#[test]
fn every_subset_of_small_shapes() {
    let mut random = StdRng::seed_from_u64(6);
    let line: Vec<_> = (1..6).map(|i| (i - 1, i)).collect();
    let star: Vec<_> = (1..6).map(|i| (0, i)).collect();
    let back: Vec<_> = (0..5).map(|i| (5, i)).collect();
    let ring: Vec<_> = (0..6).map(|i| (i, (i + 1) % 6)).collect();
    let shapes: [(&str, &[(usize, usize)]); 7] = [
        ("nothing coupled", &[]),
        ("line", &line),
        ("star about the first", &star),
        ("star about the last", &back),
        ("ring", &ring),
        ("two pieces", &[(0, 3), (3, 5), (1, 2), (2, 4), (1, 4)]),
        ("a pair and four alone", &[(1, 4)]),
    ];
    for (name, pairs) in shapes {
        let held = springs(6, pairs, |i| [3, 1, 4, 1, 5, 9][i]);
        every_subset(name, 6, &held, &mut random);
        // Held at one unknown, or free: where nothing free is eliminated.
        every_subset(
            name,
            6,
            &springs(6, pairs, |i| i64::from(i == 2)),
            &mut random,
        );
        every_subset(name, 6, &springs(6, pairs, |_| 0), &mut random);
    }
    for _ in 0..4 {
        let full = gram(6, &mut random);
        every_subset("full", 6, &full, &mut random);
    }
}

#[test]
fn one_unknown_and_no_unknown() {
    let one = Sparse::from_dense(1, &[3.0]);
    assert_eq!(schur(&one, &[0]), [3.0]);
    assert!(schur(&one, &[]).is_empty());
    // A kept unknown that nothing holds has no stiffness, and is no error.
    assert_eq!(schur(&Sparse::from_dense(1, &[0.0]), &[0]), [0.0]);
    let none = Sparse::from_dense(0, &[]);
    assert!(schur(&none, &[]).is_empty());
}
