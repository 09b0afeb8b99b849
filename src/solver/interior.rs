//! An interior-point method for large sets of rigid bodies with more reactions than motions.
//!
//! With `z = (μ r̂_n, r̂_t)` and `s = (ṽ̂_n/μ, v̂_t)` the law (9) is `L ∋ z ⊥ s ∈ L`. Newton
//! steps follow `z ∘ s = σ e`, `σ → 0`, from inside the cones, as in convex programming with
//! the Nesterov–Todd scaling. The non-convex term `‖s_t‖` of `s₀ = v̂_n/μ + ‖s_t‖` is part of
//! the same Newton system. The points lead to the middle of the set of reactions that are
//! solutions. From there Newton and proximal points, which fail where reactions are not
//! determined, find the last digits.
//!
//! `‖s_t‖` has a kink where a contact sticks, at which steps stall. It is replaced by
//! `h(s) = √(θ s₀² + (1 − θ)‖s_t‖²)`, `0 < θ < 1`, which is smooth inside the cone. The
//! solutions stay the same: `v̂_n/μ = s₀ − h(s)` is zero if `s₀ = ‖s_t‖` and positive inside
//! the cone.

use std::f64::consts::LN_2;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::second_order::{self, NesterovTodd, longest_step, product, quotient};
use crate::linalg::lu::Lu;
use crate::linalg::pages;
use crate::linalg::small::{Block, Vector};
use crate::linalg::sparse::sparse_lu::SparseLu;
use crate::reduced::memory;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{residual, scaled_imbalance};
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::compliance_form::sparse_cost;
use crate::solver::newton::linearisation::{factorisation_cost, movable};
use crate::solver::newton::newton::NewtonEnd;

/// `θ` and the initial `z = s`, in units of `e`, of each attempt: a path may succeed where
/// another stalls. Paths that start far inside turn less often.
const PATHS: [(f64, f64); 6] = [
    (0.9, 10.0),
    (0.8, 10.0),
    (0.7, 10.0),
    (0.85, 100.0),
    (0.6, 1.0),
    (0.8, 1.0),
];

/// Largest number of steps, and steps within which the remainder must halve. Walls of 1,600
/// disks take 90 to 200 steps, up to 50 of them at one turn.
const MOST_STEPS: usize = 260;
const PATIENCE: usize = 100;

/// Newton and proximal points follow a path that has reached this `σ`. They solve most problems
/// that reach it and few others, for which another path costs less.
const ENOUGH: f64 = 1e-3;

/// Share of the distance to the boundary of the cone that a step keeps.
const SHORTEST: f64 = 0.9;

/// Lengths of steps along the path, where 1 reaches the boundary: the largest and first, the
/// smallest, the factor after two steps near the path, the factor after one far from it, and
/// the largest distance from the path.
const LONGEST: f64 = 0.7;
const LEAST: f64 = 0.1;
const GROW: f64 = 1.3;
const SHRINK: f64 = 0.4;
const ASTRAY: f64 = 1.0;

/// Share of the way back to the path from beyond [`ASTRAY`], in the same lengths. Full Newton
/// steps there jump across a kink without end.
const NEARER: f64 = 0.5;

/// A longer second-order term is omitted.
const MOST_BENT: f64 = 2.0;

/// With more unknowns, a matrix that is not sparse is too large to factor repeatedly.
const MOST_DENSE: usize = 1000;

/// Follows paths, each from its own start, until one ends near a solution. `path` is the first
/// one to follow and becomes the next one. No path is followed twice: it would end at the same
/// point.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    path: &mut usize,
    monitor: &mut Monitor<D>,
) -> Result<NewtonEnd<D>, Error> {
    while let Some(&(smoothing, first)) = PATHS.get(*path) {
        *path += 1;
        let Some(system) = System::new(problem, smoothing)? else {
            break;
        };
        let end = follow(&system, first, monitor)?;
        if !matches!(end, NewtonEnd::Stalled) {
            return Ok(end);
        }
    }
    Ok(NewtonEnd::Stalled)
}

