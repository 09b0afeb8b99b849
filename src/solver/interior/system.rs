//! The equations of a path.

use crate::error::Error;
use crate::law::contact_law::ContactLaw;
use crate::law::second_order;
use crate::linalg::small::{Block, Vector};
use crate::reduced::reduced::Reduced;
use crate::reduced::rigid_motions::RigidMotions;
use crate::solver::interior::factors::plus;
use crate::solver::newton::linearisation::movable;
use crate::solver::tuning;

/// `s = A z + B â + b + h(s) e` with `A = S Ŵ S`, `B = S R̂`, `S = diag(1/μ, 1)`.
pub(super) struct System<'p, const D: usize> {
    pub(super) problem: &'p Reduced<'p, D>,
    /// Diagonals of `S`; a frictionless contact has only its normal component.
    stretch: Vec<Vector<D>>,
    smoothing: f64,
    /// `B`.
    pub(super) motions: RigidMotions<D>,
}

/// The residual of a point.
#[derive(Clone, Debug)]
pub(super) struct Missed<const D: usize> {
    /// `s − A z − B â − b − h(s) e`.
    pub(super) contacts: Vec<Vector<D>>,
    /// `Bᵀ z + ê`.
    pub(super) imbalance: Vec<f64>,
}

impl<const D: usize> Missed<D> {
    pub(super) fn times(&self, factor: f64) -> Self {
        Self {
            contacts: self.contacts.iter().map(|x| x * factor).collect(),
            imbalance: self.imbalance.iter().map(|x| x * factor).collect(),
        }
    }

    pub(super) fn plus(&self, other: &Self, factor: f64) -> Self {
        Self {
            contacts: plus(&self.contacts, &other.contacts, factor),
            imbalance: plus(&self.imbalance, &other.imbalance, factor),
        }
    }
}

impl<'p, const D: usize> System<'p, D> {
    /// `None` if it is too large, or if a contact cannot move, because its cone has no
    /// interior.
    pub(super) fn new(problem: &'p Reduced<'p, D>, smoothing: f64) -> Result<Option<Self>, Error> {
        let n = problem.contacts();
        let modes = problem.scaling.modes.len();
        match problem.whole()? {
            Some(whole) if !whole.has_memory() => return Ok(None),
            None if D * n + modes > tuning::most_dense() => return Ok(None),
            _ => {}
        }
        if !(0..n).all(|i| (0..D).all(|k| movable(problem, i, k))) {
            return Ok(None);
        }
        let stretch = problem.law.iter().map(|&ContactLaw { mu, .. }| {
            let mut diagonal = Vector::repeat(f64::from(u8::from(mu > 0.0)));
            diagonal[0] = if mu > 0.0 { 1.0 / mu } else { 1.0 };
            diagonal
        });
        let stretch: Vec<Vector<D>> = stretch.collect();
        let stretched = |i: usize, m: &[f64; D]| Vector::from(*m).component_mul(&stretch[i]).into();
        Ok(Some(Self {
            problem,
            motions: problem.scaling.modes.map(|i, _, m| stretched(i, m)),
            stretch,
            smoothing,
        }))
    }

    pub(super) fn reaction(&self, z: &[Vector<D>]) -> Vec<[f64; D]> {
        let all = z.iter().zip(&self.stretch).zip(&self.problem.scaling.to_r);
        all.map(|((z, stretch), to_r)| (z.component_mul(stretch) / *to_r).into())
            .collect()
    }

    /// `S v̂`.
    pub(super) fn displacement(&self, v: &[[f64; D]]) -> Vec<Vector<D>> {
        let all = v.iter().zip(&self.stretch).zip(&self.problem.scaling.to_v);
        all.map(|((v, stretch), to_v)| Vector::from(*v).component_mul(stretch) * *to_v)
            .collect()
    }

    fn height(&self, s: &Vector<D>) -> f64 {
        let t = second_order::tangential(s);
        (self.smoothing * s[0] * s[0] + (1.0 - self.smoothing) * t * t).sqrt()
    }

    pub(super) fn evaluate_missed(&self, s: &[Vector<D>], v: &[[f64; D]]) -> Vec<Vector<D>> {
        let mut missed = self.displacement(v);
        for ((value, s), &ContactLaw { mu, .. }) in missed.iter_mut().zip(s).zip(&self.problem.law)
        {
            *value = s - *value;
            if mu > 0.0 {
                value[0] -= self.height(s);
            }
        }
        missed
    }

    /// `∂(s − h(s) e)/∂s`.
    pub(super) fn slope(&self, s: &Vector<D>, mu: f64) -> Block<D> {
        let mut slope = Block::identity();
        if mu > 0.0 {
            let height = self.height(s);
            slope[(0, 0)] -= self.smoothing * s[0] / height;
            for k in 1..D {
                slope[(0, k)] -= (1.0 - self.smoothing) * s[k] / height;
            }
        }
        slope
    }

    /// `Bᵀ x`.
    pub(super) fn work(&self, x: &[Vector<D>]) -> Vec<f64> {
        let x: Vec<[f64; D]> = x.iter().map(|x| (*x).into()).collect();
        self.motions.work(&x, &vec![1.0; x.len()])
    }

    /// A block of `R̂` or its transpose as one of `B`; `contact` is that of its rows.
    pub(super) fn border(&self, contact: usize, w: &Block<D>) -> Block<D> {
        Block::from_fn(|k, l| self.stretch[contact][k] * w[(k, l)])
    }

    /// The block `A_ij` from `W_ij`.
    pub(super) fn block(&self, i: usize, j: usize, w: &Block<D>) -> Block<D> {
        let scaling = &self.problem.scaling;
        let scale = scaling.to_v[i] / scaling.to_r[j];
        Block::from_fn(|k, l| self.stretch[i][k] * w[(k, l)] * scale * self.stretch[j][l])
    }
}
