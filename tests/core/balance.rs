//! Loads that contact cannot balance are refused with a proof; all others are accepted.

#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "small counts; a helper of a test may fail"
)]

use std::borrow::Cow;

use crate::common::GO;
use crate::common::cases::coulomb;
use bipot_rs::equilibrium::decide::{Decision, Verdict, decide};
use bipot_rs::equilibrium::programme::Limits;
use bipot_rs::linalg::small::norm;
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::existence::is_contradiction;
use bipot_rs::reduced::reduced::Rigid;
use bipot_rs::solver::at_rest::of_problem;
use bipot_rs::solver::{Outcome, Settings, Start, solve};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Contacts with rows `R` and friction μ, on supports of unequal compliance.
struct Contacts<const D: usize> {
    modes: Vec<Vec<[f64; D]>>,
    mu: Vec<f64>,
    compliance: Compliance<'static, D>,
}

fn tangential<const D: usize>(v: &[f64; D]) -> f64 {
    norm(&v[1..])
}

impl<const D: usize> Contacts<D> {
    fn new(modes: Vec<Vec<[f64; D]>>, mu: Vec<f64>, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let contacts = mu.len();
        let m = D * contacts;
        let mut w = vec![0.0; m * m];
        for i in 0..contacts {
            let softness = 10.0_f64.powf(rng.random_range(-1.0..1.0));
            (0..D).for_each(|k| w[(D * i + k) * (m + 1)] = softness);
        }
        Self {
            modes,
            mu,
            compliance: Compliance::from_dense(contacts, Cow::Owned(w)).unwrap(),
        }
    }

    /// Rows and friction from a seed. A free body has few: the cone of what they
    /// balance is then far from everything.
    fn random(contacts: usize, motions: usize, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut row = |_| std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        let modes = (0..motions)
            .map(|_| (0..contacts).map(&mut row).collect())
            .collect();
        let mu = (0..contacts).map(|_| match rng.random_range(0..5) {
            0 => 0.0,
            1 => 10.0,
            _ => rng.random_range(0.05..1.5),
        });
        let mu = mu.collect();
        Self::new(modes, mu, seed)
    }

    /// `R d` at a contact.
    fn moved(&self, contact: usize, motion: &[f64]) -> [f64; D] {
        std::array::from_fn(|k| {
            let of_mode = self.modes.iter().zip(motion);
            of_mode.map(|(mode, d)| mode[contact][k] * d).sum()
        })
    }

    /// `−Rᵀ r`, the load that a reaction balances.
    fn balanced_by(&self, r: &[[f64; D]]) -> Vec<f64> {
        let of_mode = |mode: &Vec<[f64; D]>| {
            let pairs = mode.as_flattened().iter().zip(r.as_flattened());
            -pairs.map(|(m, x)| m * x).sum::<f64>()
        };
        self.modes.iter().map(of_mode).collect()
    }

    /// The contacts turned so that none resists a given motion: the normal row
    /// changes sign where the motion would close the contact, and where friction
    /// holds it the tangential rows shrink until it works `inside` times less
    /// than the edge of `K*_μ` allows.
    fn yield_to(&mut self, motion: &[f64], inside: f64) {
        for i in 0..self.mu.len() {
            let v = self.moved(i, motion);
            let limit = self.mu[i] * tangential(&v);
            let allowed = inside * v[0].abs();
            let shrink = if limit > allowed {
                allowed / limit
            } else {
                1.0
            };
            for mode in &mut self.modes {
                mode[i][0] *= v[0].signum();
                mode[i][1..].iter_mut().for_each(|c| *c *= shrink);
            }
        }
    }

    fn decide(&self, load: &[f64]) -> Decision {
        let q = vec![[-1.0; D]; self.mu.len()];
        let rigid = Rigid {
            modes: self.modes.clone().into(),
            load: load.to_vec(),
        };
        let problem = coulomb(&self.compliance, &q, &self.mu, &rigid);
        let limits = Limits::new(&GO, f64::INFINITY);
        decide(&of_problem(&problem).unwrap(), load, limits).unwrap()
    }

    fn is_possible(&self, load: &[f64]) -> bool {
        self.decide(load).verdict == Verdict::Balanced
    }