/// One path, from `z = s = first e`.
///
/// On it `z ∘ s = σ e`, and the residual is `σ/first²` times that of the start. Where the
/// determinant changes its sign, `σ` turns and increases until the sign changes back: the
/// direction along the path is the product of the two signs.
fn follow<const D: usize>(
    system: &System<D>,
    first: f64,
    monitor: &mut Monitor<D>,
) -> Result<NewtonEnd<D>, Error> {
    let problem = system.problem;
    let n = problem.contacts();
    let e = unit::<D>();
    let mut at = InteriorPoint {
        z: vec![e * first; n],
        s: vec![e * first; n],
        a: vec![0.0; problem.scaling.modes.len()],
        left: 0.0,
    };
    let mut before: Option<InteriorPoint<D>> = None;
    let mut start: Option<(Missed<D>, f64)> = None;
    let mut best: Option<(f64, Vec<[f64; D]>, Vec<f64>)> = None;
    let (mut reach, mut near) = (LONGEST, 0);
    let (mut halved, mut last_halved) = (0.0, 0);
    for step in 0..MOST_STEPS {
        let r = system.reaction(&at.z);
        let rigid = problem.scaling.rigid_from_scaled(&at.a);
        let v = problem.relative_displacement(&r, &rigid);
        monitor.count(1.0);
        let eta = residual(problem, &r, &v, &rigid);
        if best.as_ref().is_none_or(|(least, ..)| eta < *least) {
            best = Some((eta, r.clone(), rigid.clone()));
        }
        if let NextStep::Stop(outcome) = monitor.look(&r, &v, &rigid, true)? {
            return Ok(NewtonEnd::Stop(outcome));
        }
        if at.left <= halved - LN_2 {
            (halved, last_halved) = (at.left, step);
        }
        if step > last_halved + PATIENCE {
            break;
        }
        let pairs = at.z.iter().zip(&at.s);
        let scalings: Option<Vec<_>> = pairs.map(|(z, s)| NesterovTodd::new(z, s)).collect();
        let Some(scalings) = scalings else { break };
        let Some(factors) = system.factors(&at.s, scalings, monitor)? else {
            break;
        };
        let missed = Missed {
            contacts: system.missed(&at.s, &v),
            imbalance: scaled_imbalance(problem, &r),
        };
        let (missed_first, sense) = start.get_or_insert_with(|| (missed.clone(), factors.sign()));
        let share = at.left.exp();
        let sigma = first * first * share;
        // Along the path by the logarithm of σ, and back to it at right angles.
        let along = factors.direction(&vec![e * sigma; n], &missed_first.times(-share));
        let squares = factors.scalings.iter().map(|p| product(&p.point, &p.point));
        let aim: Vec<Vector<D>> = squares.map(|x| e * sigma - x).collect();
        let back = factors.direction(&aim, &missed.plus(missed_first, -share));
        monitor.count(4.0);
        let scaled = factors.scaled(&along, sigma);
        let turned =
            -pairing(&scaled, &factors.scaled(&back, sigma)) / (1.0 + pairing(&scaled, &scaled));
        let back = back.plus(&along, turned);
        let astray = farthest(&factors.scaled(&back, sigma));
        if astray > ASTRAY
            && reach > LEAST
            && let Some(place) = before.take()
        {
            at = place;
            reach = (reach * SHRINK).max(LEAST);
            continue;
        }
        near = if astray <= 0.5 * ASTRAY { near + 1 } else { 0 };
        if near >= 2 {
            (reach, near) = ((reach * GROW).min(LONGEST), 0);
        }
        let ahead = reach * (1.0 - astray).max(0.0) / farthest(&scaled).max(1.0);
        let change = turned - *sense * factors.sign() * ahead;
        let mut way = back.plus(&along, change - turned);
        let more = change.exp_m1() - change;
        let bent = factors.scaled(&way, 1.0);
        let bent = bent.iter().map(|(z, s)| e * (more * sigma) - product(z, s));
        let bend = factors.direction(
            &bent.collect::<Vec<_>>(),
            &missed_first.times(-more * share),
        );
        monitor.count(2.0);
        if farthest(&factors.scaled(&bend, sigma)) < MOST_BENT {
            way = way.plus(&bend, 1.0);
        }
        let rim = longest(&at.z, &way.z).min(longest(&at.s, &way.s));
        let most = if astray > ASTRAY {
            NEARER / astray
        } else {
            1.0
        };
        let next = at.moved(&way, change, (SHORTEST * rim).min(most));
        before = Some(std::mem::replace(&mut at, next));
    }
    Ok(match best {
        Some((_, r, rigid)) if first * first * halved.exp() <= ENOUGH => {
            NewtonEnd::Better(r, rigid)
        }
        _ => NewtonEnd::Stalled,
    })
}

