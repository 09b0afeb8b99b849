//! The exact solution of one contact against all the answers there are, each
//! found by another route in doubled precision: sticking by Cramer's rule,
//! sliding by a search over all directions of slip.

use crate::common::double_double::Double;
use bipot_rs::law::cone::Status;
use bipot_rs::law::one_node::{self, Habit};
use bipot_rs::linalg::small::{Block, norm};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Problems whose answers are all found, and of the tests that need one answer.
const BLOCKS: usize = 10_000;
const FEW: usize = 2_500;

/// Of the law, relative to the terms that `v = W r + q` is summed from: what is
/// asked of the solution. Rounding of products of six factors, with a digit lost
/// to cancellation, comes to a tenth of it. Errors of the answer itself are held to
/// this times its condition.
const RESIDUAL: f64 = 1e-12;

fn double(x: f64) -> Double {
    x.into()
}

fn sqrt(x: Double) -> Double {
    if x.high <= 0.0 {
        return double(0.0);
    }
    let root = double(x.high.sqrt());
    root + (x - root * root) / (root + root)
}

fn dot(a: &[Double], b: &[Double]) -> Double {
    a.iter()
        .zip(b)
        .fold(double(0.0), |sum, (&x, &y)| sum + x * y)
}

fn length(a: &[Double]) -> Double {
    sqrt(dot(a, a))
}

/// One problem in doubled precision.
struct Exact<const D: usize> {
    w: [[Double; D]; D],
    q: [Double; D],
    mu: Double,
}

/// An answer, and how many times its own rounding one in the data makes.
struct Answer<const D: usize> {
    status: Status,
    r: [f64; D],
    condition: f64,
}

impl<const D: usize> Exact<D> {
    fn new(w: &Block<D>, q: &[f64; D], mu: f64) -> Self {
        Self {
            w: std::array::from_fn(|i| std::array::from_fn(|j| double(w[(i, j)]))),
            q: q.map(double),
            mu: double(mu),
        }
    }

    fn displacement(&self, r: &[f64; D]) -> [Double; D] {
        let r = r.map(double);
        std::array::from_fn(|i| dot(&self.w[i], &r) + self.q[i])
    }

    /// Sizes of the terms of `v_n` and of `v_t`.
    fn terms(&self, r: &[f64; D]) -> (f64, f64) {
        let row = |i: usize| {
            let products = self.w[i].iter().zip(r).map(|(w, r)| (w.high * r).abs());
            products.sum::<f64>() + self.q[i].high.abs()
        };
        (row(0), (1..D).map(row).fold(0.0, f64::hypot))
    }

    /// The largest violation of (6) and (8) by a closed contact, relative.
    fn residual(&self, r: &[f64; D], status: Status) -> f64 {
        let v = self.displacement(r);
        if status == Status::Open {
            assert!(r.iter().all(|&c| c == 0.0));
            return if v[0].high >= 0.0 { 0.0 } else { f64::INFINITY };
        }
        assert!(r[0] > 0.0, "{r:?}");
        let (n, t) = self.terms(r);
        let exact = r.map(double);
        let limit = self.mu * exact[0];
        let excess = ((length(&exact[1..]) - limit) / limit).high;
        let mut worst = (v[0].high.abs() / n).max(excess);
        if status == Status::Stick {
            return worst.max(length(&v[1..]).high / t);
        }
        worst = worst.max(-excess);
        let size = length(&exact[1..]);
        let along = dot(&v[1..], &exact[1..]) / size;
        let across = if D == 2 {
            double(0.0)
        } else {
            (v[1] * exact[D - 1] - v[D - 1] * exact[1]) / size
        };
        worst.max(along.high / t).max(across.high.abs() / t)
    }

