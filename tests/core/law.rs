//! Properties of the law: geometry of the projection, the bipotential, and the one-node problem.

#![expect(clippy::float_cmp, reason = "bits are compared on purpose")]

use crate::common::minus;
use bipot_rs::law::bipotential::{corrected, gap};
use bipot_rs::law::cone::{Status, project, project_increment};
use bipot_rs::law::face::{Face, Place};
use bipot_rs::law::one_node::{self, Habit};
use bipot_rs::law::second_order::{self, NesterovTodd};
use bipot_rs::linalg::small::{Block, Vector, dot, norm, tangential_norm};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng, rngs::StdRng};

const EPS: f64 = f64::EPSILON;

/// Points of all sizes and a friction coefficient from none to huge.
fn point_and_mu<const D: usize>() -> impl Strategy<Value = ([f64; D], f64)> {
    let component = prop_oneof![Just(0.0), -1.0..1.0_f64, -1e3..1e3_f64, -1e-6..1e-6_f64];
    let mu = prop_oneof![Just(0.0), 0.0..3.0_f64, Just(1e8), Just(1e-9)];
    (proptest::array::uniform::<_, D>(component), mu)
}

/// In the cone to a few ulps of its own size.
fn in_cone<const D: usize>(r: &[f64; D], mu: f64) -> bool {
    r[0] >= 0.0 && tangential_norm(r) <= mu * r[0] * (1.0 + 8.0 * EPS)
}

/// In the polar cone `n ≤ −μ t`, to rounding of the point it came from.
fn in_polar<const D: usize>(x: &[f64; D], mu: f64, size: f64) -> bool {
    // Divided by the length of the ray, so that a huge μ does not amplify rounding.
    (x[0] + mu * tangential_norm(x)) / mu.hypot(1.0) <= 8.0 * EPS * size
}

fn projection_is_the_projection<const D: usize>(tau: [f64; D], mu: f64) {
    let (r, status) = project(&tau, mu);
    let size = norm(&tau);
    let rest = minus(&tau, &r);
    assert!(in_cone(&r, mu), "{r:?} leaves the cone of {mu}");
    assert!(
        in_polar(&rest, mu, size),
        "{rest:?} leaves the polar cone of {mu}"
    );
    // |τ|² bounds the products; two roundings a component.
    assert!(dot(&r, &rest).abs() <= 16.0 * EPS * size * size);
    // Idempotent: a point of the boundary may move by its rounding.
    let (again, _) = project(&r, mu);
    assert!(norm(&minus(&again, &r)) <= 8.0 * EPS * size);
    match status {
        Status::Open => assert_eq!(r, [0.0; D]),
        Status::Stick => assert!(mu > 0.0 && r == tau),
        Status::Slip => assert!(r[0] > 0.0),
    }
    // Powers of two: homogeneous to the bit.
    let (scaled, same) = project(&tau.map(|c| 0.125 * c), mu);
    assert_eq!((scaled, same), (r.map(|c| 0.125 * c), status));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, max_global_rejects: 100_000, failure_persistence: None, ..Default::default() })]

    #[test]
    fn projects_in_the_plane((tau, mu) in point_and_mu::<2>()) {
        projection_is_the_projection(tau, mu);
    }

    #[test]
    fn projects_in_space((tau, mu) in point_and_mu::<3>()) {
        projection_is_the_projection(tau, mu);
    }

    #[test]
    fn increments_are_projected_onto_the_translated_cone(
        (tau, mu) in point_and_mu::<3>(), (base, _) in point_and_mu::<3>()
    ) {
        let (dt, status) = project_increment(&tau, &base, mu);
        let total: [f64; 3] = std::array::from_fn(|k| base[k] + tau[k]);
        let (expected, same) = project(&total, mu);
        prop_assert_eq!(status, same);
        let back: [f64; 3] = std::array::from_fn(|k| base[k] + dt[k]);
        prop_assert!(norm(&minus(&back, &expected)) <= 4.0 * EPS * (norm(&base) + norm(&tau)));
        if status == Status::Stick {
            prop_assert_eq!(dt, tau);
        }
    }
}

