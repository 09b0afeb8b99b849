//! Stiffness matrices of regular blocks for tests of iterative methods: hexahedra, tetrahedra,
//! squares, of first and second order.
#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "indices of cells, corners and directions; counts are small; a helper of a test may fail"
)]

use bipot_rs::linalg::sparse::csc::Symmetric;

/// The cells of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cell {
    /// Lagrange polynomials on squares or cubes.
    Brick,
    /// Six tetrahedra in each cube, or two triangles in each square.
    Simplex,
}

/// A block and its material.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    /// Cells in each direction; the third is 1 in the plane.
    pub(crate) cells: [usize; 3],
    /// Sides of a cell.
    pub(crate) sides: [f64; 3],
    pub(crate) dim: usize,
    pub(crate) cell: Cell,
    /// Degree of the polynomials, 1 in triangles.
    pub(crate) order: usize,
    pub(crate) poisson: f64,
    /// Young's modulus of the cells in the half away from the face `x_d = 0`, `d` the last
    /// direction; the other half has 1.
    pub(crate) far_half: f64,
    /// Whether the face where the last coordinate is greatest is held: no unknowns.
    pub(crate) held: bool,
}

impl Grid {
    pub(crate) fn cube(cells: usize) -> Self {
        Self {
            cells: [cells; 3],
            sides: [1.0; 3],
            dim: 3,
            cell: Cell::Brick,
            order: 1,
            poisson: 0.3,
            far_half: 1.0,
            held: true,
        }
    }

    pub(crate) fn square(cells: usize) -> Self {
        Self {
            cells: [cells, cells, 1],
            dim: 2,
            ..Self::cube(cells)
        }
    }

    pub(crate) fn tetrahedra(cells: usize) -> Self {
        Self {
            cell: Cell::Simplex,
            ..Self::cube(cells)
        }
    }

    pub(crate) fn quadratic(self) -> Self {
        Self { order: 2, ..self }
    }

    pub(crate) fn floating(self) -> Self {
        Self {
            held: false,
            ..self
        }
    }

    pub(crate) fn assemble(self) -> Assembled {
        let d = self.dim;
        let nodes: Vec<usize> = (0..d).map(|k| self.cells[k] * self.order + 1).collect();
        let mut kept = nodes.clone();
        kept[d - 1] -= usize::from(self.held);
        let count: usize = kept.iter().product();
        let elements = self.elements();
        let mut rows: Vec<std::collections::BTreeMap<usize, [f64; 9]>> =
            vec![std::collections::BTreeMap::new(); count];
        for cell in 0..self.cells[..d].iter().product() {
            let mut rest = cell;
            let base: Vec<usize> = (0..d)
                .map(|k| {
                    let at = rest % self.cells[k];
                    rest /= self.cells[k];
                    at * self.order
                })
                .collect();
            let far = 2 * base[d - 1] >= self.cells[d - 1] * self.order;
            let young = if far { self.far_half } else { 1.0 };
            for (corners, stiffness) in &elements {
                let number = |a: usize| {
                    let at: Vec<usize> = (0..d).map(|k| base[k] + corners[a][k]).collect();
                    let inside = (0..d).all(|k| at[k] < kept[k]);
                    inside.then(|| (0..d).rev().fold(0, |v, k| v * kept[k] + at[k]))
                };
                let size = corners.len() * d;
                for a in 0..corners.len() {
                    for b in 0..corners.len() {
                        let (Some(v), Some(w)) = (number(a), number(b)) else {
                            continue;
                        };
                        let block = rows[v].entry(w).or_insert([0.0; 9]);
                        for i in 0..d {
                            for j in 0..d {
                                let value = stiffness[(a * d + i) * size + b * d + j];
                                block[i * d + j] += young * value;
                            }
                        }
                    }
                }
            }
        }
        let mut assembled = Assembled {
            dim: d,
            col_ptr: vec![0],
            row_idx: Vec::new(),
            values: Vec::new(),
            coordinates: Vec::new(),
        };
        for (v, row) in rows.iter().enumerate() {
            for i in 0..d {
                for (w, block) in row {
                    for j in 0..d {
                        assembled.row_idx.push(w * d + j);
                        assembled.values.push(block[i * d + j]);
                    }
                }
                assembled.col_ptr.push(assembled.row_idx.len());
            }
            let mut rest = v;
            for (kept, side) in kept.iter().zip(&self.sides).take(d) {
                let along = (rest % kept) as f64 / self.order as f64;
                assembled.coordinates.push(along * side);
                rest /= kept;
            }
        }
        assembled
    }

