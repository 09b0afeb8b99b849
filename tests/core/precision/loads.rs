//! Loads condensed, `f_c − K_ci K_ii⁻¹ f_i`: a border of the matrix whose column
//! is the load and whose unknown is kept.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::comparison::{ROUNDINGS, factor, reach};
use super::elements::{Young, build_of};
use crate::common::double_double;
use crate::common::elasticity::Grid;

/// `K` with the load as last row and column, and a last diagonal as large as makes
/// it look like a stiffness, `|f_i| ≤ √(K_ii d)`.
fn bordered(n: usize, dense: &[f64], load: &[f64]) -> Vec<f64> {
    let mut whole = vec![0.0; (n + 1) * (n + 1)];
    let mut last = 0.0_f64;
    for i in 0..n {
        whole[i * (n + 1)..i * (n + 1) + n].copy_from_slice(&dense[i * n..(i + 1) * n]);
        whole[i * (n + 1) + n] = load[i];
        whole[n * (n + 1) + i] = load[i];
        last = last.max(load[i] * load[i] / dense[i * n + i]);
    }
    whole[n * (n + 1) + n] = last;
    whole
}

#[test]
fn loads_are_condensed_as_exactly_as_the_matrix() {
    let mut random = StdRng::seed_from_u64(10);
    let soft = Grid {
        poisson: 0.4999,
        ..Grid::cube(4)
    };
    let even: Young = |_, _| 1.0;
    let grounds: [(Grid, Young); 6] = [
        (Grid::cube(4), even),
        (Grid::tetrahedra(2).quadratic(), even),
        (Grid::cube(4).floating(), even),
        (soft, even),
        (Grid::cube(4), |_, z| if z < 0.5 { 1.0 } else { 1e8 }),
        (
            Grid::square(5).quadratic(),
            |_, z| if z < 0.5 { 1e8 } else { 1.0 },
        ),
    ];
    for (grid, young) in grounds {
        let (k, kept) = build_of(grid, young);
        let (n, dense) = (k.n, k.dense());
        let loads: Vec<f64> = (0..2 * n).map(|_| random.random_range(-1.0..1.0)).collect();
        let mut found = loads.clone();
        factor(&k, &kept).unwrap().condense(&mut found, 2);
        for (load, found) in loads.chunks_exact(n).zip(found.chunks_exact(n)) {
            let whole = bordered(n, &dense, load);
            let mut with_border = kept.clone();
            with_border.push(n);
            let exact = double_double::schur(n + 1, &whole, &with_border);
            // The bound on S, for an entry of the border.
            let reach = reach(n + 1, &whole, &with_border);
            let m = kept.len();
            for (i, &dof) in kept.iter().enumerate() {
                let error = (exact[i * (m + 1) + m] - found[dof].into()).high.abs();
                let allowed = ROUNDINGS * f64::EPSILON * reach[i] * reach[m];
                assert!(error <= allowed, "{grid:?}: {error:e} {allowed:e}");
            }
        }
    }
}
