//! The stiffness of one cell.
//!
//! With `E_kl = ∫ ∂_k φ_i ∂_l φ_j` the block of nodes i, j is
//!
//! ```text
//! K_kl = Σ_ab C_kalb E_ab = λ E_kl + μ E_lk + δ_kl μ Σ_m E_mm,
//! ```
//!
//! the last for isotropic materials.

use crate::error::{Error, check_length};

/// Shape functions of a kind of cell at the quadrature points of its reference cell.
#[derive(Clone, Debug)]
pub struct Reference<const D: usize> {
    /// `∂φ_i/∂ξ_b`, point by point, node by node.
    slopes: Vec<[f64; D]>,
    /// Weights of the points, times the thickness.
    weights: Vec<f64>,
    corners: usize,
}

impl<const D: usize> Reference<D> {
    /// From `slopes` in the order (point, b, node), and the thickness, 1 in space.
    pub fn new(
        slopes: &[f64],
        weights: &[f64],
        corners: usize,
        thickness: f64,
    ) -> Result<Self, Error> {
        check_length("slopes", slopes.len(), weights.len() * D * corners)?;
        let slopes = (0..weights.len() * corners).map(|at| {
            let (point, node) = (at / corners, at % corners);
            std::array::from_fn(|b| slopes[(point * D + b) * corners + node])
        });
        Ok(Self {
            slopes: slopes.collect(),
            weights: weights.iter().map(|weight| weight * thickness).collect(),
            corners,
        })
    }
}

/// Elasticity of one material.
#[derive(Clone, Debug)]
pub enum Law {
    /// Lamé's constants λ and μ.
    Isotropic(f64, f64),
    /// The terms of `K_kl = Σ_ab C_kalb E_ab` that are not zero: position of kl, of ab, and C.
    General(Vec<(usize, usize, f64)>),
}

impl Law {
    /// From all entries `C_kalb`, in this order of the indices.
    pub fn general<const D: usize>(tensor: &[f64]) -> Result<Self, Error> {
        check_length("elasticity tensor", tensor.len(), D.pow(4))?;
        let mut terms = Vec::new();
        for (at, &value) in tensor.iter().enumerate() {
            let (k, a) = (at / D.pow(3), at / D.pow(2) % D);
            let (l, b) = (at / D % D, at % D);
            if value != 0.0 {
                terms.push((k * D + l, a * D + b, value));
            }
        }
        Ok(Self::General(terms))
    }

    /// The block of two nodes from their forms `E_ab`.
    fn block<const D: usize>(&self, forms: &[[f64; D]; D]) -> [[f64; D]; D] {
        match self {
            &Self::Isotropic(lame_lambda, lame_mu) => {
                let one = forms.map(|row| row.map(|form| [form]));
                isotropic([lame_lambda], [lame_mu], &one).map(|row| row.map(|[entry]| entry))
            }
            Self::General(terms) => {
                let mut block = [[0.0; D]; D];
                for &(to, from, value) in terms {
                    block[to / D][to % D] += value * forms[from / D][from % D];
                }
                block
            }
        }
    }
}

/// The block of two nodes of `W` cells of isotropic materials.
fn isotropic<const D: usize, const W: usize>(
    lame_lambda: [f64; W],
    lame_mu: [f64; W],
    forms: &[[[f64; W]; D]; D],
) -> [[[f64; W]; D]; D] {
    let trace: [f64; W] = each(|w| (0..D).map(|m| forms[m][m][w]).sum());
    each(|k| {
        each(|l| {
            each(|w| {
                let (lambda, mu) = (lame_lambda[w], lame_mu[w]);
                if k == l {
                    (lambda + mu) * forms[k][k][w] + mu * trace[w]
                } else {
                    lambda * forms[k][l][w] + mu * forms[l][k][w]
                }
            })
        })
    })
}

fn each<T, const N: usize>(make: impl FnMut(usize) -> T) -> [T; N] {
    std::array::from_fn(make)
}

/// Number of cells that are integrated at once: one operation on all of them fills the
/// registers of the processor, whatever the kind of cell.
pub const LANES: usize = 4;

/// A number of each of the cells that are integrated at once.
pub type Lanes = [f64; LANES];

/// Work space for the matrices of cells.
#[derive(Clone, Debug)]
pub struct Integrator<'a, const D: usize> {
    reference: &'a Reference<D>,
    /// `∂_a φ_i √weight`, node by node, point by point.
    gradients: Vec<[Lanes; D]>,
}

impl<'a, const D: usize> Integrator<'a, D> {
    /// For cells of one kind.
    pub fn new(reference: &'a Reference<D>) -> Self {
        Self {
            reference,
            gradients: vec![[[0.0; LANES]; D]; reference.slopes.len()],
        }
    }

