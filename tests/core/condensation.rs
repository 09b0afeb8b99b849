//! Factors at the edges of the kept set and of patterns: loads, recovered unknowns, bodies that
//! float, and errors. `precision` holds S to twice the precision.
#![expect(
    clippy::cast_precision_loss,
    clippy::float_cmp,
    clippy::unwrap_used,
    reason = "bits are compared on purpose; a helper of a test may fail"
)]

use std::sync::Arc;

use crate::common::GO;
use crate::common::double_double;
use crate::common::elasticity::Grid;
use crate::precision::comparison::factor_view as factor;
use crate::precision::matrices::{Entries, Sparse, shuffle};
use bipot_rs::condensation::body::Imbalance;
use bipot_rs::error::Error;
use bipot_rs::linalg::dense;
use bipot_rs::linalg::small::norm;
use bipot_rs::linalg::sparse::csc::Symmetric;
use bipot_rs::linalg::sparse::multifrontal::Factor;
use bipot_rs::linalg::sparse::symbolic::{Options, Symbolic};
use rand::{RngExt, SeedableRng, rngs::StdRng};

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let apart: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    norm(&apart) / norm(b)
}

/// Rows sum to less than the diagonal: positive definite.
fn dominant(n: usize, mut coupled: impl FnMut(usize, usize) -> Option<f64>) -> Vec<f64> {
    let mut dense = vec![0.0_f64; n * n];
    for j in 0..n {
        for i in 0..j {
            let value = coupled(i, j).unwrap_or(0.0);
            (dense[j * n + i], dense[i * n + j]) = (value, value);
        }
    }
    for j in 0..n {
        dense[j * n + j] = 1.0 + (0..n).map(|i| dense[j * n + i].abs()).sum::<f64>();
    }
    dense
}

/// Nodes of some unknowns on a grid, a tenth of the entries missing: S is the Schur
/// complement, in any order of the kept unknowns, however nodes are made of them, and wherever
/// they are said to be.
#[test]
fn nodes_whose_entries_vanish() {
    let mut random = StdRng::seed_from_u64(11);
    for (unknowns, grid) in [(3, [5, 4, 3]), (2, [8, 7, 1]), (1, [9, 9, 1])] {
        let n = unknowns * grid.iter().product::<usize>();
        let at = |v: usize| [v % grid[0], v / grid[0] % grid[1], v / grid[0] / grid[1]];
        let dense = dominant(n, |i, j| {
            let (p, q) = (at(i / unknowns), at(j / unknowns));
            let near = (0..3).all(|k| p[k].abs_diff(q[k]) <= 1);
            (near && random.random_bool(0.9)).then(|| random.random_range(-1.0..1.0))
        });
        let body = Sparse::from_dense(n, &dense);
        let k = body.view();
        for share in [0.1, 0.4] {
            let mut any: Vec<usize> = (0..n).filter(|_| random.random_bool(share)).collect();
            shuffle(&mut any, &mut random);
            let whole: Vec<usize> = (n - n / 6..n).collect();
            let mut place = |_| std::array::from_fn(|_| random.random_range(0.0..1.0));
            let places: Vec<[f64; 3]> = (0..n).map(&mut place).collect();
            for (kept, coordinates) in [(&any, None), (&any, Some(&places[..])), (&whole, None)] {
                let symbolic = Symbolic::analyse(&k, kept, &Options { coordinates }).unwrap();
                let factor = Factor::new(Arc::new(symbolic), &k, &GO).unwrap();
                let exact = double_double::schur(n, &dense, kept);
                let exact: Vec<f64> = exact.iter().map(|d| d.high).collect();
                // Some tens of roundings.
                assert!(distance(factor.schur(), &exact) < 1e-14);
            }
        }
    }
}

/// `K u = f` by `S u_c = f_c − K_ci K_ii⁻¹ f_i`, then back; several right sides are those of
/// one at a time, up to the order of their sums.
fn solves(k: &Symmetric, kept: &[usize], tolerance: f64) {
    let factor = factor(k, kept).unwrap();
    let (n, m) = (k.n(), kept.len());
    let mut random = StdRng::seed_from_u64(1);
    let load: Vec<f64> = (0..3 * n).map(|_| random.random_range(-1.0..1.0)).collect();
    let mut x = load.clone();
    factor.condense(&mut x, 3);
    let mut alone = load.clone();
    let each = alone.chunks_exact_mut(n);
    each.for_each(|f| factor.condense(f, 1));
    assert!(distance(&x, &alone) < 1e-13);
    let mut l = factor.schur().to_vec();
    dense::cholesky(&mut l, m, &GO).unwrap();
    for x in x.chunks_exact_mut(n) {
        let mut u: Vec<f64> = kept.iter().map(|&dof| x[dof]).collect();
        dense::solve_lower(&l, m, &mut u, 1);
        dense::solve_lower_transpose(&l, m, &mut u, 1);
        kept.iter().zip(u).for_each(|(&dof, u)| x[dof] = u);
    }
    factor.recover(&mut x, 3);
    for (x, load) in x.chunks_exact(n).zip(load.chunks_exact(n)) {
        let mut back = vec![0.0; n];
        k.product(x, &mut back);
        assert!(distance(&back, load) < tolerance);
    }
}

