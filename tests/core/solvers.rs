//! The solvers on random problems: all methods agree, one certificate, the same bits on any
//! number of threads, and pinned work.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::common::cases::{Case, compliance, coulomb, difference, settings};
use crate::common::{GO, with_threads};
use bipot_rs::error::Error;
use bipot_rs::law::cone::Status;
use bipot_rs::reduced::compliance::{Compliance, Part};
use bipot_rs::reduced::reduced::Rigid;
use bipot_rs::reduced::residual::Certificate;
use bipot_rs::solver::monitor::Progress;
use bipot_rs::solver::{Method, Outcome, Settings, Start, solve, solve_watched};

/// Those that take the bodies of a case.
fn methods<const D: usize>(case: &Case<D>) -> impl Iterator<Item = (&'static str, Method)> {
    let held = case.rigid.modes.is_empty();
    let names = Method::NAMES.into_iter();
    names.filter(move |(_, method)| held || method.balances())
}

/// Newton too, which has nothing beside it here: it may come to a stand where μ is
/// large and contacts are strongly coupled, as they are not in these problems.
fn methods_agree<const D: usize>(case: &Case<D>) {
    let reference = case.solve(Method::Auto);
    assert_eq!(reference.outcome, Outcome::Converged);
    for (name, method) in methods(case) {
        let other = case.solve(method);
        assert_eq!(other.outcome, Outcome::Converged, "{name}");
        // η = 1e-12 and a condition of at most some hundreds.
        let apart = difference(&other.reaction, &reference.reaction);
        assert!(apart <= 1e-9, "{name}: {apart:e}");
    }
}

#[test]
fn every_method_reaches_the_answer_where_it_is_unique() {
    for seed in 0..6 {
        methods_agree(&Case::<2>::held(12, 0.3, seed));
        for mu in [0.0, 0.3, 0.6] {
            methods_agree(&Case::<3>::held(9, mu, seed));
        }
    }
}

#[test]
fn every_method_holds_bodies_that_contact_alone_holds() {
    for seed in 0..4 {
        for share in [0.0, 0.5, 0.9] {
            methods_agree(&Case::<2>::floating(10, 0.4, share, seed));
            methods_agree(&Case::<3>::floating(8, 0.4, share, seed));
        }
    }
}

#[test]
fn a_load_beyond_friction_never_converges() {
    for method in [Method::Auto, Method::GaussSeidel, Method::Uzawa] {
        for share in [1.000_001, 1.5] {
            let case = Case::<2>::floating(6, 0.4, share, 3);
            let solution = case.run(&Settings {
                max_iterations: 3000,
                ..settings(method, 1e-10)
            });
            assert_ne!(solution.outcome, Outcome::Converged);
            assert!(solution.residual > solution.tolerance);
            let mut numbers = solution.reaction.as_flattened().iter();
            assert!(numbers.all(|x| x.is_finite()));
        }
    }
}

#[test]
fn the_result_is_the_point_of_the_certificate() {
    let case = Case::<3>::held(15, 0.5, 4);
    let solution = case.solve(Method::Auto);
    let problem = case.problem();
    let fresh = Certificate::new(&problem, &solution.reaction, &[]);
    assert_eq!(fresh.residual.to_bits(), solution.residual.to_bits());
    assert_eq!(fresh.v, solution.relative_displacement);
    assert!(solution.residual <= solution.tolerance);
    let mut pairs = solution.history.windows(2);
    assert!(pairs.all(|pair| pair[0].0 <= pair[1].0));
}

#[test]
fn progress_can_be_read() {
    let progress = Progress::default();
    assert_eq!(progress.read(), (0, 0.0, f64::INFINITY));
    let case = Case::<3>::floating(12, 0.4, 0.7, 1);
    for (name, method) in methods(&case) {
        let (problem, start) = (case.problem(), Start::default());
        let settings = settings(method, 1e-10);
        let solution = solve_watched(&problem, &settings, &start, &GO, &progress).unwrap();
        let (iterations, work, residual) = progress.read();
        assert_eq!(iterations, solution.iterations, "{name}");
        // The certificate costs two products; η before and after differs by rounding.
        assert!(
            work <= solution.work && solution.work <= work + 2.0,
            "{name}"
        );
        assert!(
            (residual - solution.residual).abs() <= solution.floor,
            "{name}"
        );
    }
}