    /// Whether a motion proves that a load cannot be balanced, by the definition: `R d` within
    /// a `distance` of `K*_μ`, and `e·d > 0` beyond rounding.
    fn is_proof(&self, load: &[f64], motion: &[f64], distance: f64) -> bool {
        let size = (0..self.mu.len())
            .map(|i| norm(&self.moved(i, motion)))
            .fold(0.0, f64::max);
        let inside = |i: usize| {
            let v = self.moved(i, motion);
            v[0] - self.mu[i] * tangential(&v) >= -distance * (1.0 + self.mu[i]) * size
        };
        let work: f64 = load.iter().zip(motion).map(|(e, d)| e * d).sum();
        let terms: f64 = load.iter().zip(motion).map(|(e, d)| (e * d).abs()).sum();
        (0..self.mu.len()).all(inside) && work > 1e-14 * terms
    }
}

fn on_the_edge<const D: usize>(rng: &mut StdRng, mu: f64, share: f64) -> [f64; D] {
    let mut r = [0.0; D];
    r[0] = rng.random_range(0.0..1.0);
    let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
    r[1] = mu
        * share
        * r[0]
        * if D == 2 {
            angle.cos().signum()
        } else {
            angle.cos()
        };
    if D == 3 {
        r[2] = mu * share * r[0] * angle.sin();
    }
    r
}

fn balanced_loads_are_let_pass<const D: usize>(contacts: usize, motions: usize) {
    for seed in 0..300 {
        let case = Contacts::<D>::random(contacts, motions, seed);
        let mut rng = StdRng::seed_from_u64(seed + 7);
        for share in [0.0, 0.5, 1.0] {
            // Some contacts pressed, to the edge of friction in the last round.
            let r: Vec<[f64; D]> = case
                .mu
                .iter()
                .map(|&mu| {
                    if rng.random_bool(0.5) {
                        on_the_edge(&mut rng, mu, share)
                    } else {
                        [0.0; D]
                    }
                })
                .collect();
            let load = case.balanced_by(&r);
            assert!(case.is_possible(&load), "seed {seed}");
        }
    }
}

#[test]
fn a_load_that_a_reaction_balances_is_accepted() {
    for (contacts, motions) in PLANE {
        balanced_loads_are_let_pass::<2>(contacts, motions);
    }
    for (contacts, motions) in SPACE {
        balanced_loads_are_let_pass::<3>(contacts, motions);
    }
}

fn unbalanced_loads_are_refused<const D: usize>(
    contacts: usize,
    motions: usize,
    inside: f64,
    shares: [f64; 3],
    distance: f64,
) {
    let seeds = if contacts < 12 { 300 } else { 60 };
    for seed in 0..seeds {
        let mut case = Contacts::<D>::random(contacts, motions, seed);
        let mut rng = StdRng::seed_from_u64(seed + 11);
        let away: Vec<f64> = (0..motions).map(|_| rng.random_range(-1.0..1.0)).collect();
        case.yield_to(&away, inside);
        // Balanced by contact but for a part that works on that motion.
        for share in shares {
            let r: Vec<[f64; D]> = case
                .mu
                .iter()
                .map(|&mu| on_the_edge(&mut rng, mu, 1.0))
                .collect();
            let mut load = case.balanced_by(&r);
            let work: f64 = load.iter().zip(&away).map(|(e, d)| e * d).sum();
            let size = norm(&load).max(0.1) * norm(&away);
            // e·d is −r·(R d) ≤ 0 before, and share of ‖e‖‖d‖ after.
            let missing = (share * size - work) / norm(&away).powi(2);
            for (e, d) in load.iter_mut().zip(&away) {
                *e += missing * d;
            }
            let decision = case.decide(&load);
            let at = format!("seed {seed}, share {share}");
            assert_eq!(decision.verdict, Verdict::None, "{at}");
            assert!(case.is_proof(&load, &decision.motion, distance), "{at}");
        }
    }
}

/// (contacts, rigid motions) in the plane and in space.
const PLANE: [(usize, usize); 5] = [(1, 1), (2, 3), (5, 3), (40, 3), (12, 6)];
const SPACE: [(usize, usize); 5] = [(1, 2), (3, 6), (8, 6), (60, 6), (20, 12)];

