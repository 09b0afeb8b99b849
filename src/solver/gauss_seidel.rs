//! Sweeps of exact one-node solves (17), accelerated by Anderson's method.
//!
//! One sweep visits every contact in order, solves it exactly with the other reactions fixed
//! (18) and adds the change to `v` of all others. It costs one product with `W` and gives η at
//! its end. Contacts that stay open cost nothing.
//!
//! For bodies that only contact holds, sweeps use the proximal form `W + R̂ R̂ᵀ/δ`,
//! `q + R̂ (â + ê/δ)`, with `â ← â + (R̂ᵀ r̂ + ê)/δ` after each sweep. Anderson's method treats
//! `r̂` and `â` as one unknown.

use std::borrow::Cow;

use crate::law::bipotential::law_step;
use crate::law::cone::Status;
use crate::law::one_node::{self, Habit};
use crate::linalg::small::{Block, Vector, minus_scaled, plus_scaled};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::scaled_imbalance;
use crate::solver::anderson::Anderson;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::linearisation::Linearisation;
use crate::solver::outcome::Ended;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// A point and the quantities that are affine in it.
#[derive(Clone, Debug)]
pub struct GaussSeidelPoint<const D: usize> {
    pub r: Vec<[f64; D]>,
    /// `W r + q`.
    v: Vec<[f64; D]>,
    /// `R̂ᵀ r̂ + ê`.
    s: Vec<f64>,
    /// `â`.
    a: Vec<f64>,
}

#[derive(Debug)]
pub struct Sweeper<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    /// Diagonal blocks with the proximal term.
    blocks: Vec<Block<D>>,
    closed: Vec<bool>,
}

/// `a ← a + sign s/δ`.
fn shift(a: &mut [f64], s: &[f64], sign: f64) {
    for (a, s) in a.iter_mut().zip(s) {
        *a += sign * (s / tuning::sweep_delta());
    }
}

/// Runs until the monitor stops it.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    let sweeper = Sweeper::new(problem, start);
    let mut point = sweeper.start(start, monitor);
    let _ = sweeper.look(&point, monitor, false)?;
    loop {
        sweeper.run(&mut point, monitor, usize::MAX, false)?;
    }
}

impl<const D: usize> GaussSeidelPoint<D> {
    /// `â + (R̂ᵀ r̂ + ê)/δ`: the rigid motion of a point of the proximal form.
    fn motion(&self) -> Vec<f64> {
        let mut motion = self.a.clone();
        shift(&mut motion, &self.s, 1.0);
        motion
    }

    fn pack(&self) -> Vec<f64> {
        let (r, v) = (self.r.as_flattened(), self.v.as_flattened());
        [r, v, &self.s, &self.a].concat()
    }

    fn unpack(&self, packed: &[f64]) -> Self {
        let m = D * self.r.len();
        let nodes = |part: &[f64]| part.as_chunks::<D>().0.to_vec();
        Self {
            r: nodes(&packed[..m]),
            v: nodes(&packed[m..2 * m]),
            s: packed[2 * m..2 * m + self.s.len()].to_vec(),
            a: packed[2 * m + self.s.len()..].to_vec(),
        }
    }
}

impl<'p, const D: usize> Sweeper<'p, D> {
    pub fn new(problem: &'p Reduced<'p, D>, start: &Start<D>) -> Self {
        let scaling = &problem.scaling;
        let blocks = (0..problem.contacts()).map(|i| {
            let mut block = problem.compliance.block(i);
            for (_, mode) in scaling.modes.at(i) {
                let motion = Vector::<D>::from(*mode);
                block += motion
                    * motion.transpose()
                    * (scaling.to_r[i] / scaling.to_v[i] / tuning::sweep_delta());
            }
            block
        });
        let closed = if start.closed.is_empty() {
            vec![false; problem.contacts()]
        } else {
            start.closed.clone()
        };
        Self {
            problem,
            blocks: blocks.collect(),
            closed,
        }
    }

    pub fn start(&self, start: &Start<D>, monitor: &mut Monitor<D>) -> GaussSeidelPoint<D> {
        let none = vec![0.0; self.problem.rigid.modes.len()];
        let given = !start.rigid.is_empty();
        let rigid = if given { &start.rigid } else { &none };
        if start.reaction.is_empty() {
            return GaussSeidelPoint {
                r: vec![[0.0; D]; self.problem.contacts()],
                v: self.problem.q.clone(),
                s: self.problem.scaling.load.clone(),
                a: self.problem.scaling.rigid_to_scaled(rigid),
            };
        }
        monitor.count(1.0);
        self.point(start.reaction.clone(), rigid)
    }

    /// `a` of a point.
    pub fn rigid_motion(&self, point: &GaussSeidelPoint<D>) -> Vec<f64> {
        self.problem.scaling.rigid_from_scaled(&point.motion())
    }

    /// `W r + q` of one contact, with the rigid motion.
    fn with_rigid(&self, i: usize, v: &[f64; D], motion: &[f64]) -> [f64; D] {
        let mut v = *v;
        for (c, mode) in self.problem.scaling.modes.at(i) {
            for (value, m) in v.iter_mut().zip(mode) {
                *value += m * motion[c] / self.problem.scaling.to_v[i];
            }
        }
        v
    }

