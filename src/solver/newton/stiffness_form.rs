//! One Newton step (19) in the displacements, if `W⁻¹` is known. The unknowns are `dv̂` of open
//! contacts and the tangential part of sliding ones, all of it with dilatancy. If most contacts stick, its matrix is much
//! smaller than the one in the reactions.
//!
//! Increments satisfy `dr = W⁻¹ (dv − R da)`. An error of `W⁻¹` is therefore an error of the
//! step, which later steps correct.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::lu::Lu;
use crate::linalg::pages;
use crate::linalg::small::Vector;
use crate::reduced::reduced::Reduced;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::newton::compliance_form::{Solved, is_free};
use crate::solver::newton::linearisation::{Linearisation, cut, factorisation_cost};
use crate::tasks;

/// Unknowns of one contact: components `from..D` of `dv̂`.
#[derive(Clone, Copy, Debug)]
struct Unknowns {
    node: usize,
    first: usize,
    from: usize,
}

#[derive(Debug)]
pub struct StiffnessForm<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    law: &'p Linearisation<D>,
    unknowns: Vec<Unknowns>,
    contact: usize,
}

impl<'p, const D: usize> StiffnessForm<'p, D> {
    pub fn new(problem: &'p Reduced<'p, D>, law: &'p Linearisation<D>) -> Self {
        let mut unknowns = Vec::new();
        let mut first = 0;
        for (node, at) in law.at.iter().enumerate() {
            let from = at.held(); // these rows say dv = −v
            if from == D {
                continue;
            }
            unknowns.push(Unknowns { node, first, from });
            first += D - from;
        }
        Self {
            problem,
            law,
            unknowns,
            contact: first,
        }
    }

    pub fn order(&self) -> usize {
        self.contact + self.problem.scaling.modes.len()
    }

    /// The next `(r, a)` from a point with `imbalance = R̂ᵀ r̂ + ê`; `None` if the matrix
    /// is singular or `W` has no inverse.
    pub fn solve(
        &self,
        at: &EvaluatedPoint<D>,
        imbalance: &[f64],
        count: &mut dyn FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let EvaluatedPoint { r, v, rigid } = at;
        let n = self.order();
        let problem = self.problem;
        if !problem.compliance.make_inverse(stop)? {
            return Ok(None);
        }
        let scaling = &problem.scaling;
        // The known part of dv: held components of closed contacts become zero.
        let mut known = vec![[0.0; D]; r.len()];
        for (i, at) in self.law.at.iter().enumerate() {
            for k in 0..at.held() {
                known[i][k] = -v[i][k];
            }
        }
        let borders = self.pushed_modes();
        let known_r = self.response(&known);
        count(1.0);
        let mut x = Vec::with_capacity(n);
        for u in &self.unknowns {
            let at = &self.law.at[u.node];
            let dr = Vector::from(known_r[u.node]) * scaling.to_r[u.node];
            let dv = Vector::from(known[u.node]) * scaling.to_v[u.node];
            let right = -at.value - at.by_r * dr - at.by_v * dv;
            x.extend(&right.as_slice()[u.from..]);
        }
        let work = scaling.modes.work(&known_r, &scaling.to_r);
        x.extend(imbalance.iter().zip(work).map(|(s, w)| -s - w));
        if n > 0 {
            count(factorisation_cost(problem, n));
            let Some(lu) = Lu::new(self.matrix(&borders), n, stop)? else {
                return Ok(None);
            };
            lu.solve(&mut x);
        }
        if x.iter().any(|c| !c.is_finite()) {
            return Ok(None);
        }
        for u in &self.unknowns {
            let solved = &x[u.first..u.first + D - u.from];
            for (value, dv) in known[u.node][u.from..].iter_mut().zip(solved) {
                *value = dv / scaling.to_v[u.node];
            }
        }
        let dr = self.response(&known);
        count(1.0);
        let amounts = &x[self.contact..];
        let mut next = r.clone();
        for (i, value) in next.iter_mut().enumerate() {
            let open = self.law.at[i].status == Status::Open;
            if is_free(problem, i, self.law.at[i].status) {
                *value = [0.0; D];
                continue;
            }
            for k in 0..D {
                let pushed = borders.iter().zip(amounts);
                value[k] += dr[i][k] - pushed.map(|(b, a)| b[i][k] * a).sum::<f64>();
            }
            if open {
                value[0] = 0.0;
            } else if !problem.law[i].has_friction() {
                value[1..].fill(0.0);
            }
        }
        let change = scaling.rigid_from_scaled(amounts);
        let rigid = rigid.iter().zip(change).map(|(a, da)| a + da).collect();
        Ok(Some(Solved { r: next, rigid }))
    }

    /// `W⁻¹ dv`.
    fn response(&self, dv: &[[f64; D]]) -> Vec<[f64; D]> {
        let mut dr = vec![[0.0; D]; dv.len()];
        self.problem.compliance.inverse_product(dv, &mut dr);
        dr
    }

    /// Columns `W⁻¹ R`, one for each `â` of length one.
    fn pushed_modes(&self) -> Vec<Vec<[f64; D]>> {
        let to_v = &self.problem.scaling.to_v;
        let pushed = |mode: Vec<[f64; D]>| {
            let motion = mode.iter().zip(to_v).map(|(m, s)| m.map(|c| c / s));
            self.response(&motion.collect::<Vec<_>>())
        };
        let modes = self.problem.scaling.modes.columns();
        modes.into_iter().map(pushed).collect()
    }

    /// Rows of the matrix.
    fn matrix(&self, borders: &[Vec<[f64; D]>]) -> Vec<f64> {
        let n = self.order();
        let scaling = &self.problem.scaling;
        let mut matrix = pages::zeros(n * n);
        let (contact, border) = matrix.split_at_mut(self.contact * n);
        let of_unknowns = cut(&self.unknowns, |u| (D - u.from) * n, contact);
        tasks::for_each_together(of_unknowns, 16, |_, (u, out)| {
            let at = &self.law.at[u.node];
            let to_r = scaling.to_r[u.node];
            for other in &self.unknowns {
                let t = self.problem.compliance.inverse_pair(u.node, other.node);
                let mut block = at.by_r * t * (to_r / scaling.to_v[other.node]);
                if u.node == other.node {
                    block += at.by_v;
                }
                for i in u.from..D {
                    for j in other.from..D {
                        out[(i - u.from) * n + other.first + j - other.from] = block[(i, j)];
                    }
                }
            }
            for (c, pushed) in borders.iter().enumerate() {
                let by_a = at.by_r * Vector::from(pushed[u.node]) * to_r;
                for i in u.from..D {
                    out[(i - u.from) * n + self.contact + c] = -by_a[i];
                }
            }
        });
        // R̂ᵀ dr̂ = R̂ᵀ Ŵ⁻¹ (dv̂ − R̂ dâ), because W is symmetric.
        let work = |other: &Vec<[f64; D]>| scaling.modes.work(other, &scaling.to_r);
        let works: Vec<_> = borders.iter().map(work).collect();
        let rows = border.chunks_exact_mut(n.max(1));
        for (k, (row, pushed)) in rows.zip(borders).enumerate() {
            for u in &self.unknowns {
                let scale = scaling.to_r[u.node];
                let of_unit = &pushed[u.node];
                for j in u.from..D {
                    row[u.first + j - u.from] = of_unit[j] * scale;
                }
            }
            for (c, work) in works.iter().enumerate() {
                row[self.contact + c] = -work[k];
            }
        }
        matrix
    }
}
