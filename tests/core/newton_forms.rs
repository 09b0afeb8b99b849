//! One Newton step in its two forms, and by LU and GMRES: one next point, which
//! satisfies the linearised law (19).

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;

use crate::common::GO;
use crate::common::cases::{Case, compliance, difference};
use bipot_rs::law::cone::Status;
use bipot_rs::linalg::small::Vector;
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::Reduced;
use bipot_rs::reduced::residual::scaled_imbalance;
use bipot_rs::solver::evaluated_point::EvaluatedPoint;
use bipot_rs::solver::newton::compliance_form::{ComplianceForm, Solved};
use bipot_rs::solver::newton::linearisation::{Linearisation, factorisation_cost};
use bipot_rs::solver::newton::refine::{RefinedPoint, forward_change, forward_error, refine};
use bipot_rs::solver::newton::stiffness_form::StiffnessForm;
use bipot_rs::solver::{Method, Outcome};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// A point, not on the law, that a step starts from.
struct Point<const D: usize> {
    r: Vec<[f64; D]>,
    v: Vec<[f64; D]>,
    a: Vec<f64>,
    imbalance: Vec<f64>,
}

impl<const D: usize> Point<D> {
    /// Any reactions and displacements: `q` of the case is what makes them belong
    /// to each other.
    fn random(case: &mut Case<D>, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut field = |normal: f64| -> Vec<[f64; D]> {
            let mut of_node = || {
                let mut x: [f64; D] = std::array::from_fn(|_| rng.random_range(-0.5..0.5));
                x[0] += normal;
                x
            };
            case.q.iter().map(|_| of_node()).collect()
        };
        let (r, v) = (field(0.4), field(0.0));
        let a: Vec<f64> = (0..case.rigid.modes.len()).map(|_| rng.random()).collect();
        case.q.fill([0.0; D]);
        let moved = case.problem().relative_displacement(&r, &a);
        for ((q, v), moved) in case.q.iter_mut().zip(&v).zip(&moved) {
            *q = std::array::from_fn(|k| v[k] - moved[k]);
        }
        Self {
            imbalance: scaled_imbalance(&case.problem(), &r),
            r,
            v,
            a,
        }
    }

    fn in_reactions(&self, problem: &Reduced<D>, law: &Linearisation<D>) -> Option<Solved<D>> {
        let form = ComplianceForm::new(problem, law);
        let from = (self.r.as_slice(), self.a.as_slice());
        form.solve(from, &self.imbalance, &|| 1e-12, &mut |_| (), &GO)
            .unwrap()
    }

    fn in_displacements(&self, problem: &Reduced<D>, law: &Linearisation<D>) -> Option<Solved<D>> {
        let form = StiffnessForm::new(problem, law);
        let at = EvaluatedPoint {
            r: self.r.clone(),
            v: self.v.clone(),
            rigid: self.a.clone(),
        };
        form.solve(&at, &self.imbalance, &mut |_| (), &GO).unwrap()
    }

    /// What a next point leaves of `value + by_r dr + by_v dv` and of the balance of
    /// forces, beside the reactions: no form of the step, but what it is for.
    fn left(&self, problem: &Reduced<D>, law: &Linearisation<D>, next: &Solved<D>) -> f64 {
        let scaling = &problem.scaling;
        let v = problem.relative_displacement(&next.r, &next.rigid);
        let mut most = 0.0_f64;
        for (i, at) in law.at.iter().enumerate() {
            let change =
                |x: &[f64; D], y: &[f64; D], s: f64| (Vector::from(*x) - Vector::from(*y)) * s;
            let dr = change(&next.r[i], &self.r[i], scaling.to_r[i]);
            let dv = change(&v[i], &self.v[i], scaling.to_v[i]);
            most = most.max((at.value + at.by_r * dr + at.by_v * dv).amax());
        }
        let imbalance = scaled_imbalance(problem, &next.r);
        let most = imbalance.iter().fold(most, |m, s| m.max(s.abs()));
        most / scaling.reaction_norm(&next.r)
    }
}

/// Both forms from a dozen points; how many contacts had each status.
fn forms_agree<const D: usize>(case: &mut Case<D>) -> [usize; 3] {
    let mut seen = [0; 3];
    for seed in 0..12 {
        let point = Point::random(case, seed);
        let problem = case.problem();
        let law = Linearisation::new(&problem, &point.r, &point.v);
        let one = point.in_reactions(&problem, &law);
        let other = point.in_displacements(&problem, &law);
        let (Some(one), Some(other)) = (&one, &other) else {
            // In the plane nothing holds a body along the surface where nothing sticks.
            let sticks = law.at.iter().any(|at| at.status == Status::Stick);
            assert!(D == 2 && !sticks && !problem.rigid.modes.is_empty());
            assert!(one.is_none() && other.is_none());
            continue;
        };
        // Systems of some dozen unknowns, conditions of some thousands at the most.
        for next in [one, other] {
            let left = point.left(&problem, &law, next);
            assert!(left <= 1e-12, "{seed}: {left:e}");
        }
        let apart = difference(&other.r, &one.r);
        assert!(apart <= 1e-11, "{seed}: {apart:e}");
        let size = one.rigid.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
        for (x, y) in one.rigid.iter().zip(&other.rigid) {
            assert!((x - y).abs() <= 1e-11 * size, "{seed}: {x} {y}");
        }
        law.at.iter().for_each(|at| seen[at.status as usize] += 1);
    }
    seen
}

