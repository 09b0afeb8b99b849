//! Elastic bodies of tetrahedra, squares and cubes, linear and quadratic, on
//! meshes whose vertices are moved and whose nodes are numbered at random.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::matrices::{Entries, Sparse, shuffle};
use crate::common::elasticity::{EDGES, boxes, cell_stiffness, grid_points, kuhn, simplices};

/// Shape of the cells; the number of nodes along an edge is the order plus one.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// Squares or cubes.
    Box { dim: usize, order: usize },
    /// Six in a cube.
    Tetrahedra { order: usize },
}

/// Young's modulus by the number of the cell and its height, from 0 at the kept
/// face to 1.
pub(crate) type Young = fn(usize, f64) -> f64;

/// A body of `cells` in each direction, its far face held or not.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Make {
    pub(crate) shape: Shape,
    pub(crate) cells: [usize; 3],
    pub(crate) poisson: f64,
    pub(crate) held: bool,
    pub(crate) young: Young,
    pub(crate) seed: u64,
}

impl Make {
    pub(crate) fn new(shape: Shape, cells: usize) -> Self {
        Self {
            shape,
            cells: [cells; 3],
            poisson: 0.3,
            held: true,
            young: |_, _| 1.0,
            seed: 1,
        }
    }

    fn dim(&self) -> usize {
        match self.shape {
            Shape::Box { dim, .. } => dim,
            Shape::Tetrahedra { .. } => 3,
        }
    }

    fn order(&self) -> usize {
        match self.shape {
            Shape::Box { order, .. } | Shape::Tetrahedra { order } => order,
        }
    }

    /// The stiffness, and the unknowns of the face that is kept, in any order.
    pub(crate) fn build(&self) -> (Sparse, Vec<usize>) {
        let (d, order) = (self.dim(), self.order());
        let mut random = StdRng::seed_from_u64(self.seed);
        let mut side = [1; 3];
        (0..d).for_each(|k| side[k] = order * self.cells[k] + 1);
        let count: usize = side.iter().product();
        let place = |v: usize| [v % side[0], v / side[0] % side[1], v / side[0] / side[1]];
        let number = |x: [usize; 3]| (x[2] * side[1] + x[1]) * side[0] + x[0];
        let at: Vec<[f64; 3]> = (0..count)
            .map(|v| {
                let x = place(v);
                // Up to a tenth of the distance of two nodes: no cell turns over.
                std::array::from_fn(|k| {
                    let moved = if k < d {
                        random.random_range(-0.1..0.1)
                    } else {
                        0.0
                    };
                    x[k] as f64 + moved
                })
            })
            .collect();
        let (reference, cells) = match self.shape {
            Shape::Box { .. } => (boxes(d, order), self.boxes(d, order, number)),
            Shape::Tetrahedra { .. } => (simplices(3, order), self.tetrahedra(order, number)),
        };
        let mut entries = Entries::default();
        let top = (side[d - 1] - 1) as f64;
        for (number, cell) in cells.iter().enumerate() {
            let middle = cell.iter().map(|&v| at[v][d - 1]).sum::<f64>() / cell.len() as f64;
            let young = (self.young)(number, middle / top);
            let nodes: Vec<[f64; 3]> = cell.iter().map(|&v| at[v]).collect();
            let stiffness = cell_stiffness(&reference, &nodes, d, self.poisson);
            let (size, dof) = (d * cell.len(), |p: usize| d * cell[p / d] + p % d);
            for (p, q) in (0..size).flat_map(|p| (0..=p).map(move |q| (p, q))) {
                entries.add(dof(p), dof(q), young * stiffness[p * size + q]);
            }
        }
        let free: Vec<usize> = (0..count)
            .filter(|&v| !self.held || place(v)[d - 1] + 1 < side[d - 1])
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

    /// Origins of the grid's cells.
    fn grid(&self, d: usize, order: usize) -> Vec<[usize; 3]> {
        let along = |k: usize| 0..if k < d { self.cells[k] } else { 1 };
        let mut found = Vec::new();
        for z in along(2) {
            for y in along(1) {
                found.extend(along(0).map(|x| [x, y, z].map(|i| i * order)));
            }
        }
        found
    }

    fn boxes(
        &self,
        d: usize,
        order: usize,
        number: impl Fn([usize; 3]) -> usize,
    ) -> Vec<Vec<usize>> {
        let of_cell = |origin: [usize; 3]| {
            let local = grid_points(d, order);
            let node = |x: [usize; 3]| number(std::array::from_fn(|k| origin[k] + x[k]));
            local.into_iter().map(node).collect()
        };
        self.grid(d, order).into_iter().map(of_cell).collect()
    }

    fn tetrahedra(&self, order: usize, number: impl Fn([usize; 3]) -> usize) -> Vec<Vec<usize>> {
        let mut cells = Vec::new();
        for origin in self.grid(3, order) {
            for unit in kuhn(3) {
                let corner = |c: &[usize; 3]| std::array::from_fn(|k| origin[k] + order * c[k]);
                let corners: Vec<[usize; 3]> = unit.iter().map(corner).collect();
                let mut cell: Vec<usize> = corners.iter().map(|&c| number(c)).collect();
                if order == 2 {
                    cell.extend(EDGES.iter().map(|&[a, b]| {
                        let (a, b) = (corners[a], corners[b]);
                        number(std::array::from_fn(|k| usize::midpoint(a[k], b[k])))
                    }));
                }
                cells.push(cell);
            }
        }
        cells
    }
}
