//! The certificate that every solver is judged by, (11) and (13), and what is
//! reported beside it.
//!
//! `F(r) = r̂ − proj(r̂ − ṽ̂, K_μ)` in scaled variables, where ρ = 1, and
//! `η = ‖F(r)‖ / max(‖r̂‖, ‖F(0)‖)`, zero when both are. With bodies held by
//! contact alone, the larger of that and `‖R̂ᵀ r̂ + ê‖ / ‖ê‖`.

use crate::law::bipotential;
use crate::law::cone::Status;
use crate::linalg::least_squares;
use crate::linalg::small::{norm, tangential_norm};
use crate::problem::reduced::Reduced;

/// A rounding floor above this is not convergence.
pub const WORST_FLOOR: f64 = 1e-6;

/// What a fresh evaluation says of a point `(r, a)`.
#[derive(Clone, Debug)]
pub struct Certificate<const D: usize> {
    /// `v = W r + R a + q`.
    pub v: Vec<[f64; D]>,
    /// Status of `proj(r̂ − ṽ̂)` at each contact.
    pub status: Vec<Status>,
    /// η.
    pub residual: f64,
    /// What rounding alone may leave of η.
    pub floor: f64,
}

impl<const D: usize> Certificate<D> {
    /// Evaluates `v` afresh, and judges.
    #[must_use]
    pub fn new(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> Self {
        let v = problem.relative_displacement(r, a);
        let mut status = vec![Status::Open; r.len()];
        let residual = judge(problem, r, &v, a, |i, s| status[i] = s);
        let floor = rounding_floor(problem, r, a);
        Self {
            v,
            status,
            residual,
            floor,
        }
    }

    /// What η is held to for a wish of `tol`.
    #[must_use]
    pub fn tolerance(&self, tol: f64) -> f64 {
        if self.floor <= WORST_FLOOR {
            tol.max(self.floor)
        } else {
            tol
        }
    }

    /// Whether this point is an answer.
    #[must_use]
    pub fn converged(&self, tol: f64) -> bool {
        self.floor <= WORST_FLOOR && self.residual <= self.tolerance(tol)
    }
}

/// η of a point whose `v` is at hand.
#[must_use]
pub fn residual<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    a: &[f64],
) -> f64 {
    judge(problem, r, v, a, |_, _| ())
}

fn judge<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    a: &[f64],
    mut report: impl FnMut(usize, Status),
) -> f64 {
    let scaling = &problem.scaling;
    let mut squares = 0.0;
    for (i, (r, v)) in r.iter().zip(v).enumerate() {
        let r = r.map(|c| c * scaling.to_r[i]);
        let v = v.map(|c| c * scaling.to_v[i]);
        let (projected, status) = bipotential::law_step(&r, &v, 1.0, problem.mu[i]);
        report(i, status);
        squares += r
            .iter()
            .zip(&projected)
            .map(|(x, p)| (x - p).powi(2))
            .sum::<f64>();
    }
    let law = ratio(squares.sqrt(), size(problem, r, a));
    if problem.rigid.modes.is_empty() {
        return law;
    }
    law.max(ratio(
        norm(&scaled_imbalance(problem, r)),
        force_size(problem, r),
    ))
}

/// `max(‖r̂‖, ‖F(0)‖)`.
fn size<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> f64 {
    let mut free = vec![[0.0; D]; r.len()];
    problem.add_rest(a, &mut free);
    let at_zero = free.iter().enumerate().map(|(i, v)| {
        let v = v.map(|c| c * problem.scaling.to_v[i]);
        let (projected, _) = bipotential::law_step(&[0.0; D], &v, 1.0, problem.mu[i]);
        projected.iter().map(|c| c * c).sum::<f64>()
    });
    at_zero
        .sum::<f64>()
        .sqrt()
        .max(problem.scaling.reaction_norm(r))
}

/// `‖ê‖`, or `‖r̂‖` where no load acts on the rigid motions.
fn force_size<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> f64 {
    let load = norm(&problem.scaling.load);
    if load > 0.0 {
        load
    } else {
        problem.scaling.reaction_norm(r)
    }
}

/// `R̂ᵀ r̂ + ê`.
#[must_use]
pub fn scaled_imbalance<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<f64> {
    let scaling = &problem.scaling;
    let of_mode = |(mode, load): (&Vec<[f64; D]>, &f64)| {
        let work = mode.iter().zip(r).zip(&scaling.to_r);
        work.map(|((m, x), s)| (0..D).map(|k| m[k] * x[k]).sum::<f64>() * s)
            .sum::<f64>()
            + load
    };
    scaling
        .modes
        .iter()
        .zip(&scaling.load)
        .map(of_mode)
        .collect()
}

/// The rigid motion `a` of least squares for a reaction: contacts that press do
/// not open, and those inside their cone do not slip.
#[must_use]
pub fn best_motion<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<f64> {
    let modes = &problem.scaling.modes;
    let mut free = vec![[0.0; D]; r.len()];
    problem.compliance.product(r, &mut free);
    problem.add_rest(&[], &mut free);
    let held = |i: usize| {
        let inside = tangential_norm(&r[i]) < problem.mu[i] * r[i][0];
        if r[i][0] > 0.0 {
            if inside { D } else { 1 }
        } else {
            0
        }
    };
    let rows = |field: &[[f64; D]], scale: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let of_node = |i: usize| (0..held(i)).map(move |k| field[i][k] * scale(i));
        (0..r.len()).flat_map(of_node).collect()
    };
    let columns: Vec<Vec<f64>> = modes.iter().map(|mode| rows(mode, &|_| 1.0)).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let right = rows(&free, &|i| -problem.scaling.to_v[i]);
    problem
        .scaling
        .rigid_from_scaled(&least_squares::solve(&columns, &right))
}

/// `4 ε ‖ |Ŵ||r̂| + |R̂||â| + |q̂| ‖ / max(‖r̂‖, ‖F(0)‖)`, its normal part with μ
/// times the tangential one: the rounding of `F`, and the same for the balance
/// of forces.
fn rounding_floor<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], a: &[f64]) -> f64 {
    let mut terms = vec![[0.0; D]; r.len()];
    problem.compliance.absolute_product(r, &mut terms);
    for (i, value) in terms.iter_mut().enumerate() {
        for k in 0..D {
            value[k] += problem.q[i][k].abs();
            let rigid = problem.rigid.modes.iter().zip(a);
            value[k] += rigid.map(|(mode, a)| (mode[i][k] * a).abs()).sum::<f64>();
            value[k] *= problem.scaling.to_v[i];
        }
        // ṽ_n takes in the rounding of v_t, μ times.
        value[0] += problem.mu[i] * tangential_norm(value);
    }
    let unit = 4.0 * f64::EPSILON;
    let law = unit * ratio(norm(terms.as_flattened()), size(problem, r, a));
    if problem.rigid.modes.is_empty() {
        return law;
    }
    let forces = problem.scaling.reaction_norm(r) + norm(&problem.scaling.load);
    law.max(unit * ratio(forces, force_size(problem, r)))
}

/// A ratio that is zero when there is nothing to measure.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { part }
}
