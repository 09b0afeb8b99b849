//! Elastic bodies of tetrahedra, squares and cubes, linear and quadratic, on
//! meshes whose vertices are moved and whose nodes are numbered at random.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::matrices::{Entries, Sparse, shuffle};
use crate::common::elasticity::{Grid, cell_stiffness};

/// Young's modulus by the number of the cell and its height, from 0 at the kept
/// face to 1.
pub(crate) type Young = fn(usize, f64) -> f64;

/// The stiffness, and the unknowns of the face that is kept, in any order.
pub(crate) fn build(grid: Grid) -> (Sparse, Vec<usize>) {
    build_of(grid, |_, _| 1.0)
}

/// [`build`] of cells with these moduli.
pub(crate) fn build_of(grid: Grid, young: Young) -> (Sparse, Vec<usize>) {
    let (d, [wide, deep, high]) = (grid.dim, grid.cells);
    let mut random = StdRng::seed_from_u64(1);
    let mut side = [1; 3];
    (0..d).for_each(|k| side[k] = grid.order * grid.cells[k] + 1);
    let count: usize = side.iter().product();
    let place = |v: usize| [v % side[0], v / side[0] % side[1], v / side[0] / side[1]];
    let at: Vec<[f64; 3]> = (0..count)
        .map(|v| {
            // Up to a tenth of the distance of two nodes: no cell turns over.
            let mut x = place(v).map(|x| x as f64);
            (0..d).for_each(|k| x[k] += random.random_range(-0.1..0.1));
            x
        })
        .collect();
    let (reference, units) = grid.units();
    let origin = |c: usize| [c % wide, c / wide % deep, c / wide / deep].map(|i| grid.order * i);
    let cells = (0..wide * deep * high).flat_map(|cell| {
        let node = move |x: &[usize; 3]| {
            let [x, y, z] = std::array::from_fn(|k| origin(cell)[k] + x[k]);
            (z * side[1] + y) * side[0] + x
        };
        let units = units.iter();
        units.map(move |unit| unit.iter().map(node).collect::<Vec<usize>>())
    });
    let mut entries = Entries::default();
    let top = (side[d - 1] - 1) as f64;
    for (number, cell) in cells.enumerate() {
        let middle = cell.iter().map(|&v| at[v][d - 1]).sum::<f64>() / cell.len() as f64;
        let young = young(number, middle / top);
        let nodes: Vec<[f64; 3]> = cell.iter().map(|&v| at[v]).collect();
        let stiffness = cell_stiffness(&reference, &nodes, d, grid.poisson);
        let (size, dof) = (d * cell.len(), |p: usize| d * cell[p / d] + p % d);
        for (p, q) in (0..size).flat_map(|p| (0..=p).map(move |q| (p, q))) {
            entries.add(dof(p), dof(q), young * stiffness[p * size + q]);
        }
    }
    let free: Vec<usize> = (0..count)
        .filter(|&v| !grid.held || place(v)[d - 1] + 1 < side[d - 1])
        .collect();
    let mut seats: Vec<usize> = (0..free.len()).collect();
    shuffle(&mut seats, &mut random);
    let mut seat = vec![None; d * count];
    for (&v, to) in free.iter().zip(seats) {
        (0..d).for_each(|k| seat[d * v + k] = Some(d * to + k));
    }
    let mut kept: Vec<usize> = (0..d * count)
        .filter(|dof| place(dof / d)[d - 1] == 0)
        .filter_map(|dof| seat[dof])
        .collect();
    shuffle(&mut kept, &mut random);
    (entries.matrix(d * count).renumbered(&seat), kept)
}