    /// The elements of one cell, by the places of their nodes.
    pub(crate) fn units(self) -> (Reference, Vec<Vec<[usize; 3]>>) {
        let (d, order) = (self.dim, self.order);
        if self.cell == Cell::Brick {
            return (boxes(d, order), vec![grid_points(d, order)]);
        }
        let nodes = |corners: Vec<[usize; 3]>| {
            let edges = if order == 2 { &EDGES[..] } else { &[] };
            let middle =
                |&[a, b]: &[usize; 2]| std::array::from_fn(|k| corners[a][k] + corners[b][k]);
            let scaled = corners.iter().map(|corner| corner.map(|x| order * x));
            scaled.chain(edges.iter().map(middle)).collect()
        };
        (
            simplices(d, order),
            kuhn(d).into_iter().map(nodes).collect(),
        )
    }

    /// The elements of one cell: places of their nodes, and their stiffness by rows.
    fn elements(self) -> Vec<(Vec<[usize; 3]>, Vec<f64>)> {
        let (d, order) = (self.dim, self.order);
        let (reference, elements) = self.units();
        let place = |node: &[usize; 3]| {
            std::array::from_fn(|k| node[k] as f64 * self.sides[k] / order as f64)
        };
        let stiffness = |nodes: Vec<[usize; 3]>| {
            let at: Vec<[f64; 3]> = nodes.iter().map(place).collect();
            let stiffness = cell_stiffness(&reference, &at, d, self.poisson);
            (nodes, stiffness)
        };
        elements.into_iter().map(stiffness).collect()
    }
}

/// Gradients of the shape functions in the reference cell.
pub(crate) struct Reference {
    weights: Vec<f64>,
    /// By point, by node.
    gradients: Vec<Vec<[f64; 3]>>,
}

/// Corners of the simplices of a unit square or cube, from one of its corners to the opposite one
/// edge by edge; right-handed.
fn kuhn(d: usize) -> Vec<Vec<[usize; 3]>> {
    const PATHS: [[usize; 3]; 6] = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let plane = |path: &&[usize; 3]| d == 3 || path[2] == 2;
    let corners = |path: &[usize; 3]| {
        let mut corners = vec![[0; 3]; d + 1];
        for (k, &axis) in path[..d].iter().enumerate() {
            corners[k + 1..].iter_mut().for_each(|c| c[axis] += 1);
        }
        if (path[0] + 1) % 3 != path[1] {
            corners.swap(0, 1);
        }
        corners
    };
    PATHS.iter().filter(plane).map(corners).collect()
}

/// The edges of a tetrahedron, by its corners.
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

