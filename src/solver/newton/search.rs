//! The non-monotone line search (20). A step may be worse than the last point, but not worse than
//! the worst of the last few: a search that requires a decrease in each step stops early where
//! statuses alternate.

use crate::solver::tuning;

/// A share of a full step whose merit is small enough.
pub(crate) struct Accepted<P> {
    pub(crate) share: f64,
    pub(crate) merit: f64,
    pub(crate) point: P,
}

/// The first of the shares 1, ½, ¼, … that reduces the merit below the worst of the `recent`
/// ones, of which the last is that of the point. `try_share` gives the merit of a share, and the
/// point.
///
/// # Errors
/// The share with the least merit, if none of `trials` shares is accepted.
pub(crate) fn search<P>(
    recent: &[f64],
    trials: usize,
    try_share: impl Fn(f64) -> (f64, P),
) -> Result<Accepted<P>, f64> {
    let last = recent.iter().rev().take(tuning::newton_memory());
    let bar = last.fold(0.0_f64, |worst, &merit| worst.max(merit));
    let (mut share, mut best) = (1.0, (f64::INFINITY, 1.0));
    for _ in 0..trials {
        let (merit, point) = try_share(share);
        if merit <= (1.0 - 1e-4 * share) * bar {
            return Ok(Accepted {
                share,
                merit,
                point,
            });
        }
        if merit < best.0 {
            best = (merit, share);
        }
        share *= 0.5;
    }
    Err(best.1)
}
