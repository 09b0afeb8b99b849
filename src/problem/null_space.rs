//! Motions that cost no energy: the null space of a condensed stiffness.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::small::{dot_long, norm};

/// The shift of inverse iteration, relative to the diagonal of `K`: far above
/// rounding, far below what separates rigid from elastic motions.
const SHIFT: f64 = 1e-10;

/// The gap between the eigenvalues that are zero and the next.
const GAP: f64 = 30.0;

/// Orthonormal basis of the null space of a symmetric positive semidefinite `S`,
/// judged in the variables that `scale` makes of order one; at most `most`
/// directions are looked for. `rounding` says what rounding may make of the
/// energy of a motion, given in the caller's variables. `None` where `S` is
/// indefinite; [`Error::Interrupted`] when `stop` is raised.
///
/// Inverse iteration on a block of `most + 2` vectors, and Rayleigh–Ritz.
pub(super) fn null_space(
    schur: &[f64],
    scale: &[f64],
    rounding: &dyn Fn(&[f64]) -> f64,
    most: usize,
    stop: &AtomicBool,
) -> Result<Option<Vec<Vec<f64>>>, Error> {
    let m = scale.len();
    let scaled = |shift: f64| {
        let mut a = vec![0.0; m * m];
        for (j, (column, s)) in a
            .chunks_exact_mut(m.max(1))
            .zip(schur.chunks_exact(m.max(1)))
            .enumerate()
        {
            for (i, (value, s)) in column.iter_mut().zip(s).enumerate() {
                *value = s * scale[i] * scale[j];
            }
            column[j] += shift;
        }
        a
    };
    let mut factor;
    let mut shift = SHIFT;
    loop {
        factor = scaled(shift);
        if dense::cholesky(&mut factor, m, stop)?.is_none() {
            break;
        }
        if shift > 1e-4 {
            return Ok(None);
        }
        shift *= 100.0;
    }
    let width = (most + 2).min(m);
    let mut block: Vec<Vec<f64>> = (0..width)
        .map(|c| {
            (0..m)
                .map(|k| start_value(k * width + c + 1) - 1.0)
                .collect()
        })
        .collect();
    for _ in 0..6 {
        for column in &mut block {
            dense::solve_lower(&factor, m, column, 1);
            dense::solve_lower_transpose(&factor, m, column, 1);
        }
        orthonormalise(&mut block);
    }
    let plain = scaled(0.0);
    let image: Vec<Vec<f64>> = block
        .iter()
        .map(|x| {
            plain
                .chunks_exact(m.max(1))
                .map(|row| dot_long(row, x))
                .collect()
        })
        .collect();
    let mut projected = vec![0.0; width * width];
    for i in 0..width {
        for j in 0..width {
            projected[i * width + j] =
                0.5 * (dot_long(&block[i], &image[j]) + dot_long(&block[j], &image[i]));
        }
    }
    let mut values = vec![0.0; width];
    dense::symmetric_eigen(&mut projected, width, &mut values);
    let ritz = |k: usize| {
        let mut mode = vec![0.0; m];
        for (column, weight) in block.iter().zip(&projected[k * width..]) {
            for ((value, x), s) in mode.iter_mut().zip(column).zip(scale) {
                *value += weight * x * s;
            }
        }
        mode
    };
    // The largest group below its bounds that a gap sets apart from what follows.
    let mut modes: Vec<Vec<f64>> = Vec::new();
    let mut null = 0;
    for k in 0..width {
        let mode = ritz(k);
        let bound = rounding(&mode);
        if values[k] < -bound {
            return Ok(None);
        }
        if values[k] > bound {
            break;
        }
        modes.push(mode);
        let floor = values[k].abs().max(f64::EPSILON);
        if k + 1 == width || values[k + 1] > GAP * floor {
            null = k + 1;
        }
    }
    modes.truncate(null);
    orthonormalise(&mut modes);
    Ok(Some(modes))
}

/// A start for inverse iterations that no rigid motion is orthogonal to.
pub(super) fn start_value(k: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a fixed, uneven sequence")]
    let phase = k as f64 * 0.618_033_988_749_895;
    0.5 + phase.fract()
}

/// Gram–Schmidt, twice.
fn orthonormalise(block: &mut [Vec<f64>]) {
    for j in 0..block.len() {
        let (done, rest) = block.split_at_mut(j);
        let column = &mut rest[0];
        for _ in 0..2 {
            let length = norm(column);
            if length > 0.0 {
                for x in column.iter_mut() {
                    *x /= length;
                }
            }
            for q in done.iter() {
                let along = dot_long(q, column);
                for (value, a) in column.iter_mut().zip(q) {
                    *value -= along * a;
                }
            }
        }
        let length = norm(column);
        if length > 0.0 {
            for x in column.iter_mut() {
                *x /= length;
            }
        }
    }
}
