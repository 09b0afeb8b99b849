//! Which matrices are refused, and by what name: beside minors in whole numbers.

use bipot_rs::error::Error;
use bipot_rs::linalg::sparse::csc::Symmetry;
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::comparison::factor;
use super::matrices::Sparse;
use super::rational::{as_floats, members, minor};

/// What a matrix and its interior are, by all principal minors.
#[derive(Debug, PartialEq)]
enum Verdict {
    /// A diagonal that no stiffness has, at this unknown.
    Diagonal(usize),
    Definite,
    /// No direction of negative energy, and one of none.
    Semidefinite,
    /// A direction of negative energy, whatever the order of elimination.
    Indefinite,
    /// Indefinite, and a pivot may be zero before one is negative.
    Either,
}

fn verdict(n: usize, dense: &[i64], interior: &[usize]) -> Verdict {
    let saddle = |i: usize| {
        let own = dense[i * n + i];
        own < 0 || own == 0 && (0..n).any(|j| dense[i * n + j] != 0)
    };
    if let Some(dof) = (0..n).find(|&i| saddle(i)) {
        return Verdict::Diagonal(dof);
    }
    let minors: Vec<i128> = (1..1 << interior.len())
        .map(|set| {
            let of = members(interior.len(), set);
            let of: Vec<usize> = of.into_iter().map(|i| interior[i]).collect();
            minor(n, dense, &of)
        })
        .collect();
    match (minors.iter().all(|&d| d >= 0), minors.contains(&0)) {
        (true, false) => Verdict::Definite,
        (true, true) => Verdict::Semidefinite,
        (false, false) => Verdict::Indefinite,
        (false, true) => Verdict::Either,
    }
}

#[test]
fn matrices_without_positive_minors_are_refused() {
    let mut random = StdRng::seed_from_u64(7);
    let n = 5;
    let mut met = [0; 5];
    for _ in 0..400 {
        let mut dense = vec![0; n * n];
        for i in 0..n {
            for j in 0..i {
                let value = random.random_range(-2..=2);
                (dense[i * n + j], dense[j * n + i]) = (value, value);
            }
            // Now and then a diagonal that is zero or negative.
            let lowest = if random.random_bool(0.02) { -1 } else { 1 };
            dense[i * n + i] = random.random_range(lowest..=6);
        }
        let k = Sparse::from_dense(n, &as_floats(&dense));
        for set in 0..1 << n {
            let (kept, interior) = (members(n, set), members(n, !set));
            let expected = verdict(n, &dense, &interior);
            let found = factor(&k, &kept);
            let named = |dof| interior.contains(&dof);
            let right = match (&expected, &found) {
                (Verdict::Diagonal(dof), Err(e)) => *e == Error::Indefinite { dof: *dof },
                (Verdict::Definite, Ok(_)) => true,
                // A pivot that is zero but for rounding is passed on as that: whether what
                // it stands for is free, others have to say.
                (Verdict::Semidefinite | Verdict::Either, Ok(factor)) => factor
                    .weakest_pivot()
                    .is_some_and(|(_, ratio)| ratio < 1e-14),
                (
                    Verdict::Semidefinite | Verdict::Either,
                    Err(Error::FloatingBody { dof } | Error::Indefinite { dof }),
                )
                | (Verdict::Indefinite, Err(Error::Indefinite { dof })) => named(*dof),
                _ => false,
            };
            let found = found.map(|factor| factor.schur().to_vec());
            assert!(right, "{dense:?}, {kept:?}: {expected:?}, {found:?}");
            met[match expected {
                Verdict::Diagonal(_) => 0,
                Verdict::Definite => 1,
                Verdict::Semidefinite => 2,
                Verdict::Indefinite => 3,
                Verdict::Either => 4,
            }] += 1;
        }
    }
    // Every case came up often.
    assert!(met.iter().all(|&times| times > 50), "{met:?}");
}

#[test]
fn kept_unknowns_come_once_and_exist() {
    let k = Sparse::from_dense(3, &[2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0]);
    assert!(matches!(
        factor(&k, &[2, 0, 2]).unwrap_err(),
        Error::Repeated {
            index: 2,
            first: 0,
            second: 2,
            ..
        }
    ));
    assert!(matches!(
        factor(&k, &[0, 3]).unwrap_err(),
        Error::IndexRange {
            position: 1,
            found: 3,
            limit: 3,
            ..
        }
    ));
}

/// One triangle alone is no symmetric matrix, and neither is one that is a digit
/// off at one place: the largest difference by its diagonals is named.
#[test]
fn asymmetric_matrices_are_named() {
    let mut random = StdRng::seed_from_u64(8);
    for n in [2, 5, 9] {
        let mut k = Sparse::from_dense(n, &vec![1.0; n * n]);
        (0..n).for_each(|i| k.values[i * n + i] = n as f64);
        assert_eq!(k.view().check_symmetry(), Ok(Symmetry::Exact));
        let (i, j) = loop {
            let pair = (random.random_range(0..n), random.random_range(0..n));
            if pair.0 > pair.1 {
                break pair;
            }
        };
        // Scaling unknowns changes neither the verdict nor the place.
        for exponent in [-30, 0, 30] {
            let unit = |at: usize| if at == i { 2_f64.powi(exponent) } else { 1.0 };
            let mut scaled = k.scaled(unit);
            scaled.values[j * n + i] *= 1.0 + 1e-6;
            let refused = scaled.view().check_symmetry().unwrap_err();
            assert!(
                matches!(refused, Error::Asymmetric { row, column, .. } if (row, column) == (j, i)),
                "{refused}, {i}, {j}"
            );
        }
    }
}
