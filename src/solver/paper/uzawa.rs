//! The algorithm (16) of the paper: predictor `r̂ − ρ ṽ̂`, corrector `proj(·, K_μ)`, [dSF91,
//! 79–81]; its earlier form with two projections [dSF91, 82–87]; and Nesterov's momentum with
//! restarts. All three use the same adaptive step.
//!
//! ρ is one number in node-scaled variables. A step is accepted if the displacement `ŵ` of the
//! predictor changes by no more than `r`, `ρ ‖ŵ(r') − ŵ(r)‖ ≤ L ‖r̂' − r̂‖`; otherwise ρ
//! decreases and the step is repeated. If it changes much less, ρ increases. `ŵ` is `ṽ̂` for
//! one projection and `v̂` for two.

use std::ops::Range;

use crate::law::bipotential::{corrected, law_step};
use crate::law::frozen::Frozen;
use crate::linalg::small::{dot, minus_scaled, plus_scaled, rows_plus_scaled, tangential_norm};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::scaled_imbalance;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::outcome::Ended;
use crate::solver::settings::Start;
use crate::solver::tuning;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// One projection of each node onto `K_μ`, (16).
    OneProjection,
    /// Normal reactions onto the half-line, then tangential ones onto the disc of the new
    /// normal reaction, [dSF91, 84–87].
    TwoProjections,
    /// One projection from a point extrapolated with Nesterov's momentum, which restarts when a
    /// step turns against it.
    Momentum,
}

/// Reactions with their relative displacement.
#[derive(Clone, Debug)]
struct UzawaPoint<const D: usize> {
    r: Vec<[f64; D]>,
    v: Vec<[f64; D]>,
}

impl<const D: usize> UzawaPoint<D> {
    /// `self + share (self − before)`; `v` follows, affine in `r`.
    fn beyond(&self, before: &Self, share: f64) -> Self {
        let blend = |x: &[[f64; D]], y: &[[f64; D]]| {
            rows_plus_scaled(x, share, &rows_plus_scaled(x, -1.0, y))
        };
        Self {
            r: blend(&self.r, &before.r),
            v: blend(&self.v, &before.v),
        }
    }
}

/// Runs until the monitor stops it.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    variant: Variant,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    let mut map = Map::new(problem, variant, &[], start);
    let mut point = map.start(start);
    monitor.count(1.0);
    let _ = monitor.look(&point.r, &point.v, &map.motion(&point.r), false)?;
    loop {
        map.iterate(&mut point, monitor, usize::MAX)?;
    }
}

/// Makes `count` steps with momentum and frozen laws from a point. For a symmetric positive
/// semidefinite `W` they converge, but slowly.
pub fn run_burst<const D: usize>(
    problem: &Reduced<D>,
    frozen: &[Frozen<D>],
    from: &EvaluatedPoint<D>,
    monitor: &mut Monitor<D>,
    count: usize,
) -> Result<EvaluatedPoint<D>, Ended> {
    let start = Start {
        reaction: from.r.clone(),
        rigid: from.rigid.clone(),
        closed: Vec::new(),
    };
    let mut map = Map::new(problem, Variant::Momentum, frozen, &start);
    // The rigid motion of the point is the given one.
    map.proximal = map.shifted(&start.reaction, -1.0);
    let mut point = map.start(&start);
    monitor.count(1.0);
    map.iterate(&mut point, monitor, count)?;
    let rigid = map.motion(&point.r);
    monitor.count(1.0);
    Ok(EvaluatedPoint::new(problem, point.r, rigid))
}

/// The map of one problem, with its step length and rigid motions.
struct Map<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    variant: Variant,
    /// Frozen laws, one for each contact; `None` for the law itself.
    frozen: &'p [Frozen<D>],
    rho: f64,
    /// `â` of the proximal form.
    proximal: Vec<f64>,
}

