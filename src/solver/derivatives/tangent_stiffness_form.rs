//! The system of [`TangentSystem`] in the displacements, if `W` is symmetric and has an inverse
//! and no rigid motions are unknown. If most contacts stick, it is much smaller.
//!
//! With `y = W dr` the matrix is `A_r + A_v W = (A_r W⁻¹ + A_v) W`, where rows without `A_r`
//! say what `y` is. The unknowns are the other components: the tangential ones of sliding
//! contacts, and all of open ones, whose rows say `dr = 0`. One step of refinement with `W`
//! corrects the error of its inverse.
//!
//! [`TangentSystem`]: crate::solver::derivatives::tangent_system::TangentSystem

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::pages;
use crate::linalg::small::{Block, Vector, rows_plus_scaled};
use crate::reduced::compliance::Compliance;
use crate::reduced::reduced::Scaling;
use crate::solver::derivatives::tangent_system::{ClosedLaw, FactoredTangent, TangentSystem};
use crate::solver::tuning;
use crate::tasks;

/// A component of `y` that is unknown.
#[derive(Clone, Copy, Debug)]
struct Unknown {
    position: usize,
    component: usize,
}

/// The factored system.
#[derive(Debug)]
pub struct TangentStiffnessForm<const D: usize> {
    compliance: Arc<Compliance<'static, D>>,
    laws: Vec<ClosedLaw<D>>,
    /// `A_r` and `A_v` of each position.
    by: Vec<(Block<D>, Block<D>)>,
    unknowns: Vec<Unknown>,
    inner: TangentSystem,
}

impl<const D: usize> TangentStiffnessForm<D> {
    /// Factors the system; `None` if this form does not pay or does not exist.
    pub fn new(
        compliance: &Arc<Compliance<'static, D>>,
        scaling: &Scaling<D>,
        laws: &[ClosedLaw<D>],
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let mut by = vec![(Block::identity(), Block::zeros()); compliance.contacts()];
        for law in laws {
            by[law.position] = (law.by_r, law.by_v);
        }
        let unknown = |position: usize| {
            let (by_r, by_v) = by[position];
            let of = move |component: usize| {
                (!says_component(&by_r, &by_v, component)).then_some(Unknown {
                    position,
                    component,
                })
            };
            (0..D).filter_map(of)
        };
        let unknowns: Vec<Unknown> = (0..by.len()).flat_map(unknown).collect();
        if tuning::fewer_unknowns() * unknowns.len() > D * laws.len()
            || !compliance.make_inverse(stop)?
        {
            return Ok(None);
        }
        let matrix = matrix(compliance, &by, &unknowns);
        let size = |u: &Unknown| {
            let (by_r, by_v) = by[u.position];
            let of = |block: &Block<D>, scale: f64| block.row(u.component).amax() / scale;
            let (to_r, to_v) = (scaling.to_r[u.position], scaling.to_v[u.position]);
            of(&by_r, to_r).max(of(&by_v, to_v))
        };
        let rows = unknowns.iter().map(size).collect();
        let columns = unknowns.iter().map(|u| 1.0 / scaling.to_v[u.position]);
        let made = TangentSystem::dense(matrix, rows, columns.collect(), stop)?;
        Ok(made.map(|inner| Self {
            compliance: Arc::clone(compliance),
            laws: laws.to_vec(),
            by,
            unknowns,
            inner,
        }))
    }

    /// `dr` of a right side, without refinement.
    fn first(&self, right: &[[f64; D]]) -> Vec<[f64; D]> {
        // What rows without A_r say of y.
        let mut y = vec![[0.0; D]; right.len()];
        for (i, (by_r, by_v)) in self.by.iter().enumerate() {
            for k in (0..D).filter(|&k| says_component(by_r, by_v, k)) {
                y[i][k] = right[i][k] / by_v[(k, k)];
            }
        }
        let r = self.inverse(&y);
        let of = |u: &Unknown| {
            let (by_r, by_v) = self.by[u.position];
            let value = by_r * Vector::from(r[u.position]) + by_v * Vector::from(y[u.position]);
            right[u.position][u.component] - value[u.component]
        };
        let mut solved: Vec<f64> = self.unknowns.iter().map(of).collect();
        self.inner.solve(&mut solved);
        for (u, value) in self.unknowns.iter().zip(solved) {
            y[u.position][u.component] = value;
        }
        self.keep_closed(&self.inverse(&y))
    }

