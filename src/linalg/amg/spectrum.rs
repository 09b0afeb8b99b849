//! An upper bound of the eigenvalues of `D⁻¹ A`, `D` the diagonal blocks of `A`.

use crate::linalg::amg::block_rows::{StepCoefficients, first_step};
use crate::linalg::amg::tuning;
use crate::linalg::parallel::{axpy, dot, xpay};
use crate::linalg::random_signs::random_signs;
use crate::linalg::real::Real;

/// A bound of the largest eigenvalue, from the coefficients of conjugate gradients with the
/// preconditioner `D`, of `b × b` blocks; `None` if the numbers leave the range. `product` writes
/// `A x` to its second argument.
pub(super) fn bound(
    b: usize,
    inverse: &[f32],
    mut product: impl FnMut(&[f32], &mut [f32]),
) -> Option<f64> {
    let n = inverse.len() / b;
    let mut r: Vec<f32> = random_signs(n, 1).into_iter().map(f32::rounded).collect();
    let (mut z, mut d, mut q) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut p = vec![0.0_f32; n];
    let unit = StepCoefficients {
        direction: 0.0,
        residual: 1.0,
        update: 1.0,
    };
    // The tridiagonal matrix of Lanczos: diagonal, and squares beside it.
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    let (mut last, mut carried) = (0.0, 0.0);
    for step in 0..tuning::spectrum_steps() {
        first_step(b, inverse, &r, &mut d, &mut z, unit);
        let size = dot(&r, &z);
        if !(size > 0.0) {
            break;
        }
        let beta = if step == 0 { 0.0 } else { size / last };
        last = size;
        xpay(&z, beta, &mut p);
        product(&p, &mut q);
        let alpha = size / dot(&p, &q);
        if !(alpha > 0.0) {
            break;
        }
        axpy(-alpha, &q, &mut r);
        diagonal.push(1.0 / alpha + beta * carried);
        if step > 0 {
            beside.push(beta * carried * carried);
        }
        carried = 1.0 / alpha;
    }
    let largest = largest_eigenvalue(&diagonal, &beside);
    (largest > 0.0 && largest.is_finite()).then_some(tuning::spectrum_safety() * largest)
}

/// The largest eigenvalue of a symmetric tridiagonal matrix with `diagonal` and the squares
/// `beside` it, by bisection with Sturm sequences.
fn largest_eigenvalue(diagonal: &[f64], beside: &[f64]) -> f64 {
    let Some(&first) = diagonal.first() else {
        return 0.0;
    };
    let root = |k: Option<&f64>| k.map_or(0.0, |square| square.sqrt());
    // Gershgorin.
    let mut high = diagonal
        .iter()
        .enumerate()
        .map(|(k, d)| d + root(beside.get(k)) + root(k.checked_sub(1).and_then(|k| beside.get(k))))
        .fold(0.0, f64::max);
    let mut low = 0.0;
    // Enough for all the digits that a bound needs.
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let mut pivot = first - middle;
        let mut all_below = pivot < 0.0;
        for (d, square) in diagonal[1..].iter().zip(beside) {
            pivot = d - middle - square / pivot;
            all_below &= pivot < 0.0;
        }
        if all_below {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}