#[test]
fn a_load_beyond_the_limit_is_refused() {
    for (inside, plane, space, distance) in [
        // By a millionth. The proof keeps clear of the edge of K*_μ; 1e-12 is rounding of a
        // dozen terms and of the change from scaled variables.
        (0.9, [1.0, 1e-2, 1e-6], [1.0, 1e-2, 1e-6], 1e-12),
        // On the only motion that contact leaves: it lies on the edge of K*_μ at many contacts,
        // and any other closes one of them. The proof then rules out reactions up to 1e9 times
        // the load, with distances up to 1e-9 of the work; scaling differs by 10 between
        // contacts. In space rounding leaves such distances, and less work, at sixty contacts.
        (1.0, [1.0, 1e-2, 1e-3], [1.0, 0.3, 0.1], 1e-8),
    ] {
        for (contacts, motions) in PLANE {
            unbalanced_loads_are_refused::<2>(contacts, motions, inside, plane, distance);
        }
        for (contacts, motions) in SPACE {
            unbalanced_loads_are_refused::<3>(contacts, motions, inside, space, distance);
        }
    }
}

/// A block of width 2 and given height on a floor: `u_x, u_y` and rotation about
/// the middle of its base, seen by contacts along that base.
fn block(contacts: usize, mu: f64) -> Contacts<2> {
    let place = |i: usize| 2.0 * i as f64 / (contacts - 1) as f64 - 1.0;
    let along = |f: &dyn Fn(f64) -> [f64; 2]| (0..contacts).map(|i| f(place(i))).collect();
    let modes = vec![
        along(&|_| [0.0, 1.0]),
        along(&|_| [1.0, 0.0]),
        along(&|x| [x, 0.0]),
    ];
    Contacts::new(modes, vec![mu; contacts], 3)
}

#[test]
fn statics_of_a_block_on_a_floor() {
    let possible = |mu: f64, load: [f64; 3]| block(9, mu).is_possible(&load);
    for mu in [0.0, 0.3, 5.0, 100.0] {
        assert!(possible(mu, [0.0, -1.0, 0.0]));
        assert!(possible(mu, [0.0, 0.0, 0.0]));
        assert!(possible(mu, [0.0, -1.0, 1.0 - 1e-6]), "within the base");
        assert!(!possible(mu, [0.0, -1.0, 1.0 + 1e-6]), "tips");
        assert!(!possible(mu, [0.0, 1e-6, 0.0]), "pulled up");
        assert!(possible(mu, [mu * (1.0 - 1e-6), -1.0, 0.3]));
        assert!(!possible(mu, [mu + 1e-6 * (1.0 + mu), -1.0, 0.3]), "slides");
        // Rounding of a tangential load is no load.
        assert!(possible(mu, [1e-17, -1.0, 0.0]));
    }
    // Along the floor only, where nothing presses: no reaction at all.
    assert!(!possible(0.3, [1.0, 0.0, 0.0]));
}

#[test]
fn the_motion_is_the_one_that_the_block_makes() {
    let motion = |load: [f64; 3]| block(9, 0.3).decide(&load).motion;
    // A proof may have any length.
    let close = |found: Vec<f64>, expected: [f64; 3]| {
        let scale = norm(&expected) / norm(&found);
        let miss: Vec<f64> = found
            .iter()
            .zip(&expected)
            .map(|(a, b)| scale * a - b)
            .collect();
        // A proof keeps 1e-13 clear of the edge, and rounds.
        assert!(norm(&miss) <= 1e-10, "{found:?}");
    };
    // Slides along x and rises by μ, on the edge of K*_μ.
    close(motion([0.301, -1.0, 0.2]), [1.0, 0.3, 0.0]);
    // Turns about its left end, at x = -1, until the right end has moved by 1.
    close(motion([0.1, -1.0, 1.1]), [0.0, 0.5, 0.5]);
}

#[test]
fn a_light_body_is_checked_with_its_own_loads() {
    // Contact 0 holds a heavy body, contact 1 a light one; two motions each.
    let unit = |contact: usize, k: usize| {
        let mut mode = vec![[0.0; 2]; 3];
        mode[contact][k] = 1.0;
        mode
    };
    let modes = vec![unit(0, 0), unit(0, 1), unit(1, 0), unit(1, 1)];
    // Contact 2 feels no motion: it lies on a body that is held.
    let case = Contacts::<2>::new(modes, vec![0.5, 0.5, 0.5], 1);
    let heavy = [-1e12, 0.3e12];
    let load = |light: [f64; 2]| [heavy[0], heavy[1], light[0], light[1]];
    assert!(case.is_possible(&load([-1.0, 0.499_999])));
    let slides = case.decide(&load([-1.0, 0.500_001]));
    assert_eq!(slides.verdict, Verdict::None);
    assert_eq!(slides.motion[..2], [0.0, 0.0]);
}