    fn total<'v>(&self, point: &'v GaussSeidelPoint<D>) -> Cow<'v, [[f64; D]]> {
        if self.problem.rigid.modes.is_empty() {
            return Cow::Borrowed(&point.v);
        }
        let motion = point.motion();
        let v = point.v.iter().enumerate();
        v.map(|(i, v)| self.with_rigid(i, v, &motion)).collect()
    }

    /// The law, linearised at a point.
    pub fn law(&self, point: &GaussSeidelPoint<D>) -> Linearisation<D> {
        Linearisation::new(self.problem, &point.r, &self.total(point))
    }

    pub fn look(
        &self,
        point: &GaussSeidelPoint<D>,
        monitor: &mut Monitor<D>,
        iterated: bool,
    ) -> Result<NextStep, Ended> {
        monitor.look(
            &point.r,
            &self.total(point),
            &self.rigid_motion(point),
            iterated,
        )
    }

    pub fn residual(&self, point: &GaussSeidelPoint<D>) -> f64 {
        let a = self.rigid_motion(point);
        crate::reduced::residual::residual(self.problem, &point.r, &self.total(point), &a)
    }

    /// Makes `count` accelerated sweeps, unless the monitor stops them before, or one changes no
    /// status and this is what the caller waits for.
    pub fn run(
        &self,
        point: &mut GaussSeidelPoint<D>,
        monitor: &mut Monitor<D>,
        count: usize,
        until_settled: bool,
    ) -> Result<(), Ended> {
        let mut anderson = Anderson::default();
        let mut statuses = vec![Status::Open; point.r.len()];
        for sweep in 1..=count {
            let before = (point.r.clone(), point.a.clone());
            let changed = self.sweep(point, &mut statuses);
            monitor.count(1.0);
            if self.look(point, monitor, true)? == NextStep::Refresh {
                self.refresh(point);
                anderson.restart();
                continue;
            }
            let refresh = sweep % tuning::sweep_refresh() == 0;
            if refresh {
                monitor.measure_floor(&point.r, &self.rigid_motion(point));
                self.refresh(point);
            }
            shift(&mut point.a, &point.s, 1.0);
            let mut f = Vec::with_capacity(D * point.r.len() + point.a.len());
            let moved = point.r.iter().zip(&before.0);
            for ((r, old), s) in moved.zip(&self.problem.scaling.to_r) {
                f.extend(minus_scaled(r, 1.0, old).map(|c| c * s));
            }
            f.extend(plus_scaled(&point.a, -1.0, &before.1));
            if let Some(next) = anderson.extrapolate(f, point.pack()) {
                let next = point.unpack(&next);
                let here = if refresh || !point.a.is_empty() {
                    self.residual(point)
                } else {
                    monitor.residual()
                };
                if self.residual(&next) <= tuning::extrapolation_trust() * here {
                    *point = next;
                } else {
                    anderson.restart();
                }
            }
            if until_settled && !changed {
                break;
            }
        }
        Ok(())
    }

    /// Changes a point to given reactions and rigid motions.
    pub fn point(&self, r: Vec<[f64; D]>, rigid: &[f64]) -> GaussSeidelPoint<D> {
        let mut point = GaussSeidelPoint {
            v: Vec::new(),
            s: Vec::new(),
            a: self.problem.scaling.rigid_to_scaled(rigid),
            r,
        };
        self.refresh(&mut point);
        // The rigid motion of the point is the given one.
        shift(&mut point.a, &point.s, -1.0);
        point
    }

    /// Evaluates all quantities that are affine in the point.
    fn refresh(&self, point: &mut GaussSeidelPoint<D>) {
        point.v = self.problem.relative_displacement(&point.r, &[]);
        point.s = scaled_imbalance(self.problem, &point.r);
    }

    /// Makes one sweep over all contacts, and tells whether it changed a status.
    fn sweep(&self, point: &mut GaussSeidelPoint<D>, statuses: &mut [Status]) -> bool {
        let mut changed = false;
        let scaling = &self.problem.scaling;
        let mut motion = point.motion();
        for (i, last) in statuses.iter_mut().enumerate() {
            let r = point.r[i];
            let block = &self.blocks[i];
            let v = self.with_rigid(i, &point.v[i], &motion);
            let own = block * Vector::<D>::from(r);
            let free = minus_scaled(&v, 1.0, &own.into());
            let habit = if self.closed[i] {
                Habit::Closed
            } else {
                Habit::None
            };
            // A contact that cannot move does not penetrate: this was checked.
            let law = self.problem.law[i];
            let solved = one_node::solve(block, &free, law, habit);
            // No solution with the other reactions fixed: make one projection.
            let project = || law_step(&r, &v, scaling.to_v[i] / scaling.to_r[i], law);
            let (next, status) = solved.unwrap_or_else(project);
            changed |= std::mem::replace(last, status) != status;
            let dr = minus_scaled(&next, 1.0, &r);
            if dr.iter().all(|&c| c == 0.0) {
                continue;
            }
            self.problem.compliance.add_column(i, &dr, &mut point.v);
            for (c, mode) in scaling.modes.at(i) {
                let ds = (0..D).map(|k| mode[k] * dr[k]).sum::<f64>() * scaling.to_r[i];
                point.s[c] += ds;
                motion[c] += ds / tuning::sweep_delta();
            }
            point.r[i] = next;
        }
        changed
    }
}
