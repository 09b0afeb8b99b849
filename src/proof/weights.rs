//! Weights for which the matrix `A` of [`monotonicity`](crate::proof::monotonicity) is as
//! definite as possible.
//!
//! Any weights are valid, because the result is proved afterwards. With `p = 1` and one common
//! θ, `A ≽ (1 − κ) W` with, in closed form, `κ = ½ √(αβ)` at `θ = √(β/α)`, where
//! `α = λ_max(M½ W_tt M½)`, `β = λ_max(M½ (W⁻¹)_nn M½)`, `M = diag μ`.
//!
//! If this is not sufficient, each contact gets its own weights. `A` is concave in `θ` in the
//! order of quadratic forms, and so is `log det (A − σ W)`. At its maximum
//!
//! ```text
//! θ_i² = X_nn,ii / tr (W X Wᵀ)_tt,ii,      X = (A − σ W)⁻¹
//! ```
//!
//! The term `− Σ log p_i` removes the effect of p as a scaling of rows; with it,
//! `p_i = 1/(W X)_nn,ii · p_i`. Steps towards these values, in logarithms, are ascent
//! directions; they are shortened until the sum increases. Then σ follows the least eigenvalue
//! of `A` relative to `W` from below.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::dense::{self, Op};
use crate::linalg::small::{add_scaled, dot_long};
use crate::linalg::verified_cholesky::Lower;
use crate::proof::monotonicity::{KnownSlip, Monotonicity, Weights, largest, product};
use crate::proof::tuning;

/// Weights in closed form, with the estimates that give them.
#[derive(Clone, Debug)]
pub struct Common {
    pub weights: Weights,
    /// `θ` is a multiple of this: α and β belong to `diag(μ shape)` and `diag(μ / shape)`.
    pub shape: Vec<f64>,
    pub alpha: f64,
    pub beta: f64,
}

impl Common {
    /// κ, estimated.
    pub fn kappa(&self) -> f64 {
        0.5 * (self.alpha * self.beta).sqrt()
    }
}

/// The best common θ of the scaled variables, or of those of the caller, with `p = 1`. `lower`
/// is a factor below the symmetric part of `W`.
pub fn common<const D: usize>(monotonicity: &Monotonicity<D>, lower: &Lower) -> Common {
    let of_shapes = monotonicity.shapes.each_ref();
    let [scaled, plain] = of_shapes.map(|shape| of_shape(monotonicity, lower, shape));
    if plain.kappa() < scaled.kappa() {
        plain
    } else {
        scaled
    }
}

fn of_shape<const D: usize>(
    monotonicity: &Monotonicity<D>,
    lower: &Lower,
    shape: &[f64],
) -> Common {
    let contacts = monotonicity.mu.len();
    let n = monotonicity.order();
    let (half, _) = monotonicity.symmetric_part(&monotonicity.all());
    let root = |normal: bool| -> Vec<f64> {
        let of = |unknown: usize| {
            let (contact, k) = monotonicity.contact(unknown);
            let (mu, shape) = (monotonicity.mu[contact], shape[contact]);
            match (k == 0, normal) {
                (true, true) => (mu / shape).sqrt(),
                (false, false) => (mu * shape).sqrt(),
                _ => 0.0,
            }
        };
        (0..n).map(of).collect()
    };
    let (on_normal, on_tangent) = (root(true), root(false));
    let scale = |x: &mut [f64], by: &[f64]| {
        for (x, s) in x.iter_mut().zip(by) {
            *x *= s;
        }
    };
    let alpha = largest(n, |x| {
        scale(x, &on_tangent);
        let y = product(&half, x);
        x.copy_from_slice(&y);
        scale(x, &on_tangent);
    });
    let beta = largest(n, |x| {
        scale(x, &on_normal);
        lower.forward(x);
        lower.backward(x);
        scale(x, &on_normal);
    });
    let theta = (beta / alpha).sqrt();
    let usable = theta.is_finite() && theta > 0.0;
    Common {
        weights: Weights {
            normal: vec![1.0; contacts],
            theta: shape
                .iter()
                .map(|s| if usable { theta * s } else { *s })
                .collect(),
        },
        shape: shape.to_vec(),
        alpha,
        beta,
    }
}

/// Weights of each contact, from common ones; `None` if those suffice, or if the search would
/// take too long.
pub fn refined<const D: usize>(
    monotonicity: &Monotonicity<D>,
    start: &Common,
    stop: &AtomicBool,
) -> Result<Option<Weights>, Error> {
    if start.kappa() < tuning::good_kappa() || monotonicity.order() > tuning::weighted_unknowns() {
        return Ok(None);
    }
    let mut search = WeightSearch::new(monotonicity);
    let mut weights = start.weights.clone();
    // At the start the least eigenvalue is 1 − κ.
    let mut least = 1.0 - start.kappa();
    let mut gap = tuning::gap_fall() * least.abs().max(0.1);
    let mut best = (f64::NEG_INFINITY, None);
    for _ in 0..tuning::weight_rounds() {
        let Some(here) = search.at(&weights, least - gap, stop)? else {
            gap *= tuning::gap_rise(); // the estimate of the least eigenvalue lay above it
            continue;
        };
        let step = search.step(&here, &weights);
        let mut moved = None;
        for halvings in 0..8 {
            let trial = towards(&weights, &step, 0.5_f64.powi(halvings));
            if let Some(there) = search.at(&trial, here.sigma, stop)?
                && there.value > here.value
            {
                moved = Some((trial, there));
                break;
            }
        }
        let failed = moved.is_none();
        let there = match moved {
            Some((trial, there)) => {
                weights = trial;
                there
            }
            None => here,
        };
        let before = least;
        least = there.sigma + search.least(&there);
        if least > best.0 {
            best = (least, Some(weights.clone()));
        }
        let factor = if failed {
            tuning::gap_rise()
        } else {
            tuning::gap_fall()
        };
        gap = (factor * (least - there.sigma)).max(tuning::least_gap() * least.abs());
        let gain = tuning::weight_gain();
        if least > gain && !failed && least - before < gain * least {
            break;
        }
    }
    Ok(best.1)
}