    /// `w` of a right side, without refinement.
    fn first_transposed(&self, right: &[[f64; D]]) -> Vec<[f64; D]> {
        // (W⁻¹ A_rᵀ + A_vᵀ) w = W⁻¹ c, where rows without A_r act on their own component.
        let g = self.inverse(right);
        let at = |u: &Unknown| g[u.position][u.component];
        let mut solved: Vec<f64> = self.unknowns.iter().map(at).collect();
        self.inner.solve_transposed(&mut solved);
        let mut w = vec![[0.0; D]; right.len()];
        for (u, value) in self.unknowns.iter().zip(solved) {
            w[u.position][u.component] = value;
        }
        let pulled = self.inverse(&self.times(&w, |(by_r, _)| by_r.transpose()));
        let own = self.times(&w, |(_, by_v)| by_v.transpose());
        for (i, (by_r, by_v)) in self.by.iter().enumerate() {
            for k in (0..D).filter(|&k| says_component(by_r, by_v, k)) {
                w[i][k] = (g[i][k] - pulled[i][k] - own[i][k]) / by_v[(k, k)];
            }
        }
        w
    }

    fn times(
        &self,
        x: &[[f64; D]],
        of: impl Fn(&(Block<D>, Block<D>)) -> Block<D>,
    ) -> Vec<[f64; D]> {
        let pairs = self.by.iter().zip(x);
        pairs
            .map(|(by, x)| (of(by) * Vector::from(*x)).into())
            .collect()
    }

    fn inverse(&self, y: &[[f64; D]]) -> Vec<[f64; D]> {
        let mut r = vec![[0.0; D]; y.len()];
        self.compliance.inverse_product(y, &mut r);
        r
    }

    /// The values of closed contacts; reactions of open ones are rounding.
    fn keep_closed(&self, r: &[[f64; D]]) -> Vec<[f64; D]> {
        let mut found = vec![[0.0; D]; r.len()];
        for law in &self.laws {
            found[law.position] = r[law.position];
        }
        found
    }

    fn spread(&self, x: &[f64]) -> Vec<[f64; D]> {
        let mut whole = vec![[0.0; D]; self.by.len()];
        for (law, own) in self.laws.iter().zip(x.as_chunks::<D>().0) {
            whole[law.position] = *own;
        }
        whole
    }

    fn gather(&self, whole: &[[f64; D]], x: &mut [f64]) {
        for (law, own) in self.laws.iter().zip(x.as_chunks_mut::<D>().0) {
            *own = whole[law.position];
        }
    }
}

impl<const D: usize> FactoredTangent for TangentStiffnessForm<D> {
    fn order(&self) -> usize {
        D * self.laws.len()
    }

    fn reciprocal_condition(&self) -> f64 {
        self.inner.reciprocal_condition()
    }

    fn solve(&self, x: &mut [f64]) {
        let right = self.spread(x);
        let r = self.first(&right);
        let mut v = vec![[0.0; D]; r.len()];
        self.compliance.product(&r, &mut v);
        let pulled = self.times(&r, |(by_r, _)| *by_r);
        let value = rows_plus_scaled(&pulled, 1.0, &self.times(&v, |(_, by_v)| *by_v));
        let correction = self.first(&rows_plus_scaled(&right, -1.0, &value));
        self.gather(&rows_plus_scaled(&r, 1.0, &correction), x);
    }

    fn solve_transposed(&self, x: &mut [f64]) {
        let right = self.spread(x);
        let w = self.first_transposed(&right);
        let pulled: Vec<[f64; D]> = self.times(&w, |(_, by_v)| by_v.transpose());
        let mut moved = vec![[0.0; D]; w.len()];
        self.compliance.product(&pulled, &mut moved);
        let own = self.times(&w, |(by_r, _)| by_r.transpose());
        let value = self.keep_closed(&rows_plus_scaled(&own, 1.0, &moved));
        let correction = self.first_transposed(&rows_plus_scaled(&right, -1.0, &value));
        self.gather(&rows_plus_scaled(&w, 1.0, &correction), x);
    }
}

/// Whether a row says what a component of `y` is.
fn says_component<const D: usize>(by_r: &Block<D>, by_v: &Block<D>, k: usize) -> bool {
    let alone = (0..D).all(|l| (l == k) == (by_v[(k, l)] != 0.0));
    alone && by_r.row(k).amax() == 0.0
}

/// Rows of `A_r W⁻¹ + A_v` at the unknowns.
fn matrix<const D: usize>(
    compliance: &Compliance<'static, D>,
    by: &[(Block<D>, Block<D>)],
    unknowns: &[Unknown],
) -> Vec<f64> {
    let n = unknowns.len();
    let mut matrix = pages::zeros(n * n);
    if n == 0 {
        return matrix;
    }
    tasks::for_each_together(matrix.chunks_mut(n).zip(unknowns), 16, |_, (out, u)| {
        let (by_r, by_v) = by[u.position];
        let (by_r, by_v) = (by_r.row(u.component), by_v.row(u.component));
        for (value, other) in out.iter_mut().zip(unknowns) {
            let inverse = compliance.inverse_pair(u.position, other.position);
            *value = (by_r * inverse)[other.component];
            if u.position == other.position {
                *value += by_v[other.component];
            }
        }
    });
    matrix
}
