//! The systems of the derivatives of a solution: against the equations that they solve,
//! against differences of solutions, and against their transposes.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;
use std::sync::Arc;

use bipot_rs::law::cone::Status;
use bipot_rs::linalg::small::{Block, Vector};
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::Reduced;
use bipot_rs::solver::derivatives::tangent_stiffness_form::TangentStiffnessForm;
use bipot_rs::solver::derivatives::tangent_system::{ClosedLaw, FactoredTangent, TangentSystem};
use bipot_rs::solver::{Method, Solution};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use crate::common::cases::{Case, compliance, coulomb};
use crate::common::{GO, random};

/// Systems of some dozen unknowns, with conditions of some thousands at the most.
const ROUNDING: f64 = 1e-11;

/// Laws with any coefficients of some contacts; a sticking one has `dv = s`.
fn any_laws<const D: usize>(positions: &[usize], sticks: &[usize], seed: u64) -> Vec<ClosedLaw<D>> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut block = || Block::<D>::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let law = |&position: &usize| {
        let (mut by_r, mut by_v) = (block() + Block::identity() * 2.0, block());
        // The normal component of a closed contact is held, as at a solution.
        by_r.fill_row(0, 0.0);
        by_v.fill_row(0, 0.0);
        by_v[(0, 0)] = 1.0;
        if sticks.contains(&position) {
            (by_r, by_v) = (Block::zeros(), Block::identity());
        }
        ClosedLaw {
            position,
            by_r,
            by_v,
        }
    };
    positions.iter().map(law).collect()
}

/// `M x` of (33), written out with the problem's own products.
fn product<const D: usize>(problem: &Reduced<D>, laws: &[ClosedLaw<D>], x: &[f64]) -> Vec<f64> {
    let (own, amounts) = x.split_at(D * laws.len());
    let mut r = vec![[0.0; D]; problem.contacts()];
    for (law, part) in laws.iter().zip(own.as_chunks::<D>().0) {
        r[law.position] = *part;
    }
    let mut v = vec![[0.0; D]; r.len()];
    problem.compliance.product(&r, &mut v);
    problem.add_rigid(amounts, &mut v);
    let of = |law: &ClosedLaw<D>| {
        let i = law.position;
        let row: [f64; D] = (law.by_r * Vector::from(r[i]) + law.by_v * Vector::from(v[i])).into();
        row
    };
    let mut found: Vec<f64> = laws.iter().flat_map(of).collect();
    found.extend(work(problem, &r));
    found
}

/// `Rᵀ r`.
fn work<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<f64> {
    let of = |mode: &Vec<[f64; D]>| {
        let terms = mode.as_flattened().iter().zip(r.as_flattened());
        terms.map(|(m, r)| m * r).sum()
    };
    problem.rigid.modes.columns().iter().map(of).collect()
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

fn close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    let apart: Vec<f64> = found.iter().zip(expected).map(|(x, y)| x - y).collect();
    let (apart, size) = (largest(&apart), largest(expected));
    assert!(apart <= tolerance * size, "{apart:e} of {size:e}");
}

/// A system solves its equations and their transpose.
fn solves<const D: usize>(
    problem: &Reduced<D>,
    laws: &[ClosedLaw<D>],
    system: &dyn FactoredTangent,
    seed: u64,
) {
    let n = system.order();
    let right = random(n, seed);
    let mut x = right.clone();
    system.solve(&mut x);
    close(&product(problem, laws, &x), &right, ROUNDING);
    let mut w = right.clone();
    system.solve_transposed(&mut w);
    let unit = |k: usize| {
        (0..n)
            .map(|i| f64::from(u8::from(i == k)))
            .collect::<Vec<_>>()
    };
    let along = |k: usize| {
        product(problem, laws, &unit(k))
            .iter()
            .zip(&w)
            .map(|(m, w)| m * w)
            .sum()
    };
    close(&(0..n).map(along).collect::<Vec<f64>>(), &right, ROUNDING);
}

fn held_and_floating<const D: usize>(seed: u64) {
    let contacts = 9;
    for case in [
        Case::<D>::held(contacts, 0.4, seed),
        Case::<D>::floating(contacts, 0.4, 0.5, seed),
    ] {
        let problem = case.problem();
        let laws = any_laws::<D>(&[0, 2, 3, 5, 8], &[2, 5], seed + 7);
        let system = TangentSystem::new(&problem, &laws, &GO).unwrap().unwrap();
        assert_eq!(system.order(), 5 * D + problem.rigid.modes.len());
        solves(&problem, &laws, &system, seed + 9);
    }
}

