//! The paper's variational principles and complementary pivoting as methods: what
//! each is proved to do, and what it honestly does not.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;

use crate::common::GO;
use crate::common::cases::{Case, apart, difference, settings};
use bipot_rs::error::Error;
use bipot_rs::law::cone::{Status, project};
use bipot_rs::law::frozen::Frozen;
use bipot_rs::linalg::dense::symmetric_eigen;
use bipot_rs::proof::error_bound::Prepared;
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::Reduced;
use bipot_rs::solver::enumerate::Enumeration;
use bipot_rs::solver::evaluated_point::EvaluatedPoint;
use bipot_rs::solver::monitor::{Monitor, Progress};
use bipot_rs::solver::outcome::Ended;
use bipot_rs::solver::paper::principles::convex::minimise;
use bipot_rs::solver::paper::principles::minimising_sequence::Sequence;
use bipot_rs::solver::paper::principles::{
    alternating_principles, displacement_principle, minimising_sequence, stress_principle,
};
use bipot_rs::solver::{Method, Outcome, Settings, Start, enumerate, solve};
use rand::{RngExt, SeedableRng, rngs::StdRng};

const PAPER: [Method; 7] = [
    Method::ReturnMapping,
    Method::PerturbedLagrangian,
    Method::Pivoting,
    Method::DisplacementPrinciple,
    Method::AlternatingPrinciples,
    Method::StressPrinciple,
    Method::MinimisingSequence,
];

// Dense algebra of small matrices, rows of rows.

type Matrix = Vec<Vec<f64>>;

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    let columns = b[0].len();
    a.iter()
        .map(|row| {
            (0..columns)
                .map(|j| row.iter().zip(b).map(|(x, b)| x * b[j]).sum())
                .collect()
        })
        .collect()
}

fn transposed(a: &Matrix) -> Matrix {
    (0..a[0].len())
        .map(|j| a.iter().map(|row| row[j]).collect())
        .collect()
}

/// A function of a symmetric matrix, by its eigenvalues.
fn function(a: &Matrix, f: impl Fn(f64) -> f64) -> Matrix {
    let n = a.len();
    let (mut vectors, mut values) = (a.concat(), vec![0.0; n]);
    symmetric_eigen(&mut vectors, n, &mut values);
    // Eigenvectors by columns; their order is that of the values.
    let entry = |i: usize, j: usize| {
        (0..n)
            .map(|k| vectors[k * n + i] * f(values[k]) * vectors[k * n + j])
            .sum()
    };
    (0..n)
        .map(|i| (0..n).map(|j| entry(i, j)).collect())
        .collect()
}

/// The largest singular value.
fn norm(a: &Matrix) -> f64 {
    let square = times(&transposed(a), a);
    let (mut vectors, mut values) = (square.concat(), vec![0.0; square.len()]);
    symmetric_eigen(&mut vectors, square.len(), &mut values);
    values.iter().fold(0.0_f64, |m, &x| m.max(x)).sqrt()
}

fn part(a: &Matrix, rows: &[usize], columns: &[usize]) -> Matrix {
    rows.iter()
        .map(|&i| columns.iter().map(|&j| a[i][j]).collect())
        .collect()
}

/// `√(xᵀ A x)`.
fn length(a: &Matrix, x: &[f64]) -> f64 {
    let of_row =
        |(row, xi): (&Vec<f64>, &f64)| xi * row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
    a.iter().zip(x).map(of_row).sum::<f64>().sqrt()
}

/// `W`, and the factors by which passes are proved to contract.
struct Factors {
    w: Matrix,
    /// `L = √(λ_max(M½ W_tt M½) λ_max(M½ (W⁻¹)_nn M½))`.
    whole: f64,
    /// `κ ξ` of the alternating principles.
    alternating: f64,
    tangential: Vec<usize>,
}

