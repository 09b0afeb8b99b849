//! Paths from inside the cones towards a solution.

use std::f64::consts::LN_2;

use crate::law::second_order::{NesterovTodd, longest_step, product};
use crate::linalg::small::Vector;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{residual, scaled_imbalance};
use crate::solver::interior::factors::{InteriorFactors, InteriorStep};
use crate::solver::interior::system::{Missed, System};
use crate::solver::monitor::Monitor;
use crate::solver::newton::compliance_form::Solved;
use crate::solver::outcome::Ended;
use crate::solver::tuning;

/// Follows paths, each from its own start, until one ends near a solution. `path` is the first
/// one to follow and becomes the next one. No path is followed twice: it would end at the same
/// point.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    path: &mut usize,
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Ended> {
    while let Some(&(smoothing, first)) = tuning::PATHS.get(*path) {
        *path += 1;
        let Some(system) = System::new(problem, smoothing)? else {
            break;
        };
        let end = follow(&system, first, monitor)?;
        if end.is_some() {
            return Ok(end);
        }
    }
    Ok(None)
}

/// One path, from `z = s = first e`; its best point, if it leads far enough.
///
/// On it `z ∘ s = σ e`, and the residual is `σ/first²` times that of the start. Where the
/// determinant changes its sign, `σ` turns and increases until the sign changes back: the
/// direction along the path is the product of the two signs.
fn follow<const D: usize>(
    system: &System<D>,
    first: f64,
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Ended> {
    let mut path = InteriorPath::new(system, first);
    for step in 0..tuning::path_steps() {
        let (r, v) = path.look(monitor)?;
        if !path.progresses(step) {
            break;
        }
        let Some(ways) = path.find_ways(&r, &v, monitor)? else {
            break;
        };
        if !path.step_back(&ways) {
            path.advance(&ways, monitor);
        }
    }
    Ok(path.end())
}

/// Reactions and relative displacements.
type Pair<const D: usize> = (Vec<[f64; D]>, Vec<[f64; D]>);

struct InteriorPath<'s, 'p, const D: usize> {
    system: &'s System<'p, D>,
    first: f64,
    at: InteriorStep<D>,
    /// The logarithm of the remaining share.
    left: f64,
    /// Both at the point before, unless the path has returned to it.
    before: Option<(InteriorStep<D>, f64)>,
    /// The residual of the start, and the sign of its determinant.
    start: Option<(Missed<D>, f64)>,
    /// The point with the least η.
    best: Option<(f64, Solved<D>)>,
    /// Length of the next step, and the number of last points near the path.
    reach: f64,
    near: usize,
    /// `left` when it last halved, and the step in which it did.
    halved: f64,
    last_halved: usize,
}

/// The two directions at a point.
struct Ways<'s, 'p, const D: usize> {
    factors: InteriorFactors<'s, 'p, D>,
    /// `σ` over that of the start, and `σ`.
    share: f64,
    sigma: f64,
    /// Along the path by the logarithm of σ, and back to it at right angles.
    along: InteriorStep<D>,
    back: InteriorStep<D>,
    /// The change of the logarithm of σ in `back`.
    turned: f64,
    /// Sizes of both in units of the distance to the boundary.
    length: f64,
    astray: f64,
}

impl<'s, 'p, const D: usize> InteriorPath<'s, 'p, D> {
    fn new(system: &'s System<'p, D>, first: f64) -> Self {
        let (n, e) = (system.problem.contacts(), unit::<D>());
        Self {
            system,
            first,
            at: InteriorStep {
                z: vec![e * first; n],
                s: vec![e * first; n],
                a: vec![0.0; system.problem.scaling.modes.len()],
            },
            left: 0.0,
            before: None,
            start: None,
            best: None,
            reach: tuning::longest_reach(),
            near: 0,
            halved: 0.0,
            last_halved: 0,
        }
    }

    /// Checks the point; returns its reactions and relative displacements.
    fn look(&mut self, monitor: &mut Monitor<D>) -> Result<Pair<D>, Ended> {
        let problem = self.system.problem;
        let r = self.system.reaction(&self.at.z);
        let rigid = problem.scaling.rigid_from_scaled(&self.at.a);
        let v = problem.relative_displacement(&r, &rigid);
        monitor.count(1.0);
        let eta = residual(problem, &r, &v, &rigid);
        let _ = monitor.look(&r, &v, &rigid, true)?;
        if self.best.as_ref().is_none_or(|(least, _)| eta < *least) {
            let r = r.clone();
            self.best = Some((eta, Solved { r, rigid }));
        }
        Ok((r, v))
    }

    /// Whether the remainder has halved lately.
    fn progresses(&mut self, step: usize) -> bool {
        if self.left <= self.halved - LN_2 {
            (self.halved, self.last_halved) = (self.left, step);
        }
        step <= self.last_halved + tuning::path_patience()
    }

    /// The directions at the point; `None` if it is at the boundary, or the matrix is singular.
    fn find_ways(
        &mut self,
        r: &[[f64; D]],
        v: &[[f64; D]],
        monitor: &mut Monitor<D>,
    ) -> Result<Option<Ways<'s, 'p, D>>, Ended> {
        let (at, system) = (&self.at, self.system);
        let pairs = at.z.iter().zip(&at.s);
        let scalings: Option<Vec<_>> = pairs.map(|(z, s)| NesterovTodd::new(z, s)).collect();
        let Some(scalings) = scalings else {
            return Ok(None);
        };
        let Some(factors) = system.factor(&at.s, scalings, monitor)? else {
            return Ok(None);
        };
        let missed = Missed {
            contacts: system.evaluate_missed(&at.s, v),
            imbalance: scaled_imbalance(system.problem, r),
        };
        let start = self
            .start
            .get_or_insert_with(|| (missed.clone(), factors.sign()));
        let share = self.left.exp();
        let sigma = self.first * self.first * share;
        let e = unit::<D>();
        let along = factors.direction(&vec![e * sigma; r.len()], &start.0.times(-share));
        let squares = factors.scalings.iter().map(|p| product(&p.point, &p.point));
        let aim: Vec<Vector<D>> = squares.map(|x| e * sigma - x).collect();
        let back = factors.direction(&aim, &missed.plus(&start.0, -share));
        monitor.count(4.0);
        let scaled = factors.scale_step(&along, sigma);
        let turned = -pairing(&scaled, &factors.scale_step(&back, sigma))
            / (1.0 + pairing(&scaled, &scaled));
        let back = back.plus(&along, turned);
        Ok(Some(Ways {
            astray: farthest(&factors.scale_step(&back, sigma)),
            length: farthest(&scaled),
            factors,
            share,
            sigma,
            along,
            back,
            turned,
        }))
    }

    /// Returns to the point before, with a shorter reach, from a point far from the path.
    fn step_back(&mut self, ways: &Ways<D>) -> bool {
        if ways.astray <= tuning::most_astray() || self.reach <= tuning::least_reach() {
            return false;
        }
        let Some(before) = self.before.take() else {
            return false;
        };
        (self.at, self.left) = before;
        self.reach = (self.reach * tuning::reach_shrink()).max(tuning::least_reach());
        true
    }

    /// Makes a step: back to the path, along it, and by the second-order term.
    fn advance(&mut self, ways: &Ways<D>, monitor: &mut Monitor<D>) {
        let (most_astray, longest_reach) = (tuning::most_astray(), tuning::longest_reach());
        let near_path = ways.astray <= 0.5 * most_astray;
        self.near = if near_path { self.near + 1 } else { 0 };
        if self.near >= 2 {
            self.reach = (self.reach * tuning::reach_growth()).min(longest_reach);
            self.near = 0;
        }
        let Some((missed_first, sense)) = &self.start else {
            return;
        };
        let factors = &ways.factors;
        let ahead = self.reach * (1.0 - ways.astray).max(0.0) / ways.length.max(1.0);
        let change = ways.turned - *sense * factors.sign() * ahead;
        let mut way = ways.back.plus(&ways.along, change - ways.turned);
        let more = change.exp_m1() - change;
        let e = unit::<D>();
        let bent = factors.scale_step(&way, 1.0);
        let bent = bent
            .iter()
            .map(|(z, s)| e * (more * ways.sigma) - product(z, s));
        let bend = factors.direction(
            &bent.collect::<Vec<_>>(),
            &missed_first.times(-more * ways.share),
        );
        monitor.count(2.0);
        if farthest(&factors.scale_step(&bend, ways.sigma)) < tuning::most_bent() {
            way = way.plus(&bend, 1.0);
        }
        let rim = longest(&self.at.z, &way.z).min(longest(&self.at.s, &way.s));
        let most = if ways.astray > most_astray {
            tuning::way_back() / ways.astray
        } else {
            1.0
        };
        let share = (tuning::path_rim() * rim).min(most);
        let next = self.at.plus(&way, share);
        self.before = Some((std::mem::replace(&mut self.at, next), self.left));
        self.left += share * change;
    }

    /// The best point, if the path has reached a small σ.
    fn end(self) -> Option<Solved<D>> {
        let sigma = self.first * self.first * self.halved.exp();
        let (_, best) = self.best?;
        (sigma <= tuning::path_enough()).then_some(best)
    }
}

fn pairing<const D: usize>(x: &[(Vector<D>, Vector<D>)], y: &[(Vector<D>, Vector<D>)]) -> f64 {
    let pairs = x.iter().zip(y);
    pairs.map(|(x, y)| x.0.dot(&y.0) + x.1.dot(&y.1)).sum()
}

fn farthest<const D: usize>(pairs: &[(Vector<D>, Vector<D>)]) -> f64 {
    let squares = pairs
        .iter()
        .map(|(z, s)| z.norm_squared() + s.norm_squared());
    squares.fold(0.0, f64::max).sqrt()
}

/// `e`.
fn unit<const D: usize>() -> Vector<D> {
    let mut e = Vector::zeros();
    e[0] = 1.0;
    e
}

fn longest<const D: usize>(x: &[Vector<D>], dx: &[Vector<D>]) -> f64 {
    let steps = x.iter().zip(dx).map(|(x, dx)| longest_step(x, dx));
    steps.fold(f64::INFINITY, f64::min)
}