#[test]
fn the_system_in_reactions_solves_its_equations() {
    held_and_floating::<2>(1);
    held_and_floating::<3>(2);
}

#[test]
fn an_asymmetric_compliance_is_transposed() {
    let mut w = compliance::<3>(7, 3);
    let order = 21;
    for (k, noise) in random(order * order, 4).iter().enumerate() {
        w[k] += 0.02 * noise;
    }
    let case = Case::<3>::of(w, 7, 0.4, 3);
    let laws = any_laws::<3>(&[0, 1, 4, 6], &[1], 5);
    let problem = case.problem();
    let system = TangentSystem::new(&problem, &laws, &GO).unwrap().unwrap();
    solves(&problem, &laws, &system, 6);
    // Its inverse is not formed: the other form is for symmetric compliances.
    let shared = Arc::new(case.compliance);
    let problem = coulomb(&shared, &case.q, &case.mu, &case.rigid);
    let sticking = any_laws::<3>(&[0, 1, 2, 3, 4, 5, 6], &[0, 1, 2, 3, 4, 5, 6], 5);
    let form = TangentStiffnessForm::new(&shared, &problem.scaling, &sticking, &GO).unwrap();
    assert!(form.is_none());
}

fn both_forms<const D: usize>(seed: u64) {
    let contacts = 12;
    let case = Case::<D>::held(contacts, 0.4, seed);
    let shared = Arc::new(case.compliance);
    let problem = coulomb(&shared, &case.q, &case.mu, &case.rigid);
    // One open contact, three that slide, the others stick.
    let closed: Vec<usize> = (0..contacts).filter(|&i| i != 4).collect();
    let sticks: Vec<usize> = closed.iter().copied().filter(|i| i % 4 != 1).collect();
    let laws = any_laws::<D>(&closed, &sticks, seed + 3);
    let form = TangentStiffnessForm::new(&shared, &problem.scaling, &laws, &GO);
    let form = form.unwrap().unwrap();
    assert_eq!(form.order(), D * closed.len());
    solves(&problem, &laws, &form, seed + 4);
    let system = TangentSystem::new(&problem, &laws, &GO).unwrap().unwrap();
    let right = random(form.order(), seed + 5);
    let (mut one, mut other) = (right.clone(), right);
    form.solve(&mut one);
    system.solve(&mut other);
    close(&one, &other, ROUNDING);
    // Where most contacts slide it has too many unknowns to pay.
    let sliding = any_laws::<D>(&closed, &[], seed + 6);
    let form = TangentStiffnessForm::new(&shared, &problem.scaling, &sliding, &GO).unwrap();
    assert!(form.is_none());
}

#[test]
fn the_system_in_displacements_is_the_one_in_reactions() {
    both_forms::<2>(11);
    both_forms::<3>(12);
}

#[test]
fn a_singular_system_is_told() {
    let case = Case::<2>::held(3, 0.4, 21);
    let problem = case.problem();
    let mut laws = any_laws::<2>(&[0, 1], &[0, 1], 22);
    laws[1].by_v.fill_row(1, 0.0);
    assert!(TangentSystem::new(&problem, &laws, &GO).unwrap().is_none());
    // Nearly singular: the condition says so, and independently of units.
    let mut estimates = Vec::new();
    for unit in [1.0, 1e9] {
        let w = compliance::<2>(3, 21).iter().map(|w| w * unit).collect();
        let case = Case::<2>::of(w, 3, 0.4, 21);
        let mut laws = any_laws::<2>(&[0, 1], &[0, 1], 22);
        laws[1].by_v = Block::<2>::new(1.0, 0.0, 1.0, 1e-9);
        let problem = case.problem();
        let system = TangentSystem::new(&problem, &laws, &GO).unwrap().unwrap();
        estimates.push(system.reciprocal_condition());
    }
    assert!(estimates[0] < 1e-8 && estimates[0] > 1e-12, "{estimates:?}");
    assert!(
        (estimates[1] / estimates[0] - 1.0).abs() < 1e-3,
        "{estimates:?}"
    );
}