impl Factors {
    fn new<const D: usize>(case: &Case<D>) -> Self {
        let m = D * case.q.len();
        let dense = case.compliance.to_dense();
        let w: Matrix = dense.chunks(m).map(<[f64]>::to_vec).collect();
        let (n, t): (Vec<usize>, Vec<usize>) = (0..m).partition(|k| k % D == 0);
        let mu = case.mu[0]; // the same at all contacts of these cases
        let inverse = function(&w, |x| 1.0 / x);
        let w_tt = part(&w, &t, &t);
        let whole = mu * (norm(&w_tt) * norm(&part(&inverse, &n, &n))).sqrt();
        let w_nn = part(&w, &n, &n);
        let root = |a: &Matrix| function(a, |x| 1.0 / x.sqrt());
        let coupling = times(&times(&root(&w_nn), &part(&w, &n, &t)), &root(&w_tt));
        let kappa = norm(&coupling);
        let l = mu * (norm(&w_tt) * norm(&function(&w_nn, |x| 1.0 / x))).sqrt();
        let sum = kappa + l;
        Self {
            w,
            whole,
            alternating: kappa * 0.5 * (sum + (sum * sum + 4.0 * kappa * l).sqrt()),
            tangential: t,
        }
    }
}

/// The answer of a frozen problem, to rounding.
fn answer<const D: usize>(
    problem: &Reduced<D>,
    frozen: Vec<Frozen<D>>,
    from: &EvaluatedPoint<D>,
) -> EvaluatedPoint<D> {
    let (settings, progress) = (settings(Method::Auto, 1e-15), Progress::default());
    let mut monitor = Monitor::new(problem, &settings, &GO, &progress);
    let enough = 1e-13 * from.merit(problem);
    minimise(problem, frozen, from, enough, &mut monitor).unwrap()
}

/// Reactions in the cones, of the size of answers.
fn reactions<const D: usize>(case: &Case<D>, seed: u64) -> Vec<[f64; D]> {
    let mut rng = StdRng::seed_from_u64(seed);
    let any = |mu: &f64| {
        let tau = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        project(&tau, *mu).0
    };
    case.mu.iter().map(any).collect()
}

/// Passes from two points are nearer to each other than the points, by the factor
/// that is proved; and how much of it they use at the most.
fn contracts<const D: usize>(case: &Case<D>, seed: u64, used: &mut [f64; 3]) {
    let mut factors = Factors::new(case);
    let problem = case.problem();
    let bounds = Prepared::new(&problem, &GO).unwrap();
    let open = vec![[0.0; D]; case.q.len()];
    let bound = bounds.bound(&problem, (&open, &[]), None, &GO).unwrap();
    match bound.contraction {
        // It has a weight for each contact, and a margin of 1.02^1.5.
        Some(proved) => {
            assert!(
                proved <= 1.031 * factors.whole,
                "{proved} {}",
                factors.whole
            );
            factors.whole = factors.whole.min(proved);
        }
        None => assert!(factors.whole > 0.9, "{}", factors.whole),
    }
    let at = |seed| EvaluatedPoint::new(&problem, reactions(case, seed), Vec::new());
    let (x, y) = (at(seed), at(seed + 1000));
    // Frozen problems are solved to 1e-13.
    let slack = 1.0 + 1e-9;
    let before = length(&factors.w, &apart(&x.r, &y.r));
    let tresca =
        |p: &EvaluatedPoint<D>| answer(&problem, displacement_principle::frozen(&problem, &p.r), p);
    let cone =
        |p: &EvaluatedPoint<D>| answer(&problem, stress_principle::frozen(&problem, &p.v), p);
    for (k, (x, y)) in [(tresca(&x), tresca(&y)), (cone(&x), cone(&y))]
        .iter()
        .enumerate()
    {
        let after = length(&factors.w, &apart(&x.r, &y.r));
        assert!(after <= slack * factors.whole * before, "{k} {seed}");
        used[k] = used[k].max(after / (factors.whole * before));
    }
    let turn = |p: &EvaluatedPoint<D>| {
        let pressed = answer(&problem, alternating_principles::frozen_friction(&p.r), p);
        let friction = alternating_principles::frozen_contact(&problem, &pressed.r);
        answer(&problem, friction, &pressed)
    };
    let tangential = |a: &EvaluatedPoint<D>, b: &EvaluatedPoint<D>| {
        let all = apart(&a.r, &b.r);
        let own: Vec<f64> = factors.tangential.iter().map(|&k| all[k]).collect();
        length(
            &part(&factors.w, &factors.tangential, &factors.tangential),
            &own,
        )
    };
    let before = tangential(&x, &y);
    let after = tangential(&turn(&x), &turn(&y));
    assert!(after <= slack * factors.alternating * before, "{seed}");
    used[2] = used[2].max(after / (factors.alternating * before));
}