#[test]
fn both_forms_of_a_step_lead_to_one_point() {
    let mut seen = [0; 3];
    for friction in [0.3, 1.2] {
        for counts in [
            forms_agree(&mut Case::<2>::held(12, friction, 1)),
            forms_agree(&mut Case::<3>::held(10, friction, 2)),
            forms_agree(&mut Case::<2>::floating(12, friction, 0.5, 3)),
            forms_agree(&mut Case::<3>::floating(10, friction, 0.5, 4)),
        ] {
            (0..3).for_each(|k| seen[k] += counts[k]);
        }
    }
    assert!(seen.iter().all(|&count| count > 50), "{seen:?}");
}

#[test]
fn contacts_without_friction_bring_one_unknown() {
    let mut case = Case::<3>::held(12, 0.5, 5);
    (0..12).step_by(2).for_each(|i| case.mu[i] = 0.0);
    let seen = forms_agree(&mut case);
    assert!(seen[Status::Slip as usize] > 20);
    let problem = case.problem();
    let closed = Linearisation::held(&problem, |_| true, &problem.q, &problem.q);
    assert_eq!(ComplianceForm::new(&problem, &closed).order(), 6 + 6 * 3);
    // In the displacements it is the frictionless contact that is free to move.
    assert_eq!(StiffnessForm::new(&problem, &closed).order(), 6 * 2);
    let open = Linearisation::held(&problem, |i| i < 4, &problem.q, &problem.q);
    assert_eq!(ComplianceForm::new(&problem, &open).order(), 2 + 2 * 3);
    assert_eq!(StiffnessForm::new(&problem, &open).order(), 8 * 3 + 2 * 2);
    // Of floating bodies every rigid motion is one more, in either.
    let floating = Case::<2>::floating(5, 0.0, 0.0, 6);
    let problem = floating.problem();
    let closed = Linearisation::held(&problem, |_| true, &problem.q, &problem.q);
    assert_eq!(ComplianceForm::new(&problem, &closed).order(), 5 + 2);
    assert_eq!(StiffnessForm::new(&problem, &closed).order(), 5 + 2);
}

#[test]
fn an_asymmetric_compliance_never_makes_an_inverse() {
    let contacts = 100;
    let m = 2 * contacts;
    let mut case = Case::<2>::held(contacts, 0.9, 7);
    // Nothing slides: most contacts stick, which is where an inverse would pay.
    case.q
        .iter_mut()
        .for_each(|q| *q = [-1.0 - q[0].abs(), 0.01 * q[1]]);
    let symmetric = case.solve(Method::Newton);
    assert_eq!(symmetric.outcome, Outcome::Converged);
    assert_eq!(symmetric.bytes_beside, 8 * m * m);

    let mut w = compliance::<2>(contacts, 7);
    w[1] *= 1.0 + f64::EPSILON;
    case.compliance = Compliance::from_dense(contacts, Cow::Owned(w)).unwrap();
    let loads = case.q.clone();
    let point = Point::random(&mut case, 1);
    let problem = case.problem();
    let law = Linearisation::new(&problem, &point.r, &point.v);
    assert!(point.in_displacements(&problem, &law).is_none());
    assert_eq!(case.compliance.inverse_known(), Some(false));
    case.q = loads;
    // Its transpose is beside it instead, and the answer is the same to rounding.
    for (_, method) in Method::NAMES {
        let solution = case.solve(method);
        assert_eq!(solution.bytes_beside, 8 * m * m);
        assert!(difference(&solution.reaction, &symmetric.reaction) <= 1e-9);
    }
}

/// A compliance of many contacts that falls off with distance, made without sums.
fn long<const D: usize>(contacts: usize) -> Vec<f64> {
    let m = D * contacts;
    let entry = |k: usize| {
        let (i, j) = (k / m, k % m);
        let apart = u32::try_from((i / D).abs_diff(j / D)).unwrap();
        let part = match (i % D, j % D) {
            (a, b) if a == b => 1.0,
            (0, _) => 0.2 * (f64::from(u8::from(i > j)) - 0.5),
            (_, 0) => 0.2 * (f64::from(u8::from(j > i)) - 0.5),
            _ => 0.1,
        };
        part * 0.6_f64.powf(f64::from(apart)) + if i == j { 0.5 } else { 0.0 }
    };
    (0..m * m).map(entry).collect()
}

