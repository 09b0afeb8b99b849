//! Elastic bodies on regular grids: bilinear squares in plane strain, trilinear
//! cubes, a unit to the side of a cell.
#![expect(
    clippy::many_single_char_names,
    clippy::cast_precision_loss,
    reason = "indices of cells, corners, nodes and directions; counts are small"
)]

/// A stiffness matrix by columns, with what a test wants to know of it.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    pub(crate) n: usize,
    pub(crate) col_ptr: Vec<usize>,
    pub(crate) row_idx: Vec<usize>,
    pub(crate) values: Vec<f64>,
    /// Place of each unknown.
    pub(crate) at: Vec<[f64; 3]>,
    /// Unknowns of the face `x_d = 0`, d the last direction.
    pub(crate) face: Vec<usize>,
}

/// How the body is made and held.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Make {
    /// Cells in each direction; the third is ignored in two dimensions.
    pub(crate) cells: [usize; 3],
    /// 2 or 3.
    pub(crate) dim: usize,
    pub(crate) poisson: f64,
    /// Young's modulus of the half away from the face; the other half has 1.
    pub(crate) far_half: f64,
    /// Whether the face opposite to `x_d = 0` is held, its unknowns left out.
    pub(crate) held: bool,
}

impl Make {
    pub(crate) fn cube(cells: usize) -> Self {
        Self {
            cells: [cells; 3],
            dim: 3,
            poisson: 0.3,
            far_half: 1.0,
            held: true,
        }
    }

    pub(crate) fn square(cells: usize) -> Self {
        Self {
            dim: 2,
            ..Self::cube(cells)
        }
    }

    pub(crate) fn build(self) -> Body {
        let d = self.dim;
        let cells = &self.cells[..d];
        let nodes: Vec<usize> = cells.iter().map(|c| c + 1).collect();
        let mut layers = nodes.clone();
        layers[d - 1] -= usize::from(self.held);
        let total: usize = layers.iter().product();
        let n = total * d;
        let place = |mut v: usize| {
            let mut x = [0; 3];
            for k in 0..d {
                x[k] = v % layers[k];
                v /= layers[k];
            }
            x
        };
        let number = |x: [usize; 3]| {
            let inside = (0..d).all(|k| x[k] < layers[k]);
            inside.then(|| (0..d).rev().fold(0, |v, k| v * layers[k] + x[k]))
        };
        // Pattern: every node with its neighbours, whole blocks of d by d.
        let mut col_ptr = vec![0];
        let mut row_idx = Vec::new();
        for v in 0..total {
            let x = place(v);
            let mut near = Vec::new();
            for shift in 0..[9, 27][d - 2] {
                let mut s = shift;
                let mut y = Some([0; 3]);
                for k in 0..d {
                    let moved = (x[k] + s % 3).checked_sub(1);
                    y = y.and_then(|mut y: [usize; 3]| {
                        y[k] = moved?;
                        Some(y)
                    });
                    s /= 3;
                }
                near.extend(y.and_then(number));
            }
            near.sort_unstable();
            for _ in 0..d {
                row_idx.extend(near.iter().flat_map(|w| (0..d).map(move |k| w * d + k)));
                col_ptr.push(row_idx.len());
            }
        }
        let mut values = vec![0.0; row_idx.len()];
        let element = element(d, self.poisson);
        let corners = 1 << d;
        for cell in 0..cells.iter().product() {
            let mut c = cell;
            let mut base = [0; 3];
            for k in 0..d {
                base[k] = c % cells[k];
                c /= cells[k];
            }
            let young = if 2 * base[d - 1] >= cells[d - 1] {
                self.far_half
            } else {
                1.0
            };
            let corner = |a: usize| {
                let mut x = base;
                (0..d).for_each(|k| x[k] += a >> k & 1);
                number(x)
            };
            for a in 0..corners {
                for b in 0..corners {
                    let (Some(v), Some(w)) = (corner(a), corner(b)) else {
                        continue;
                    };
                    for i in 0..d {
                        for j in 0..d {
                            let column = w * d + j;
                            let rows = &row_idx[col_ptr[column]..col_ptr[column + 1]];
                            let at = rows
                                .binary_search(&(v * d + i))
                                .expect("corners are neighbours");
                            values[col_ptr[column] + at] +=
                                young * element[(a * d + i) * corners * d + b * d + j];
                        }
                    }
                }
            }
        }
        let at = (0..n).map(|dof| place(dof / d).map(|x| x as f64)).collect();
        let face = (0..n).filter(|dof| place(dof / d)[d - 1] == 0).collect();
        Body {
            n,
            col_ptr,
            row_idx,
            values,
            at,
            face,
        }
    }
}

/// Stiffness of one cell with Young's modulus 1, two Gauss points a direction.
fn element(d: usize, poisson: f64) -> Vec<f64> {
    let corners = 1_usize << d;
    let size = corners * d;
    let mut k = vec![0.0; size * size];
    let lambda = poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    let mu = 0.5 / (1.0 + poisson);
    let gauss = [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()];
    for point in 0..corners {
        let x: Vec<f64> = (0..d).map(|k| gauss[point >> k & 1]).collect();
        let gradient = |a: usize, along: usize| -> f64 {
            (0..d)
                .map(|k| match (k == along, a >> k & 1) {
                    (true, 1) => 1.0,
                    (true, _) => -1.0,
                    (false, 1) => x[k],
                    (false, _) => 1.0 - x[k],
                })
                .product()
        };
        let weight = 1.0 / corners as f64;
        for a in 0..corners {
            for b in 0..corners {
                let dots: f64 = (0..d).map(|k| gradient(a, k) * gradient(b, k)).sum();
                for i in 0..d {
                    for j in 0..d {
                        let mut value = lambda * gradient(a, i) * gradient(b, j)
                            + mu * gradient(a, j) * gradient(b, i);
                        if i == j {
                            value += mu * dots;
                        }
                        k[(a * d + i) * size + b * d + j] += weight * value;
                    }
                }
            }
        }
    }
    // Exactly symmetric: the sums above round the two triangles apart.
    for i in 0..size {
        for j in 0..i {
            k[j * size + i] = k[i * size + j];
        }
    }
    k
}