#[test]
fn vertex_ends_of_the_range_and_special_coefficients() {
    assert_eq!(project(&[0.0, 0.0, 0.0], 0.5), ([0.0; 3], Status::Open));
    assert_eq!(project(&[-1.0, 0.0, 0.0], 0.0), ([0.0; 3], Status::Open));
    assert_eq!(
        project(&[2.0, 5.0, -1.0], 0.0),
        ([2.0, 0.0, 0.0], Status::Slip)
    );
    assert_eq!(project(&[1.0, -1e3], 1e8), ([1.0, -1e3], Status::Stick));
    // A tie of stick and slip is stick.
    assert_eq!(project(&[1.0, 0.5], 0.5), ([1.0, 0.5], Status::Stick));
    let (reference, _) = project(&[1.0, 3.0, 4.0], 0.5);
    for exponent in [-1060, -600, 600, 1020] {
        let half = 2.0_f64.powi(exponent / 2);
        let scale = |x: f64| x * half * 2.0_f64.powi(exponent - exponent / 2);
        let (r, status) = project(&[1.0, 3.0, 4.0].map(scale), 0.5);
        assert_eq!(status, Status::Slip);
        for k in 0..3 {
            // Below the normal range the result is rounded to the spacing there.
            let spacing = 4.0 * f64::from_bits(1);
            assert!((r[k] - scale(reference[k])).abs() <= 4.0 * EPS * r[k].abs() + spacing);
        }
    }
    let (r, _) = project(&[f64::MAX / 4.0; 3], 0.7);
    assert!(r.iter().all(|c| c.is_finite() && *c > 0.0));
}

#[test]
fn gap_of_a_total_state_is_a_power() {
    // Sliding against the reaction at the limit: no gap. With it: twice the power.
    let r = [2.0, -0.6];
    assert!(gap(&r, &[0.0, 0.5], 0.3).abs() <= 4.0 * EPS);
    assert!((gap(&r, &[0.0, -0.5], 0.3) - 0.6).abs() <= 4.0 * EPS);
    assert_eq!(corrected(&[0.1, 3.0, 4.0], 0.5), [2.6, 3.0, 4.0]);
}

#[test]
fn one_node_published_values() {
    // An anisotropic and a full block: slip is not along the trial force.
    let q = [-1.0, 1.6, 0.9];
    let diagonal = Block::<3>::from_diagonal(&[1.0, 2.0, 5.0].into());
    let (r, status) = one_node::solve(&diagonal, &q, 0.4, Habit::None).unwrap();
    assert_eq!(status, Status::Slip);
    for (x, y) in r.iter().zip([1.0, -0.380_025_48, -0.124_822_41]) {
        assert!((x - y).abs() <= 5e-9, "eight printed digits: {x} {y}");
    }
    let full = Block::<3>::new(1.0, 0.2, -0.1, 0.2, 2.0, 0.5, -0.1, 0.5, 5.0);
    let (r, _) = one_node::solve(&full, &q, 0.4, Habit::None).unwrap();
    for (x, y) in r.iter().zip([1.076_523_77, -0.422_976_89, -0.080_716_13]) {
        assert!((x - y).abs() <= 5e-9, "eight printed digits: {x} {y}");
    }
}

#[test]
fn one_node_with_prescribed_components() {
    // Nothing moves: open without penetration, no answer with it.
    assert_eq!(
        one_node::solve(&Block::<2>::zeros(), &[0.0, 1.0], 0.5, Habit::None),
        Some(([0.0; 2], Status::Open))
    );
    assert_eq!(
        one_node::solve(&Block::<2>::zeros(), &[-1.0, 0.0], 0.5, Habit::None),
        None
    );
    // One tangent prescribed and still: it carries nothing.
    let w = Block::<3>::new(2.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5, 0.0, 1.0);
    let (r, status) = one_node::solve(&w, &[-1.0, 0.0, 0.1], 0.9, Habit::None).unwrap();
    // By hand, of 2 r_n + r_2/2 = 1 and r_n/2 + r_2 = −1/10.
    assert_eq!((r[1], status), (0.0, Status::Stick));
    assert!(norm(&minus(&r, &[0.6, 0.0, -0.4])) <= 4.0 * EPS);
    // Prescribed and dragged: friction at the limit against the motion.
    let w = Block::<3>::from_diagonal(&[2.0, 0.0, 0.0].into());
    let (r, status) = one_node::solve(&w, &[-1.0, 0.3, -0.4], 0.5, Habit::None).unwrap();
    assert_eq!(status, Status::Slip);
    assert!(norm(&minus(&r, &[0.5, -0.15, 0.2])) <= 4.0 * EPS);
}

#[test]
fn a_closed_node_stays_on_its_branch() {
    // Wedged: k_n = 2, k_t = 1, k_c = 0.5, μ = 3 > k_t/k_c; at zero load, displaced
    // by u_t = 2, it sticks with r = (1, 2), or opens.
    let w = Block::<2>::new(2.0, 0.5, 0.5, 1.0).try_inverse().unwrap();
    let q = [0.0, -2.0];
    let (r, status) = one_node::solve(&w, &q, 3.0, Habit::Closed).unwrap();
    assert_eq!(status, Status::Stick);
    assert!(norm(&minus(&r, &[1.0, 2.0])) <= 16.0 * EPS);
    let (r, status) = one_node::solve(&w, &q, 3.0, Habit::None).unwrap();
    assert_eq!((r, status), ([0.0; 2], Status::Open));
}

