//! The softest motions of a body, by inverse iteration: candidates for motions without energy.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::bodies::tuning;
use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{add_scaled, dot_long, norm, take_out};
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::linalg::sparse::symbolic::Symbolic;

/// A block of the softest motions, and its shift.
#[derive(Debug)]
pub(super) struct MotionBlock {
    pub columns: Vec<Vec<f64>>,
    pub shift: f64,
    /// `K` with its diagonal increased, if it was factored.
    pub raised: Option<Raised>,
}

/// `K` with its diagonal increased, factored.
#[derive(Debug)]
pub(super) struct Raised {
    factor: Factor,
    /// Lower Cholesky factor of its Schur complement.
    s: Vec<f64>,
    kept: Vec<usize>,
}

impl Raised {
    fn solve(&self, f: &mut [f64]) {
        self.factor.condense(f, 1);
        let mut contact: Vec<f64> = self.kept.iter().map(|&i| f[i]).collect();
        dense::solve_lower(&self.s, self.kept.len(), &mut contact, 1);
        dense::solve_lower_transpose(&self.s, self.kept.len(), &mut contact, 1);
        for (&i, value) in self.kept.iter().zip(&contact) {
            f[i] = *value;
        }
        self.factor.recover(f, 1);
    }

    /// `x − (K + σ D)⁻¹ K x` with `K x` in twice the precision: it keeps the part of `x`
    /// without energy to the last digit and removes the stiff part.
    pub(super) fn soften(&self, k: &OwnedMatrix, x: &mut [f64]) {
        for _ in 0..2 {
            let mut change = k.residual(x, &vec![0.0; x.len()]);
            self.solve(&mut change);
            add_scaled(x, 1.0, &change);
        }
    }
}

/// Scaling that makes the diagonal of K one.
#[derive(Debug)]
pub(super) struct DiagonalScaling {
    roots: Vec<f64>,
}

impl DiagonalScaling {
    pub(super) fn new(k: &OwnedMatrix) -> Self {
        let diagonal = k.view().diagonal();
        let root = |&x: &f64| if x > 0.0 { x.sqrt() } else { 1.0 };
        Self {
            roots: diagonal.iter().map(root).collect(),
        }
    }

    /// Gram–Schmidt, twice, in variables in which the diagonal of K is one; first against
    /// `removed`. Columns that vanish are dropped.
    pub(super) fn orthonormalise(&self, removed: &[Vec<f64>], block: &mut Vec<Vec<f64>>) {
        let mut done: Vec<Vec<f64>> = Vec::with_capacity(removed.len() + block.len());
        for column in removed.iter().chain(&*block) {
            let mut x: Vec<f64> = column.iter().zip(&self.roots).map(|(x, w)| x * w).collect();
            let mut lost = false;
            for _ in 0..2 {
                let length = norm(&x);
                if !(length > 0.0 && length.is_finite()) {
                    lost = true;
                    break;
                }
                scale(&mut x, length);
                for q in &done {
                    let _ = take_out(&mut x, q);
                }
                lost |= norm(&x) < 1e-12;
            }
            let length = norm(&x);
            if lost || !(length > 0.5) {
                continue;
            }
            scale(&mut x, length);
            done.push(x);
        }
        let first = done.len().min(removed.len());
        *block = done.split_off(first);
        for x in block {
            for (value, w) in x.iter_mut().zip(&self.roots) {
                *value /= w;
            }
        }
    }

    /// `D x`, D the diagonal of K.
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.roots).map(|(x, w)| x * w * w).collect()
    }
}

/// The softest motions of a body with a definite interior: inverse iteration on `S`, whose kept
/// unknowns are scaled to order one, with `x_i = −K_ii⁻¹ K_ic x_c`, corrected until the
/// interior rows are in balance. `None` if `S` is far from semidefinite.
pub(super) fn iterate_on_contact_set(
    (k, kept, factor): (&OwnedMatrix, &[usize], &Factor),
    schur: &[f64],
    scale: &[f64],
    width: usize,
    stop: &AtomicBool,
) -> Result<Option<MotionBlock>, Error> {
    let m = scale.len();
    let shifted = |shift: f64| {
        let mut a = vec![0.0; m * m];
        let columns = a.chunks_exact_mut(m.max(1));
        for (j, (column, s)) in columns.zip(schur.chunks_exact(m.max(1))).enumerate() {
            for (i, (value, s)) in column.iter_mut().zip(s).enumerate() {
                *value = s * scale[i] * scale[j];
            }
            column[j] += shift;
        }
        a
    };
    let factor_shifted = |shift| {
        let mut a = shifted(shift);
        let failed = dense::cholesky(&mut a, m, stop)?;
        Ok(failed.is_none().then_some(a))
    };
    let Some((factored, shift)) = find_shift(factor_shifted)? else {
        return Ok(None);
    };
    let mut block = starts(m, width.min(m));
    for _ in 0..tuning::inverse_rounds() {
        for column in &mut block {
            dense::solve_lower(&factored, m, column, 1);
            dense::solve_lower_transpose(&factored, m, column, 1);
        }
        orthonormalise_plain(&mut block);
    }
    let whole = |column: &Vec<f64>| {
        let mut x = vec![0.0; k.pointer.len() - 1];
        for ((&i, value), s) in kept.iter().zip(column).zip(scale) {
            x[i] = value * s;
        }
        factor.recover(&mut x, 1);
        for _ in 0..2 {
            let mut left = k.residual(&x, &vec![0.0; x.len()]);
            solve_interior(factor, kept, &mut left);
            add_scaled(&mut x, 1.0, &left);
        }
        x
    };
    Ok(Some(MotionBlock {
        columns: block.iter().map(whole).collect(),
        shift,
        raised: None,
    }))
}

