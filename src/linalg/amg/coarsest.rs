//! The coarsest level: a dense Cholesky factor.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::block_rows::Blocks as _;
use crate::linalg::dense::cholesky;
use crate::linalg::real::Real;

/// `L` with `L Lᵀ = A + s diag(A)`.
#[derive(Clone, Debug)]
pub(super) struct Coarsest {
    n: usize,
    /// The rows of the lower triangle, one after another, with the inverse of the diagonal.
    factor: Vec<f32>,
}

impl Coarsest {
    /// Relative shifts of the diagonal, tried in turn.
    ///
    /// A body that nothing holds has rigid motions without energy, of which single precision
    /// leaves ±1e-7 of the diagonal. A shift above this makes the matrix positive definite. It
    /// changes no solution, only the preconditioner: the rigid motions that it lets through have
    /// no energy.
    const SHIFTS: [f64; 4] = [1e-6, 1e-5, 1e-4, 1e-3];

    /// Without an unknown.
    pub(super) fn none() -> Self {
        Self {
            n: 0,
            factor: Vec::new(),
        }
    }

    pub(super) fn new(matrix: &BlockMatrix, stop: &AtomicBool) -> Result<Self, Error> {
        let (b, n) = (matrix.b, matrix.b * matrix.nodes());
        let mut dense = vec![0.0; n * n];
        for shift in Self::SHIFTS {
            dense.fill(0.0);
            for i in 0..matrix.nodes() {
                for at in matrix.row(i) {
                    let j = matrix.column[at] as usize;
                    for c in 0..b {
                        for l in 0..b {
                            let value = matrix.values[at * b * b + c * b + l].double();
                            let factor = if i == j && c == l { 1.0 + shift } else { 1.0 };
                            dense[(b * j + c) * n + b * i + l] = factor * value;
                        }
                    }
                }
            }
            if cholesky(&mut dense, n, stop)?.is_none() {
                return Ok(Self::packed(&dense, n));
            }
        }
        Err(Error::Multigrid {
            reason: "the matrix of the coarsest level is not positive definite",
        })
    }

    /// Takes the lower triangle of a matrix by columns.
    fn packed(dense: &[f64], n: usize) -> Self {
        let mut factor = Vec::with_capacity(n * (n + 1) / 2);
        for i in 0..n {
            factor.extend((0..i).map(|j| f32::rounded(dense[j * n + i])));
            factor.push(f32::rounded(dense[i * n + i].recip()));
        }
        Self { n, factor }
    }

    pub(super) fn unknowns(&self) -> usize {
        self.n
    }

    pub(super) fn bytes(&self) -> usize {
        4 * self.factor.len()
    }

    /// `x = (L Lᵀ)⁻¹ b`.
    pub(super) fn solve(&self, b: &[f32], x: &mut [f32]) {
        let mut at = 0;
        for i in 0..self.n {
            let (row, inverse) = (&self.factor[at..at + i], self.factor[at + i]);
            x[i] = (b[i] - dot(row, &x[..i])) * inverse;
            at += i + 1;
        }
        for i in (0..self.n).rev() {
            at -= i + 1;
            let (row, inverse) = (&self.factor[at..at + i], self.factor[at + i]);
            let (earlier, own) = x.split_at_mut(i);
            own[0] *= inverse;
            for (x, l) in earlier.iter_mut().zip(row) {
                *x -= l * own[0];
            }
        }
    }
}

/// `a · b` in eight sums, which the processor adds side by side.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; 8];
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    rest + sums.iter().sum::<f32>()
}