/// `log p` and `log θ` of each contact.
type LogStep = (Vec<f64>, Vec<f64>);

fn towards(weights: &Weights, step: &LogStep, share: f64) -> Weights {
    let along = |from: &[f64], by: &[f64]| {
        let pairs = from.iter().zip(by);
        pairs.map(|(w, s)| w * (share * s).exp()).collect()
    };
    Weights {
        normal: along(&weights.normal, &step.0),
        theta: along(&weights.theta, &step.1),
    }
}

struct WeightSearch<'a, const D: usize> {
    monotonicity: &'a Monotonicity<D>,
    kept: Vec<usize>,
    known: Vec<KnownSlip<D>>,
    half: Vec<f64>,
}

/// A factor of `A − σ W`, and the function to be maximised.
struct Centre {
    sigma: f64,
    factor: Vec<f64>,
    value: f64,
}

impl<'a, const D: usize> WeightSearch<'a, D> {
    fn new(monotonicity: &'a Monotonicity<D>) -> Self {
        let kept = monotonicity.all();
        let (half, _) = monotonicity.symmetric_part(&kept);
        Self {
            monotonicity,
            known: monotonicity.nothing_known(),
            kept,
            half,
        }
    }

    fn at(
        &self,
        weights: &Weights,
        sigma: f64,
        stop: &AtomicBool,
    ) -> Result<Option<Centre>, Error> {
        let n = self.kept.len();
        let (mut a, _) = self.monotonicity.form(&self.kept, weights, &self.known);
        add_scaled(&mut a, -sigma, &self.half);
        if !a.iter().all(|x| x.is_finite()) || dense::cholesky(&mut a, n, stop)?.is_some() {
            return Ok(None);
        }
        let determinant: f64 = (0..n).map(|i| 2.0 * a[i * (n + 1)].ln()).sum();
        let scales: f64 = weights.normal.iter().map(|p| p.ln()).sum();
        Ok(Some(Centre {
            sigma,
            factor: a,
            value: determinant - scales,
        }))
    }

    fn step(&mut self, here: &Centre, weights: &Weights) -> LogStep {
        let n = self.kept.len();
        // L⁻¹ and L⁻¹ Wᵀ: the lengths of their columns are needed.
        let mut inverse = vec![0.0; n * n];
        for k in 0..n {
            inverse[k * (n + 1)] = 1.0;
        }
        dense::solve_lower(&here.factor, n, &mut inverse, n);
        let mut moved = vec![0.0; n * n];
        let shape = (n, n, n);
        let (half, plain) = (&self.half, Op::Plain);
        // The symmetric part of an asymmetric W: weights need not be optimal.
        dense::matmul(&mut moved, shape, 1.0, &inverse, plain, half, plain, 0.0);
        let contacts = self.monotonicity.mu.len();
        let (mut normal, mut theta) = (vec![0.0; contacts], vec![0.0; contacts]);
        let mut against = vec![0.0; contacts];
        let columns = inverse
            .chunks_exact(n.max(1))
            .zip(moved.chunks_exact(n.max(1)));
        for (j, (x, w)) in columns.enumerate() {
            let (contact, k) = self.monotonicity.contact(j);
            if k == 0 {
                theta[contact] += dot_long(x, x);
                normal[contact] = weights.normal[contact] * dot_long(x, w);
            } else {
                against[contact] += dot_long(w, w);
            }
        }
        // The logarithm of a positive number, in bounds.
        let step = |is_usable: bool, logarithm: f64, most: f64| {
            let step = logarithm.clamp(-most, most);
            if is_usable && step.is_finite() {
                step
            } else {
                0.0
            }
        };
        let longest = tuning::longest_logarithm();
        for contact in 0..contacts {
            let ratio = theta[contact] / against[contact];
            let usable = self.monotonicity.mu[contact] > 0.0 && ratio > 0.0;
            let logarithm = 0.5 * ratio.ln() - weights.theta[contact].ln();
            theta[contact] = step(usable, logarithm, 2.0 * longest);
            let slope = normal[contact];
            normal[contact] = step(slope > 0.0, slope.ln(), longest);
        }
        (normal, theta)
    }

    /// An estimate of the least eigenvalue of `A − σ W` relative to `W`.
    fn least(&self, here: &Centre) -> f64 {
        let n = self.kept.len();
        let most = largest(n, |x| {
            dense::solve_lower_transpose(&here.factor, n, x, 1);
            let y = product(&self.half, x);
            x.copy_from_slice(&y);
            dense::solve_lower(&here.factor, n, x, 1);
        });
        1.0 / most
    }
}