#[test]
fn loads_condense_and_unknowns_come_back() {
    let cells = [5, 6, 4];
    let body = Grid {
        cells,
        ..Grid::cube(1)
    }
    .assemble();
    // Backward stable: the residual is some roundings of ‖K‖‖u‖, which a cube held on a face
    // has within a hundred times ‖f‖.
    solves(&body.view(), &body.face(), 1e-12);
    // Four chains, and an unknown that all others touch.
    let (n, hub) = (2000, 700);
    let mut entries = Entries::default();
    for j in 0..n {
        entries.add(j, j, if j == hub { n as f64 } else { 8.0 });
        let near = (j + 1..n.min(j + 3)).filter(|i| i / 500 == j / 500);
        near.filter(|&i| i != hub && j != hub)
            .for_each(|i| entries.add(i, j, -1.0));
        if j != hub {
            entries.add(hub, j, -0.5);
        }
    }
    let (star, kept) = (entries.matrix(n), (0..n).step_by(97).collect::<Vec<_>>());
    let k = star.view();
    // The hub is eliminated last: nothing fills but bands.
    assert!(factor(&k, &kept).unwrap().symbolic().counts().nnz_factor < 40 * n);
    // cond(K) is below 1e4.
    solves(&k, &kept, 1e-12);
}

#[test]
fn edges_of_the_kept_set() {
    let n = 40;
    let mut random = StdRng::seed_from_u64(1);
    let dense = dominant(n, |_, _| {
        random
            .random_bool(0.15)
            .then(|| random.random_range(-1.0..1.0))
    });
    let body = Sparse::from_dense(n, &dense);
    let k = body.view();

    let all: Vec<usize> = (0..n).rev().collect();
    let factor_all = factor(&k, &all).unwrap();
    for (q, &j) in all.iter().enumerate() {
        for (p, &i) in all.iter().enumerate() {
            assert_eq!(factor_all.schur()[q * n + p], dense[j * n + i]);
        }
    }
    assert_eq!(factor_all.weakest_pivot(), None);
    let mut f = vec![1.0; n];
    factor_all.condense(&mut f, 1);
    factor_all.recover(&mut f, 1);
    assert_eq!(f, vec![1.0; n]);

    // Diagonally dominant: cond(K) is small.
    solves(&k, &[], 1e-13);

    let nothing = factor(&Sparse::from_dense(0, &[]).view(), &[]).unwrap();
    assert!(nothing.schur().is_empty());
    nothing.condense(&mut [], 1);
    nothing.recover(&mut [], 1);
}

#[test]
fn only_the_lower_triangle_is_read() {
    let body = Grid::cube(3).assemble();
    let mut spoilt = body.clone();
    for j in 0..body.n() {
        for at in body.col_ptr[j]..body.col_ptr[j + 1] {
            if body.row_idx[at] < j {
                spoilt.values[at] = 1e3;
            }
        }
    }
    let [a, b] = [&body, &spoilt].map(|body| factor(&body.view(), &body.face()).unwrap());
    assert_eq!(a.schur(), b.schur());
}

#[test]
fn a_pattern_with_one_side_missing_is_completed() {
    // Entry (0, 2) was cancelled on one side only.
    let values = [4.0, 1.0, 0.0, 1.0, 4.0, 0.0, 4.0];
    let k = Symmetric::new(3, &[0, 3, 5, 7], &[0, 1, 2, 0, 1, 1, 2], &values).unwrap();
    assert!(k.check_symmetry().is_ok());
    let s = factor(&k, &[2, 0]).unwrap();
    assert_eq!(s.schur(), [4.0, 0.0, 0.0, 4.0 - 0.25]);
}

