//! One further Newton correction, from a relative displacement that is better
//! than the products of a solver: what it moves is the forward error, and where
//! `W` has lost digits that the displacement has kept, it brings them back.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::small::norm;
use crate::problem::reduced::Reduced;
use crate::solver::linearisation::Linearisation;
use crate::solver::newton;

/// A step of an iterative solution leaves less than this of what it corrects.
const FORCING: f64 = 1e-4;

/// Corrections at the most.
const MOST: usize = 12;

/// Corrections below this change no status but that of a contact at a border.
const SETTLED: f64 = 1e-6;

/// A point with everything that belongs to it.
#[derive(Clone, Debug)]
pub struct Point<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
    /// `W r + R a + q`, as exact as it is to be had.
    pub v: Vec<[f64; D]>,
    /// `R̂ᵀ r̂ + ê`.
    pub imbalance: Vec<f64>,
}

/// A correction of a point.
#[derive(Clone, Debug)]
struct Correction<const D: usize> {
    r: Vec<[f64; D]>,
    rigid: Vec<f64>,
    /// What it moves, beside what it leads to: `‖dr‖ / ‖r‖` and `‖dv‖ / ‖v‖`.
    moved: (f64, f64),
}

/// The relative forward errors of `r` and of `v + before` at a point, `None`
/// where the correction is not determined. `before` is what a step is added to,
/// nothing for one that stands alone.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn forward_error<const D: usize>(
    problem: &Reduced<D>,
    point: &Point<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<(f64, f64)>, Error> {
    Ok(correction(problem, point, before, stop)?.map(|c| c.moved))
}

/// Corrects a point as long as that helps; `evaluate` makes a point of `(r, a)`.
///
/// # Errors
/// What `evaluate` returns, and [`Error::Interrupted`].
pub fn refine<const D: usize>(
    problem: &Reduced<D>,
    mut point: Point<D>,
    evaluate: impl Fn(Vec<[f64; D]>, Vec<f64>) -> Result<Point<D>, Error>,
    stop: &AtomicBool,
) -> Result<Point<D>, Error> {
    let mut last = f64::INFINITY;
    for _ in 0..MOST {
        let Some(next) = correction(problem, &point, &[], stop)? else {
            break;
        };
        let moved = next.moved.0.max(next.moved.1);
        // Below this, corrections that have stopped falling are rounding; above it
        // statuses may still change.
        if moved <= f64::EPSILON || (moved < SETTLED && moved > 0.5 * last) {
            break;
        }
        last = moved;
        point = evaluate(next.r, next.rigid)?;
    }
    Ok(point)
}

fn correction<const D: usize>(
    problem: &Reduced<D>,
    point: &Point<D>,
    before: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<Correction<D>>, Error> {
    let law = Linearisation::new(problem, &point.r, &point.v);
    let here = (
        point.r.as_slice(),
        point.v.as_slice(),
        point.rigid.as_slice(),
    );
    let imbalance = &point.imbalance;
    let solved = newton::solve(problem, &law, here, imbalance, FORCING, &mut |_| (), stop)?;
    let Some(next) = solved else {
        return Ok(None);
    };
    let change: Vec<[f64; D]> = next
        .r
        .iter()
        .zip(&point.r)
        .map(|(x, y)| std::array::from_fn(|k| x[k] - y[k]))
        .collect();
    let mut dv = vec![[0.0; D]; change.len()];
    problem.compliance.product(&change, &mut dv);
    let da: Vec<f64> = next
        .rigid
        .iter()
        .zip(&point.rigid)
        .map(|(x, y)| x - y)
        .collect();
    problem.add_rigid(&da, &mut dv);
    let mut corrected = point.v.clone();
    for addend in [dv.as_slice(), before] {
        for (value, x) in corrected
            .as_flattened_mut()
            .iter_mut()
            .zip(addend.as_flattened())
        {
            *value += x;
        }
    }
    let moved = (
        share(change.as_flattened(), next.r.as_flattened()),
        share(dv.as_flattened(), corrected.as_flattened()),
    );
    if !(moved.0.is_finite() && moved.1.is_finite()) {
        return Ok(None);
    }
    Ok(Some(Correction {
        r: next.r,
        rigid: next.rigid,
        moved,
    }))
}

/// `‖part‖ / ‖whole‖`, zero where nothing moves; scaled first, so that no unit
/// makes the squares overflow.
fn share(part: &[f64], whole: &[f64]) -> f64 {
    let size = |a: &[f64]| a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let unit = size(part).max(size(whole));
    if size(part) == 0.0 {
        return 0.0;
    }
    let scaled = |a: &[f64]| norm(&a.iter().map(|x| x / unit).collect::<Vec<_>>());
    scaled(part) / scaled(whole)
}