/// The softest motions of a body whose interior may be singular: inverse iteration on the whole
/// K with its diagonal increased. `None` if this matrix is indefinite.
pub(super) fn iterate_on_all(
    (k, kept, symbolic): (&OwnedMatrix, &[usize], &Arc<Symbolic>),
    weights: &DiagonalScaling,
    width: usize,
    stop: &AtomicBool,
) -> Result<Option<MotionBlock>, Error> {
    let factor_raised = |shift| {
        let mut raised = k.clone();
        for j in 0..raised.pointer.len() - 1 {
            for at in raised.pointer[j]..raised.pointer[j + 1] {
                if raised.index[at] == j {
                    raised.values[at] *= 1.0 + shift;
                }
            }
        }
        match Factor::new(Arc::clone(symbolic), &raised.view(), stop) {
            Ok(mut factor) => {
                let mut s = factor.take_schur();
                let failed = dense::cholesky(&mut s, kept.len(), stop)?;
                Ok(failed.is_none().then_some((factor, s)))
            }
            Err(Error::Indefinite { .. } | Error::FloatingBody { .. }) => Ok(None),
            Err(other) => Err(other),
        }
    };
    let Some(((factor, s), shift)) = find_shift(factor_raised)? else {
        return Ok(None);
    };
    let raised = Raised {
        factor,
        s,
        kept: kept.to_vec(),
    };
    let n = k.pointer.len() - 1;
    let mut block = starts(n, width.min(n));
    for _ in 0..tuning::inverse_rounds() {
        for x in &mut block {
            let mut y = weights.times(x);
            raised.solve(&mut y);
            *x = y;
        }
        weights.orthonormalise(&[], &mut block);
    }
    Ok(Some(MotionBlock {
        columns: block,
        shift,
        raised: Some(raised),
    }))
}

/// The first of growing shifts with which `factor` gives a factorisation, and the latter; `None`
/// if none does.
fn find_shift<T>(
    factor: impl Fn(f64) -> Result<Option<T>, Error>,
) -> Result<Option<(T, f64)>, Error> {
    let mut shift = tuning::first_shift();
    loop {
        if let Some(factored) = factor(shift)? {
            return Ok(Some((factored, shift)));
        }
        shift *= tuning::shift_growth();
        if shift > tuning::largest_shift() {
            return Ok(None);
        }
    }
}

/// The energy of the softest motion of the interior alone that inverse iteration finds,
/// relative to that of the diagonal.
pub(super) fn measure_softest_interior(
    factor: &Factor,
    weights: &DiagonalScaling,
    kept: &[usize],
) -> f64 {
    let mut x: Vec<f64> = (0..weights.roots.len()).map(start_value).collect();
    let mut quotient = f64::INFINITY;
    for _ in 0..3 {
        for &i in kept {
            x[i] = 0.0;
        }
        let weighted = weights.times(&x);
        let mut y = weighted.clone();
        solve_interior(factor, kept, &mut y);
        // With K y = D x: yᵀ K y / yᵀ D y = yᵀ D x / yᵀ D y.
        let size = dot_long(&y, &weights.times(&y));
        if !size.is_finite() || size == 0.0 {
            return 0.0;
        }
        quotient = quotient.min(dot_long(&y, &weighted) / size);
        let length = size.sqrt();
        x = y.iter().map(|y| y / length).collect();
    }
    quotient
}

/// `K_ii⁻¹ f_i`, and zero at the kept unknowns.
fn solve_interior(factor: &Factor, kept: &[usize], f: &mut [f64]) {
    factor.condense(f, 1);
    for &i in kept {
        f[i] = 0.0;
    }
    factor.recover(f, 1);
}

/// A start for inverse iteration that is orthogonal to no rigid motion.
fn start_value(k: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a fixed, uneven sequence")]
    let phase = k as f64 * 0.618_033_988_749_895;
    0.5 + phase.fract()
}

/// Independent columns; a basis of the whole space if there are as many.
fn starts(n: usize, width: usize) -> Vec<Vec<f64>> {
    let column = |c: usize| -> Vec<f64> {
        let signs = random_signs(n, c as u64 + 1).into_iter().enumerate();
        signs
            .map(|(k, sign)| sign * start_value(k * width + c + 1))
            .collect()
    };
    (0..width).map(column).collect()
}

/// Gram–Schmidt, twice.
fn orthonormalise_plain(block: &mut [Vec<f64>]) {
    for j in 0..block.len() {
        let (done, rest) = block.split_at_mut(j);
        let column = &mut rest[0];
        for _ in 0..2 {
            normalise(column);
            for q in done.iter() {
                let _ = take_out(column, q);
            }
        }
        normalise(column);
    }
}

pub(super) fn scale(column: &mut [f64], length: f64) {
    for x in column {
        *x /= length;
    }
}

fn normalise(column: &mut [f64]) {
    let length = norm(column);
    if length > 0.0 {
        scale(column, length);
    }
}