#[test]
fn a_floating_body_is_refused_or_found_at_one_of_its_unknowns() {
    // Whether a body is soft or free is not for a pivot to say, but it is to be seen.
    let seen = |k: &Symmetric, kept: &[usize]| match factor(k, kept) {
        Ok(factor) => {
            let weakest = factor.weakest_pivot();
            weakest
                .filter(|(_, ratio)| *ratio < 1e-8)
                .map(|(dof, _)| dof)
        }
        Err(Error::FloatingBody { dof }) => Some(dof),
        Err(_) => None,
    };
    let free = |grid: Grid| grid.floating().assemble();
    // Two squares; the second is free and touches nothing.
    let held = Grid::square(6).assemble();
    let both = held.clone().beside(&free(Grid::square(6)), 20.0);
    let dof = seen(&both.view(), &held.face()).unwrap();
    assert!(dof >= held.n(), "{dof}");

    // One corner does not hold a square against rotation.
    for body in [free(Grid::square(5)), free(Grid::cube(5))] {
        let corner: Vec<usize> = (0..body.dim).collect();
        assert!(seen(&body.view(), &corner).is_some());
    }
    // Alike cells round alike: nothing of K's entries cancels, and the pivots of
    // a free motion grow with the number of unknowns to 1e-12 of the diagonal.
    let plate = free(Grid {
        poisson: 0.4999,
        ..Grid::square(60)
    });
    for kept in [&[][..], &[0, 1]] {
        assert!(seen(&plate.view(), kept).is_some());
    }
    // A stiff half on a soft one, free as a whole: negative, but no more than
    // what the stiff half has lost.
    let contrast = free(Grid {
        far_half: 1e8,
        ..Grid::square(8)
    });
    assert!(seen(&contrast.view(), &[0, 1]).is_some());
    // Nothing at all at an unknown.
    let body = Sparse::from_dense(3, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let refused = factor(&body.view(), &[]).unwrap_err();
    assert_eq!(refused, Error::FloatingBody { dof: 1 });
}

#[test]
fn bad_input_is_named() {
    type Pattern<'a> = (usize, &'a [usize], &'a [usize], &'a [f64]);
    let told = |(n, p, r, v): Pattern| Symmetric::new(n, p, r, v).unwrap_err().to_string();
    let cases: [(Pattern, &str); 6] = [
        (
            (2, &[0, 1], &[0], &[1.0]),
            "column pointers of K has length 2, expected 3",
        ),
        ((1, &[0, 1], &[0], &[1.0, 2.0]), "has length 2, expected 1"),
        (
            (2, &[0, 1, 2], &[0, 2], &[1.0, 1.0]),
            "index 2 at position 1, expected less than 2",
        ),
        ((2, &[0, 2, 3], &[1, 0, 1], &[1.0; 3]), "row 0"),
        ((2, &[0, 2, 1], &[0, 1], &[1.0; 2]), "row 1"),
        (
            (2, &[0, 1, 2], &[0, 1], &[1.0, f64::NAN]),
            "at row 1, column 1",
        ),
    ];
    for (pattern, words) in cases {
        let message = told(pattern);
        assert!(message.contains(words), "{message}: {words}");
    }
    let body = Grid::square(3).assemble();
    let mut at = body.places();
    at[4][1] = f64::INFINITY;
    let coordinates = Some(&at[..]);
    let refused = Symbolic::analyse(&body.view(), &[], &Options { coordinates }).unwrap_err();
    assert!(matches!(refused, Error::NotFinite { index: 13, .. }));
}

/// A row in balance to 32 roundings of its terms, and a tenth of all forces.
#[test]
fn what_rounding_explains_passes_and_nothing_else() {
    let passes = |by_row: f64, of_forces: f64| {
        let left = Imbalance {
            by_row,
            dof: 7,
            of_forces,
        };
        match left.check() {
            Ok(()) => true,
            Err(Error::NotBalanced { dof: 7, .. }) => false,
            Err(other) => panic!("{other}"),
        }
    };
    let most = 32.0 * f64::EPSILON;
    assert!(passes(0.0, 0.0) && passes(most, 0.1));
    assert!(!passes(2.0 * most, 0.0) && !passes(0.0, 0.2));
    assert!(!passes(f64::NAN, 0.0) && !passes(0.0, f64::NAN));
}

#[test]
fn an_entry_without_partner_is_named() {
    let k = Symmetric::new(2, &[0, 1, 3], &[0, 0, 1], &[1.0, 0.5, 1.0]).unwrap();
    let (row, column, upper, lower) = (0, 1, 0.5, 0.0);
    let expected = Error::Asymmetric {
        row,
        column,
        upper,
        lower,
    };
    assert_eq!(k.check_symmetry().unwrap_err(), expected);
}

#[test]
fn components_count_values_not_storage() {
    let values = [1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0];
    let k = Symmetric::new(4, &[0, 2, 4, 6, 8], &[0, 3, 1, 2, 1, 2, 0, 3], &values).unwrap();
    assert_eq!(k.components(), [0, 1, 2, 0]);
}