/// A point of a path; `left` is the logarithm of the remaining share.
struct InteriorPoint<const D: usize> {
    z: Vec<Vector<D>>,
    s: Vec<Vector<D>>,
    a: Vec<f64>,
    left: f64,
}

impl<const D: usize> InteriorPoint<D> {
    fn moved(&self, way: &InteriorStep<D>, change: f64, share: f64) -> Self {
        let there = |x: &[Vector<D>], dx: &[Vector<D>]| {
            let pairs = x.iter().zip(dx);
            pairs.map(|(x, dx)| x + dx * share).collect()
        };
        let pairs = self.a.iter().zip(&way.a);
        Self {
            z: there(&self.z, &way.z),
            s: there(&self.s, &way.s),
            a: pairs.map(|(a, da)| a + da * share).collect(),
            left: self.left + share * change,
        }
    }
}

fn pairing<const D: usize>(x: &[(Vector<D>, Vector<D>)], y: &[(Vector<D>, Vector<D>)]) -> f64 {
    let pairs = x.iter().zip(y);
    pairs.map(|(x, y)| x.0.dot(&y.0) + x.1.dot(&y.1)).sum()
}

/// The largest of the pairs.
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

/// `s = A z + B â + b + h(s) e` with `A = S Ŵ S`, `B = S R̂`, `S = diag(1/μ, 1)`.
struct System<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    /// Diagonals of `S`; a frictionless contact has only its normal component.
    stretch: Vec<Vector<D>>,
    smoothing: f64,
}

/// The residual of a point.
#[derive(Clone, Debug)]
struct Missed<const D: usize> {
    /// `s − A z − B â − b − h(s) e`.
    contacts: Vec<Vector<D>>,
    /// `Bᵀ z + ê`.
    imbalance: Vec<f64>,
}

impl<const D: usize> Missed<D> {
    fn times(&self, factor: f64) -> Self {
        Self {
            contacts: self.contacts.iter().map(|x| x * factor).collect(),
            imbalance: self.imbalance.iter().map(|x| x * factor).collect(),
        }
    }

    fn plus(&self, other: &Self, factor: f64) -> Self {
        let contacts = self.contacts.iter().zip(&other.contacts);
        let imbalance = self.imbalance.iter().zip(&other.imbalance);
        Self {
            contacts: contacts.map(|(x, y)| x + y * factor).collect(),
            imbalance: imbalance.map(|(x, y)| x + y * factor).collect(),
        }
    }
}

/// A step.
struct InteriorStep<const D: usize> {
    z: Vec<Vector<D>>,
    s: Vec<Vector<D>>,
    a: Vec<f64>,
}

impl<const D: usize> InteriorStep<D> {
    fn plus(&self, other: &Self, factor: f64) -> Self {
        let sum = |x: &[Vector<D>], y: &[Vector<D>]| {
            let pairs = x.iter().zip(y);
            pairs.map(|(x, y)| x + y * factor).collect()
        };
        Self {
            z: sum(&self.z, &other.z),
            s: sum(&self.s, &other.s),
            a: self
                .a
                .iter()
                .zip(&other.a)
                .map(|(x, y)| x + y * factor)
                .collect(),
        }
    }
}