#[test]
fn passes_contract_by_the_factors_that_are_proved() {
    let mut used = [0.0; 3];
    for seed in 0..20 {
        for mu in [0.1, 0.5, 1.5] {
            contracts(&Case::<2>::held(6, mu, seed), seed, &mut used);
            contracts(&Case::<3>::held(5, mu, seed), seed, &mut used);
        }
    }
    // Bounds that nothing comes near would prove little.
    assert!(used.iter().all(|&share| share > 0.15), "{used:?}");
}

/// A single contact whose normal and tangential motions are coupled by `c`.
fn coupled(c: f64, q: [f64; 2], mu: f64) -> Case<2> {
    let inverse = |k: [f64; 3]| {
        let det = k[0] * k[2] - k[1] * k[1];
        vec![k[2] / det, -k[1] / det, -k[1] / det, k[0] / det]
    };
    let mut case = Case::<2>::held(1, mu, 0);
    case.compliance = Compliance::from_dense(1, Cow::Owned(inverse([1.0, c, 1.0]))).unwrap();
    case.q = vec![q];
    case
}

/// `B` along the sequence.
fn told<const D: usize>(case: &Case<D>, start: &Start<D>, tol: f64) -> (Vec<f64>, Outcome) {
    let problem = case.problem();
    let (settings, progress) = (settings(Method::Auto, tol), Progress::default());
    let mut monitor = Monitor::new(&problem, &settings, &GO, &progress);
    let mut sequence = Sequence::default();
    let end = minimising_sequence::run(&problem, start, &mut monitor, &mut sequence);
    let outcome = match end {
        Ok(()) => Outcome::Stalled,
        Err(Ended::Stopped(outcome)) => outcome,
        Err(Ended::Failed(error)) => panic!("{error}"),
    };
    (sequence.bifunctional, outcome)
}

/// Falling at each step, as far as rounding lets it be seen.
fn falls(history: &[f64], energy: f64) {
    for pair in history.windows(2) {
        // Steps are solved to the rounding of the law, 1e-14 of its terms, which penetration
        // then has; reactions work on it at all contacts.
        let rounding = 1e-12 * energy;
        assert!(pair[1] <= pair[0] + rounding, "{history:?}");
        assert!(pair[1] >= -rounding);
    }
}

#[test]
fn the_bifunctional_decreases_to_zero_in_every_step() {
    let mut slid = 0;
    for seed in 0..12 {
        for mu in [0.2, 0.6, 1.2] {
            let case = Case::<3>::held(8, mu, seed);
            let (history, outcome) = told(&case, &Start::default(), 1e-9);
            assert_eq!(outcome, Outcome::Converged);
            assert!(history.len() > 4);
            // What reactions do on the free displacement, of which B is a difference.
            let solved = case.solve(Method::Auto);
            let r = &solved.reaction;
            let work = r.as_flattened().iter().zip(case.q.as_flattened());
            let energy: f64 = work.map(|(r, q)| (r * q).abs()).sum();
            falls(&history, energy);
            // Of second order: a residual of 1e-9 leaves rounding alone, and the step before
            // the one that ends it, which is not told, little more.
            // Where nothing slides a step meets the answer on its way, whatever is frozen.
            if solved.status.contains(&Status::Slip) {
                slid += 1;
                let last = *history.last().unwrap() / energy;
                assert!(last <= 1e-11, "{seed} {mu} {last:e}: {history:?}");
            }
            assert!(history[0] >= 1e-4 * energy);
        }
    }
    assert!(slid > 20, "{slid}");
}

#[test]
fn the_bifunctional_may_decrease_to_a_positive_limit() {
    // Coupling and friction so strong that L is far above one.
    let mut stalled = 0;
    for k in 0..40 {
        let angle = 0.16 * f64::from(k);
        let case = coupled(0.9, [angle.cos(), angle.sin()], 3.0);
        let start = Start {
            reaction: vec![[1.0, 0.7]],
            ..Start::default()
        };
        let (history, outcome) = told(&case, &start, 1e-10);
        falls(&history, history.first().copied().unwrap_or(1.0));
        let settings = settings(Method::MinimisingSequence, 1e-10);
        let solution = solve(&case.problem(), &settings, &start, &GO).unwrap();
        assert_eq!(solution.outcome, outcome);
        if outcome == Outcome::Stalled {
            stalled += 1;
            assert!(solution.residual > solution.tolerance);
            // At rest, and not at zero.
            let last = history.last().unwrap();
            assert!(*last > 1e-3 * history[0], "{history:?}");
            let before = history[history.len() - 3];
            assert!((before - last).abs() <= 1e-6 * last, "{history:?}");
        }
    }
    assert!(stalled > 0);
}

