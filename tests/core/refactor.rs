//! One analysis for several matrices: S without the factor, and a new factor.
#![expect(
    clippy::unwrap_used,
    clippy::cast_precision_loss,
    reason = "a test may fail, and its counts are small"
)]

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::common::elasticity::{Assembled, Grid};
use crate::common::{GO, bits, with_threads};
use bipot_rs::error::Error;
use bipot_rs::linalg::dense::{cholesky, invert_from_cholesky};
use bipot_rs::linalg::sparse::csc::Symmetric;
use bipot_rs::linalg::sparse::multifrontal::{Factor, Schur};
use bipot_rs::linalg::sparse::reach::Reach;
use bipot_rs::linalg::sparse::symbolic::{Options, Symbolic};

fn analysed(body: &Assembled) -> Arc<Symbolic> {
    Arc::new(Symbolic::analyse(&body.view(), &body.face(), &Options::default()).unwrap())
}

/// Large enough for fronts that are shared out by tiles: the cube has 6,591
/// unknowns and 1.2e9 flops, where whole subtrees end at 2e8.
fn bodies() -> [Assembled; 2] {
    [Grid::cube(12).assemble(), Grid::square(40).assemble()]
}

fn loads(n: usize, columns: usize) -> Vec<f64> {
    (0..n * columns)
        .map(|at| ((at * 37) % 101) as f64 - 50.0)
        .collect()
}

#[test]
fn s_without_the_factor_has_the_same_bits() {
    for body in bodies() {
        let symbolic = analysed(&body);
        // None, one, and more than pass together.
        for columns in [0, 1, 3] {
            let factor = Factor::new(Arc::clone(&symbolic), &body.view(), &GO).unwrap();
            let mut expected = loads(body.n(), columns);
            factor.condense(&mut expected, columns);
            for threads in [1, 2] {
                let mut found = loads(body.n(), columns);
                let schur = with_threads(threads, || {
                    Schur::new(&symbolic, &body.view(), &mut found, &GO).unwrap()
                });
                assert_eq!(bits(schur.values()), bits(factor.schur()));
                assert_eq!(schur.weakest_pivot(), factor.weakest_pivot());
                assert_eq!(bits(&found), bits(&expected));
            }
        }
    }
}

#[test]
fn a_second_matrix_gives_the_bits_of_a_new_factor() {
    for grid in [Grid::cube(12), Grid::square(40)] {
        let soft = grid.assemble();
        let far_half = 7.0;
        let body = Grid { far_half, ..grid }.assemble();
        let symbolic = analysed(&soft);
        drop(Factor::new(Arc::clone(&symbolic), &soft.view(), &GO).unwrap());
        let k = body.view();
        let factor = Factor::new(Arc::clone(&symbolic), &k, &GO).unwrap();
        // Nothing is left over for this one.
        let fresh = Factor::new(symbolic, &k, &GO).unwrap();
        assert_eq!(bits(factor.schur()), bits(fresh.schur()));
        assert_eq!(factor.weakest_pivot(), fresh.weakest_pivot());
        let (mut a, mut b) = (loads(body.n(), 2), loads(body.n(), 2));
        factor.condense(&mut a, 2);
        fresh.condense(&mut b, 2);
        assert_eq!(bits(&a), bits(&b));
    }
}

#[test]
fn many_columns_are_those_of_one_thread() {
    for body in bodies() {
        let factor = Factor::new(analysed(&body), &body.view(), &GO).unwrap();
        // One column, a block that is not whole, and two blocks.
        for columns in [1, 5, 40] {
            let solved = |threads| {
                with_threads(threads, || {
                    let mut x = loads(body.n(), columns);
                    factor.condense(&mut x, columns);
                    factor.recover(&mut x, columns);
                    x
                })
            };
            assert_eq!(bits(&solved(1)), bits(&solved(2)));
        }
    }
}

#[test]
fn a_half_solve_has_the_same_bits_alone() {
    for body in bodies() {
        let factor = Factor::new(analysed(&body), &body.view(), &GO).unwrap();
        let face = body.face();
        let inside: Vec<usize> = (0..body.n()).filter(|i| !face.contains(i)).collect();
        let entries: Vec<[(usize, f64); 2]> = (0..37)
            .map(|k| {
                let at = |by: usize| inside[k * by % inside.len()];
                [(at(97), 1.0 + k as f64), (at(211), -0.3)]
            })
            .collect();
        let unknowns = entries.iter().flatten().map(|&(i, _)| i);
        let reach = Reach::new(factor.symbolic(), unknowns);
        let columns: Vec<&[(usize, f64)]> = entries.iter().map(|e| &e[..]).collect();
        let (all, kept) = factor.half_solve(&reach, &columns);
        let (p, m) = (reach.pivots().len(), factor.symbolic().kept());
        // Each alone, and the last ones in other places.
        for (k, column) in columns.iter().enumerate() {
            let (one, of_kept) = factor.half_solve(&reach, &[column]);
            assert!(bits(&one) == bits(&all[k * p..(k + 1) * p]), "column {k}");
            assert!(
                bits(&of_kept) == bits(&kept[k * m..(k + 1) * m]),
                "column {k}"
            );
        }
        let (last, _) = factor.half_solve(&reach, &columns[30..]);
        assert!(bits(&last) == bits(&all[30 * p..]), "the last ones");
    }
}