    /// `W⁻¹ b` by Cramer's rule.
    fn solution(&self, b: [Double; D]) -> [Double; D] {
        let determinant = |replaced: usize| {
            let at = |i: usize, j: usize| if replaced == j { b[i] } else { self.w[i][j] };
            let minor =
                |i: usize, j: usize, k: usize, l: usize| at(i, k) * at(j, l) - at(i, l) * at(j, k);
            if D == 2 {
                return minor(0, 1, 0, 1);
            }
            let rest = [minor(1, 2, 1, 2), minor(1, 2, 0, 2), minor(1, 2, 0, 1)];
            at(0, 0) * rest[0] - at(0, 1) * rest[1] + at(0, 2) * rest[2]
        };
        let whole = determinant(D); // no column replaced
        std::array::from_fn(|j| determinant(j) / whole)
    }

    fn stick(&self) -> Option<Answer<D>> {
        let r = self.solution(self.q.map(|c| double(0.0) - c));
        let plain = r.map(|c| c.high);
        let unit = |j: usize| std::array::from_fn(|i| double(f64::from(u8::from(i == j))));
        let inverse = Block::<D>::from_fn(|i, j| self.solution(unit(j))[i].high);
        let w = Block::<D>::from_fn(|i, j| self.w[i][j].high);
        // ‖W⁻¹‖ (‖W‖ ‖r‖ + ‖q‖) over ‖r‖, the sensitivity to rounding of both.
        let terms = w.norm() * norm(&plain) + norm(&self.q.map(|c| c.high));
        let moved = inverse.norm() * terms;
        let condition = moved / norm(&plain);
        let limit = self.mu * r[0];
        let excess = (length(&r[1..]) - limit).high;
        let slack = RESIDUAL * moved * (1.0 + self.mu.high);
        (r[0].high > -slack && excess <= slack).then_some(Answer {
            status: Status::Stick,
            r: plain,
            condition,
        })
    }

    fn open(&self) -> Option<Answer<D>> {
        (self.q[0].high >= 0.0).then_some(Answer {
            status: Status::Open,
            r: [0.0; D],
            condition: 1.0,
        })
    }

    /// The sliding answer with friction along `p`, if it is one. `turning` says
    /// how rounding of the data turns `p`.
    fn sliding(&self, p: &[Double], turning: f64) -> Option<Answer<D>> {
        let size = length(p);
        let c: Vec<Double> = p.iter().map(|&x| x / size).collect();
        let coupled = self.mu * dot(&self.w[0][1..], &c);
        let held = self.w[0][0] + coupled;
        let r_n = (double(0.0) - self.q[0]) / held;
        if !(r_n.high > 0.0) {
            return None;
        }
        let exact: [Double; D] = std::array::from_fn(|k| {
            if k == 0 {
                r_n
            } else {
                self.mu * r_n * c[k - 1]
            }
        });
        let r = exact.map(|x| x.high);
        let reach = self.mu.high * self.w[0][1..].iter().map(|x| x.high.abs()).sum::<f64>();
        let amplified = (self.w[0][0].high + reach) / held.high;
        let condition = turning * amplified + amplified;
        let v: Vec<Double> = (1..D)
            .map(|i| dot(&self.w[i], &exact) + self.q[i])
            .collect();
        let slack = RESIDUAL * condition * self.terms(&r).1;
        (dot(&v, &c).high <= slack).then_some(Answer {
            status: Status::Slip,
            r,
            condition,
        })
    }
}

impl Exact<3> {
    /// Sizes of the terms of [`Across`] before the normal is eliminated, which
    /// rounding of the data is in proportion to.
    fn terms_of_across(&self) -> f64 {
        let (w, q) = (
            self.w.map(|row| row.map(|c| c.high)),
            self.q.map(|c| c.high),
        );
        let mu = self.mu.high;
        let (tt, tn) = (
            norm(&[norm(&w[1][1..]), norm(&w[2][1..])]),
            w[1][0].hypot(w[2][0]),
        );
        q[0].abs() * (mu * tt + tn) + norm(&q[1..]) * (w[0][0] + mu * norm(&w[0][1..]))
    }
}

