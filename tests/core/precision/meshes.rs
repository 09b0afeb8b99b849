//! Elastic bodies: every element, hard materials, bodies that float.

use bipot_rs::linalg::dense;
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::comparison::{Errors, errors, errors_of_data, factor, schur};
use super::elements::{Young, build, build_of};
use super::matrices::{Sparse, shuffle};
use crate::common::elasticity::Grid;

/// Digits that S is held to where the body is not hard: 45 roundings, for entries
/// that are sums of some hundred terms. Nearly incompressible bodies, and stiff
/// parts afloat in soft ones, have fewer: K itself, rounded, does not hold them.
const PROMISED: f64 = 1e-14;

/// Errors by those that one rounding of every entry of K makes: as many digits as
/// the data have. Mostly up to 3.4; of a stiff grain afloat, over orders of
/// elimination, up to 6.3 and once in sixteen 10.7.
const OF_DATA: f64 = 10.0;

/// Every element, about 400 unknowns.
fn elements() -> [Grid; 6] {
    [
        Grid::square(13),
        Grid::square(7).quadratic(),
        Grid::cube(4),
        Grid::cube(2).quadratic(),
        Grid::tetrahedra(4),
        Grid::tetrahedra(2).quadratic(),
    ]
}

/// S has as many digits as one rounding of the entries of K leaves.
fn as_exact_as_the_data(name: &str, k: &Sparse, kept: &[usize]) -> Errors {
    let (found, data) = (errors(k, kept), errors_of_data(k, kept));
    let within = |found: f64, data: f64| found <= OF_DATA * data;
    assert!(
        within(found.of_largest, data.of_largest) && within(found.of_diagonal, data.of_diagonal),
        "{name}: {found:?}, {data:?}"
    );
    found
}

#[test]
fn every_element_to_fourteen_digits() {
    for grid in elements() {
        for poisson in [0.0, 0.3, 0.49] {
            let (k, kept) = build(Grid { poisson, ..grid });
            let name = format!("{grid:?}, {poisson}");
            let found = as_exact_as_the_data(&name, &k, &kept);
            // Row by row too: all unknowns of the face are alike.
            assert!(found.of_largest <= PROMISED, "{name}: {found:?}");
            assert!(found.of_diagonal <= PROMISED, "{name}: {found:?}");
        }
    }
}

#[test]
fn nearly_incompressible() {
    for grid in elements() {
        for poisson in [0.4999, 0.499_999_9] {
            let (k, kept) = build(Grid { poisson, ..grid });
            as_exact_as_the_data(&format!("{grid:?}, {poisson}"), &k, &kept);
        }
    }
}

/// The first and the third quarter of the height.
fn even(z: f64) -> bool {
    z < 0.25 || (0.5..0.75).contains(&z)
}

#[test]
fn stiff_beside_soft() {
    let grounds: [(&str, Young); 6] = [
        (
            "stiff below a soft face",
            |_, z| if z < 0.5 { 1.0 } else { 1e8 },
        ),
        (
            "soft below a stiff face",
            |_, z| if z < 0.5 { 1.0 } else { 1e-8 },
        ),
        ("layers", |_, z| if even(z) { 1.0 } else { 1e8 }),
        ("soft layers", |_, z| if even(z) { 1.0 } else { 1e-8 }),
        // From 1e-4 to 1e4, without a pattern.
        ("any cell", |cell, _| {
            10_f64.powf(8.0 * (0.618_033_988_749_895 * cell as f64).fract() - 4.0)
        }),
        (
            "a stiff grain",
            |cell, _| if cell == 21 { 1e8 } else { 1.0 },
        ),
    ];
    for grid in [Grid::square(12), Grid::cube(4), Grid::tetrahedra(4)] {
        for (name, young) in grounds {
            let (k, kept) = build_of(grid, young);
            as_exact_as_the_data(&format!("{grid:?}, {name}"), &k, &kept);
        }
    }
}

/// A free body keeps its rigid motions, 3 or 6 of them, and nothing else.
#[test]
fn floating_bodies_keep_their_motions() {
    for grid in elements().map(Grid::floating) {
        let (k, kept) = build(grid);
        let found = errors(&k, &kept);
        assert!(found.of_largest <= PROMISED, "{grid:?}: {found:?}");
        let m = kept.len();
        let mut vectors = schur(&k, &kept);
        let mut values = vec![0.0; m];
        dense::symmetric_eigen(&mut vectors, m, &mut values);
        let largest = values[m - 1];
        let free = if grid.dim == 2 { 3 } else { 6 };
        // K itself is rounded: some roundings of the largest.
        let null = values[..free].iter().all(|v| v.abs() < 1e-14 * largest);
        assert!(
            null && values[free] > 1e-2 * largest,
            "{grid:?}: {:?}",
            &values[..8]
        );
    }
}

/// The numbers of the unknowns choose another order of elimination and no other S.
#[test]
fn numbering_moves_nothing_but_rounding() {
    let mut random = StdRng::seed_from_u64(4);
    for grid in elements() {
        let (k, kept) = build(grid);
        for _ in 0..2 {
            let mut number: Vec<usize> = (0..k.n).collect();
            shuffle(&mut number, &mut random);
            let number: Vec<Option<usize>> = number.into_iter().map(Some).collect();
            let mut places: Vec<usize> = kept.iter().map(|&i| number[i].unwrap()).collect();
            shuffle(&mut places, &mut random);
            let found = errors(&k.renumbered(&number), &places);
            assert!(found.of_largest <= PROMISED, "{grid:?}: {found:?}");
        }
    }
}

/// Units that are powers of two, one for each unknown: not a bit changes but the
/// exponents.
#[test]
fn units_scale_every_bit() {
    let mut random = StdRng::seed_from_u64(5);
    for grid in elements() {
        let (k, kept) = build(grid);
        let s = schur(&k, &kept);
        for spread in [0, 20, 200] {
            let unit: Vec<f64> = (0..k.n)
                .map(|_| 2_f64.powi(35 + random.random_range(-spread..=spread)))
                .collect();
            let other = k.scaled(|i| unit[i]);
            let weakest = |k| factor(k, &kept).unwrap().weakest_pivot();
            assert_eq!(weakest(&other), weakest(&k));
            let scaled = schur(&other, &kept);
            let m = kept.len();
            for (at, (found, one)) in scaled.iter().zip(&s).enumerate() {
                let expected = one * unit[kept[at / m]] * unit[kept[at % m]];
                assert_eq!(found.to_bits(), expected.to_bits(), "{grid:?}, {spread}");
            }
        }
    }
}

/// Large enough to be shared out among the threads.
#[test]
fn threads_do_not_change_a_bit() {
    for grid in [Grid::tetrahedra(5), Grid::cube(5).floating()] {
        let (k, kept) = build(grid.quadratic());
        let flops = factor(&k, &kept).unwrap().symbolic().counts().flops;
        // More than one thread takes at a time: two tasks, and fronts above them.
        assert!(flops > 3e8, "{flops:e}");
        schur(&k, &kept);
    }
}
