//! The index of a solution. Its sign may prove that there are other solutions.
//!
//! For `W` positive definite the map (19) has degree +1: as μ decreases to zero its zeros stay
//! bounded, and at μ = 0 there is one, of index +1. If a solution with a regular derivative of
//! (19) is unique, the sign of the determinant is the degree. So a solution of index −1 is not
//! unique.

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::alart_curnier::linearised;
use crate::law::contact_law::ContactLaw;
use crate::linalg::lu::Lu;
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{amax, minus_scaled, norm, tangential_norm};
use crate::reduced::reduced::Reduced;
use crate::solver::newton::compliance_form::ComplianceForm;

/// A solution is at a boundary between two statuses if its distance, relative to the largest
/// `r̂ − v̂`, is smaller.
const BORDER: f64 = 1e-8;

/// Newton corrections that a solution may need for this accuracy.
const CORRECTIONS: usize = 3;

/// With a larger condition number, rounding might change the sign of a determinant.
const WORST_CONDITION: f64 = 1e10;

/// The index of a solution, `det(B + A W)/|det(B + A W)|`, with `B`, `A` the derivatives of
/// (19) by `r` and by `v`; open contacts give 1. `None` at a boundary between statuses, where
/// (19) has no derivative, if rounding might change the sign, and for laws other than Coulomb's.
pub fn index<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<f64>, Error> {
    let scaling = &problem.scaling;
    if !problem.law[nodes.clone()]
        .iter()
        .all(ContactLaw::is_coulomb)
    {
        return Ok(None);
    }
    let (mut r, mut v) = (r.to_vec(), v.to_vec());
    for _ in 0..CORRECTIONS {
        let Some(margin) = margin(problem, nodes.clone(), &r, &v) else {
            return Ok(None);
        };
        let Some((next, sign)) = newton_step(problem, nodes.clone(), &r, &v, stop)? else {
            return Ok(None);
        };
        let next_v = problem.relative_displacement(&next, &[]);
        let apart = |x: &[[f64; D]], y: &[[f64; D]], scale: &[f64]| {
            let of_node = |i: usize| {
                let of_component = move |k: usize| (x[i][k] - y[i][k]).abs() * scale[i];
                (0..D).map(of_component).fold(0.0, f64::max)
            };
            nodes.clone().map(of_node).fold(0.0, f64::max)
        };
        let change = apart(&next, &r, &scaling.to_r).max(apart(&next_v, &v, &scaling.to_v));
        if change <= 0.1 * margin {
            return Ok(Some(sign));
        }
        (r, v) = (next, next_v);
    }
    Ok(None)
}

/// The least distance of a solution from all boundaries; `None` if it is on one.
fn margin<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Option<f64> {
    let x = |i: usize| {
        let (r, v) = problem.scaling.scale(i, &r[i], &v[i]);
        minus_scaled(&r, 1.0, &v)
    };
    let size = amax(&nodes.clone().flat_map(x).collect::<Vec<_>>());
    let margin = BORDER * size;
    let clear = |i: usize| {
        let (x, mu) = (x(i), problem.law[i].mu);
        let from_limit = (tangential_norm(&x) - mu * x[0]).abs() / mu.hypot(1.0);
        x[0].abs() > margin && (x[0] < 0.0 || mu == 0.0 || from_limit > margin)
    };
    nodes.clone().all(clear).then_some(margin)
}

/// A next point, and the sign of the determinant of its system.
type Corrected<const D: usize> = (Vec<[f64; D]>, f64);

/// The next point of Newton's method for (19); `None` if its system is nearly singular.
fn newton_step<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<Corrected<D>>, Error> {
    let of_contact = |i: usize| {
        let (r, v) = problem.scaling.scale(i, &r[i], &v[i]);
        (i, linearised(&r, &v, problem.law[i].mu))
    };
    let laws: Vec<_> = nodes.map(of_contact).collect();
    let form = ComplianceForm::of_contacts(problem, laws.iter().map(|(i, at)| (*i, at)), 0.0);
    let n = form.order();
    let matrix = form.matrix();
    let size = norm(&matrix);
    let Some(lu) = Lu::new(matrix, n, stop)? else {
        return Ok(None);
    };
    // For random signs z, E ‖A⁻¹ z‖² is the square of Frobenius' norm of A⁻¹.
    for seed in 1..=3 {
        let mut z = random_signs(n, seed);
        lu.solve(&mut z);
        if !(size * norm(&z) <= WORST_CONDITION) {
            return Ok(None);
        }
    }
    let mut x = form.right(r, &[], &mut |_| ());
    lu.solve(&mut x);
    Ok(Some((form.moved(r, &[], &x).r, lu.sign())))
}
