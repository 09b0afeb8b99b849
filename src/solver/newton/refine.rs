//! Newton corrections with a relative displacement that is more accurate than the products of a
//! solver. Their size is the forward error. If `W` has lost digits that the displacement keeps,
//! they restore these digits.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::small::{amax, norm};
use crate::reduced::reduced::Reduced;
use crate::solver::anderson::Anderson;
use crate::solver::newton::linearisation::Linearisation;
use crate::solver::newton::newton;
use crate::solver::tuning;

/// A point with all quantities that depend on it.
#[derive(Clone, Debug)]
pub struct RefinedPoint<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
    /// `W r + R a + q`, as accurate as possible.
    pub v: Vec<[f64; D]>,
    /// `R̂ᵀ r̂ + ê`.
    pub imbalance: Vec<f64>,
}

/// A correction of a point.
#[derive(Clone, Debug)]
struct RefinementStep<const D: usize> {
    r: Vec<[f64; D]>,
    rigid: Vec<f64>,
    /// `v` after the correction.
    v: Vec<[f64; D]>,
    /// Its relative size: `‖dr‖ / ‖r‖` and `‖dv‖ / ‖v‖`.
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
    let change: Vec<[f64; D]> = next.v.iter().zip(&point.v).map(minus).collect();
    let (of_r, of_v) = next.moved;
    Ok(Some((
        of_r,
        without_cancellation(problem, point, &change, of_v),
    )))
}

/// The relative size of a change of `v`. Where the change is not smaller than `v`, loads and
/// reactions cancel: it is then relative to what each of them would cause alone.
fn without_cancellation<const D: usize>(
    problem: &Reduced<D>,
    point: &RefinedPoint<D>,
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

/// The same for changes `wanders` of `v` and of `ê`: how far each changes the reactions, and with
/// these the relative displacements, to first order; the largest.
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
    let total: Vec<[f64; D]> = if before.is_empty() {
        point.v.clone()
    } else {
        let sum = |(v, b): (&[f64; D], &[f64; D])| std::array::from_fn(|k| v[k] + b[k]);
        point.v.iter().zip(before).map(sum).collect()
    };
    let mut largest = (0.0_f64, 0.0_f64);
    for (of_v, of_e) in wanders {
        let mut moved = point.clone();
        let values = moved.v.as_flattened_mut().iter_mut();
        for (v, change) in values.zip(of_v.as_flattened()) {
            *v += change;
        }
        for (imbalance, change) in moved.imbalance.iter_mut().zip(of_e) {
            *imbalance += change;
        }
        // Of the point itself: the change may close a contact before rigid motions follow it.
        let mut law = Linearisation::new(problem, &point.r, &point.v);
        law.move_by(problem, of_v);
        let Some(there) = solve(problem, &moved, &law, before, stop)? else {
            return Ok(None);
        };
        let part = |there: &[[f64; D]], here: &[[f64; D]], whole: &[[f64; D]]| {
            let change: Vec<[f64; D]> = there.iter().zip(here).map(minus).collect();
            (share(change.as_flattened(), whole.as_flattened()), change)
        };
        let (of_r, _) = part(&there.r, &here.r, &point.r);
        let (of_v, change) = part(&there.v, &here.v, &total);
        let of_v = without_cancellation(problem, point, &change, of_v);
        if !(of_r.is_finite() && of_v.is_finite()) {
            return Ok(None);
        }
        largest = (largest.0.max(of_r), largest.1.max(of_v));
    }
    Ok(Some(largest))
}

fn minus<const D: usize>((a, b): (&[f64; D], &[f64; D])) -> [f64; D] {
    std::array::from_fn(|k| a[k] - b[k])
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
        let (mut r, mut rigid) = (next.r, next.rigid);
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
            let change = r.iter().zip(&point.r).flat_map(minus).collect();
            let payload = [r.as_flattened(), &rigid].concat();
            if let Some(there) = anderson.extrapolate(change, payload) {
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
    let law = Linearisation::new(problem, &point.r, &point.v);
    solve(problem, point, &law, before, stop)
}

fn solve<const D: usize>(
    problem: &Reduced<D>,
    point: &RefinedPoint<D>,
    law: &Linearisation<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<RefinementStep<D>>, Error> {
    let here = (
        point.r.as_slice(),
        point.v.as_slice(),
        point.rigid.as_slice(),
    );
    let imbalance = &point.imbalance;
    let solved = newton::solve(
        problem,
        law,
        here,
        imbalance,
        &tuning::correction_forcing,
        &mut |_| (),
        stop,
    )?;
    let Some(next) = solved else {
        return Ok(None);
    };
    let change: Vec<[f64; D]> = next.r.iter().zip(&point.r).map(minus).collect();
    let mut dv = vec![[0.0; D]; change.len()];
    problem.compliance.product(&change, &mut dv);
    let da: Vec<f64> = next
        .rigid
        .iter()
        .zip(&point.rigid)
        .map(|(x, y)| x - y)
        .collect();
    problem.add_rigid(&da, &mut dv);
    let mut v = point.v.clone();
    for (value, x) in v.as_flattened_mut().iter_mut().zip(dv.as_flattened()) {
        *value += x;
    }
    let mut corrected = v.clone();
    let all = corrected.as_flattened_mut().iter_mut();
    for (value, x) in all.zip(before.as_flattened()) {
        *value += x;
    }
    let moved = (
        share(change.as_flattened(), next.r.as_flattened()),
        share(dv.as_flattened(), corrected.as_flattened()),
    );
    if !(moved.0.is_finite() && moved.1.is_finite()) {
        return Ok(None);
    }
    Ok(Some(RefinementStep {
        r: next.r,
        rigid: next.rigid,
        v,
        moved,
    }))
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