#[test]
fn limits_end_with_the_best_point() {
    let case = Case::<2>::held(20, 0.6, 5);
    let settings = Settings {
        method: Method::Uzawa,
        max_iterations: 3,
        ..Settings::default()
    };
    let solution = case.run(&settings);
    assert_eq!(solution.outcome, Outcome::IterationLimit);
    assert_eq!(solution.iterations, 3);
    let etas = solution.history.iter().map(|row| row.1);
    let best = etas.fold(f64::INFINITY, f64::min);
    // The certificate of the best point differs from the running η by rounding.
    assert!((solution.residual - best).abs() <= 1e-12 * best);

    let (problem, start) = (case.problem(), Start::default());
    let interrupted = solve(&problem, &settings, &start, &AtomicBool::new(true));
    assert_eq!(interrupted.unwrap_err(), Error::Interrupted);
    for answer in [true, false] {
        let asking = Progress::asking(if answer { || true } else { || false });
        let asked = solve_watched(&problem, &settings, &start, &GO, &asking);
        assert_eq!(asked.is_err_and(|e| e == Error::Interrupted), answer);
    }
    for (tol, max_iterations, max_seconds) in [
        (0.0, 3, 1.0),
        (f64::NAN, 3, 1.0),
        (0.1, 0, 1.0),
        (0.1, 3, -1.0),
    ] {
        let settings = Settings {
            method: Method::Uzawa,
            tol,
            max_iterations,
            max_seconds,
        };
        let refused = solve(&problem, &settings, &start, &GO);
        assert!(matches!(refused, Err(Error::Setting { .. })));
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    // 260 contacts in space are 780 rows, enough for the products to be shared.
    let case = Case::<3>::held(260, 0.4, 6);
    for (name, method) in methods(&case) {
        let settings = Settings {
            max_iterations: if method == Method::Auto { 100_000 } else { 12 },
            ..settings(method, 1e-12)
        };
        let run = |threads| with_threads(threads, || case.run(&settings));
        let (one, two) = (run(1), run(2));
        assert_eq!(one.reaction, two.reaction, "{name}");
        assert_eq!(one.history, two.history, "{name}");
    }
}

#[test]
fn an_asymmetric_compliance_is_solved_as_it_is_given() {
    let mut w = compliance::<2>(6, 7);
    w[1] += 1e-2;
    w[5 * 12] -= 2e-2;
    let mut case = Case::<2>::held(6, 0.3, 7);
    case.compliance = Compliance::from_dense(6, Cow::Owned(w.clone())).unwrap();
    assert!(case.compliance.asymmetry() > 1e-3);
    for method in [Method::Auto, Method::GaussSeidel, Method::Uzawa] {
        let solution = case.solve(method);
        assert_eq!(solution.outcome, Outcome::Converged);
        let r = solution.reaction.as_flattened();
        let moved = solution.relative_displacement.as_flattened();
        for (i, v) in moved.iter().enumerate() {
            let by_rows: f64 = (0..12).map(|j| w[12 * i + j] * r[j]).sum();
            // Two sums of twelve terms of order one.
            assert!((v - by_rows - case.q.as_flattened()[i]).abs() <= 1e-14);
        }
    }
}

#[test]
fn islands_are_solved_as_one_dense_problem_is() {
    let (first, second) = (compliance::<2>(4, 8), compliance::<2>(3, 9));
    let parts = vec![
        (
            vec![0, 2, 4, 6],
            Part::Dense(Cow::Borrowed(first.as_slice())),
        ),
        (vec![1, 3, 5], Part::Dense(Cow::Borrowed(second.as_slice()))),
    ];
    let islands = Compliance::<2>::new(parts).unwrap();
    let mut case = Case::<2>::held(7, 0.4, 8);
    case.compliance = Compliance::from_dense(7, Cow::Owned(islands.to_dense())).unwrap();
    let dense = case.solve(Method::Auto);
    let problem = coulomb(&islands, &case.q, &case.mu, &case.rigid);
    let settings = settings(Method::Auto, 1e-12);
    let apart = solve(&problem, &settings, &Start::default(), &GO).unwrap();
    assert_eq!(apart.status, dense.status);
    assert!(difference(&apart.reaction, &dense.reaction) <= 1e-11);
}

/// The same problem in other units: displacements times `s`, forces times `c`.
fn in_units<const D: usize>(case: &Case<D>, s: f64, c: f64) -> Case<D> {
    let contacts = case.q.len();
    let matrix = case.compliance.to_dense().into_iter().map(|w| w * (s / c));
    Case {
        compliance: Compliance::from_dense(contacts, Cow::Owned(matrix.collect())).unwrap(),
        q: case.q.iter().map(|q| q.map(|x| x * s)).collect(),
        mu: case.mu.clone(),
        rigid: Rigid {
            modes: case.rigid.modes.clone(),
            load: case.rigid.load.iter().map(|e| e * c).collect(),
        },
    }
}

#[test]
fn powers_of_two_change_no_bit_of_a_run() {
    let cases = [Case::<3>::held(20, 0.4, 3), Case::floating(12, 0.4, 0.7, 3)];
    let bits = |history: &[(f64, f64)]| -> Vec<_> {
        let row = |(work, eta): &(f64, f64)| (work.to_bits(), eta.to_bits());
        history.iter().map(row).collect()
    };
    for case in &cases {
        for (name, method) in methods(case) {
            let one = case.solve(method);
            for (s, c) in [(40, -25), (-60, 7), (0, 30), (33, 0)] {
                let (s, c) = (2.0_f64.powi(s), 2.0_f64.powi(c));
                let other = in_units(case, s, c).solve(method);
                assert_eq!(bits(&other.history), bits(&one.history), "{name}");
                let back: Vec<_> = other.reaction.iter().map(|r| r.map(|x| x / c)).collect();
                assert_eq!(back, one.reaction, "{name}");
            }
        }
    }
}

/// Products with `W` to η = 1e-12, over these seeds.
fn work<const D: usize>(method: Method, seeds: u64, case: impl Fn(u64) -> Case<D>) -> f64 {
    let of_seed = |seed| {
        let solution = case(seed).solve(method);
        assert_eq!(solution.outcome, Outcome::Converged);
        solution.work
    };
    (0..seeds).map(of_seed).sum()
}

/// Work may be a tenth more than was measured: a slower algorithm shows up.
fn pinned(name: &str, work: f64, measured: f64) {
    assert!(
        work <= 1.1 * measured,
        "{name}: {work} products, {measured} before"
    );
}

#[test]
fn work_is_pinned() {
    let auto = Method::Auto;
    let plane = work(auto, 12, |seed| Case::<2>::held(40, 0.3, seed));
    pinned("plane", plane, 120.2);
    let plane = work(auto, 12, |seed| Case::<2>::floating(20, 0.4, 0.6, seed));
    pinned("floating, plane", plane, 160.3);
    let space = work(auto, 12, |seed| Case::<3>::floating(20, 0.4, 0.6, seed));
    pinned("floating, space", space, 253.6);
    for (method, contacts, measured) in [
        (Method::Auto, 40, 124.7),
        (Method::GaussSeidel, 40, 116.0),
        (Method::Nesterov, 40, 311.0),
        (Method::Uzawa, 40, 437.0),
        (Method::UzawaTwoProjection, 40, 386.0),
        (Method::ReturnMapping, 20, 269.5),
        (Method::PerturbedLagrangian, 20, 162.7),
        (Method::DisplacementPrinciple, 20, 188.9),
        (Method::AlternatingPrinciples, 20, 476.0),
        (Method::StressPrinciple, 20, 262.6),
        (Method::MinimisingSequence, 20, 685.6),
        (Method::Pivoting, 20, 1397.7),
    ] {
        let seeds = if contacts == 40 { 12 } else { 6 };
        let work = work(method, seeds, |seed| Case::<3>::held(contacts, 0.3, seed));
        pinned(method.name(), work, measured);
    }
}

#[test]
fn work_of_warm_steps_is_pinned() {
    let (mut work, mut iterations) = (0.0, 0);
    for seed in 0..12 {
        let mut case = Case::<3>::held(40, 0.3, seed);
        let before = case.solve(Method::Auto);
        // The loads move on by a tenth, and turn.
        for (k, q) in case.q.as_flattened_mut().iter_mut().enumerate() {
            *q *= if k % 2 == 0 { 1.1 } else { 0.95 };
        }
        let start = Start {
            closed: before.status.iter().map(|&s| s != Status::Open).collect(),
            reaction: before.reaction,
            rigid: Vec::new(),
        };
        let settings = settings(Method::Auto, 1e-12);
        let warm = solve(&case.problem(), &settings, &start, &GO).unwrap();
        assert_eq!(warm.outcome, Outcome::Converged);
        let cold = case.solve(Method::Auto);
        assert!(difference(&warm.reaction, &cold.reaction) <= 1e-9); // η and condition
        work += warm.work;
        iterations += warm.iterations;
    }
    pinned("warm steps", work, 155.0);
    assert!(iterations <= 4 * 12, "{iterations}"); // the predictor, and Newton's few
}

/// A contact that slides with a large μ and penetrates: η counts only `v_n/√(1 + μ²)`, over a
/// reaction of length μ.
#[test]
fn a_large_friction_hides_no_penetration() {
    const MU: f64 = 100.0;
    const TOL: f64 = 1e-10;
    let unit = Compliance::<2>::from_dense(1, Cow::Owned(vec![1.0, 0.0, 0.0, 1.0])).unwrap();
    let certificate = |depth: f64| {
        // On the cone, and slipping against the reaction.
        let (r, v) = ([1.0, MU], [-depth, -0.5]);
        let q = [v[0] - r[0], v[1] - r[1]];
        let problem = coulomb(&unit, &[q], &[MU], &Rigid::default());
        Certificate::of(&problem, &[r], vec![v], &[])
    };
    assert!(certificate(0.0).converged(TOL));
    // η = 8e-7/μ² is within the tolerance; the penetration is 80 times the tolerance, relative
    // to the reaction.
    let deep = certificate(8e-7);
    assert!(deep.residual <= TOL, "{:e}", deep.residual);
    assert!(!deep.converged(TOL));
}

/// Eight contacts apart, of which the last has `W = (1, 2; 2, 1)`, `μ = 1`, `q = (−1, 0)`. By
/// hand: sticking asks for `r_n = −1/3`, slip along −t for `v_t = 1 > 0`, slip along t for
/// `r_n = −1`, and open it penetrates.
fn fails_without_an_answer<const D: usize>() {
    const CONTACTS: usize = 8;
    let m = D * CONTACTS;
    let mut w: Vec<f64> = (0..m * m)
        .map(|k| f64::from(u8::from(k % (m + 1) == 0)))
        .collect();
    let last = m - D;
    w[last * m + last + 1] = 2.0;
    w[(last + 1) * m + last] = 2.0;
    let mut case = Case::<D>::of(w, CONTACTS, 1.0, 0);
    let mut q = [0.0; D];
    q[0] = -1.0;
    case.q.fill(q);
    let solution = case.solve(Method::Auto);
    // In the plane all statuses have been tried. That is no proof: only bodies that contact alone
    // holds can be without a solution, if W is that of bodies.
    assert_eq!(solution.outcome, Outcome::Stalled);
    assert_eq!(solution.statuses_tried, 0);
    assert!(solution.residual > 1e-2);
    // So many sweeps and Newton steps without progress are made before it gives up.
    assert!(solution.iterations > 5_000, "{}", solution.iterations);
}

#[test]
fn a_problem_without_an_answer_gets_none() {
    fails_without_an_answer::<2>();
    fails_without_an_answer::<3>();
}