/// A point inside the second-order cone, as near to its rim as `1 − share`.
fn inside<const D: usize>() -> impl Strategy<Value = Vector<D>> {
    let component = prop_oneof![-1.0..1.0_f64, -1e3..1e3_f64, -1e-6..1e-6_f64];
    let tangential = proptest::array::uniform::<_, D>(component);
    (tangential, 1e-3..1e3_f64).prop_map(|(t, excess)| {
        let mut x = Vector::from(t);
        x[0] = tangential_norm(&t) * (1.0 + excess) + excess;
        x
    })
}

fn scaling_makes_one_point_of_two<const D: usize>(z: Vector<D>, s: Vector<D>) {
    let p = NesterovTodd::new(&z, &s).expect("both lie inside of the cone");
    let apart = |x: Vector<D>, y: Vector<D>| (x - y).norm() / y.norm();
    // Roundings of z and s grow by what the scaling stretches them by.
    let stretch = p.forward.norm() * p.inverse.norm();
    assert!(apart(p.inverse * s, p.point) <= 64.0 * EPS * stretch);
    assert!(apart(p.inverse * p.point, z) <= 64.0 * EPS * stretch);
    assert!((p.point.norm_squared() - z.dot(&s)).abs() <= 64.0 * EPS * stretch * z.dot(&s));
    let b = second_order::product(&z, &s);
    let worst = z.norm_squared() / second_order::determinant(&z);
    assert!(apart(second_order::quotient(&b, &z), s) <= 64.0 * EPS * worst);
    // As far as it goes, and no further.
    let longest = second_order::longest_step(&z, &-s);
    assert!(second_order::determinant(&(z - s * (longest * (1.0 - 1e-6)))) > 0.0);
    let beyond = z - s * (longest * (1.0 + 1e-6));
    assert!(second_order::determinant(&beyond) < 0.0 || beyond[0] < 0.0);
}

proptest! {
    #[test]
    fn scaling_makes_one_point_of_two_in_the_plane(z in inside::<2>(), s in inside::<2>()) {
        scaling_makes_one_point_of_two(z, s);
    }

    #[test]
    fn scaling_makes_one_point_of_two_in_space(z in inside::<3>(), s in inside::<3>()) {
        scaling_makes_one_point_of_two(z, s);
    }
}

/// Errors of the misfit where it is not known exactly, and of a contact that is known to stick or
/// to slip.
fn misfits_have_their_errors<const D: usize>(rng: &mut StdRng) {
    let mut any = || -> [f64; D] { std::array::from_fn(|_| rng.random_range(-1.0..1.0)) };
    let (v, tau, mu) = (any(), any(), 0.1 + any()[0].abs());
    let p = 1.5 + any()[0];
    let face = Face::of(&project(&tau, mu).0, mu);
    // If `v` may be anywhere within `dv`, the misfit there is within its error.
    let dv: [f64; D] = any().map(|c| 1e-3 * c.abs());
    let (e, error) = face.misfit(&v, &dv, p, mu);
    let moved: [f64; D] = std::array::from_fn(|k| v[k] + dv[k] * any()[0]);
    let (there, _) = face.misfit(&moved, &[0.0; D], p, mu);
    assert!((0..D).all(|k| (there[k] - e[k]).abs() <= error[k]));
    // Where the contact is known to stick, y = 0; where the direction of its slip is, one
    // number is left, on the half-line of a contact without friction.
    let (held, _) = Face::misfit_held(&v, &dv, p);
    assert!(held[0] == -p * v[0] && held[1..] == v.map(|c| -c)[1..]);
    let (along, error) = face.misfit_along(v[0], dv[0], p);
    let expected = match face.place {
        Place::Apex => (-p * v[0]).max(0.0),
        _ => -p * v[0],
    };
    assert!((along - expected).abs() <= error);
}

#[test]
fn misfits_have_their_errors_in_the_plane_and_in_space() {
    let mut rng = StdRng::seed_from_u64(31);
    for _ in 0..2000 {
        misfits_have_their_errors::<2>(&mut rng);
        misfits_have_their_errors::<3>(&mut rng);
    }
}

#[test]
fn points_on_the_boundary_of_the_cone_have_no_scaling() {
    let (inside, boundary) = (Vector::<2>::new(2.0, 1.0), Vector::<2>::new(1.0, -1.0));
    assert!(NesterovTodd::new(&inside, &inside).is_some());
    for (z, s) in [
        (inside, boundary),
        (boundary, inside),
        (-inside, inside),
        (inside, -inside),
    ] {
        assert!(NesterovTodd::new(&z, &s).is_none());
    }
}