impl<'p, const D: usize> Map<'p, D> {
    fn new(
        problem: &'p Reduced<'p, D>,
        variant: Variant,
        frozen: &'p [Frozen<D>],
        start: &Start<D>,
    ) -> Self {
        let proximal = if start.rigid.is_empty() {
            vec![0.0; problem.rigid.modes.len()]
        } else {
            problem.scaling.rigid_to_scaled(&start.rigid)
        };
        Self {
            problem,
            variant,
            frozen,
            rho: 1.0,
            proximal,
        }
    }

    fn start(&self, start: &Start<D>) -> UzawaPoint<D> {
        let r = if start.reaction.is_empty() {
            vec![[0.0; D]; self.problem.contacts()]
        } else {
            start.reaction.clone()
        };
        self.point(r)
    }

    /// `a`, the rigid motions of given reactions in the proximal form.
    fn motion(&self, r: &[[f64; D]]) -> Vec<f64> {
        self.problem
            .scaling
            .rigid_from_scaled(&self.shifted(r, 1.0))
    }

    /// `â + sign (R̂ᵀ r̂ + ê)/δ`.
    fn shifted(&self, r: &[[f64; D]], sign: f64) -> Vec<f64> {
        let s = scaled_imbalance(self.problem, r);
        let pairs = self.proximal.iter().zip(&s);
        pairs
            .map(|(a, s)| a + sign * (s / tuning::projection_delta()))
            .collect()
    }

    fn point(&self, r: Vec<[f64; D]>) -> UzawaPoint<D> {
        let v = self.problem.relative_displacement(&r, &self.motion(&r));
        UzawaPoint { r, v }
    }

    fn iterate(
        &mut self,
        point: &mut UzawaPoint<D>,
        monitor: &mut Monitor<D>,
        count: usize,
    ) -> Result<(), Ended> {
        let mut before = point.clone();
        let mut theta = 1.0_f64;
        for iteration in 1..=count {
            let mut share = 0.0;
            if self.variant == Variant::Momentum {
                // θ' solves θ'² = (1 − θ') θ²: Nesterov's sequence.
                let square = theta * theta;
                let next = 0.5 * ((square * square + 4.0 * square).sqrt() - square);
                share = theta * (1.0 - theta) / (square + next);
                theta = next;
            }
            let next = if share > 0.0 {
                let ahead = point.beyond(&before, share);
                let next = self.advance(&ahead, monitor);
                if self.turns(&ahead, &next, point) {
                    theta = 1.0;
                }
                next
            } else {
                self.advance(point, monitor)
            };
            before = std::mem::replace(point, next);
            let next = monitor.look(&point.r, &point.v, &self.motion(&point.r), true)?;
            if next == NextStep::Refresh {
                *point = self.point(std::mem::take(&mut point.r));
                theta = 1.0;
            }
            if iteration % tuning::projection_refresh() == 0 {
                monitor.measure_floor(&point.r, &self.motion(&point.r));
                if self.variant == Variant::TwoProjections {
                    // Its v is a running sum, which accumulates rounding.
                    *point = self.point(std::mem::take(&mut point.r));
                }
            }
            if !self.proximal.is_empty() && iteration % tuning::steps_a_phase() == 0 {
                self.proximal = self.shifted(&point.r, 1.0);
                *point = self.point(std::mem::take(&mut point.r));
            }
        }
        Ok(())
    }

    /// Whether the step from `ahead` to `next` is opposed to the one from `last`.
    fn turns(&self, ahead: &UzawaPoint<D>, next: &UzawaPoint<D>, last: &UzawaPoint<D>) -> bool {
        let mut product = 0.0;
        for (i, to_r) in self.problem.scaling.to_r.iter().enumerate() {
            let back = minus_scaled(&ahead.r[i], 1.0, &next.r[i]);
            let way = minus_scaled(&next.r[i], 1.0, &last.r[i]);
            product += dot(&back, &way) * to_r * to_r;
        }
        product > 0.0
    }

