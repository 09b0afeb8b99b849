//! Newton corrections with a relative displacement that is more accurate than the products of a
//! solver. Their size is the forward error. If `W` has lost digits that the displacement keeps,
//! they restore these digits.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::small::{add_scaled, amax, norm, plus_scaled, rows_plus_scaled};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::scaled_imbalance;
use crate::solver::anderson::Anderson;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::newton::compliance_form::Solved;
use crate::solver::newton::linearisation::Linearisation;
use crate::solver::newton::newton;
use crate::solver::tuning;

/// A point, its `v` as accurate as possible, and its `R̂ᵀ r̂ + ê`.
#[derive(Clone, Debug)]
pub struct RefinedPoint<const D: usize> {
    pub at: EvaluatedPoint<D>,
    pub imbalance: Vec<f64>,
}

impl<const D: usize> RefinedPoint<D> {
    pub fn new(problem: &Reduced<D>, at: EvaluatedPoint<D>) -> Self {
        let imbalance = scaled_imbalance(problem, &at.r);
        Self { at, imbalance }
    }
}

#[derive(Clone, Debug)]
struct RefinementStep<const D: usize> {
    /// The point after the correction.
    to: EvaluatedPoint<D>,
    /// The relative size of the correction: `‖dr‖ / ‖r‖` and `‖dv‖ / ‖v‖`.
    moved: (f64, f64),
}

