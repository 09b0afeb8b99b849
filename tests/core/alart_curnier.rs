//! The map of Alart and Curnier (19) at one contact: its zeros are the law.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use bipot_rs::law::alart_curnier::{Linearised, linearised};
use bipot_rs::law::cone::Status;
use bipot_rs::law::one_node::{self, Habit};
use bipot_rs::linalg::small::{Block, Vector, tangential_norm};
use rand::{RngExt, SeedableRng, rngs::StdRng};

fn random<const D: usize>(rng: &mut StdRng) -> [f64; D] {
    std::array::from_fn(|_| rng.random_range(-1.0..1.0))
}

/// Distance of `x = r − v` from where the formula changes.
fn from_kinks<const D: usize>(x: &[f64; D], mu: f64) -> f64 {
    let t = tangential_norm(x);
    if x[0] <= 0.0 || mu == 0.0 {
        return x[0].abs();
    }
    x[0].min((t - mu * x[0]).abs() / mu.hypot(1.0)).min(t)
}

/// A block whose mean diagonal is one, as scaled variables have it.
fn block<const D: usize>(rng: &mut StdRng) -> Block<D> {
    let g = Block::<D>::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let w = g * g.transpose() + Block::identity() * 0.3;
    w * (Block::<D>::identity().trace() / w.trace())
}

fn moved<const D: usize>(w: &Block<D>, q: &[f64; D], r: &[f64; D]) -> [f64; D] {
    (w * Vector::from(*r) + Vector::from(*q)).into()
}

fn zeros_are_the_answers<const D: usize>() {
    let mut rng = StdRng::seed_from_u64(20);
    let mut seen = [0; 3];
    for _ in 0..6000 {
        let (w, q) = (block::<D>(&mut rng), random::<D>(&mut rng));
        let mu = [0.0, 0.1, 0.4][rng.random_range(0..3)];
        let (answer, status) = one_node::solve(&w, &q, mu, Habit::None).unwrap();
        let at = |r: &[f64; D]| linearised(r, &moved(&w, &q, r), mu);
        let Linearised {
            value,
            status: same,
            ..
        } = at(&answer);
        // Sizes and conditions are below ten: some roundings of one.
        assert!(value.amax() <= 1e-13, "{w} {q:?} {mu} {value}");
        let x: [f64; D] = std::array::from_fn(|k| answer[k] - moved(&w, &q, &answer)[k]);
        if from_kinks(&x, mu) > 1e-9 {
            assert_eq!(same, status);
        }
        seen[status as usize] += 1;
        // There is one answer: elsewhere the map is away from zero, by the smallest
        // eigenvalue of the block, above 0.1, less what friction takes.
        let away = 10.0_f64.powf(rng.random_range(-6.0..0.0));
        let other = answer.map(|c| c + away * rng.random_range(-1.0..1.0));
        let distance = (Vector::from(other) - Vector::from(answer)).norm();
        assert!(
            at(&other).value.norm() >= 1e-2 * distance,
            "{w} {q:?} {mu} {other:?}"
        );
    }
    assert!(seen.iter().all(|&count| count > 30), "{seen:?}");
}

#[test]
fn zeros_are_the_answers_in_the_plane() {
    zeros_are_the_answers::<2>();
}

#[test]
fn zeros_are_the_answers_in_space() {
    zeros_are_the_answers::<3>();
}

#[test]
fn a_tie_of_stick_and_slip_is_stick_and_nothing_pressed_is_open() {
    let tie = linearised(&[1.0, 0.5], &[0.0, 0.0], 0.5);
    assert_eq!(tie.status, Status::Stick);
    assert_eq!(tie.by_v, Block::<2>::identity());
    let free = linearised(&[0.0; 3], &[0.0; 3], 0.5);
    assert_eq!(
        (free.status, free.by_r),
        (Status::Open, Block::<3>::identity())
    );
}
