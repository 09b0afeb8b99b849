//! An upper bound of `L = √(αβ)` of section 10. If `L < 1`, alternating principles contract,
//! and the missing energy `B` of a point bounds its error.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::small::norm;
use crate::linalg::verified_cholesky::{self, gamma};
use crate::proof::monotonicity::Monotonicity;
use crate::proof::tuning;
use crate::proof::weights::Common;

/// A proved upper bound of `L`, if it is below 1 and `W` is symmetric, without errors of its entries.
///
/// `c ≥ α = λ_max(M½ W_tt M½)` if `c 1 − M½ W_tt M½` has a Cholesky factor, and then `L ≤ ℓ`
/// if `W − (c/ℓ²) P_nᵀ M P_n` has one.
pub fn contraction<const D: usize>(
    monotonicity: &Monotonicity<D>,
    common: &Common,
    stop: &AtomicBool,
) -> Result<Option<f64>, Error> {
    if !monotonicity.symmetric || monotonicity.entry_rounding > 0.0 {
        return Ok(None);
    }
    let n = monotonicity.order();
    let (half, _) = monotonicity.symmetric_part(&monotonicity.all());
    let friction = |unknown: usize| {
        let (contact, k) = monotonicity.contact(unknown);
        let (mu, shape) = (monotonicity.mu[contact], common.shape[contact]);
        if k == 0 { mu / shape } else { mu * shape }
    };
    let tangents: Vec<usize> = (0..n).filter(|&i| monotonicity.contact(i).1 > 0).collect();
    if tangents.is_empty() {
        return Ok(Some(0.0)); // without friction nothing couples the two principles
    }
    let m = tangents.len();
    let mut rough = Vec::with_capacity(m * m);
    for &j in &tangents {
        let entry = |&i: &usize| (friction(i) * friction(j)).sqrt() * half[j * n + i];
        rough.extend(tangents.iter().map(entry));
    }
    let of_rough = 8.0 * f64::EPSILON * norm(&rough);
    let mut alpha = None;
    for above in tuning::CONTRACTION_MARGINS {
        let c = above * common.alpha;
        let mut rest: Vec<f64> = rough.iter().map(|x| -x).collect();
        for i in 0..m {
            rest[i * (m + 1)] += c;
        }
        let error = of_rough + 2.0 * f64::EPSILON * c;
        if verified_cholesky::is_definite(rest, m, error, stop)? {
            alpha = Some(c);
            break;
        }
    }
    let Some(alpha) = alpha else { return Ok(None) };
    for above in tuning::CONTRACTION_MARGINS {
        let least = above * (alpha * common.beta).sqrt();
        if !(least < 1.0) {
            break;
        }
        let share = alpha / (least * least);
        let mut rest = half.clone();
        let mut largest = 0.0_f64;
        for i in (0..n).filter(|&i| monotonicity.contact(i).1 == 0) {
            let loss = share * friction(i);
            rest[i * (n + 1)] -= loss;
            largest = largest.max(loss);
        }
        let error = gamma(0) * (largest + norm(&half));
        if verified_cholesky::is_definite(rest, n, error, stop)? {
            return Ok(Some(least * (1.0 + gamma(0))));
        }
    }
    Ok(None)
}