    /// Writes the blocks of all pairs of nodes, in the order (i, j, k, l), one cell after the
    /// other: of the first cells, as many as `matrices` has room for. The block of j, i is the
    /// transpose of that of i, j to the last bit.
    ///
    /// `corners` are the positions of the nodes relative to the first: far from the origin
    /// positions themselves have lost digits. Returns which cells are valid, neither folded nor
    /// flat; the others have no matrix.
    pub fn matrices(
        &mut self,
        corners: &[[Lanes; D]],
        laws: [&Law; LANES],
        matrices: &mut [f64],
    ) -> [bool; LANES] {
        let valid = self.gradients(corners);
        let count = self.reference.corners;
        let constants = constants(laws);
        for i in 0..count {
            for j in i..count {
                let forms = self.forms(i, j);
                let block = if let Some((lambda, mu)) = constants {
                    isotropic(lambda, mu, &forms)
                } else {
                    let own: [[[f64; D]; D]; LANES] =
                        each(|w| laws[w].block(&each(|k| each(|l| forms[k][l][w]))));
                    each(|k| each(|l| each(|w| own[w][k][l])))
                };
                for (w, matrix) in matrices.chunks_exact_mut((count * D).pow(2)).enumerate() {
                    let upper = &mut matrix[(i * count + j) * D * D..][..D * D];
                    for k in 0..D {
                        for l in 0..D {
                            // Sums of mirrored terms may have another order within a block.
                            let mirrored = i == j && k > l;
                            let (from, to) = if mirrored { (l, k) } else { (k, l) };
                            upper[k * D + l] = block[from][to][w];
                        }
                    }
                    if i != j {
                        let lower = &mut matrix[(j * count + i) * D * D..][..D * D];
                        for k in 0..D {
                            for l in 0..D {
                                lower[l * D + k] = block[k][l][w];
                            }
                        }
                    }
                }
            }
        }
        valid
    }

    /// `E_kl` of nodes i, j.
    fn forms(&self, i: usize, j: usize) -> [[Lanes; D]; D] {
        let points = self.reference.weights.len();
        let own = &self.gradients[i * points..][..points];
        let other = &self.gradients[j * points..][..points];
        each(|k| {
            let mut row = [[0.0; LANES]; D];
            for (own, other) in own.iter().zip(other) {
                for (sum, slope) in row.iter_mut().zip(other) {
                    for w in 0..LANES {
                        sum[w] += own[k][w] * slope[w];
                    }
                }
            }
            row
        })
    }

    fn gradients(&mut self, corners: &[[Lanes; D]]) -> [bool; LANES] {
        let (count, points) = (self.reference.corners, self.reference.weights.len());
        let mut positive = [true; LANES];
        let mut negative = [true; LANES];
        for (point, &weight) in self.reference.weights.iter().enumerate() {
            let slopes = &self.reference.slopes[point * count..][..count];
            // ∂x_a/∂ξ_b, row b.
            let mut jacobian = [[[0.0; LANES]; D]; D];
            for (slope, x) in slopes.iter().zip(corners) {
                for (row, slope) in jacobian.iter_mut().zip(slope) {
                    for (sum, x) in row.iter_mut().zip(x) {
                        for w in 0..LANES {
                            sum[w] += slope * x[w];
                        }
                    }
                }
            }
            let (mut inner, determinant) = inverse(&jacobian);
            // A mirrored numbering has one sign at all points; a folded cell has both signs.
            for w in 0..LANES {
                positive[w] &= determinant[w] > 0.0;
                negative[w] &= determinant[w] < 0.0;
            }
            let root: Lanes = each(|w| (weight * determinant[w].abs()).sqrt());
            for entry in inner.as_flattened_mut() {
                for w in 0..LANES {
                    entry[w] *= root[w];
                }
            }
            for (i, slope) in slopes.iter().enumerate() {
                self.gradients[i * points + point] =
                    each(|a| each(|w| (0..D).map(|b| slope[b] * inner[b][a][w]).sum()));
            }
        }
        each(|w| positive[w] || negative[w])
    }
}

/// λ and μ of the cells, if all are isotropic.
fn constants(laws: [&Law; LANES]) -> Option<(Lanes, Lanes)> {
    let mut found = ([0.0; LANES], [0.0; LANES]);
    for (w, law) in laws.iter().enumerate() {
        let Law::Isotropic(lame_lambda, lame_mu) = law else {
            return None;
        };
        (found.0[w], found.1[w]) = (*lame_lambda, *lame_mu);
    }
    Some(found)
}

/// `∂ξ_b/∂x_a`, row b, and the determinant of the Jacobian with rows `∂x/∂ξ_b`.
fn inverse<const D: usize>(jacobian: &[[Lanes; D]; D]) -> ([[Lanes; D]; D], Lanes) {
    let cofactor = |b: usize, a: usize, w: usize| {
        let j = |b: usize, a: usize| jacobian[b % D][a % D][w];
        match D {
            2 if a == b => j(b + 1, a + 1),
            2 => -j(b + 1, a + 1),
            _ => j(b + 1, a + 1) * j(b + 2, a + 2) - j(b + 1, a + 2) * j(b + 2, a + 1),
        }
    };
    let cofactors: [[Lanes; D]; D] = each(|b| each(|a| each(|w| cofactor(b, a, w))));
    let determinant: Lanes = each(|w| (0..D).map(|a| jacobian[0][a][w] * cofactors[0][a][w]).sum());
    let inner = each(|b| each(|a| each(|w| cofactors[b][a][w] / determinant[w])));
    (inner, determinant)
}