fn answers_in_the_plane(exact: &Exact<2>) -> Vec<Answer<2>> {
    let slides = [1.0, -1.0].map(|c| exact.sliding(&[double(c)], 0.0));
    let others = [exact.open(), exact.stick()];
    others.into_iter().chain(slides).flatten().collect()
}

/// Friction along `p` and slip along its opposite ask that `v_t` has no component
/// across `p`. With `v_n = 0` eliminated, times `(W_nn + μ W_nt c) |p|²`, that is
/// `F = −q_n μ p⊥·W̃ p + (p⊥·q̃) (W_nn |p| + μ W_nt p)`: of second degree in the
/// cosine and the sine, with four roots at most.
struct Across<T> {
    /// `−q_n μ W̃`.
    friction: [[T; 2]; 2],
    /// `q̃`.
    q: [T; 2],
    /// `W_nn` and `μ W_nt`.
    w_nn: T,
    nt: [T; 2],
}

impl Across<Double> {
    fn new(exact: &Exact<3>) -> Self {
        let (w, q) = (&exact.w, &exact.q);
        let limit = (double(0.0) - q[0]) * exact.mu;
        let ratio = |i: usize| w[i][0] / w[0][0];
        Self {
            friction: [1, 2].map(|i| [1, 2].map(|j| limit * (w[i][j] - ratio(i) * w[0][j]))),
            q: [1, 2].map(|i| q[i] - ratio(i) * q[0]),
            w_nn: w[0][0],
            nt: [exact.mu * w[0][1], exact.mu * w[0][2]],
        }
    }

    fn plain(&self) -> Across<f64> {
        let of = |pair: [Double; 2]| pair.map(|x| x.high);
        Across {
            friction: self.friction.map(of),
            q: of(self.q),
            w_nn: self.w_nn.high,
            nt: of(self.nt),
        }
    }

    fn at(&self, p: [Double; 2]) -> Double {
        let held = self.w_nn * length(&p) + dot(&self.nt, &p);
        let part = |i: usize| dot(&self.friction[i], &p) + held * self.q[i];
        p[0] * part(1) - p[1] * part(0)
    }
}

impl Across<f64> {
    fn at(&self, [c, s]: [f64; 2]) -> f64 {
        let held = self.w_nn + self.nt[0] * c + self.nt[1] * s;
        let part = |i: usize| self.friction[i][0] * c + self.friction[i][1] * s + held * self.q[i];
        c * part(1) - s * part(0)
    }

    /// Derivative by the angle.
    fn slope(&self, [c, s]: [f64; 2]) -> f64 {
        let held = self.w_nn + self.nt[0] * c + self.nt[1] * s;
        let turned = self.nt[1] * c - self.nt[0] * s;
        let part = |i: usize| self.friction[i][0] * c + self.friction[i][1] * s + held * self.q[i];
        let change =
            |i: usize| self.friction[i][1] * c - self.friction[i][0] * s + turned * self.q[i];
        c * change(1) - s * change(0) - s * part(1) - c * part(0)
    }

    /// `T ≥ |F|`, with `|F'| ≤ 2 T` and `|F''| ≤ 4 T`.
    fn terms(&self) -> f64 {
        norm(self.friction.as_flattened()) + norm(&self.q) * (self.w_nn + norm(&self.nt))
    }
}

fn direction(angle: f64) -> [f64; 2] {
    [angle.cos(), angle.sin()]
}