impl<'p, const D: usize> System<'p, D> {
    /// `None` if it is too large, or if a contact cannot move, because its cone has no
    /// interior.
    fn new(problem: &'p Reduced<'p, D>, smoothing: f64) -> Result<Option<Self>, Error> {
        let n = problem.contacts();
        let modes = problem.scaling.modes.len();
        match problem.compliance.whole()? {
            Some(whole) => {
                let bytes = 2 * whole.analysis.counts().bytes_peak as u128;
                if modes > MOST_DENSE || memory::check("the factors of W", bytes).is_err() {
                    return Ok(None);
                }
            }
            None if D * n + modes > MOST_DENSE => return Ok(None),
            None => {}
        }
        if !(0..n).all(|i| (0..D).all(|k| movable(problem, i, k))) {
            return Ok(None);
        }
        let stretch = problem.mu.iter().map(|&mu| {
            let mut diagonal = Vector::repeat(f64::from(u8::from(mu > 0.0)));
            diagonal[0] = if mu > 0.0 { 1.0 / mu } else { 1.0 };
            diagonal
        });
        Ok(Some(Self {
            problem,
            stretch: stretch.collect(),
            smoothing,
        }))
    }

    fn reaction(&self, z: &[Vector<D>]) -> Vec<[f64; D]> {
        let all = z.iter().zip(&self.stretch).zip(&self.problem.scaling.to_r);
        all.map(|((z, stretch), to_r)| (z.component_mul(stretch) / *to_r).into())
            .collect()
    }

    /// `S v̂`.
    fn displacement(&self, v: &[[f64; D]]) -> Vec<Vector<D>> {
        let all = v.iter().zip(&self.stretch).zip(&self.problem.scaling.to_v);
        all.map(|((v, stretch), to_v)| Vector::from(*v).component_mul(stretch) * *to_v)
            .collect()
    }

    fn height(&self, s: &Vector<D>) -> f64 {
        let t = second_order::tangential(s);
        (self.smoothing * s[0] * s[0] + (1.0 - self.smoothing) * t * t).sqrt()
    }

    fn missed(&self, s: &[Vector<D>], v: &[[f64; D]]) -> Vec<Vector<D>> {
        let mut missed = self.displacement(v);
        for ((value, s), &mu) in missed.iter_mut().zip(s).zip(&self.problem.mu) {
            *value = s - *value;
            if mu > 0.0 {
                value[0] -= self.height(s);
            }
        }
        missed
    }

