//! The law with cohesion and dilatancy at one contact, against its definition: the set
//! `C = {r_n ≥ 0, ‖r_t‖ ≤ c + μ r_n}`, `v_n ≥ β‖v_t‖`, and what each part says.

use bipot_rs::law::alart_curnier::linearised;
use bipot_rs::law::bipotential::{gap, law_step};
use bipot_rs::law::cone::{Status, derivative, project};
use bipot_rs::law::contact_law::ContactLaw;
use bipot_rs::law::face::{Face, Place};
use bipot_rs::law::one_node::{self, Habit};
use bipot_rs::linalg::small::{Block, Vector, dot, tangential_norm};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Errors of a few operations on numbers of order one.
const ROUNDING: f64 = 1e-13;

fn any<const D: usize>(rng: &mut StdRng) -> [f64; D] {
    std::array::from_fn(|_| rng.random_range(-2.0..2.0))
}

/// A law in which each number may be zero, and β may be μ.
fn any_law(rng: &mut StdRng) -> ContactLaw {
    let mu = if rng.random_bool(0.2) {
        0.0
    } else {
        rng.random_range(0.0..1.5)
    };
    let cohesion = if rng.random_bool(0.2) {
        0.0
    } else {
        rng.random_range(0.0..1.0)
    };
    let share = [0.0, 1.0, rng.random_range(0.0..1.0)][rng.random_range(0..3)];
    ContactLaw {
        mu,
        cohesion,
        dilatancy: share * mu,
    }
}

/// A point of `C`, often on its boundary.
fn within<const D: usize>(rng: &mut StdRng, law: &ContactLaw) -> [f64; D] {
    let mut r: [f64; D] = any(rng);
    r[0] = r[0].max(0.0);
    let length = tangential_norm(&r);
    let most = law.limit(r[0]);
    if length > most {
        r[1..].iter_mut().for_each(|c| *c *= most / length);
    }
    r
}

/// The derivative by central differences. Away from borders and from a small tangential part the
/// third derivatives are at most 1e3, the squared step 1e-12 and the rounding 1e-10.
fn differences<const D: usize>(x: &[f64; D], map: impl Fn(&[f64; D]) -> [f64; D]) -> Block<D> {
    let step = 1e-6;
    let mut slopes = Block::<D>::zeros();
    for k in 0..D {
        let moved = |by: f64| {
            let mut x = *x;
            x[k] += by;
            Vector::from(map(&x))
        };
        slopes.set_column(k, &((moved(step) - moved(-step)) / (2.0 * step)));
    }
    slopes
}