/// The relative forward errors of `r` and of `v + before` at a point; `None` if the correction
/// is not determined. `before` is the total of the earlier steps, empty for a single problem.
pub fn forward_error<const D: usize>(
    problem: &Reduced<D>,
    point: &RefinedPoint<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<(f64, f64)>, Error> {
    let Some(next) = correction(problem, point, before, stop)? else {
        return Ok(None);
    };
    let change = rows_plus_scaled(&next.to.v, -1.0, &point.at.v);
    let (of_r, of_v) = next.moved;
    let of_v = without_cancellation(problem, &point.at, &change, of_v);
    Ok(Some((of_r, of_v)))
}

/// The relative size of a change of `v`. Where the change is not smaller than `v`, loads and
/// reactions cancel: it is then relative to what each of them would cause alone.
fn without_cancellation<const D: usize>(
    problem: &Reduced<D>,
    point: &EvaluatedPoint<D>,
    change: &[[f64; D]],
    relative: f64,
) -> f64 {
    if relative < 1.0 {
        return relative;
    }
    let mut caused = vec![[0.0; D]; change.len()];
    problem.compliance.product(&point.r, &mut caused);
    let by_loads = share(change.as_flattened(), problem.q.as_flattened());
    share(change.as_flattened(), caused.as_flattened()).min(by_loads)
}

/// The largest relative changes of `r` and of `v + before` by the changes `wanders` of `v` and of
/// `ê`: how far each changes the reactions, and with these the relative displacements, to first
/// order.
pub fn forward_change<const D: usize>(
    problem: &Reduced<D>,
    point: &RefinedPoint<D>,
    wanders: &[(Vec<[f64; D]>, Vec<f64>)],
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<(f64, f64)>, Error> {
    let Some(here) = correction(problem, point, before, stop)? else {
        return Ok(None);
    };
    let total = rows_plus_scaled(&point.at.v, 1.0, before);
    let mut largest = (0.0_f64, 0.0_f64);
    for (of_v, of_e) in wanders {
        let mut moved = point.clone();
        add_scaled(moved.at.v.as_flattened_mut(), 1.0, of_v.as_flattened());
        add_scaled(&mut moved.imbalance, 1.0, of_e);
        // Of the point itself: the change may close a contact before rigid motions follow it.
        let mut law = Linearisation::new(problem, &point.at.r, &point.at.v);
        law.move_by(problem, of_v);
        let Some(there) = solve(problem, &moved, &law, before, stop)? else {
            return Ok(None);
        };
        let part = |there: &[[f64; D]], here: &[[f64; D]], whole: &[[f64; D]]| {
            let change = rows_plus_scaled(there, -1.0, here);
            (share(change.as_flattened(), whole.as_flattened()), change)
        };
        let (of_r, _) = part(&there.to.r, &here.to.r, &point.at.r);
        let (of_v, change) = part(&there.to.v, &here.to.v, &total);
        let of_v = without_cancellation(problem, &point.at, &change, of_v);
        if !(of_r.is_finite() && of_v.is_finite()) {
            return Ok(None);
        }
        largest = (largest.0.max(of_r), largest.1.max(of_v));
    }
    Ok(Some(largest))
}

/// Corrects a point while this improves it; `evaluate` makes a point from `(r, a)`.
pub fn refine<const D: usize>(
    problem: &Reduced<D>,
    mut point: RefinedPoint<D>,
    evaluate: impl Fn(Vec<[f64; D]>, Vec<f64>) -> Result<RefinedPoint<D>, Error>,
    stop: &AtomicBool,
) -> Result<RefinedPoint<D>, Error> {
    let mut best: Option<(f64, RefinedPoint<D>)> = None;
    let (mut idle, mut anderson) = (0, Anderson::default());
    for _ in 0..tuning::most_corrections() {
        let Some(next) = correction(problem, &point, &[], stop)? else {
            break;
        };
        let moved = next.moved.0.max(next.moved.1);
        let EvaluatedPoint {
            mut r, mut rigid, ..
        } = next.to;
        if moved >= tuning::settled_correction() {
            // Statuses may still change.
            anderson.restart();
            (best, idle) = (None, 0);
        } else {
            idle += 1;
            if best.as_ref().is_none_or(|(least, _)| moved < 0.5 * least) {
                best = Some((moved, point.clone()));
                idle = 0;
            }
            if moved <= f64::EPSILON || idle == tuning::idle_corrections() {
                break;
            }
            // The problem is linear now. Rounding of W may exceed its energy of the softest
            // motions of the contacts.
            let change = rows_plus_scaled(&r, -1.0, &point.at.r);
            let payload = [r.as_flattened(), &rigid].concat();
            if let Some(there) = anderson.extrapolate(change.into_flattened(), payload) {
                let (forces, amounts) = there.split_at(D * r.len());
                r = forces.as_chunks::<D>().0.to_vec();
                rigid = amounts.to_vec();
            }
        }
        point = evaluate(r, rigid)?;
    }
    Ok(best.map_or(point, |(_, best)| best))
}

fn correction<const D: usize>(
    problem: &Reduced<D>,
    point: &RefinedPoint<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<RefinementStep<D>>, Error> {
    let law = Linearisation::new(problem, &point.at.r, &point.at.v);
    solve(problem, point, &law, before, stop)
}

fn solve<const D: usize>(
    problem: &Reduced<D>,
    point: &RefinedPoint<D>,
    law: &Linearisation<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<RefinementStep<D>>, Error> {
    let here = (&point.at, point.imbalance.as_slice());
    let forcing = tuning::correction_forcing;
    let solved = newton::solve(problem, law, here, &forcing, &mut |_| (), stop)?;
    let Some(Solved { r, rigid }) = solved else {
        return Ok(None);
    };
    let change = rows_plus_scaled(&r, -1.0, &point.at.r);
    let mut dv = vec![[0.0; D]; change.len()];
    problem.compliance.product(&change, &mut dv);
    problem.add_rigid(&plus_scaled(&rigid, -1.0, &point.at.rigid), &mut dv);
    let v = rows_plus_scaled(&point.at.v, 1.0, &dv);
    let corrected = rows_plus_scaled(&v, 1.0, before);
    let moved = (
        share(change.as_flattened(), r.as_flattened()),
        share(dv.as_flattened(), corrected.as_flattened()),
    );
    let to = EvaluatedPoint { r, v, rigid };
    let finite = moved.0.is_finite() && moved.1.is_finite();
    Ok(finite.then_some(RefinementStep { to, moved }))
}

/// `‖part‖ / ‖whole‖`, zero if both are zero. Scaled first, so that squares do not overflow in
/// any unit.
fn share(part: &[f64], whole: &[f64]) -> f64 {
    let unit = amax(part).max(amax(whole));
    if amax(part) == 0.0 {
        return 0.0;
    }
    let scaled = |a: &[f64]| norm(&a.iter().map(|x| x / unit).collect::<Vec<_>>());
    scaled(part) / scaled(whole)
}
