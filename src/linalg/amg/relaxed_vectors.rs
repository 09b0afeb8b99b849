//! Near-null vectors without coordinates: translations, and random vectors after smoothing.

use crate::error::Error;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::block_rows::{Coefficients, step};
use crate::linalg::amg::inverse_diagonal::inverse_diagonal;
use crate::linalg::amg::spectrum::bound;
use crate::linalg::parallel::{largest, map};
use crate::linalg::random_signs::random_signs;
use crate::linalg::real::Real;

/// Smoothing steps on each random vector. What remains is smooth over an aggregate of three
/// nodes a side.
const STEPS: u32 = 20;

/// Near-null vectors, `b × m` by rows for each node, as
/// [`rigid_motions`](super::rigid_motions::rigid_motions) orders them: the translations, which
/// are exact, and in place of each rotation a random vector relaxed on `A x = 0`. `seeds` chooses
/// the random vectors.
///
/// These are weaker than rotations: give coordinates where there are any.
///
/// # Errors
/// [`Error::Multigrid`] if a diagonal of the matrix is not positive.
pub fn relaxed_vectors(matrix: &BlockMatrix<f32>, seeds: u64) -> Result<Vec<f64>, Error> {
    let failure = Error::Multigrid {
        reason: "a diagonal entry is not positive, or not finite",
    };
    let inverse = inverse_diagonal(matrix).ok_or(failure.clone())?;
    let spectrum = bound(matrix, &inverse).ok_or(failure)?;
    let b = matrix.block_size();
    let n = b * matrix.nodes();
    let m = if b == 2 { 3 } else { 6 };
    let mut vectors = vec![0.0; n * m];
    for (k, row) in vectors.chunks_exact_mut(m).enumerate() {
        row[k % b] = 1.0;
    }
    // Jacobi steps of the size that damps the upper half of the spectrum most.
    let with = Coefficients {
        direction: 0.0,
        residual: f32::rounded(4.0 / (3.0 * spectrum)),
        update: 1.0,
    };
    let zeros = vec![0.0; n];
    let (mut d, mut y) = (zeros.clone(), zeros.clone());
    for c in b..m {
        let seed = seeds.wrapping_add(c as u64);
        let signs = random_signs(n, seed).into_iter();
        let mut x: Vec<f32> = signs.map(f32::rounded).collect();
        for (x, &held) in x.iter_mut().zip(matrix.held()) {
            if held {
                *x = 0.0;
            }
        }
        for _ in 0..STEPS {
            step(matrix, &inverse, &x, &zeros, &mut d, &mut y, with);
            std::mem::swap(&mut x, &mut y);
        }
        let size = f32::rounded(largest(&x));
        if size > 0.0 {
            map(&mut x, |x| x / size);
        }
        for (row, x) in vectors.chunks_exact_mut(m).zip(&x) {
            row[c] = x.double();
        }
    }
    Ok(vectors)
}