#[test]
fn a_refused_matrix_changes_neither_loads_nor_analysis() {
    let mut body = Grid::cube(5).assemble();
    let symbolic = analysed(&body);
    let factored = |k: &Symmetric| Factor::new(Arc::clone(&symbolic), k, &GO);
    let whole = bits(factored(&body.view()).unwrap().schur());
    let other = Grid::cube(4).assemble();
    let error = factored(&other.view()).unwrap_err();
    assert!(matches!(error, Error::Shape { .. }), "{error}");
    // As many unknowns, another pattern.
    let cells = [4, 5, 6];
    let other = Grid {
        cells,
        ..Grid::cube(1)
    }
    .assemble();
    assert_eq!(other.n(), body.n());
    let error = factored(&other.view()).unwrap_err();
    assert!(matches!(error, Error::SparseStructure { .. }), "{error}");

    let good = body.values.clone();
    // Off the diagonal larger than on it: indefinite, with sound diagonals.
    for j in 0..body.n() {
        for at in body.col_ptr[j]..body.col_ptr[j + 1] {
            if body.row_idx[at] != j {
                body.values[at] *= 40.0;
            }
        }
    }
    let error = factored(&body.view()).unwrap_err();
    assert!(matches!(error, Error::Indefinite { .. }), "{error}");
    let mut load = loads(body.n(), 1);
    let error = Schur::new(&symbolic, &body.view(), &mut load, &GO).unwrap_err();
    assert!(matches!(error, Error::Indefinite { .. }), "{error}");
    assert_eq!(load, loads(body.n(), 1), "loads stay as they were");
    let stopped = Factor::new(Arc::clone(&symbolic), &body.view(), &AtomicBool::new(true));
    assert!(matches!(stopped, Err(Error::Interrupted)));

    body.values = good;
    assert_eq!(bits(factored(&body.view()).unwrap().schur()), whole);
}

/// `A = D + x xᵀ`, whose inverse is known: `D⁻¹ − D⁻¹ x xᵀ D⁻¹ / (1 + xᵀ D⁻¹ x)`.
fn known(n: usize) -> (Vec<f64>, impl Fn(usize, usize) -> f64) {
    let x: Vec<f64> = (0..n).map(|i| ((i * 29) % 13) as f64 / 13.0).collect();
    let d: Vec<f64> = (0..n).map(|i| 1.0 + ((i * 7) % 5) as f64).collect();
    let mut a = vec![0.0; n * n];
    for j in 0..n {
        for i in 0..n {
            a[j * n + i] = x[i] * x[j] + if i == j { d[i] } else { 0.0 };
        }
    }
    let sum = 1.0 + (0..n).map(|i| x[i] * x[i] / d[i]).sum::<f64>();
    let inverse = move |i: usize, j: usize| {
        let diagonal = if i == j { 1.0 / d[i] } else { 0.0 };
        diagonal - x[i] * x[j] / (d[i] * d[j] * sum)
    };
    (a, inverse)
}

/// Sizes on both sides of the blocks of 128, strips of 256 and panels of 384.
const SIZES: [usize; 9] = [0, 1, 2, 127, 129, 257, 385, 513, 901];

#[test]
fn the_inverse_takes_the_place_of_the_factor() {
    for n in SIZES {
        let (a, expected) = known(n);
        let inverted = |threads| {
            with_threads(threads, || {
                let mut a = a.clone();
                assert_eq!(cholesky(&mut a, n, &GO).unwrap(), None);
                // Only the lower triangle may be read.
                for j in 0..n {
                    assert!(a[j * n..j * n + j].iter().all(|&above| above == 0.0));
                    a[j * n..j * n + j].fill(f64::NAN);
                }
                invert_from_cholesky(&mut a, n, &GO).unwrap();
                a
            })
        };
        let found = inverted(1);
        assert_eq!(bits(&found), bits(&inverted(2)));
        // Condition 1 + ‖x‖² ≤ n, inverse of size one: n roundings of that.
        let bound = f64::EPSILON * (n * n) as f64;
        for j in 0..n {
            for i in 0..n {
                let value = found[j * n + i];
                assert!((value - expected(i, j)).abs() <= bound, "{n}: {i}, {j}");
                assert_eq!(value.to_bits(), found[i * n + j].to_bits());
            }
        }
    }
}

#[test]
fn the_failed_pivot_has_its_global_number() {
    for (n, at) in [(5, 0), (300, 129), (901, 383), (901, 384), (901, 900)] {
        let (mut a, _) = known(n);
        a[at * (n + 1)] = -1.0;
        assert_eq!(cholesky(&mut a, n, &GO).unwrap(), Some(at));
    }
}