    /// `∂(s − h(s) e)/∂s`.
    fn slope(&self, s: &Vector<D>, mu: f64) -> Block<D> {
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

    /// A column of `B`.
    fn mode(&self, c: usize) -> Vec<Vector<D>> {
        let mode = self.problem.scaling.modes[c].iter().zip(&self.stretch);
        mode.map(|(m, stretch)| Vector::from(*m).component_mul(stretch))
            .collect()
    }

    /// The block `A_ij` from `W_ij`.
    fn block(&self, i: usize, j: usize, w: &Block<D>) -> Block<D> {
        let scaling = &self.problem.scaling;
        let scale = scaling.to_v[i] / scaling.to_r[j];
        Block::from_fn(|k, l| self.stretch[i][k] * w[(k, l)] * scale * self.stretch[j][l])
    }

    fn factors(
        &self,
        s: &[Vector<D>],
        scalings: Vec<NesterovTodd<D>>,
        monitor: &mut Monitor<D>,
    ) -> Result<Option<Factors<'_, 'p, D>>, Error> {
        let problem = self.problem;
        let compliance = &problem.compliance;
        let slopes = s.iter().zip(&problem.mu).map(|(s, &mu)| self.slope(s, mu));
        let slopes: Vec<Block<D>> = slopes.collect();
        let of_law = slopes.iter().zip(&scalings);
        let of_law: Vec<Block<D>> = of_law
            .map(|(slope, p)| slope * p.forward * p.forward)
            .collect();
        let scale = |i: usize| {
            let forward = &scalings[i].forward;
            let own = self.block(i, i, &compliance.block(i)) + forward * forward;
            own.diagonal().map(|d| 1.0 / d.sqrt())
        };
        let scale: Vec<Vector<D>> = (0..s.len()).map(scale).collect();
        let entry = |i: usize, j: usize, w: &Block<D>| {
            let mut block = self.block(i, j, w);
            if i == j {
                block += of_law[i];
            }
            Block::from_fn(|k, l| scale[i][k] * block[(k, l)] * scale[j][l])
        };
        let modes = problem.scaling.modes.len();
        let inner = if let Some(whole) = compliance.whole()? {
            monitor.count(sparse_cost(whole));
            let matrix = whole.blocks.map(entry);
            SparseLu::new(&whole.analysis, &matrix, monitor.stop())?.map(Factorisation::Sparse)
        } else {
            let order = D * s.len();
            monitor.count(factorisation_cost(problem, order + modes));
            let mut matrix = pages::zeros(order * order);
            for i in 0..s.len() {
                for j in 0..s.len() {
                    let block = entry(i, j, &compliance.pair(i, j));
                    for (k, l) in (0..D).flat_map(|k| (0..D).map(move |l| (k, l))) {
                        matrix[(D * i + k) * order + D * j + l] = block[(k, l)];
                    }
                }
            }
            Lu::new(matrix, order, monitor.stop())?.map(Factorisation::Dense)
        };
        let Some(inner) = inner else { return Ok(None) };
        let mut factors = Factors {
            system: self,
            scalings,
            slopes,
            of_law,
            scale,
            inner,
            border: Vec::new(),
            balance: None,
        };
        if modes > 0 {
            factors.border = (0..modes)
                .map(|c| factors.contacts(&self.mode(c)))
                .collect();
            let rows = (0..modes).map(|c| self.mode(c));
            let matrix = rows.flat_map(|mode| {
                let along = |column: &Vec<Vector<D>>| along(&mode, column);
                factors.border.iter().map(along).collect::<Vec<_>>()
            });
            let matrix: Vec<f64> = matrix.collect();
            let never = AtomicBool::new(false);
            let Some(lu) = Lu::new(matrix, modes, &never)? else {
                return Ok(None);
            };
            factors.balance = Some(lu);
        }
        Ok(Some(factors))
    }
}

fn along<const D: usize>(x: &[Vector<D>], y: &[Vector<D>]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x.dot(y)).sum()
}

enum Factorisation<'w> {
    Sparse(SparseLu<'w>),
    Dense(Lu),
}

/// `A + N P²`, `N` the slope, with the border `B`: factored.
struct Factors<'s, 'p, const D: usize> {
    system: &'s System<'p, D>,
    scalings: Vec<NesterovTodd<D>>,
    slopes: Vec<Block<D>>,
    /// `N P²`.
    of_law: Vec<Block<D>>,
    /// Factors of rows and columns. `P²` of open contacts grows without bound; without these
    /// factors it would hide the pivots of sticking contacts.
    scale: Vec<Vector<D>>,
    inner: Factorisation<'s>,
    /// `(A + N P²)⁻¹ B`, and `Bᵀ` times it.
    border: Vec<Vec<Vector<D>>>,
    balance: Option<Lu>,
}

impl<const D: usize> Factors<'_, '_, D> {
    /// The sign of the determinant.
    fn sign(&self) -> f64 {
        let inner = match &self.inner {
            Factorisation::Sparse(factors) => factors.sign(),
            Factorisation::Dense(factors) => factors.sign(),
        };
        self.balance.as_ref().map_or(inner, |lu| inner * lu.sign())
    }