/// What of the law does not hold, in the units of numbers of order one.
fn violation<const D: usize>(r: &[f64; D], v: &[f64; D], law: &ContactLaw) -> f64 {
    let slip = tangential_norm(v);
    let opening = v[0] - law.dilatancy * slip;
    let limit = law.cohesion + law.mu * r[0];
    let along: f64 = (1..D).map(|k| r[k] * v[k]).sum();
    [
        -r[0],
        tangential_norm(r) - limit,
        -opening,
        (r[0] * opening).abs(),
        (limit * slip + along).abs(),
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

/// A reaction and a displacement on the law, in each status.
fn on_law<const D: usize>(rng: &mut StdRng, law: &ContactLaw) -> ([f64; D], [f64; D], Status) {
    let mut r: [f64; D] = within(rng, law);
    let direction: [f64; D] = any(rng);
    let slip = rng.random_range(0.1..2.0);
    let status = [Status::Open, Status::Slip, Status::Stick][rng.random_range(0..3)];
    let mut v = [0.0; D];
    if status == Status::Stick {
        r[0] += 0.1;
        return (r, v, status);
    }
    r[0] = if status == Status::Open {
        0.0
    } else {
        r[0] + 0.1
    };
    let scale = slip / tangential_norm(&direction);
    for k in 1..D {
        v[k] = scale * direction[k];
        r[k] = -law.limit(r[0]) * v[k] / slip;
    }
    v[0] = law.dilatancy * slip;
    if status == Status::Open {
        v[0] += 0.2;
    }
    (r, v, status)
}

fn the_projection_is_the_nearest_point<const D: usize>(rng: &mut StdRng) {
    let (law, tau) = (any_law(rng), any::<D>(rng));
    let (p, status) = project(&tau, law);
    assert!(violation(&p, &[0.0; D], &law) <= ROUNDING);
    assert_eq!(status == Status::Open, p[0] == 0.0, "{tau:?} {law:?}");
    for _ in 0..20 {
        let z: [f64; D] = within(rng, &law);
        let product: f64 = (0..D).map(|k| (tau[k] - p[k]) * (z[k] - p[k])).sum();
        assert!(
            product <= ROUNDING,
            "{tau:?} {law:?}: {z:?} is nearer than {p:?}"
        );
    }
    // Homogeneous in forces: to the bit for powers of two.
    let (smaller, same) = project(&tau.map(|c| 0.125 * c), law.scaled(0.125));
    assert_eq!((smaller.map(|c| 8.0 * c), same), (p, status));
}

fn its_derivative_is_that_of_differences<const D: usize>(rng: &mut StdRng) {
    let (law, tau) = (any_law(rng), any::<D>(rng));
    let difference = differences(&tau, |x| project(x, law).0);
    // Away from the borders the difference has an error of its step; at a border the two
    // sides differ.
    let (_, status) = project(&tau, law);
    let apart = (0..D).all(|k| {
        [-1e-5, 1e-5].iter().all(|step| {
            let mut x = tau;
            x[k] += step;
            let length = tangential_norm(&x) - law.cohesion;
            let before = tangential_norm(&tau) - law.cohesion;
            project(&x, law).1 == status && (length > 0.0) == (before > 0.0)
        })
    });
    if apart && tangential_norm(&tau) > 0.1 {
        assert!(
            (derivative(&tau, law) - difference).amax() <= 1e-6,
            "{tau:?} {law:?}"
        );
    }
}

fn the_gap_is_zero_on_the_law_only<const D: usize>(rng: &mut StdRng) {
    let law = any_law(rng);
    let (r, v, status) = on_law::<D>(rng, &law);
    assert!(violation(&r, &v, &law) <= ROUNDING);
    assert!(gap(&r, &v, law).abs() <= ROUNDING);
    let rho = rng.random_range(0.1..5.0);
    let (next, same) = law_step(&r, &v, rho, law);
    assert!(
        (0..D).all(|k| (next[k] - r[k]).abs() <= ROUNDING),
        "{r:?} {v:?} {law:?}"
    );
    // A reaction on the border may lie beyond it by rounding.
    let inside = tangential_norm(&r) < law.limit(r[0]) - ROUNDING;
    let certain = status == Status::Open || (status == Status::Stick && inside);
    if law.has_friction() && certain {
        assert_eq!(same, status, "{r:?} {v:?} {law:?}");
    }
    // The map of Newton's method has the same zeros.
    let rows = linearised(&r, &v, law);
    assert!(rows.value.amax() <= ROUNDING, "{r:?} {v:?} {law:?}");
    // Elsewhere in its domain the gap is positive, and no step of (11) stays.
    let other: [f64; D] = within(rng, &law);
    let mut moved: [f64; D] = any(rng);
    moved[0] = moved[0].abs() + law.dilatancy * tangential_norm(&moved);
    let excess = gap(&other, &moved, law);
    assert!(excess >= -ROUNDING);
    let (step, _) = law_step(&other, &moved, rho, law);
    let stays = (0..D).all(|k| (step[k] - other[k]).abs() <= 1e-9);
    assert!(!stays || excess <= 1e-7, "{other:?} {moved:?} {law:?}");
}

fn the_rows_of_newton_are_derivatives<const D: usize>(rng: &mut StdRng) {
    let (law, r, v) = (any_law(rng), any::<D>(rng), any::<D>(rng));
    let rows = linearised(&r, &v, law);
    let status_of = |r: &[f64; D], v: &[f64; D]| {
        let at = linearised(r, v, law);
        let x: [f64; D] = std::array::from_fn(|k| r[k] - v[k]);
        (at.status, tangential_norm(&x) > law.cohesion)
    };
    let near = (0..D).all(|k| {
        [-1e-5, 1e-5].iter().all(|step| {
            let mut other = r;
            other[k] += step;
            status_of(&other, &v) == status_of(&r, &v)
        })
    });
    let x: [f64; D] = std::array::from_fn(|k| r[k] - v[k]);
    if near && tangential_norm(&x) > 0.1 {
        let by_r = differences(&r, |r| linearised(r, &v, law).value.into());
        let by_v = differences(&v, |v| linearised(&r, v, law).value.into());
        assert!((rows.by_r - by_r).amax() <= 1e-6, "{r:?} {v:?} {law:?}");
        assert!((rows.by_v - by_v).amax() <= 1e-6, "{r:?} {v:?} {law:?}");
    }
}

fn one_contact_is_solved_exactly<const D: usize>(rng: &mut StdRng, seen: &mut [usize; 3]) {
    let law = any_law(rng);
    let root = Block::<D>::from_fn(|_, _| rng.random_range(-1.0..1.0));
    // The coupling of normal and tangent is weak enough for one solution.
    let w = root * root.transpose() * 0.2 + Block::identity() * rng.random_range(0.5..2.0);
    let q: [f64; D] = any(rng);
    let (r, status) = one_node::solve(&w, &q, law, Habit::None).expect("there is a solution");
    let v: [f64; D] = (w * Vector::from(r) + Vector::from(q)).into();
    assert!(violation(&r, &v, &law) <= 1e-11, "{w} {q:?} {law:?}: {r:?}");
    seen[status as usize] += 1;
    // The map of Newton's method is away from zero elsewhere, by the smallest eigenvalue of the
    // block, above 0.5, less what friction takes.
    let mut own = StdRng::seed_from_u64(q[0].to_bits());
    let change = Vector::from(any::<D>(&mut own)) * 10.0_f64.powf(own.random_range(-6.0..0.0));
    let other: [f64; D] = (Vector::from(r) + change).into();
    let moved: [f64; D] = (w * Vector::from(other) + Vector::from(q)).into();
    let value = linearised(&other, &moved, law).value;
    assert!(value.norm() >= 1e-2 * change.norm(), "{w} {q:?} {law:?}");
    // Units: powers of two change no bit.
    let (a, b) = (2.0_f64.powi(40), 2.0_f64.powi(-31));
    let (other, same) =
        one_node::solve(&(w * a), &q.map(|c| b * c), law.scaled(b / a), Habit::None)
            .expect("there is a solution");
    assert_eq!((other.map(|c| c * (a / b)), same), (r, status));
}

/// The misfit `e = y − V` leads to the nearest inward normal `y` of `C` at the reaction.
fn the_misfit_leads_to_the_nearest_normal<const D: usize>(rng: &mut StdRng, seen: &mut [usize; 5]) {
    let mut law = any_law(rng);
    law.dilatancy = 0.0;
    let (tau, v) = (any::<D>(rng), any::<D>(rng));
    let face = Face::of(&project(&tau, law).0, law);
    let p = rng.random_range(0.5..2.5);
    let mut weighted = v;
    weighted[0] = p * v[0] + law.mu * tangential_norm(&v);
    if !law.has_friction() {
        weighted = [0.0; D];
        weighted[0] = p * v[0];
    }
    let (e, error) = face.misfit(&v, &[0.0; D], p, law.mu);
    assert!(error.iter().all(|e| (0.0..=1e-12).contains(e)));
    let y: [f64; D] = std::array::from_fn(|k| weighted[k] + e[k]);
    let to = |z: &[f64; D]| -> [f64; D] { std::array::from_fn(|k| z[k] - face.reaction[k]) };
    for _ in 0..20 {
        let z: [f64; D] = within(rng, &law);
        assert!(
            dot(&y, &to(&z)) >= -ROUNDING,
            "{law:?} {face:?}: {y:?} is no normal"
        );
        // A normal at the same reaction, from any point outside.
        let mut out: [f64; D] = any(rng);
        let far: [f64; D] = std::array::from_fn(|k| face.reaction[k] + out[k]);
        let (near, _) = project(&far, law);
        let same = (0..D).all(|k| (near[k] - face.reaction[k]).abs() <= 1e-15);
        if same {
            out = out.map(|c| -c);
            let turn: f64 = (0..D).map(|k| e[k] * (out[k] - y[k])).sum();
            assert!(turn >= -ROUNDING, "{law:?} {face:?}: {out:?} is nearer");
        }
    }
    let kind = match face.place {
        Place::Apex => 0,
        Place::Ray(_) => 1,
        Place::Inside => 2,
        Place::Edge(None) => 3,
        Place::Edge(Some(_)) => 4,
    };
    seen[kind] += 1;
}

fn all<const D: usize>(seed: u64) {
    let mut rng = StdRng::seed_from_u64(seed);
    let (mut statuses, mut faces) = ([0; 3], [0; 5]);
    for _ in 0..400 {
        the_projection_is_the_nearest_point::<D>(&mut rng);
        its_derivative_is_that_of_differences::<D>(&mut rng);
        the_gap_is_zero_on_the_law_only::<D>(&mut rng);
        the_rows_of_newton_are_derivatives::<D>(&mut rng);
        one_contact_is_solved_exactly::<D>(&mut rng, &mut statuses);
        the_misfit_leads_to_the_nearest_normal::<D>(&mut rng, &mut faces);
    }
    assert!(
        statuses.iter().chain(&faces).all(|&n| n > 1),
        "{statuses:?} {faces:?}"
    );
}

#[test]
fn the_law_in_the_plane() {
    all::<2>(1);
}

#[test]
fn the_law_in_space() {
    all::<3>(2);
}

#[test]
fn a_tie_of_stick_and_slip_is_stick_and_nothing_pressed_is_open() {
    let tie = linearised(&[1.0, 0.5], &[0.0, 0.0], 0.5);
    assert_eq!((tie.status, tie.by_v), (Status::Stick, Block::identity()));
    let free = linearised(&[0.0; 3], &[0.0; 3], 0.5);
    assert_eq!((free.status, free.by_r), (Status::Open, Block::identity()));
}

/// A stress of a plane, and one of space.
#[test]
fn the_law_of_more_components() {
    all::<4>(3);
    all::<6>(4);
}
