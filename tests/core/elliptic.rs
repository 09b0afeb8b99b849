//! Friction with two coefficients: the projection onto the elliptic cone, for all valid
//! coefficients and any size, and the invariants of the change of variables.

#![expect(clippy::float_cmp, reason = "bits are compared on purpose")]
#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;

use crate::common::minus;
use bipot_rs::Error;
use bipot_rs::law::bipotential::{gap, law_step};
use bipot_rs::law::cone::{Status, project};
use bipot_rs::law::elliptic::{project_elliptic, project_elliptic_increment};
use bipot_rs::linalg::small::{dot, norm};
use bipot_rs::linalg::sparse::blocks::Blocks;
use bipot_rs::linalg::sparse::rows::OwnedMatrix;
use bipot_rs::reduced::compliance::{Compliance, Part};
use bipot_rs::reduced::elliptic_scaling::EllipticScaling;
use bipot_rs::reduced::rotation::Rotation;
use proptest::prelude::*;

const EPS: f64 = f64::EPSILON;

/// `‖D⁻¹ x_t‖`.
fn shear(x: &[f64; 3], mu: [f64; 2]) -> f64 {
    (x[1] / mu[0]).hypot(x[2] / mu[1])
}

/// `‖D x_t‖`.
fn drag(x: &[f64; 3], mu: [f64; 2]) -> f64 {
    (x[1] * mu[0]).hypot(x[2] * mu[1])
}

