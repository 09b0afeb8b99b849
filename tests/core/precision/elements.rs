//! Elastic bodies of tetrahedra, squares and cubes, linear and quadratic, on
//! meshes whose vertices are moved and whose nodes are numbered at random.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::matrices::{Entries, Sparse, shuffle};

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

/// Gradients of the shape functions in the reference cell.
struct Reference {
    weights: Vec<f64>,
    /// By point, by node.
    gradients: Vec<Vec<[f64; 3]>>,
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
            Shape::Tetrahedra { .. } => (tetrahedra(order), self.tetrahedra(order, number)),
        };
        let mut entries = Entries::default();
        let top = (side[d - 1] - 1) as f64;
        for (number, cell) in cells.iter().enumerate() {
            let middle = cell.iter().map(|&v| at[v][d - 1]).sum::<f64>() / cell.len() as f64;
            let young = (self.young)(number, middle / top);
            add_cell(&mut entries, &reference, cell, &at, d, young, self.poisson);
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
        // Paths from one corner of the cube to the opposite one, edge by edge.
        const PATHS: [[usize; 2]; 6] = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]];
        let mut cells = Vec::new();
        for origin in self.grid(3, order) {
            for [first, second] in PATHS {
                let mut corners = [origin; 4];
                for c in &mut corners[1..] {
                    c[first] += order;
                }
                for c in &mut corners[2..] {
                    c[second] += order;
                }
                corners[3][3 - first - second] += order;
                if (first + 1) % 3 != second {
                    corners.swap(0, 1); // the other paths are right-handed
                }
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

const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

fn grid_points(d: usize, order: usize) -> Vec<[usize; 3]> {
    let side = order + 1;
    let last = |k: usize| if k < d { side } else { 1 };
    let count = last(0) * last(1) * last(2);
    (0..count)
        .map(|v| [v % side, v / side % last(1), v / side / last(1)])
        .collect()
}

/// Gauss' rule of `order + 1` points a direction.
fn boxes(d: usize, order: usize) -> Reference {
    let rule: &[(f64, f64)] = if order == 1 {
        &[
            (-0.577_350_269_189_625_8, 1.0),
            (0.577_350_269_189_625_8, 1.0),
        ]
    } else {
        &[
            (-0.774_596_669_241_483_4, 5.0 / 9.0),
            (0.0, 8.0 / 9.0),
            (0.774_596_669_241_483_4, 5.0 / 9.0),
        ]
    };
    // Lagrange's polynomial of node `a` at `x`, and its slope, nodes from 0 to order.
    let value = |a: usize, x: f64| -> f64 {
        (0..=order)
            .filter(|&b| b != a)
            .map(|b| (x - b as f64) / (a as f64 - b as f64))
            .product()
    };
    let slope = |a: usize, x: f64| -> f64 {
        let without = |b: usize| -> f64 {
            let rest = (0..=order).filter(|&c| c != a && c != b);
            let product: f64 = rest
                .map(|c| (x - c as f64) / (a as f64 - c as f64))
                .product();
            product / (a as f64 - b as f64)
        };
        (0..=order).filter(|&b| b != a).map(without).sum()
    };
    let half = 0.5 * order as f64;
    let points = grid_points(d, order);
    let mut made = Reference {
        weights: Vec::new(),
        gradients: Vec::new(),
    };
    for point in &points {
        let x = point.map(|i| half * (1.0 + rule[i].0));
        let weight = (0..d).map(|k| half * rule[point[k]].1).product();
        made.weights.push(weight);
        let gradient = |node: &[usize; 3]| -> [f64; 3] {
            std::array::from_fn(|k| {
                let factor = |l: usize| match (l == k, l < d) {
                    (true, true) => slope(node[l], x[l]),
                    (true, false) => 0.0,
                    (false, true) => value(node[l], x[l]),
                    (false, false) => 1.0,
                };
                factor(0) * factor(1) * factor(2)
            })
        };
        made.gradients.push(points.iter().map(gradient).collect());
    }
    made
}

fn tetrahedra(order: usize) -> Reference {
    const FLAT: [[f64; 3]; 4] = [
        [-1.0, -1.0, -1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    if order == 1 {
        return Reference {
            weights: vec![1.0 / 6.0],
            gradients: vec![FLAT.to_vec()],
        };
    }
    // Four points integrate quadratics, which products of gradients are.
    let (near, far) = (0.585_410_196_624_968_5, 0.138_196_601_125_010_5);
    let at_point = |point: usize| {
        let l: [f64; 4] = std::array::from_fn(|i| if i == point { near } else { far });
        let corner = |i: usize| FLAT[i].map(|g| (4.0 * l[i] - 1.0) * g);
        let edge = |[i, j]: [usize; 2]| {
            std::array::from_fn(|k| 4.0 * (l[i] * FLAT[j][k] + l[j] * FLAT[i][k]))
        };
        (0..4).map(corner).chain(EDGES.map(edge)).collect()
    };
    Reference {
        weights: vec![1.0 / 24.0; 4],
        gradients: (0..4).map(at_point).collect(),
    }
}

/// Stiffness of a cell whose map is given by its nodes.
fn add_cell(
    entries: &mut Entries,
    reference: &Reference,
    cell: &[usize],
    at: &[[f64; 3]],
    d: usize,
    young: f64,
    poisson: f64,
) {
    let lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    let mu = 0.5 * young / (1.0 + poisson);
    let size = d * cell.len();
    let mut element = vec![0.0; size * size];
    for (weight, flat) in reference.weights.iter().zip(&reference.gradients) {
        // ∂x_k/∂ξ_l; in the plane the third direction stays as it is.
        let mut map = nalgebra::Matrix3::identity();
        for k in 0..d {
            for l in 0..d {
                map[(k, l)] = cell.iter().zip(flat).map(|(&v, g)| at[v][k] * g[l]).sum();
            }
        }
        let volume: f64 = map.determinant();
        assert!(volume > 0.0, "a cell is turned over");
        let back = map.transpose().try_inverse().unwrap();
        let gradients: Vec<[f64; 3]> = flat
            .iter()
            .map(|&g| (back * nalgebra::Vector3::from(g)).into())
            .collect();
        for (p, row) in element.chunks_exact_mut(size).enumerate() {
            let (ga, i) = (gradients[p / d], p % d);
            for (q, value) in row.iter_mut().enumerate().take(p + 1) {
                let (gb, j) = (gradients[q / d], q % d);
                let mut energy = lambda * ga[i] * gb[j] + mu * ga[j] * gb[i];
                if i == j {
                    energy += mu * (0..d).map(|k| ga[k] * gb[k]).sum::<f64>();
                }
                *value += weight * volume * energy;
            }
        }
    }
    let dof = |p: usize| d * cell[p / d] + p % d;
    for p in 0..size {
        (0..=p).for_each(|q| entries.add(dof(p), dof(q), element[p * size + q]));
    }
}
