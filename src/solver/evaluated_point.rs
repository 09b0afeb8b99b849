//! A point with its relative displacement.

use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{merit, residual};
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::outcome::Ended;
use crate::solver::settings::Start;

/// Reactions and rigid motions, with `v = W r + R a + q`.
#[derive(Clone, Debug)]
pub struct EvaluatedPoint<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub v: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
}

impl<const D: usize> EvaluatedPoint<D> {
    /// Evaluates `v`.
    pub fn new(problem: &Reduced<D>, r: Vec<[f64; D]>, rigid: Vec<f64>) -> Self {
        let v = problem.relative_displacement(&r, &rigid);
        Self { r, v, rigid }
    }

    /// The start value; without one zero, whose `v` needs no product.
    pub fn begin(problem: &Reduced<D>, start: &Start<D>, monitor: &mut Monitor<D>) -> Self {
        let mut rigid = vec![0.0; problem.rigid.modes.len()];
        if !start.rigid.is_empty() {
            rigid.copy_from_slice(&start.rigid);
        }
        if !start.reaction.is_empty() {
            monitor.count(1.0);
            return Self::new(problem, start.reaction.clone(), rigid);
        }
        let mut v = problem.q.clone();
        problem.add_rigid(&rigid, &mut v);
        let r = vec![[0.0; D]; v.len()];
        Self { r, v, rigid }
    }

    /// The point at a share of the way to another; exactly its `r` and `v` for a full step.
    pub fn towards(&self, to: &Self, share: f64) -> Self {
        let blend = |x: &f64, y: &f64| x + share * (y - x);
        let between = |x: &[[f64; D]], y: &[[f64; D]]| {
            if share >= 1.0 {
                return y.to_vec();
            }
            let pairs = x.iter().zip(y);
            pairs
                .map(|(x, y)| std::array::from_fn(|k| blend(&x[k], &y[k])))
                .collect()
        };
        let rigid = self.rigid.iter().zip(&to.rigid);
        Self {
            r: between(&self.r, &to.r),
            v: between(&self.v, &to.v),
            rigid: rigid.map(|(x, y)| blend(x, y)).collect(),
        }
    }

    /// `‖(F, R̂ᵀ r̂ + ê)‖` of the law.
    pub fn merit(&self, problem: &Reduced<D>) -> f64 {
        merit(problem, &self.r, &self.v)
    }

    pub fn residual(&self, problem: &Reduced<D>) -> f64 {
        residual(problem, &self.r, &self.v, &self.rigid)
    }

    pub fn look(&self, monitor: &mut Monitor<D>, iterated: bool) -> Result<NextStep, Ended> {
        monitor.look(&self.r, &self.v, &self.rigid, iterated)
    }
}