/// Points of all kinds: in the middle, and near the borders of the cone and of its
/// polar, where the status changes.
fn point_and_mu() -> impl Strategy<Value = ([f64; 3], [f64; 2])> {
    let component = || prop_oneof![Just(0.0), -1.0..1.0_f64, -1e3..1e3_f64, -1e-6..1e-6_f64];
    let mu = || {
        prop_oneof![
            0.01..3.0_f64,
            (-8.0..8.0_f64).prop_map(|e| 10.0_f64.powf(e))
        ]
    };
    let place = prop_oneof![Just(None), Just(Some(true)), Just(Some(false))];
    let parts = (component(), component(), component(), mu(), mu());
    (parts, place, -16.0..0.0_f64).prop_map(|((n, t1, t2, m1, m2), place, apart)| {
        let mu = [m1, m2];
        let near = 1.0 - 10.0_f64.powf(apart);
        let n = match place {
            None => n,
            Some(true) => shear(&[n, t1, t2], mu) * near,
            Some(false) => -drag(&[n, t1, t2], mu) * near,
        };
        ([n, t1, t2], mu)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn the_remainder_is_normal_to_the_cone_at_the_projection((tau, mu) in point_and_mu()) {
        let (r, status) = project_elliptic(&tau, mu);
        let size = norm(&tau);
        let rest = minus(&tau, &r);
        // On the cone to the rounding of its own formula: a few operations a component.
        prop_assert!(r[0] >= 0.0 && shear(&r, mu) <= r[0] * (1.0 + 8.0 * EPS));
        // In the polar cone to the rounding of the point, over the length of its rays.
        let ray = mu[0].max(mu[1]).hypot(1.0);
        prop_assert!((rest[0] + drag(&rest, mu)) / ray <= 16.0 * EPS * size, "{rest:?}");
        // These two and orthogonality are the projection (Moreau); |τ|² bounds products.
        prop_assert!(dot(&r, &rest).abs() <= 16.0 * EPS * size * size);
        // A point of the boundary may move by its rounding.
        let (again, _) = project_elliptic(&r, mu);
        prop_assert!(norm(&minus(&again, &r)) <= 16.0 * EPS * size);
        match status {
            Status::Open => prop_assert_eq!(r, [0.0; 3]),
            Status::Stick => prop_assert_eq!(r, tau),
            Status::Slip => prop_assert!(r[0] > 0.0),
        }
    }

    #[test]
    fn its_size_and_the_order_of_its_axes_do_not_matter((tau, mu) in point_and_mu()) {
        let (r, status) = project_elliptic(&tau, mu);
        // Powers of two, into the range where squares overflow too: to the bit.
        for power in [-3, 40] {
            let scale = 2.0_f64.powi(power);
            let (scaled, same) = project_elliptic(&tau.map(|c| scale * c), mu);
            prop_assert_eq!((scaled, same), (r.map(|c| scale * c), status));
        }
        let (turned, same) = project_elliptic(&[tau[0], tau[2], tau[1]], [mu[1], mu[0]]);
        prop_assert_eq!(same, status);
        // Sums of two numbers in the other order, which `hypot` need not round alike.
        prop_assert!(norm(&minus(&[turned[0], turned[2], turned[1]], &r)) <= 16.0 * EPS * norm(&tau));
        let (mirrored, _) = project_elliptic(&[tau[0], -tau[1], tau[2]], mu);
        prop_assert_eq!(mirrored, [r[0], -r[1], r[2]]);
    }

    #[test]
    fn equal_coefficients_are_coulombs((tau, mu) in point_and_mu()) {
        prop_assert_eq!(project_elliptic(&tau, [mu[0]; 2]), project(&tau, mu[0]));
        // And nearly equal ones nearly so: an ulp of μ moves r by an ulp of its size.
        let close = [mu[0], mu[0] * (1.0 + EPS)];
        let apart = minus(&project_elliptic(&tau, close).0, &project(&tau, mu[0]).0);
        prop_assert!(norm(&apart) <= 32.0 * EPS * norm(&tau));
    }

    #[test]
    fn on_the_borders_it_keeps_the_digits_of_the_point((tau, mu) in point_and_mu()) {
        let (drag, shear) = (drag(&tau, mu), shear(&tau, mu));
        for ulps in -3_i32..=3 {
            // A few roundings from the border of the polar cone the nearest point is the
            // apex but for as many; at the border of the cone it is the point itself.
            let apart = 1.0 + f64::from(ulps) * EPS;
            let polar = [-drag * apart, tau[1], tau[2]];
            prop_assert!(norm(&project_elliptic(&polar, mu).0) <= 16.0 * EPS * norm(&polar));
            let border = [shear * apart, tau[1], tau[2]];
            let moved = minus(&project_elliptic(&border, mu).0, &border);
            prop_assert!(norm(&moved) <= 16.0 * EPS * norm(&border));
        }
    }

    #[test]
    fn along_an_axis_it_is_the_plane_cone(n in -3.0..3.0_f64, t in -3.0..3.0_f64, mu in 0.01..3.0_f64) {
        // The plane of normal and axis is one of symmetry, so the point stays in it.
        let ([r_n, r_t], status) = project(&[n, t], mu);
        let (first, same) = project_elliptic(&[n, t, 0.0], [mu, 0.7]);
        prop_assert_eq!(same, status);
        // Two formulas for one point, some operations each.
        prop_assert!(norm(&minus(&first, &[r_n, r_t, 0.0])) <= 16.0 * EPS * (n.abs() + t.abs()));
    }

    #[test]
    fn an_increment_is_a_translated_point(
        (tau, mu) in point_and_mu(), base in proptest::array::uniform3(-1.0..1.0_f64)
    ) {
        let (t, status) = project_elliptic_increment(&tau, &base, mu);
        let total = std::array::from_fn(|k| base[k] + tau[k]);
        let (r, same) = project_elliptic(&total, mu);
        prop_assert_eq!(status, same);
        if status == Status::Stick {
            prop_assert_eq!(t, tau);
        } else {
            prop_assert_eq!(t, minus(&r, &base));
        }
    }
}

#[test]
fn the_apex_the_axis_and_no_friction() {
    let mu = [0.5, 0.1];
    assert_eq!(project_elliptic(&[0.0; 3], mu), ([0.0; 3], Status::Open));
    let pulled = [-1.0, 0.0, 0.0];
    assert_eq!(project_elliptic(&pulled, mu), ([0.0; 3], Status::Open));
    let pressed = [1.0, 0.0, 0.0];
    assert_eq!(project_elliptic(&pressed, mu), (pressed, Status::Stick));
    // Both zero: the half-line, where a pressed contact slides.
    let frictionless = project_elliptic(&[2.0, 1.0, 1.0], [0.0; 2]);
    assert_eq!(frictionless, ([2.0, 0.0, 0.0], Status::Slip));
    // τ_n = 0: λ = 1, r_n = ‖(τ_i μ_i/(1 + μ_i²))‖ by hand.
    let (r, status) = project_elliptic(&[0.0, 3.0, 4.0], [1.0, 0.5]);
    assert_eq!(status, Status::Slip);
    let by_hand = [1.5_f64.hypot(1.6), 1.5, 0.8];
    assert!(norm(&minus(&r, &by_hand)) <= 8.0 * EPS * norm(&by_hand));
    // The ends of the range.
    for size in [1e-305, 1e305] {
        let (far, status) = project_elliptic(&[0.0, 3.0 * size, 4.0 * size], [1.0, 0.5]);
        assert_eq!(status, Status::Slip);
        let back = far.map(|c| c / size);
        assert!(norm(&minus(&back, &by_hand)) <= 16.0 * EPS * norm(&by_hand));
    }
}

/// The larger coefficients, and the scaling.
fn scaling(mu: &[[f64; 2]]) -> (Vec<f64>, EllipticScaling) {
    let (largest, elliptic) = EllipticScaling::new(mu).unwrap();
    (largest, elliptic.unwrap())
}

/// A symmetric `W` of two contacts, dense.
fn compliance() -> Result<Compliance<'static, 3>, Error> {
    let n = 6_u8;
    let entry = |i: u8, j: u8| {
        let (i, j) = (f64::from(i), f64::from(j));
        (1.0 + i + j).recip() + f64::from(u8::from(i == j))
    };
    let dense = (0..n).flat_map(|i| (0..n).map(move |j| entry(i, j)));
    Compliance::from_dense(2, Cow::Owned(dense.collect()))
}

/// The same in sparse blocks.
fn sparse() -> Compliance<'static, 3> {
    let dense = compliance().unwrap().to_dense();
    let blocks =
        (0..4).flat_map(|at| (0..9).map(move |k| (3 * (at / 2) + k / 3, 3 * (at % 2) + k % 3)));
    let entries: Vec<f64> = blocks.map(|(i, j)| dense[6 * i + j]).collect();
    let blocks = Blocks::new(&[0, 2, 4], &[0, 1, 0, 1], &entries).unwrap();
    Compliance::new(vec![(vec![0, 1], Part::Sparse(Cow::Owned(blocks)))]).unwrap()
}