    /// Makes one step from a point, decreasing ρ until the step is accepted.
    fn advance(&mut self, from: &UzawaPoint<D>, monitor: &mut Monitor<D>) -> UzawaPoint<D> {
        loop {
            let next = match self.variant {
                Variant::TwoProjections => self.two_projections(from),
                _ => self.point(self.one_projection(from)),
            };
            monitor.count(1.0);
            let ratio = self.rho * self.contraction(from, &next);
            // A ratio that is NaN gives no measure of the step: accept it, the monitor checks
            // the point.
            if !(ratio > tuning::cut_above()) || self.rho < f64::EPSILON {
                if ratio > 0.0 && ratio < tuning::grow_below() {
                    self.rho *= tuning::rho_growth();
                }
                return next;
            }
            self.rho *= tuning::rho_cut() * (1.0 / ratio).min(1.0);
        }
    }

    /// ρ of a node, in the caller's units.
    fn rho(&self, i: usize) -> f64 {
        self.rho * self.problem.scaling.to_v[i] / self.problem.scaling.to_r[i]
    }

    /// Predictor (80) and corrector (81) at every contact.
    fn one_projection(&self, from: &UzawaPoint<D>) -> Vec<[f64; D]> {
        let node = |(i, (r, v)): (usize, (&[f64; D], &[f64; D]))| match self.frozen.get(i) {
            Some(law) => law.step(r, v, self.rho(i)),
            None => law_step(r, v, self.rho(i), self.problem.law[i]).0,
        };
        from.r.iter().zip(&from.v).enumerate().map(node).collect()
    }

    /// (84), (85) for all normal reactions, then (86), (87) for all tangential
    /// ones, with the displacement that the new normal reactions give: the
    /// columns of one product with `W`, in two parts.
    fn two_projections(&self, from: &UzawaPoint<D>) -> UzawaPoint<D> {
        let mut r = from.r.clone();
        for (i, r) in r.iter_mut().enumerate() {
            let opening = self.problem.law[i].opening(&from.v[i]);
            r[0] = (r[0] - self.rho(i) * opening).max(0.0);
        }
        let half = self.respond(from, r, 0..1);
        let mut r = half.r.clone();
        for (i, r) in r.iter_mut().enumerate() {
            // The disc is the section of the cone at the height of its radius.
            let limit = self.problem.law[i].limit(r[0]);
            let tau = minus_scaled(r, self.rho(i), &half.v[i]);
            let length = tangential_norm(&tau);
            let shrink = if length > limit { limit / length } else { 1.0 };
            for k in 1..D {
                r[k] = shrink * tau[k];
            }
        }
        self.respond(&half, r, 1..D)
    }

    /// The point with reactions `r`, which differ from those of `from` in some
    /// components only.
    fn respond(
        &self,
        from: &UzawaPoint<D>,
        r: Vec<[f64; D]>,
        parts: Range<usize>,
    ) -> UzawaPoint<D> {
        let dr = rows_plus_scaled(&r, -1.0, &from.r);
        let mut v = from.v.clone();
        self.problem.compliance.add_columns(parts, &dr, &mut v);
        let change = plus_scaled(&self.motion(&r), -1.0, &self.motion(&from.r));
        self.problem.add_rigid(&change, &mut v);
        UzawaPoint { r, v }
    }

    /// `‖ŵ' − ŵ‖ / ‖r̂' − r̂‖`, zero where nothing moved.
    fn contraction(&self, from: &UzawaPoint<D>, next: &UzawaPoint<D>) -> f64 {
        let scaling = &self.problem.scaling;
        let (mut moved_v, mut moved_r) = (0.0, 0.0);
        for i in 0..from.r.len() {
            let subtracted = |v: &[f64; D]| match self.variant {
                Variant::OneProjection | Variant::Momentum if self.frozen.is_empty() => {
                    corrected(v, self.problem.law[i])
                }
                _ => *v,
            };
            let (w, next_w) = (subtracted(&from.v[i]), subtracted(&next.v[i]));
            for k in 0..D {
                moved_v += ((next_w[k] - w[k]) * scaling.to_v[i]).powi(2);
                moved_r += ((next.r[i][k] - from.r[i][k]) * scaling.to_r[i]).powi(2);
            }
        }
        if moved_r > 0.0 {
            (moved_v / moved_r).sqrt()
        } else {
            0.0
        }
    }
}
