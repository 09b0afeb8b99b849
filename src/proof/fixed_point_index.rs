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
use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::linalg::lu::Lu;
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{Block, Vector, norm, tangential_norm};
use crate::reduced::reduced::Reduced;

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
        let Some(next) = newton_step(problem, nodes.clone(), &r, &v, stop)? else {
            return Ok(None);
        };
        let next_v = problem.relative_displacement(&next.r, &[]);
        let apart = |x: &[[f64; D]], y: &[[f64; D]], scale: &[f64]| {
            let of_node = |i: usize| {
                let of_component = move |k: usize| (x[i][k] - y[i][k]).abs() * scale[i];
                (0..D).map(of_component).fold(0.0, f64::max)
            };
            nodes.clone().map(of_node).fold(0.0, f64::max)
        };
        let change = apart(&next.r, &r, &scaling.to_r).max(apart(&next_v, &v, &scaling.to_v));
        if change <= 0.1 * margin {
            return Ok(Some(next.sign));
        }
        (r, v) = (next.r, next_v);
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
    let scaling = &problem.scaling;
    let x = |i: usize| -> [f64; D] {
        std::array::from_fn(|k| r[i][k] * scaling.to_r[i] - v[i][k] * scaling.to_v[i])
    };
    let size = nodes
        .clone()
        .flat_map(x)
        .fold(0.0_f64, |m, c| m.max(c.abs()));
    let margin = BORDER * size;
    let clear = |i: usize| {
        let (x, mu) = (x(i), problem.law[i].mu);
        let from_limit = (tangential_norm(&x) - mu * x[0]).abs() / mu.hypot(1.0);
        x[0].abs() > margin && (x[0] < 0.0 || mu == 0.0 || from_limit > margin)
    };
    nodes.clone().all(clear).then_some(margin)
}

/// The next point of Newton's method for (19).
struct Corrected<const D: usize> {
    r: Vec<[f64; D]>,
    /// Sign of the determinant of its system.
    sign: f64,
}

/// `None` if the system is nearly singular.
fn newton_step<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Option<Corrected<D>>, Error> {
    let scaling = &problem.scaling;
    let scaled = |i: usize| {
        let r = r[i].map(|c| c * scaling.to_r[i]);
        let v = v[i].map(|c| c * scaling.to_v[i]);
        (i, r, linearised(&r, &v, problem.law[i].mu))
    };
    let closed: Vec<_> = nodes
        .clone()
        .map(scaled)
        .filter(|(.., row)| row.status != Status::Open)
        .collect();
    let n = D * closed.len();
    let mut matrix = vec![0.0; n * n];
    let mut right = vec![0.0; n];
    for (k, (i, r, row)) in closed.iter().enumerate() {
        for (l, (j, ..)) in closed.iter().enumerate() {
            let w = problem.compliance.pair(*i, *j);
            let mut block: Block<D> = row.by_v * w * (scaling.to_v[*i] / scaling.to_r[*j]);
            if k == l {
                block += row.by_r;
            }
            for a in 0..D {
                for b in 0..D {
                    matrix[(D * k + a) * n + D * l + b] = block[(a, b)];
                }
            }
        }
        // value + by_r (r' − r) + by_v (W r' + q − v) = 0.
        let free = Vector::from(problem.q[*i].map(|c| c * scaling.to_v[*i]));
        let v = Vector::from(v[*i].map(|c| c * scaling.to_v[*i]));
        let known = row.by_r * Vector::from(*r) + row.by_v * (v - free) - row.value;
        right[D * k..D * (k + 1)].copy_from_slice(known.as_slice());
    }
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
    lu.solve(&mut right);
    let mut next = r.to_vec();
    next[nodes].fill([0.0; D]);
    for ((i, ..), value) in closed.iter().zip(right.as_chunks::<D>().0) {
        next[*i] = value.map(|c| c / scaling.to_r[*i]);
    }
    Ok(Some(Corrected {
        r: next,
        sign: lu.sign(),
    }))
}