#[test]
fn sparse_blocks_are_those_of_the_dense_matrix() {
    let (dense, sparse) = (compliance().unwrap(), sparse());
    assert_eq!(sparse.to_dense(), dense.to_dense());
    let (_, elliptic) = scaling(&[[0.3, 0.1], [0.2, 0.7]]);
    let scaled = [&dense, &sparse].map(|w| w.scaled(&elliptic).unwrap().to_dense());
    assert_eq!(scaled[0], scaled[1]);
    let x = [[0.3, -1.0, 2.0], [0.5, 0.1, -0.7]];
    for (contact, k) in (0..2).flat_map(|i| (0..3).map(move |k| (i, k))) {
        let [a, b] = [&dense, &sparse].map(|w| w.exact_row(contact, k, &x).value());
        assert_eq!(a, b);
    }
    let [a, b] = [&dense, &sparse].map(|w| {
        let mut y = [[0.0; 3]; 2];
        w.add_columns(1..3, &x, &mut y);
        y
    });
    for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
        // Sums of four products in another order.
        assert!((a - b).abs() <= 8.0 * EPS);
    }
}

#[test]
fn scaling_is_t_w_t_and_leads_back() {
    let (mu, elliptic) = scaling(&[[0.3, 0.1], [0.2, 0.7]]);
    assert_eq!(mu, [0.3, 0.7]);
    let t = [1.0, 1.0, 0.1 / 0.3, 1.0, 0.2 / 0.7, 1.0];
    let given = compliance().unwrap();
    let made = given.scaled(&elliptic).unwrap();
    assert!(made.is_symmetric(), "what is symmetric stays so to the bit");
    let (whole, scaled) = (given.to_dense(), made.to_dense());
    for (k, (w, s)) in whole.iter().zip(&scaled).enumerate() {
        assert_eq!(*s, w * (t[k / 6] * t[k % 6]));
    }
    let back = made.scaled(&elliptic.inverse()).unwrap().to_dense();
    // Four products and two quotients.
    let apart = back.iter().zip(&whole).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) <= 4.0 * EPS);
    // From one scaling to another, as from none to the other.
    let (_, other) = scaling(&[[0.1, 0.1], [0.5, 0.4]]);
    let change = EllipticScaling::between(Some(&elliptic), Some(&other)).unwrap();
    let changed = made.scaled(&change).unwrap().to_dense();
    let straight = given.scaled(&other).unwrap().to_dense();
    let apart = changed.iter().zip(&straight).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) <= 4.0 * EPS);
    assert!(EllipticScaling::between(None, None).is_none());
}

#[test]
fn the_law_of_one_is_that_of_the_other() {
    // Slip along (3, 4) with μ = (0.4, 0.2), by hand: r_t = −(0.48, 0.16)/√2.08.
    let (mu, elliptic) = scaling(&[[0.4, 0.2]]);
    let size = 2.08_f64.sqrt();
    let (r, v) = ([1.0, -0.48 / size, -0.16 / size], [0.0, 3.0, 4.0]);
    let (flat_r, flat_v) = (elliptic.over(&[r])[0], elliptic.times(&[v])[0]);
    // Work is the same, and none is missing from the law: a few roundings of size 1.
    assert!((dot(&flat_r, &flat_v) - dot(&r, &v)).abs() <= 8.0 * EPS);
    assert!(gap(&flat_r, &flat_v, mu[0]).abs() <= 8.0 * EPS);
    let (step, status) = law_step(&flat_r, &flat_v, 1.0, mu[0]);
    assert_eq!(status, Status::Slip);
    assert!(norm(&minus(&step, &flat_r)) <= 8.0 * EPS);
}

