//! The multigrid preconditioner: iterations, invariances, bodies without supports.
#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::sync::atomic::AtomicBool;

use bipot_rs::linalg::amg::block_matrix::BlockMatrix;
use bipot_rs::linalg::amg::multigrid::Multigrid;
use bipot_rs::linalg::amg::rigid_motions::rigid_motions;
use bipot_rs::linalg::amg::settings::Settings;
use bipot_rs::linalg::conjugate_gradients;
use bipot_rs::linalg::parallel::norm;
use bipot_rs::linalg::random_signs::random_signs;

use crate::common::elasticity::{Assembled, Cell, Grid};

/// Rounding of products and of the recurrence stays below this for the condition of these bodies.
const TOL: f64 = 1e-12;

fn blocks(body: &Assembled) -> BlockMatrix<f64> {
    let place: Vec<u32> = (0..u32::try_from(body.n()).unwrap()).collect();
    BlockMatrix::new(&body.view(), &place, body.nodes(), body.dim)
}

fn multigrid(body: &Assembled, settings: &Settings) -> (BlockMatrix<f64>, Multigrid) {
    let matrix = blocks(body);
    let vectors = rigid_motions(&body.coordinates, body.dim);
    let held = vec![false; body.n()];
    let never = AtomicBool::new(false);
    let levels = Multigrid::new(matrix.to_single(), vectors, &held, settings, &never).unwrap();
    (matrix, levels)
}

/// Iterations of conjugate gradients, and the solution, which is checked.
fn solve(matrix: &BlockMatrix<f64>, levels: &mut Multigrid, b: &[f64]) -> (usize, Vec<f64>) {
    let never = AtomicBool::new(false);
    let found = conjugate_gradients::solve(
        |x, y| matrix.product(x, y),
        |r, z| levels.apply(r, z),
        b,
        TOL,
        200,
        &never,
    )
    .unwrap();
    assert!(found.reached, "{} after {}", found.residual, found.products);
    let mut left = vec![0.0; b.len()];
    matrix.product(&found.x, &mut left);
    for (left, b) in left.iter_mut().zip(b) {
        *left -= b;
    }
    // The true residual: that of the recurrence and the rounding of the products, whose terms
    // are larger than their sum by the condition.
    assert!(norm(&left) <= 1e-10 * norm(b), "{}", norm(&left) / norm(b));
    (found.products, found.x)
}

fn iterations(body: &Assembled) -> usize {
    let (matrix, mut levels) = multigrid(body, &Settings::default());
    solve(&matrix, &mut levels, &random_signs(body.n(), 7)).0
}

#[test]
fn cubes_need_as_many_iterations_at_any_size() {
    for cells in [6, 12, 20] {
        let found = iterations(&Grid::cube(cells).assemble());
        assert!(found <= 22, "{cells} cells: {found}");
    }
}

/// Bounds are the measured counts and a tenth: 65, 18, 23, 16, 23, 26. Cells five times as long
/// as wide are hard, because an aggregate spans as many of them in each direction.
#[test]
fn iterations_on_other_cells() {
    let cube = Grid::cube(12);
    let square = Grid::square(60);
    let simplex = |grid| Grid {
        cell: Cell::Simplex,
        ..grid
    };
    let stretched = Grid {
        sides: [1.0, 1.0, 5.0],
        ..cube
    };
    let quadratic = Grid {
        order: 2,
        ..Grid::cube(7)
    };
    let soft = Grid {
        poisson: 0.45,
        ..cube
    };
    for (name, grid, most) in [
        ("stretched", stretched, 71),
        ("tetrahedra", simplex(cube), 20),
        ("second order", quadratic, 25),
        ("plane", square, 18),
        ("triangles", simplex(square), 25),
        ("ν = 0.45", soft, 29),
    ] {
        let found = iterations(&grid.assemble());
        assert!(found <= most, "{name}: {found}");
    }
}

/// Bodies in one matrix, and one that nothing holds with loads that sum to no force or moment.
#[test]
fn bodies_without_supports() {
    let free = Grid {
        held: false,
        ..Grid::cube(10)
    };
    let pair = Grid::cube(8).assemble().beside(&free.assemble(), 20.0);
    for body in [free.assemble(), pair] {
        let (matrix, mut levels) = multigrid(&body, &Settings::default());
        // The range of K contains K times anything.
        let mut b = vec![0.0; body.n()];
        matrix.product(&random_signs(body.n(), 3), &mut b);
        let (found, _) = solve(&matrix, &mut levels, &b);
        assert!(found <= 30, "{found}");
    }
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let body = Grid::cube(14).assemble();
    let solution = |threads| {
        bipot_rs::threads::pool(threads).unwrap().install(|| {
            let (matrix, mut levels) = multigrid(&body, &Settings::default());
            solve(&matrix, &mut levels, &random_signs(body.n(), 5)).1
        })
    };
    assert_eq!(solution(1), solution(2));
}

/// A power of two scales each number without rounding; another factor changes rounding only.
#[test]
fn units_change_nothing() {
    let body = Grid::cube(10).assemble();
    let b = random_signs(body.n(), 5);
    let scaled = |factor: f64| {
        let mut body = body.clone();
        body.values.iter_mut().for_each(|value| *value *= factor);
        let (matrix, mut levels) = multigrid(&body, &Settings::default());
        solve(&matrix, &mut levels, &b)
    };
    let (found, x) = scaled(1.0);
    for power in [-200, 70] {
        let factor = 2.0_f64.powi(power);
        let (same, other) = scaled(factor);
        assert_eq!(same, found);
        assert!(x.iter().zip(&other).all(|(x, y)| *x == y * factor));
    }
    assert!(scaled(1e9).0.abs_diff(found) <= 1);
}