/// Where `F` changes sign between two angles.
fn bisected(across: &Across<f64>, mut low: f64, mut high: f64) -> f64 {
    let positive = |a: f64| across.at(direction(a)) > 0.0;
    let sign = positive(low);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if positive(middle) == sign {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// All angles with `F = 0` between two others: none where `F` is larger than its
/// slope can undo, one at most where the slope cannot change sign, else the
/// halves are looked at.
fn angles(across: &Across<f64>, terms: f64, low: f64, high: f64, found: &mut Vec<f64>) {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let here = direction(middle);
    if across.at(here).abs() > 2.0 * terms * half {
        return;
    }
    if across.slope(here).abs() > 4.0 * terms * half {
        let positive = |a: f64| across.at(direction(a)) > 0.0;
        if positive(low) != positive(high) {
            found.push(bisected(across, low, high));
        }
    } else if half < 1e-12 {
        found.push(middle); // a double root, to rounding
    } else {
        angles(across, terms, low, middle, found);
        angles(across, terms, middle, high, found);
    }
}

fn answers_in_space(exact: &Exact<3>) -> Vec<Answer<3>> {
    let mut all: Vec<_> = [exact.open(), exact.stick()]
        .into_iter()
        .flatten()
        .collect();
    if exact.q[0].high >= 0.0 {
        return all;
    }
    let across = Across::new(exact);
    let plain = across.plain();
    let mut found = Vec::new();
    let turn = std::f64::consts::TAU;
    angles(&plain, plain.terms(), 0.0, turn, &mut found);
    for angle in found {
        let [c, s] = direction(angle);
        let slope = plain.slope([c, s]);
        let turning = exact.terms_of_across() / slope.abs();
        // Newton's method with the slope of plain precision: eight digits a step.
        let mut p = [double(c), double(s)];
        for _ in 0..6 {
            let turn = across.at(p) / double(slope);
            if !(turn.high.abs() > 1e-28 && turn.high.abs() < 1e-3) {
                break;
            }
            p = [p[0] + turn * p[1], p[1] - turn * p[0]];
        }
        all.extend(exact.sliding(&p, turning));
    }
    all
}

/// Random problems, from mild to nasty. `W = Gᵀ G` is formed with rounding and
/// is what it then is.
struct Blocks {
    rng: StdRng,
    kind: usize,
}

impl Blocks {
    fn new(seed: u64) -> Self {
        let rng = StdRng::seed_from_u64(seed);
        Self { rng, kind: 0 }
    }

    fn power(&mut self, low: f64, high: f64) -> f64 {
        10.0_f64.powf(self.rng.random_range(low..high))
    }

    fn block(&mut self) -> Block<3> {
        let mut g = Block::<3>::zeros();
        g.iter_mut()
            .for_each(|x| *x = self.rng.random_range(-1.0..1.0));
        match self.kind % 4 {
            // Mild, in any units.
            0 => {
                let units = self.power(-12.0, 12.0);
                (g * g.transpose() + Block::identity() * 0.01) * units
            }
            // Conditions up to 1e8 and more, in no particular direction.
            1 => g * g.transpose() + Block::identity() * self.power(-8.0, 0.0),
            // Components of very different stiffness.
            2 => {
                let sizes: [f64; 3] = std::array::from_fn(|_| self.power(-3.0, 0.0));
                let d = Block::from_diagonal(&sizes.into());
                d * (g * g.transpose() + Block::identity() * 1e-3) * d
            }
            // Tangents that move with the normal: W̃ is nearly nothing.
            _ => {
                let column = g.column(0).into_owned();
                let rest = self.power(-10.0, -1.0);
                let mut w = column * column.transpose() + g * g.transpose() * rest;
                w[(0, 0)] *= 1.0 + rest;
                w
            }
        }
    }

    fn next(&mut self) -> (Block<3>, [f64; 3], f64) {
        self.kind += 1;
        let mut w = self.block();
        w = (w + w.transpose()) * 0.5;
        let mu = if self.rng.random() {
            self.power(-1.0, 0.3)
        } else {
            self.power(-8.0, 8.0)
        };
        let mut q: [f64; 3] = std::array::from_fn(|_| self.rng.random_range(-1.0..1.0));
        match self.rng.random_range(0..4) {
            // Barely touching.
            0 => q[0] *= self.power(-16.0, 0.0),
            // On the border of stick and slip, but for a little.
            1 => {
                let turn = direction(self.rng.random_range(0.0..std::f64::consts::TAU));
                let r = [1.0, mu * turn[0], mu * turn[1]].map(|c| c / mu.max(1.0));
                let little = self.power(-17.0, -3.0);
                q = std::array::from_fn(|i| {
                    -(0..3).map(|j| w[(i, j)] * r[j]).sum::<f64>() * (1.0 + little * q[i])
                });
            }
            _ => q[0] = -q[0].abs(),
        }
        (w, q, mu)
    }
}

/// What was seen on the way: answers by status, and how many could not be told
/// apart from another for their condition.
#[derive(Debug, Default)]
struct Seen {
    statuses: [usize; 3],
    several: usize,
    vague: usize,
}

fn check<const D: usize>(
    exact: &Exact<D>,
    found: Option<([f64; D], Status)>,
    answers: &[Answer<D>],
    seen: &mut Seen,
) {
    let case = || {
        let w = Block::<D>::from_fn(|i, j| exact.w[i][j].high);
        format!("{w:?} {:?} {:e}", exact.q.map(|c| c.high), exact.mu.high)
    };
    let (r, status) = found.unwrap_or_else(|| panic!("no answer to {}", case()));
    seen.statuses[status as usize] += 1;
    seen.several += usize::from(answers.len() > 1);
    let residual = exact.residual(&r, status);
    assert!(
        residual <= RESIDUAL,
        "{residual:e} {r:?} {status:?} {}",
        case()
    );
    let near = |a: &&Answer<D>| {
        let distance: [f64; D] = std::array::from_fn(|k| a.r[k] - r[k]);
        // On their border stick and slip are one; the residual told them apart off it.
        (a.status == Status::Open) == (status == Status::Open)
            && !(norm(&distance) > RESIDUAL * a.condition * norm(&a.r))
    };
    let all: Vec<_> = answers
        .iter()
        .map(|a| (a.status, a.r, a.condition))
        .collect();
    let Some(answer) = answers.iter().find(near) else {
        panic!("{r:?} {status:?} is none of {all:?}: {}", case())
    };
    seen.vague += usize::from(!(answer.condition < 1e-3 / RESIDUAL));
}

#[test]
fn every_answer_is_one_of_those_there_are() {
    let mut blocks = Blocks::new(1991);
    let (mut plane, mut space) = (Seen::default(), Seen::default());
    for _ in 0..BLOCKS {
        let (w, q, mu) = blocks.next();
        let exact = Exact::<3>::new(&w, &q, mu);
        let found = one_node::solve(&w, &q, mu, Habit::None);
        check(&exact, found, &answers_in_space(&exact), &mut space);

        let (w, q) = (w.fixed_view::<2, 2>(0, 0).into_owned(), [q[0], q[1]]);
        let exact = Exact::<2>::new(&w, &q, mu);
        let found = one_node::solve(&w, &q, mu, Habit::None);
        check(&exact, found, &answers_in_the_plane(&exact), &mut plane);
    }
    for seen in [plane, space] {
        assert!(seen.statuses.iter().all(|&n| n > BLOCKS / 10), "{seen:?}");
        assert!(seen.several > BLOCKS / 100, "{seen:?}");
        assert!(seen.vague < BLOCKS / 20, "{seen:?}");
    }
}

/// Where sticking fits, a contact that was closed sticks.
#[test]
fn a_closed_contact_sticks_where_it_can() {
    let mut blocks = Blocks::new(7);
    let mut opening = 0;
    for _ in 0..FEW {
        let (w, q, mu) = blocks.next();
        let exact = Exact::<3>::new(&w, &q, mu);
        let Some(answer) = exact.stick() else {
            continue;
        };
        // On a border rounding decides, and far from it for a bad condition.
        let room = (mu * answer.r[0] - norm(&answer.r[1..])) / norm(&answer.r);
        if room <= RESIDUAL * answer.condition * (1.0 + mu) {
            continue;
        }
        let (r, status) = one_node::solve(&w, &q, mu, Habit::Closed).unwrap();
        assert_eq!(status, Status::Stick, "{w} {q:?} {mu:e}");
        assert!(exact.residual(&r, status) <= RESIDUAL);
        opening += usize::from(q[0] >= 0.0);
    }
    assert!(opening > FEW / 50, "{opening} were also open");
}

/// A measured block is not symmetric; its sliding is held to the same equations.
#[test]
fn blocks_need_not_be_symmetric() {
    let mut blocks = Blocks::new(16);
    let mut statuses = [0; 3];
    for _ in 0..FEW {
        let (mut w, q, mu) = blocks.next();
        if w.symmetric_eigenvalues().min() < 0.05 * w.trace() {
            continue; // the change must not take the answers away
        }
        let size = w.trace() * blocks.power(-16.0, -2.0);
        w.iter_mut()
            .for_each(|x| *x += blocks.rng.random_range(-1.0..1.0) * size);
        let exact = Exact::<3>::new(&w, &q, mu);
        let Some((r, status)) = one_node::solve(&w, &q, mu, Habit::None) else {
            panic!("no answer to {w} {q:?} {mu:e}");
        };
        statuses[status as usize] += 1;
        assert!(exact.residual(&r, status) <= RESIDUAL, "{w} {q:?} {mu:e}");
    }
    assert!(statuses.iter().all(|&n| n > FEW / 50), "{statuses:?}");
}

#[test]
fn powers_of_two_of_the_units_change_no_bit() {
    let mut blocks = Blocks::new(2);
    for _ in 0..FEW {
        let (w, q, mu) = blocks.next();
        // Past ±200 squares of the numbers leave the range of doubles.
        let (a, b) = (
            blocks.rng.random_range(-400..400),
            blocks.rng.random_range(-400..400),
        );
        let (compliance, length) = (2.0_f64.powi(a), 2.0_f64.powi(b));
        let here = one_node::solve(&w, &q, mu, Habit::None).unwrap();
        let there = one_node::solve(&(w * compliance), &q.map(|c| c * length), mu, Habit::None);
        let expected = here.0.map(|c| c * 2.0_f64.powi(b - a));
        assert_eq!(there, Some((expected, here.1)), "{w} {q:?} {mu:e}");
    }
}

/// Whatever the numbers: an end, no NaN, no infinity, and nothing outside the cone.
#[test]
fn extreme_numbers_give_finite_results() {
    let mut rng = StdRng::seed_from_u64(666);
    let sizes = [0.0, 1.0, 1.0, 1e-16, 1e8, 1e-300, 1e300];
    let mut wild = |kinds: usize| sizes[rng.random_range(0..kinds)] * rng.random_range(-1.0..1.0);
    for try_of in 0..BLOCKS {
        // Every other time without the numbers near the ends of the range.
        let kinds = [5, 7][try_of % 2];
        let mut w = Block::<3>::zeros();
        w.iter_mut().for_each(|x| *x = wild(kinds));
        let q = [wild(kinds), wild(kinds), wild(kinds)];
        let mu: f64 = wild(kinds).abs();
        for habit in [Habit::None, Habit::Closed] {
            let case = |r: &[f64]| format!("{w:e} {q:?} {mu:e} {r:?}");
            let valid = |r: &[f64]| r.iter().all(|c| c.is_finite()) && r[0] >= 0.0;
            let plane = w.fixed_view::<2, 2>(0, 0).into_owned();
            if let Some((r, _)) = one_node::solve(&plane, &[q[0], q[1]], mu, habit) {
                assert!(valid(&r), "{}", case(&r));
            }
            if let Some((r, _)) = one_node::solve(&w, &q, mu, habit) {
                assert!(valid(&r), "{}", case(&r));
                // Near the ends of the range the numbers of the cone lose digits.
                let excess = r[1].hypot(r[2]) - mu * r[0];
                let near = excess <= RESIDUAL * mu * r[0];
                assert!(kinds == 7 || near, "{}", case(&r));
            }
        }
    }
}