#[test]
fn equal_coefficients_need_no_scaling() {
    let (mu, elliptic) = EllipticScaling::new(&[[0.3, 0.3], [0.0, 0.0], [1e-300, 1e-300]]).unwrap();
    assert_eq!(mu, [0.3, 0.0, 1e-300]);
    assert!(elliptic.is_none());
}

#[test]
fn invalid_coefficients_are_named() {
    let told = |pair: [f64; 2]| {
        let wrong = EllipticScaling::new(&[[0.3, 0.3], pair]);
        wrong.unwrap_err().to_string()
    };
    let node = "mu of contact 1 is ";
    assert_eq!(
        told([0.3, -1.0]),
        format!("{node}-1.0, expected zero or positive, at most 1e75")
    );
    assert!(told([0.3, 1e76]).starts_with(&format!("{node}1e76")));
    assert!(told([f64::NAN, 0.3]).starts_with(&format!("{node}NaN")));
    for wrong in [[0.3, 0.0], [0.0, 0.3], [0.3, 2.9e-7], [1e75, 1e-75]] {
        let expected = format!("{node}({}, {}), expected two positive", wrong[0], wrong[1]);
        assert!(told(wrong).starts_with(&expected), "{}", told(wrong));
    }
    assert!(EllipticScaling::new(&[[0.3, 3.1e-7]]).is_ok());
}

/// An orthogonal block: two turns and a reflection.
fn orthogonal(a: f64, b: f64) -> [[f64; 3]; 3] {
    let ((s, c), (t, d)) = (a.sin_cos(), b.sin_cos());
    [[c, -s * d, s * t], [-s, -c * d, c * t], [0.0, t, d]]
}

/// `Q W Qᵀ` row by row, back by `Qᵀ`, and with scaled variables as after the scaling.
#[test]
fn rotated_frames_have_the_rotated_compliance() {
    let frames = [orthogonal(0.4, 1.3), orthogonal(-2.0, 0.7)];
    let whole: Vec<[f64; 3]> = frames.concat();
    let transposed: Vec<[f64; 3]> = frames
        .iter()
        .flat_map(|q| std::array::from_fn::<_, 3, _>(|k| q.map(|row| row[k])))
        .collect();
    let (forth, back) = (
        Rotation::new(&whole, None),
        Rotation::new(&transposed, None),
    );
    let given = compliance().unwrap();
    let turned = given.rotated(&forth).unwrap();
    assert!(
        turned.is_symmetric(),
        "what is symmetric stays so to the bit"
    );
    let (w, made) = (given.to_dense(), turned.to_dense());
    let q = |i: usize, j: usize| if i / 3 == j / 3 { whole[i][j % 3] } else { 0.0 };
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
        let pairs = (0..6).flat_map(|k| (0..6).map(move |l| (k, l)));
        let sum: f64 = pairs.map(|(k, l)| q(i, k) * w[6 * k + l] * q(j, l)).sum();
        // Nine products of numbers up to two.
        assert!((made[6 * i + j] - sum).abs() <= 16.0 * EPS);
    }
    let close = |a: &[f64], b: &[f64]| {
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 64.0 * EPS));
    };
    close(&turned.rotated(&back).unwrap().to_dense(), &w);
    assert_eq!(sparse().rotated(&forth).unwrap().to_dense(), made);
    let x = [[0.3, -1.0, 2.0], [0.5, 0.1, -0.7]];
    assert_eq!(forth.contacts(), 2);
    close(
        back.times(&forth.times(&x)).as_flattened(),
        x.as_flattened(),
    );
    let (_, elliptic) = scaling(&[[0.3, 0.1], [0.2, 0.7]]);
    let of_scaled = Rotation::new(&whole, Some(&elliptic));
    let after = given
        .scaled(&elliptic)
        .unwrap()
        .rotated(&of_scaled)
        .unwrap();
    close(
        &after.to_dense(),
        &turned.scaled(&elliptic).unwrap().to_dense(),
    );
}

#[test]
fn rotated_rows_of_a_matrix_are_sorted_and_have_no_zeros() {
    // Normal and second tangent change places; the rows are those of one contact.
    let swap = Rotation::new(&[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]], None);
    let matrix = OwnedMatrix {
        pointer: vec![0, 2, 2, 3],
        index: vec![7, 2, 4],
        values: vec![1.5, -2.0, 3.0],
    };
    let turned = matrix.rotated(&swap);
    assert_eq!(turned.pointer, [0, 1, 1, 3]);
    assert_eq!(turned.index, [4, 2, 7]);
    assert_eq!(turned.values, [3.0, -2.0, 1.5]);
}