    /// `P dz` and `P⁻¹ ds`, in units of the root of `aim`.
    fn scaled(&self, way: &InteriorStep<D>, aim: f64) -> Vec<(Vector<D>, Vector<D>)> {
        let unit = 1.0 / aim.sqrt();
        let pairs = self.scalings.iter().zip(way.z.iter().zip(&way.s));
        pairs
            .map(|(p, (z, s))| (p.forward * z * unit, p.inverse * s * unit))
            .collect()
    }

    /// `(A + N P²)⁻¹ b`.
    fn contacts(&self, b: &[Vector<D>]) -> Vec<Vector<D>> {
        let scaled = b.iter().zip(&self.scale);
        let mut x: Vec<f64> = scaled
            .flat_map(|(b, scale)| <[f64; D]>::from(b.component_mul(scale)))
            .collect();
        match &self.inner {
            Factorisation::Sparse(factors) => factors.solve(&mut x),
            Factorisation::Dense(factors) => factors.solve(&mut x),
        }
        let (x, _) = x.as_chunks::<D>();
        let scaled = x.iter().zip(&self.scale);
        scaled
            .map(|(x, scale)| Vector::from(*x).component_mul(scale))
            .collect()
    }

    fn bordered(&self, b: &[Vector<D>], balance: &[f64]) -> (Vec<Vector<D>>, Vec<f64>) {
        let mut x = self.contacts(b);
        let mut a = Vec::new();
        if let Some(lu) = &self.balance {
            let modes = 0..self.border.len();
            a = modes
                .map(|c| along(&self.system.mode(c), &x) - balance[c])
                .collect();
            lu.solve(&mut a);
            for (column, amount) in self.border.iter().zip(&a) {
                for (x, c) in x.iter_mut().zip(column) {
                    *x -= c * *amount;
                }
            }
        }
        (x, a)
    }

    /// `b − (A + N P²) x − B a` and `balance − Bᵀ x`.
    fn left(
        &self,
        (b, balance): (&[Vector<D>], &[f64]),
        (x, a): (&[Vector<D>], &[f64]),
    ) -> (Vec<Vector<D>>, Vec<f64>) {
        let system = self.system;
        let r = system.reaction(x);
        let mut v = vec![[0.0; D]; r.len()];
        system.problem.compliance.product(&r, &mut v);
        let mut left = system.displacement(&v);
        for (i, value) in left.iter_mut().enumerate() {
            *value = b[i] - *value - self.of_law[i] * x[i];
        }
        let mut unbalanced = balance.to_vec();
        for (c, amount) in a.iter().enumerate() {
            let mode = system.mode(c);
            unbalanced[c] -= along(&mode, x);
            for (value, m) in left.iter_mut().zip(&mode) {
                *value -= m * *amount;
            }
        }
        (left, unbalanced)
    }

    /// The step for which `λ ∘ (P dz + P⁻¹ ds)` is `aim`.
    fn direction(&self, aim: &[Vector<D>], right: &Missed<D>) -> InteriorStep<D> {
        let known = aim.iter().zip(&self.scalings);
        let known: Vec<Vector<D>> = known
            .map(|(aim, p)| p.forward * quotient(aim, &p.point))
            .collect();
        let b: Vec<Vector<D>> = (0..aim.len())
            .map(|i| self.slopes[i] * known[i] + right.contacts[i])
            .collect();
        let balance: Vec<f64> = right.imbalance.iter().map(|x| -x).collect();
        let (mut z, mut a) = self.bordered(&b, &balance);
        // Rows are exchanged within fronts only: one refinement corrects the error.
        let (left, unbalanced) = self.left((&b, &balance), (&z, &a));
        let (dz, da) = self.bordered(&left, &unbalanced);
        for (z, dz) in z.iter_mut().zip(&dz) {
            *z += dz;
        }
        for (a, da) in a.iter_mut().zip(&da) {
            *a += da;
        }
        let s = (0..z.len())
            .map(|i| {
                let forward = &self.scalings[i].forward;
                known[i] - forward * (forward * z[i])
            })
            .collect();
        InteriorStep { z, s, a }
    }
}