#[test]
fn units_that_differ_by_powers_of_two_change_no_bit() {
    let mut case = Contacts::<3>::random(8, 6, 5);
    let away = [0.3, -0.5, 0.7, 0.2, -0.9, 0.4];
    case.yield_to(&away, 0.9);
    let big = away.map(|d| 2.0_f64.powi(70) * d);
    let first = case.decide(&away);
    assert_eq!(first.verdict, Verdict::None);
    assert_eq!(case.decide(&big).motion, first.motion);
}

#[test]
fn the_solver_refuses_in_its_first_round() {
    let solved = |load: [f64; 3]| {
        let case = block(5, 0.3);
        let rigid = Rigid {
            modes: case.modes.clone().into(),
            load: load.to_vec(),
        };
        let q = vec![[0.0; 2]; 5];
        let problem = coulomb(&case.compliance, &q, &case.mu, &rigid);
        solve(&problem, &Settings::default(), &Start::default(), &GO).unwrap()
    };
    let held = solved([0.29, -1.0, 0.0]);
    assert_eq!(held.outcome, Outcome::Converged);
    assert!(held.free_motion.is_empty());
    let slides = solved([0.31, -1.0, 0.0]);
    assert_eq!(slides.outcome, Outcome::NoEquilibrium);
    assert_eq!(slides.free_motion.len(), 3);
    assert!(slides.iterations < 100, "{}", slides.iterations);
    assert!(slides.residual.is_finite() && slides.residual > slides.tolerance);
}

/// Two plane contacts with the normal compliance `w`, tangentially rigid.
fn normal_compliance(w: [[f64; 2]; 2]) -> Compliance<'static, 2> {
    let mut dense = vec![0.0; 16];
    for (i, row) in w.iter().enumerate() {
        dense[8 * i] = row[0];
        dense[8 * i + 2] = row[1];
    }
    Compliance::from_dense(2, Cow::Owned(dense)).unwrap()
}

#[test]
fn contradiction_of_an_unsymmetric_compliance_uses_its_rows() {
    // λ = (1, 1). The sum of the rows of the first matrix is zero, so that λ·v = λ·q < 0.
    // The columns of the second one sum to zero; it has the solution r_n = (0.5, 0).
    for (w, proof) in [
        ([[1.0, 2.0], [-1.0, -2.0]], true),
        ([[1.0, -1.0], [2.0, -2.0]], false),
    ] {
        let compliance = normal_compliance(w);
        let q = [[-0.5, 0.0]; 2];
        let problem = coulomb(&compliance, &q, &[0.0; 2], &Rigid::default());
        assert_eq!(is_contradiction(&problem, &[1.0, 1.0]), proof);
        assert!(!is_contradiction(&problem, &[-1.0, -1.0]));
    }
}

#[test]
fn gaps_that_sum_to_zero_but_for_rounding_are_no_contradiction() {
    // 0.1 + 0.2 − 0.3 is 6e-17, the rounding of a node that touches two walls.
    let compliance = normal_compliance([[1.0, -1.0], [-1.0, 1.0]]);
    for (rounding, proof) in [(6e-17, false), (1e-6, true)] {
        let q = [[0.3 - rounding, 0.0], [-0.3, 0.0]];
        let problem = coulomb(&compliance, &q, &[0.0; 2], &Rigid::default());
        assert_eq!(is_contradiction(&problem, &[1.0, 1.0]), proof);
    }
}

#[test]
fn an_overlap_that_a_motion_opens_is_no_contradiction() {
    // λ·v = λ·q + λ·(R a): the sum is only fixed if the motion is along the walls.
    for (mode, proof) in [([1.0, 0.0], false), ([0.0, 1.0], true)] {
        let compliance = normal_compliance([[0.0; 2]; 2]);
        let rigid = Rigid {
            modes: vec![vec![mode; 2]].into(),
            load: vec![0.0],
        };
        let problem = coulomb(&compliance, &[[-1.0, 0.0]; 2], &[0.0; 2], &rigid);
        assert_eq!(is_contradiction(&problem, &[1.0, 1.0]), proof);
    }
}