#[test]
fn a_large_step_by_gmres_is_the_one_by_lu() {
    let contacts = 420;
    for floating in [false, true] {
        let mut case = Case::<3>::of(long::<3>(contacts), contacts, 0.6, 8);
        if floating {
            case = case.freed(0.3);
        }
        case.q.iter_mut().for_each(|q| q[0] = -1.0 - q[0].abs());
        let loads = case.q.clone();
        let point = Point::random(&mut case, 9);
        let problem = case.problem();
        let law = Linearisation::held(&problem, |i| i % 10 > 0, &point.r, &point.v);
        let form = ComplianceForm::new(&problem, &law);
        let n = form.order();
        assert!(n > 1000, "{n}");
        let from = (point.r.as_slice(), point.a.as_slice());
        let mut costs = Vec::new();
        let mut count = |cost| costs.push(cost);
        let iterated = form.solve(from, &point.imbalance, &|| 1e-12, &mut count, &GO);
        let iterated = iterated.unwrap().unwrap();
        // GMRES was enough: what an LU costs has not been counted.
        let direct = factorisation_cost(&problem, n);
        assert!(costs.iter().all(|cost| (cost - direct).abs() > 1e-9));
        // In the displacements there are far fewer unknowns, solved by LU.
        let other = point.in_displacements(&problem, &law).unwrap();
        // The tolerance of GMRES, and a condition below a hundred.
        assert!(difference(&iterated.r, &other.r) <= 1e-10);
        assert!(point.left(&problem, &law, &iterated) <= 1e-11);
        assert!(point.left(&problem, &law, &other) <= 1e-11);
        // And the whole of Newton's method by such steps, against sweeps.
        case.q = loads;
        let solution = case.solve(Method::Newton);
        assert_eq!(solution.outcome, Outcome::Converged);
        let other = case.solve(Method::GaussSeidel);
        assert!(difference(&solution.reaction, &other.reaction) <= 1e-9);
    }
}

/// A point with the displacement of its reactions, summed in twice the precision.
fn exact_point<const D: usize>(
    problem: &Reduced<D>,
    r: Vec<[f64; D]>,
    rigid: Vec<f64>,
) -> RefinedPoint<D> {
    let v = problem.exact_displacement(&r, &rigid);
    RefinedPoint::new(problem, EvaluatedPoint { r, v, rigid })
}

/// Near a solution the size of a correction is the error, corrections lead back to the solution,
/// and a change of `v` moves the solution as the same change of `q`.
fn corrections_restore<const D: usize>(case: &mut Case<D>, seed: u64) {
    let solution = case.solve(Method::Auto);
    let problem = case.problem();
    let (exact, rigid) = (solution.reaction, solution.rigid_motion);
    let mut rng = StdRng::seed_from_u64(seed);
    let mut off = exact.clone();
    for value in off.as_flattened_mut() {
        *value *= 1.0 + 1e-7 * rng.random_range(-1.0..1.0);
    }
    let moved = exact_point(&problem, off.clone(), rigid.clone());
    let total = moved.at.v.clone();
    let (of_r, of_v) = forward_error(&problem, &moved, &[], &GO).unwrap().unwrap();
    // The law is linear so near to the solution; the solver leaves 1e-12, times its condition.
    let apart = difference(&off, &exact);
    assert!(
        (of_r - apart).abs() <= 1e-2 * apart,
        "{seed}: {of_r:e} {apart:e}"
    );
    // As a step after an equal one, the displacement is twice as large.
    let after = forward_error(&problem, &moved, &total, &GO)
        .unwrap()
        .unwrap();
    assert!((after.1 / of_v - 0.5).abs() <= 1e-3 && after.0.to_bits() == of_r.to_bits());
    let evaluate = |r, a| Ok(exact_point(&problem, r, a));
    let refined = refine(&problem, moved, evaluate, &GO).unwrap();
    assert!(difference(&refined.at.r, &exact) <= 1e-10, "{seed}");
    let left = forward_error(&problem, &refined, &[], &GO)
        .unwrap()
        .unwrap();
    // Rounding, times the condition.
    assert!(left.0 <= 1e-12, "{seed}: {:e}", left.0);

    let change: Vec<[f64; D]> = exact
        .iter()
        .map(|_| std::array::from_fn(|_| 1e-6 * rng.random_range(-1.0..1.0)))
        .collect();
    let changes = [(change.clone(), Vec::new())];
    let told = forward_change(&problem, &refined, &changes, &[], &GO)
        .unwrap()
        .unwrap();
    let later = forward_change(&problem, &refined, &changes, &refined.at.v, &GO)
        .unwrap()
        .unwrap();
    assert!((later.1 / told.1 - 0.5).abs() <= 1e-9);
    for (q, change) in case.q.iter_mut().zip(&change) {
        (0..D).for_each(|k| q[k] += change[k]);
    }
    let there = case.solve(Method::Auto);
    let apart = difference(&exact, &there.reaction);
    assert!(
        (told.0 - apart).abs() <= 1e-2 * apart,
        "{seed}: {told:?} {apart:e}"
    );
}

#[test]
fn corrections_are_the_error_and_remove_it() {
    for seed in 0..4 {
        corrections_restore(&mut Case::<2>::held(10, 0.4, seed), seed);
        corrections_restore(&mut Case::<3>::held(8, 0.4, seed), seed);
        corrections_restore(&mut Case::<3>::floating(8, 0.4, 0.5, seed), seed);
    }
}