/// The laws of a solution (33), and the right side `−by_v dq` of a change of `q`.
fn laws_at<const D: usize>(problem: &Reduced<D>, at: &Solution<D>) -> Vec<ClosedLaw<D>> {
    let of = |position: usize| {
        let (r, v) = (at.reaction[position], at.relative_displacement[position]);
        let (mut by_r, mut by_v) = (Block::<D>::zeros(), Block::<D>::zeros());
        by_v[(0, 0)] = 1.0;
        match at.status[position] {
            Status::Open => return None,
            Status::Stick => by_v = Block::identity(),
            Status::Slip => {
                let length = v[1..].iter().map(|s| s * s).sum::<f64>().sqrt();
                let (mu, p): (f64, Vec<f64>) = (
                    problem.law[position].mu,
                    v[1..].iter().map(|s| s / length).collect(),
                );
                // p·dr_t + μ dr_n = 0, and in space p⊥·(‖s‖ dr_t + μ r_n ds) = 0.
                by_r[(1, 0)] = mu;
                for k in 1..D {
                    by_r[(1, k)] = p[k - 1];
                }
                if D == 3 {
                    for (k, across) in [(1, -p[1]), (2, p[0])] {
                        by_r[(2, k)] = length * across;
                        by_v[(2, k)] = mu * r[0] * across;
                    }
                }
            }
        }
        Some(ClosedLaw {
            position,
            by_r,
            by_v,
        })
    };
    (0..problem.contacts()).filter_map(of).collect()
}

fn differences<const D: usize>(case: &mut Case<D>, seed: u64) -> [usize; 3] {
    let solution = case.solve(Method::Newton);
    let change: Vec<[f64; D]> = random(D * case.q.len(), seed).as_chunks::<D>().0.to_vec();
    let found = {
        let problem = case.problem();
        let laws = laws_at(&problem, &solution);
        let system = TangentSystem::new(&problem, &laws, &GO).unwrap().unwrap();
        let of = |law: &ClosedLaw<D>| {
            let row: [f64; D] = (law.by_v * Vector::from(change[law.position]) * -1.0).into();
            row
        };
        let mut x: Vec<f64> = laws.iter().flat_map(of).collect();
        x.resize(system.order(), 0.0);
        system.solve(&mut x);
        let mut r = vec![[0.0; D]; problem.contacts()];
        for (law, part) in laws.iter().zip(x.as_chunks::<D>().0) {
            r[law.position] = *part;
        }
        r
    };
    let (h, q) = (1e-5, case.q.clone());
    let mut moved = |sign: f64| {
        for ((q, known), d) in case.q.iter_mut().zip(&q).zip(&change) {
            *q = std::array::from_fn(|k| known[k] + sign * h * d[k]);
        }
        case.solve(Method::Newton)
    };
    let (ahead, behind) = (moved(1.0), moved(-1.0));
    case.q = q;
    let mut seen = [0; 3];
    if ahead.status != solution.status || behind.status != solution.status {
        return seen;
    }
    let ends = ahead.reaction.as_flattened().iter();
    let slope: Vec<f64> = ends
        .zip(behind.reaction.as_flattened())
        .map(|(x, y)| (x - y) / (2.0 * h))
        .collect();
    // h² = 1e-10 times a third derivative, and η = 1e-12 over h.
    close(found.as_flattened(), &slope, 1e-6);
    solution.status.iter().for_each(|&s| seen[s as usize] += 1);
    seen
}

#[test]
fn derivatives_of_solutions_are_those_of_differences() {
    let mut seen = [0; 3];
    for seed in 0..8 {
        for counts in [
            differences(&mut Case::<2>::held(10, 0.4, seed), seed + 50),
            differences(&mut Case::<3>::held(8, 0.4, seed), seed + 60),
            differences(&mut Case::<3>::floating(8, 0.4, 0.5, seed), seed + 70),
        ] {
            (0..3).for_each(|k| seen[k] += counts[k]);
        }
    }
    assert!(seen.iter().all(|&count| count > 20), "{seen:?}");
}

/// The compliance of contacts that share nothing is a matrix of blocks.
#[test]
fn a_contact_alone_has_a_closed_form() {
    // W = 2 I: sliding along t with μ r_n = −r_t gives dr_n = −dq_n / 2, dr_t = μ dq_n / 2.
    let mu = 0.3;
    let w = vec![2.0, 0.0, 0.0, 2.0];
    let shared = Compliance::<2>::from_dense(1, Cow::Owned(w)).unwrap();
    let (q, rigid) = ([[-1.0, 3.0]], bipot_rs::reduced::reduced::Rigid::default());
    let problem = coulomb(&shared, &q, &[mu], &rigid);
    let law = ClosedLaw {
        position: 0,
        by_r: Block::<2>::new(0.0, 0.0, mu, 1.0),
        by_v: Block::<2>::new(1.0, 0.0, 0.0, 0.0),
    };
    let system = TangentSystem::new(&problem, &[law], &GO).unwrap().unwrap();
    let mut x = vec![-1.0, 0.0];
    system.solve(&mut x);
    close(&x, &[-0.5, 0.5 * mu], 4.0 * f64::EPSILON);
}
