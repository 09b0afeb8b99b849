//! `S`, the stiffness of the contact set of a body, made definite and inverted.

use std::sync::atomic::AtomicBool;

use crate::bodies::definite::{are_pivots_safe, is_inverse_safe};
use crate::bodies::free_motions::{FreeMotions, Question};
use crate::condensation::ordered::OrderedBody;
use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::small::{add_scaled, dot_long};
use crate::linalg::sparse::multifrontal::Factor;

/// `S + α R Rᵀ` with the rigid motions `R` that the supports leave free.
#[derive(Debug)]
pub struct ContactStiffness {
    /// The lower Cholesky factor of `S`, column-major.
    pub(super) cholesky: Vec<f64>,
    /// The inverse of `S`, until it is taken.
    pub(super) inverse: Vec<f64>,
    pub(super) motions: FreeMotions,
    /// The condition number of `S` in the 1-norm.
    pub(super) condition: f64,
    /// Bound of the error of `W`, in ε: the condition number, or more if `S` is a small
    /// difference of large entries of `K`, as for flat elements at the contact, or if the
    /// interior rests on much softer parts.
    pub(super) amplification: f64,
}

impl ContactStiffness {
    /// `S` without rigid motions, if supports hold the body beyond doubt. `weakest_pivot` is
    /// that of the interior.
    pub(super) fn of_held_body(
        body: &OrderedBody,
        schur: &[f64],
        weakest_pivot: Option<(usize, f64)>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let m = body.kept.len();
        let scale = scale_to_one(body);
        let mut cholesky = schur.to_vec();
        let definite = dense::cholesky(&mut cholesky, m, stop)?.is_none();
        if !(definite && are_pivots_safe(&cholesky, &scale, &body.stiffness)) {
            return Ok(None);
        }
        let inverse = invert(&cholesky, m, stop)?;
        if !is_inverse_safe(&inverse, &scale) {
            return Ok(None);
        }
        let (size, motions) = (one_norm(schur, m), FreeMotions::default());
        let of = (cholesky, inverse);
        Ok(Some(Self::new(body, of, motions, size, weakest_pivot)))
    }

    /// `S` with the rigid motions that the supports leave free.
    pub(super) fn of_loose_body(
        body: &OrderedBody,
        schur: &[f64],
        factor: &Factor,
        question: &Question<'_>,
    ) -> Result<Self, Error> {
        let m = body.kept.len();
        let regularise = |motions: &FreeMotions| regularise(body, schur, &motions.kept);
        let (motions, mut s) =
            question.find_free_motions(&scale_to_one(body), factor, regularise)?;
        let size = one_norm(&s, m);
        if let Some(at) = dense::cholesky(&mut s, m, question.stop)? {
            let dof = body.dofs[body.kept[at]];
            return Err(Error::FewDigits { dof });
        }
        let inverse = invert(&s, m, question.stop)?;
        Ok(Self::new(
            body,
            (s, inverse),
            motions,
            size,
            factor.weakest_pivot(),
        ))
    }

    fn new(
        body: &OrderedBody,
        (cholesky, inverse): (Vec<f64>, Vec<f64>),
        motions: FreeMotions,
        size: f64,
        weakest_pivot: Option<(usize, f64)>,
    ) -> Self {
        let flexible = one_norm(&inverse, body.kept.len());
        let stiffest = body.kept_diagonal().fold(0.0, f64::max);
        let condition = size * flexible;
        // The softness of the interior relative to its diagonal.
        let inside = weakest_pivot.map_or(1.0, |(_, ratio)| ratio.recip());
        Self {
            cholesky,
            inverse,
            motions,
            condition,
            amplification: condition.max(stiffest * flexible).max(inside),
        }
    }
}

fn invert(cholesky: &[f64], m: usize, stop: &AtomicBool) -> Result<Vec<f64>, Error> {
    let mut inverse = cholesky.to_vec();
    dense::invert_from_cholesky(&mut inverse, m, stop)?;
    Ok(inverse)
}

/// Scaling that makes the diagonal of K one at the kept unknowns.
fn scale_to_one(body: &OrderedBody) -> Vec<f64> {
    let scale = |diagonal: f64| {
        if diagonal > 0.0 {
            diagonal.sqrt().recip()
        } else {
            1.0
        }
    };
    body.kept_diagonal().map(scale).collect()
}

/// `P S P + α R Rᵀ` with `P = 1 − R Rᵀ`, `α = tr S / m`: it removes the rounding of `S R`.
/// If all kept unknowns move rigidly, `S` is only rounding, and α is that of `K`.
fn regularise(body: &OrderedBody, schur: &[f64], modes: &[Vec<f64>]) -> Vec<f64> {
    let mut sum = schur.to_vec();
    let m = body.kept.len();
    if modes.is_empty() {
        return sum;
    }
    if modes.len() >= m {
        sum.fill(0.0);
    } else {
        project_out(&mut sum, schur, modes);
    }
    let trace: f64 = if modes.len() < m {
        (0..m).map(|i| sum[i * (m + 1)]).sum()
    } else {
        body.kept_diagonal().sum()
    };
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let alpha = trace / m as f64;
    let alpha = if alpha > 0.0 { alpha } else { 1.0 };
    for mode in modes {
        for (column, a) in sum.chunks_exact_mut(m).zip(mode) {
            for (value, b) in column.iter_mut().zip(mode) {
                *value += alpha * (a * b);
            }
        }
    }
    sum
}

/// `S − R (S R)ᵀ − (S R) Rᵀ + R (Rᵀ S R) Rᵀ`, bitwise symmetric.
fn project_out(sum: &mut [f64], schur: &[f64], modes: &[Vec<f64>]) {
    let m = modes[0].len();
    let times =
        |x: &Vec<f64>| -> Vec<f64> { schur.chunks_exact(m).map(|row| dot_long(row, x)).collect() };
    let mut images: Vec<Vec<f64>> = modes.iter().map(times).collect();
    let inner: Vec<Vec<f64>> = modes
        .iter()
        .map(|mode| images.iter().map(|image| dot_long(mode, image)).collect())
        .collect();
    for (a, image) in images.iter_mut().enumerate() {
        for (mode, amounts) in modes.iter().zip(&inner) {
            add_scaled(image, -0.5 * amounts[a], mode);
        }
    }
    for (mode, image) in modes.iter().zip(&images) {
        for (j, column) in sum.chunks_exact_mut(m).enumerate() {
            for (i, value) in column.iter_mut().enumerate() {
                let (low, high) = (i.min(j), i.max(j));
                *value -= mode[low] * image[high] + image[low] * mode[high];
            }
        }
    }
}

fn one_norm(a: &[f64], m: usize) -> f64 {
    a.chunks_exact(m.max(1))
        .map(|c| c.iter().map(|x| x.abs()).sum())
        .fold(0.0, f64::max)
}
