//! When a factor of `K` shows that a body is held, part 3 of the theorem.

use crate::linalg::small::norm;
use crate::linalg::sparse::rows::OwnedMatrix;

/// A motion whose energy is above this share of the diagonal of `K` is held beyond doubt, a
/// million times the rounding of a pivot; the
/// softest motions are examined otherwise. With a soft contact set and a stiff interior, the
/// rounding of the interior may exceed it.
const SAFE: f64 = 1e-9;

/// Share of the diagonal of `K` above which a pivot of the interior, whose inverse is not
/// available, leaves no doubt: elimination of a
/// singular matrix without a smaller pivot would have increased its entries as much.
const SAFE_INSIDE: f64 = 1e-6;

/// Whether the weakest pivot of an interior, if it has one, leaves no doubt.
pub fn is_interior_safe(weakest_pivot: Option<(usize, f64)>) -> bool {
    weakest_pivot.is_none_or(|(_, ratio)| ratio >= SAFE_INSIDE)
}

/// Whether the pivots of `S`, scaled to a unit diagonal of `K`, are above all rounding: that of
/// independent errors of the entries of `K` for a unit motion of the body. A sum of absolute
/// values would reject large bodies.
pub fn are_pivots_safe(cholesky: &[f64], scale: &[f64], k: &OwnedMatrix) -> bool {
    let rounding = 8.0 * f64::EPSILON * norm(&k.values);
    let pivots = cholesky.iter().step_by(scale.len() + 1).zip(scale);
    pivots.into_iter().all(|(pivot, scale)| {
        let doubt = SAFE.max(rounding * scale * scale);
        (pivot * scale).powi(2) > doubt
    })
}

/// Whether no motion is soft: the trace of an inverse bounds the softness of each motion;
/// pivots do not.
pub fn is_inverse_safe(inverse: &[f64], scale: &[f64]) -> bool {
    let diagonal = inverse.iter().step_by(scale.len() + 1).zip(scale);
    let softness: f64 = diagonal.map(|(value, scale)| value / (scale * scale)).sum();
    softness < 1.0 / SAFE
}