/// The distance of the nearest answer.
fn nearest(all: &Enumeration<2>, reaction: &[[f64; 2]]) -> f64 {
    let answers = all.answers.iter();
    let apart = answers.map(|(r, _)| difference(reaction, r));
    apart.fold(f64::INFINITY, f64::min)
}

/// What every method says of problems whose friction is beyond all proofs.
#[test]
fn beyond_the_limits_no_wrong_point_is_a_solution() {
    for seed in 0..10 {
        for mu in [3.0, 10.0] {
            let plane = Case::<2>::held(5, mu, seed);
            let problem = plane.problem();
            let all = enumerate::answers(&problem, &GO).unwrap();
            assert!(all.complete);
            for method in PAPER {
                let solution = plane.run(&Settings {
                    max_iterations: 2000,
                    ..settings(method, 1e-12)
                });
                if solution.outcome == Outcome::Converged {
                    let nearest = nearest(&all, &solution.reaction);
                    // η of 1e-12 and a condition that friction has made worse.
                    assert!(nearest <= 1e-8, "{method:?} {seed} {mu}: {nearest:e}");
                } else {
                    assert!(solution.residual > solution.tolerance);
                }
            }
        }
    }
}

#[test]
fn pivoting_in_the_plane_ends_at_an_answer_whatever_friction_is() {
    for seed in 0..40 {
        for mu in [0.0, 0.3, 1.0, 4.0, 30.0] {
            let case = Case::<2>::held(7, mu, seed);
            let solution = case.solve(Method::Pivoting);
            assert_eq!(solution.outcome, Outcome::Converged, "{seed} {mu}");
            // The law is piecewise linear: exact but for the solution of the last system.
            assert!(solution.residual <= solution.floor, "{seed} {mu}");
            let problem = case.problem();
            let all = enumerate::answers(&problem, &GO).unwrap();
            let nearest = nearest(&all, &solution.reaction);
            // The condition of the law of given statuses, large where μ is.
            assert!(nearest <= 1e-9, "{seed} {mu}: {nearest:e}");
        }
    }
}

#[test]
fn pivoting_on_ties_does_not_cycle() {
    // Contacts that are all alike, and loads along the normal alone: all close at once,
    // with no slip to tell a direction.
    for contacts in [1, 4, 9] {
        let m = 3 * contacts;
        let mut w = vec![0.0; m * m];
        for i in 0..m {
            w[i * (m + 1)] = 1.0;
        }
        let mut case = Case::<3>::held(contacts, 0.5, 0);
        case.compliance = Compliance::from_dense(contacts, Cow::Owned(w)).unwrap();
        for pull in [[0.0, 0.0], [0.5, 0.0], [0.3, 0.3], [2.0, -2.0]] {
            case.q = vec![[-1.0, pull[0], pull[1]]; contacts];
            let solution = case.solve(Method::Pivoting);
            assert_eq!(solution.outcome, Outcome::Converged, "{contacts} {pull:?}");
            // W = 1: each contact for itself, by the projection of −q.
            let length = pull[0].hypot(pull[1]);
            let share = if length > 0.5 { 0.5 / length } else { 1.0 };
            for r in &solution.reaction {
                let exact = [1.0, -share * pull[0], -share * pull[1]];
                for k in 0..3 {
                    assert!((r[k] - exact[k]).abs() <= 1e-11); // η = 1e-12
                }
            }
        }
    }
}

#[test]
fn bodies_held_by_contact_alone_are_refused_by_name() {
    let case = Case::<2>::floating(6, 0.4, 0.5, 1);
    for (name, method) in Method::NAMES {
        let solved = solve(
            &case.problem(),
            &settings(method, 1e-10),
            &Start::default(),
            &GO,
        );
        assert_eq!(solved.is_ok(), method.balances(), "{name}");
        if let Err(error) = solved {
            assert_eq!(error, Error::NotHeld { method: name });
            assert!(error.to_string().contains(name));
        }
    }
}