/// Tetrahedra, and triangles of the first order.
fn simplices(d: usize, order: usize) -> Reference {
    const FLAT: [[f64; 3]; 4] = [
        [-1.0, -1.0, -1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    if d == 2 {
        let gradients = vec![vec![[-1.0, -1.0, 0.0], FLAT[1], FLAT[2]]];
        let weights = vec![0.5];
        return Reference { weights, gradients };
    }
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

/// Stiffness by rows of a cell with Young's modulus 1 whose map is given by its nodes; exactly
/// symmetric.
pub(crate) fn cell_stiffness(
    reference: &Reference,
    at: &[[f64; 3]],
    d: usize,
    poisson: f64,
) -> Vec<f64> {
    let lambda = poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    let mu = 0.5 / (1.0 + poisson);
    let size = d * at.len();
    let mut element = vec![0.0; size * size];
    for (weight, flat) in reference.weights.iter().zip(&reference.gradients) {
        // ∂x_k/∂ξ_l; in the plane the third direction stays as it is.
        let mut map = nalgebra::Matrix3::identity();
        for k in 0..d {
            for l in 0..d {
                map[(k, l)] = at.iter().zip(flat).map(|(x, g)| x[k] * g[l]).sum();
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
    for p in 0..size {
        (0..p).for_each(|q| element[q * size + p] = element[p * size + q]);
    }
    element
}

/// A stiffness matrix by columns.
#[derive(Clone, Debug)]
pub(crate) struct Assembled {
    pub(crate) dim: usize,
    pub(crate) col_ptr: Vec<usize>,
    pub(crate) row_idx: Vec<usize>,
    pub(crate) values: Vec<f64>,
    /// Coordinates of each node.
    pub(crate) coordinates: Vec<f64>,
}

impl Assembled {
    pub(crate) fn n(&self) -> usize {
        self.col_ptr.len() - 1
    }

    pub(crate) fn nodes(&self) -> usize {
        self.n() / self.dim
    }

    /// Place of each unknown.
    pub(crate) fn places(&self) -> Vec<[f64; 3]> {
        let at = |dof: usize| {
            let node = &self.coordinates[dof / self.dim * self.dim..][..self.dim];
            std::array::from_fn(|k| node.get(k).copied().unwrap_or(0.0))
        };
        (0..self.n()).map(at).collect()
    }

    /// Unknowns of the face where the last coordinate is zero.
    pub(crate) fn face(&self) -> Vec<usize> {
        let at = self.places();
        (0..self.n())
            .filter(|&dof| at[dof][self.dim - 1] == 0.0)
            .collect()
    }

    pub(crate) fn view(&self) -> Symmetric<'_> {
        Symmetric::new(self.n(), &self.col_ptr, &self.row_idx, &self.values).unwrap()
    }

    /// The same body with node `i` at place `order[i]`.
    pub(crate) fn renumbered(&self, order: &[usize]) -> Self {
        let d = self.dim;
        let mut from = vec![0; order.len()];
        for (i, &to) in order.iter().enumerate() {
            from[to] = i;
        }
        let mut out = Self {
            dim: d,
            col_ptr: vec![0],
            row_idx: Vec::new(),
            values: Vec::new(),
            coordinates: Vec::new(),
        };
        let view = self.view();
        for &i in &from {
            for c in 0..d {
                let mut column: Vec<(usize, f64)> = view
                    .column(d * i + c)
                    .map(|(j, value)| (d * order[j / d] + j % d, value))
                    .collect();
                column.sort_by_key(|entry| entry.0);
                out.row_idx.extend(column.iter().map(|entry| entry.0));
                out.values.extend(column.iter().map(|entry| entry.1));
                out.col_ptr.push(out.row_idx.len());
                out.coordinates.push(self.coordinates[d * i + c]);
            }
        }
        out
    }

    /// Two bodies in one matrix, the second `apart` further along the first axis.
    pub(crate) fn beside(mut self, other: &Self, apart: f64) -> Self {
        let (n, entries) = (self.n(), self.row_idx.len());
        self.col_ptr
            .extend(other.col_ptr[1..].iter().map(|p| p + entries));
        self.row_idx.extend(other.row_idx.iter().map(|i| i + n));
        self.values.extend(&other.values);
        let moved = other.coordinates.iter().enumerate();
        let moved = moved.map(|(k, x)| if k % self.dim == 0 { x + apart } else { *x });
        self.coordinates.extend(moved.collect::<Vec<_>>());
        self
    }
}
