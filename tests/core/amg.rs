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
        println!("{cells}: {found}");
        assert!(found <= 22, "{cells} cells: {found}");
    }
}

#[test]
fn other_cells() {
    let stretched = Grid {
        sides: [1.0, 1.0, 5.0],
        ..Grid::cube(12)
    };
    let tets = Grid {
        cell: Cell::Simplex,
        ..Grid::cube(12)
    };
    let second = Grid {
        order: 2,
        ..Grid::cube(7)
    };
    let plane = Grid::square(60);
    let triangles = Grid {
        cell: Cell::Simplex,
        ..Grid::square(60)
    };
    let soft = Grid {
        poisson: 0.45,
        ..Grid::cube(12)
    };
    for (name, grid) in [
        ("stretched", stretched),
        ("tets", tets),
        ("second", second),
        ("plane", plane),
        ("triangles", triangles),
        ("soft", soft),
    ] {
        println!("{name}: {}", iterations(&grid.assemble()));
    }
}
