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
    /// Degree of the polynomials, 2 for bricks only.
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

    /// The elements of one cell: places of their nodes, and their stiffness by rows.
    fn elements(self) -> Vec<(Vec<[usize; 3]>, Vec<f64>)> {
        match self.cell {
            Cell::Brick => vec![self.brick()],
            Cell::Simplex => self.simplices(),
        }
    }

    fn brick(self) -> (Vec<[usize; 3]>, Vec<f64>) {
        let (d, p) = (self.dim, self.order);
        let n = (p + 1).pow(u32::try_from(d).unwrap());
        let index = |mut a: usize| {
            let mut x = [0; 3];
            for x in &mut x[..d] {
                *x = a % (p + 1);
                a /= p + 1;
            }
            x
        };
        // Three Gauss points are exact for both orders.
        let gauss = [
            (0.5 - 0.5 * 0.6_f64.sqrt(), 5.0 / 18.0),
            (0.5, 8.0 / 18.0),
            (0.5 + 0.5 * 0.6_f64.sqrt(), 5.0 / 18.0),
        ];
        let shape = |a: usize, x: f64| -> (f64, f64) {
            let knots: Vec<f64> = (0..=p).map(|k| k as f64 / p as f64).collect();
            let (mut value, mut slope) = (1.0, 0.0);
            for (k, knot) in knots.iter().enumerate().filter(|(k, _)| *k != a) {
                let _ = k;
                let width = knots[a] - knot;
                slope = slope * (x - knot) / width + value / width;
                value *= (x - knot) / width;
            }
            (value, slope)
        };
        let mut stiffness = vec![0.0; (n * d) * (n * d)];
        for point in 0..3_usize.pow(u32::try_from(d).unwrap()) {
            let places = [point % 3, point / 3 % 3, point / 9];
            let mut weight = 1.0;
            for k in 0..d {
                weight *= gauss[places[k]].1 * self.sides[k];
            }
            let gradients: Vec<[f64; 3]> = (0..n)
                .map(|a| {
                    let at = index(a);
                    let mut gradient = [0.0; 3];
                    for (along, g) in gradient[..d].iter_mut().enumerate() {
                        *g = 1.0 / self.sides[along];
                        for k in 0..d {
                            let (value, slope) = shape(at[k], gauss[places[k]].0);
                            *g *= if k == along { slope } else { value };
                        }
                    }
                    gradient
                })
                .collect();
            self.add(&gradients, weight, &mut stiffness);
        }
        ((0..n).map(index).collect(), stiffness)
    }

    fn simplices(self) -> Vec<(Vec<[usize; 3]>, Vec<f64>)> {
        let d = self.dim;
        let orders: &[&[usize]] = if d == 2 {
            &[&[0, 1], &[1, 0]]
        } else {
            &[
                &[0, 1, 2],
                &[0, 2, 1],
                &[1, 0, 2],
                &[1, 2, 0],
                &[2, 0, 1],
                &[2, 1, 0],
            ]
        };
        let volume = self.sides[..d].iter().product::<f64>() / orders.len() as f64;
        orders
            .iter()
            .map(|axes| {
                // Kuhn's simplex: one axis after another, from corner 0 to the opposite one.
                let mut corners = vec![[0; 3]];
                for &axis in *axes {
                    let mut next = corners[corners.len() - 1];
                    next[axis] = 1;
                    corners.push(next);
                }
                // x_axis[k] is the sum of the barycentric coordinates after k.
                let mut gradients = vec![[0.0; 3]; d + 1];
                for (k, &axis) in axes.iter().enumerate() {
                    gradients[k][axis] -= 1.0 / self.sides[axis];
                    gradients[k + 1][axis] += 1.0 / self.sides[axis];
                }
                let mut stiffness = vec![0.0; ((d + 1) * d).pow(2)];
                self.add(&gradients, volume, &mut stiffness);
                (corners, stiffness)
            })
            .collect()
    }

    /// Adds one integration point, exactly symmetric.
    fn add(self, gradients: &[[f64; 3]], weight: f64, stiffness: &mut [f64]) {
        let (d, n) = (self.dim, gradients.len());
        let lambda = self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson));
        let mu = 0.5 / (1.0 + self.poisson);
        for a in 0..n {
            for b in 0..n {
                let (p, q) = (gradients[a], gradients[b]);
                let dots: f64 = (0..d).map(|k| p[k] * q[k]).sum();
                for i in 0..d {
                    for j in 0..d {
                        let (first, second) = (lambda * (p[i] * q[j]), mu * (p[j] * q[i]));
                        let shear = if i == j { mu * dots } else { 0.0 };
                        stiffness[(a * d + i) * n * d + b * d + j] +=
                            weight * (first + second + shear);
                    }
                }
            }
        }
    }
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
