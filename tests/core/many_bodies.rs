//! Towers of rigid bodies on compliant joints: the work grows as their number, and the results
//! are those of orthonormal motions, which a dense `W` has.

#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "small counts; a helper of a test may fail"
)]

use std::borrow::Cow;

use crate::common::GO;
use crate::common::cases::coulomb;
use bipot_rs::linalg::small::Block;
use bipot_rs::linalg::sparse::blocks::Blocks;
use bipot_rs::reduced::compliance::{Compliance, Part};
use bipot_rs::reduced::reduced::{Reduced, Rigid};
use bipot_rs::reduced::residual::residual;
use bipot_rs::solver::monitor::{Monitor, Progress};
use bipot_rs::solver::{Outcome, Settings, Start, interior, solve};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Square blocks on each other, with two corners a joint; of each the motions along x, along y
/// and about its middle.
struct Tower {
    blocks: usize,
    rigid: Rigid<2>,
    softness: Vec<f64>,
}

impl Tower {
    /// Blocks of weight 1, each pushed sideways.
    fn new(blocks: usize, push: f64, softness: impl FnMut() -> f64) -> Self {
        let mut modes = vec![vec![[0.0; 2]; 2 * blocks]; 3 * blocks];
        for block in 0..blocks {
            // Its lower joint, and the upper one, which it moves the other way.
            for (joint, sign, y) in [(block, 1.0, -0.5), (block + 1, -1.0, 0.5)] {
                for (corner, x) in [(0, -0.5), (1, 0.5)] {
                    let contact = 2 * joint + corner;
                    if contact < 2 * blocks {
                        modes[3 * block][contact] = [0.0, sign];
                        modes[3 * block + 1][contact] = [sign, 0.0];
                        modes[3 * block + 2][contact] = [sign * x, -sign * y];
                    }
                }
            }
        }
        let load = (0..blocks).flat_map(|_| [push, -1.0, 0.0]).collect();
        Self {
            blocks,
            rigid: Rigid {
                modes: modes.into(),
                load,
            },
            softness: std::iter::repeat_with(softness).take(2 * blocks).collect(),
        }
    }

    fn compliance(&self, sparse: bool) -> Compliance<'static, 2> {
        let n = 2 * self.blocks;
        let blocks = Blocks::from_rows(n, |i, add| add(i, Block::identity() * self.softness[i]));
        let part = if sparse {
            Part::Sparse(Cow::Owned(blocks))
        } else {
            let order = 2 * n;
            let entry =
                |at: usize| blocks.at(at / order / 2, at % order / 2)[(at / order % 2, at % 2)];
            Part::Dense(Cow::Owned((0..order * order).map(entry).collect()))
        };
        Compliance::new(vec![((0..n).collect(), part)]).unwrap()
    }

    fn with<T>(&self, sparse: bool, ask: impl FnOnce(&Reduced<2>) -> T) -> T {
        let compliance = self.compliance(sparse);
        let n = 2 * self.blocks;
        let (q, mu) = (vec![[0.0; 2]; n], vec![0.5; n]);
        let problem = coulomb(&compliance, &q, &mu, &self.rigid);
        assert_eq!(problem.scaling.is_sparse(), sparse);
        ask(&problem)
    }
}

/// Entries of `R̂` and of the factors, and the iterations of a solution that is known.
fn measure(blocks: usize) -> (usize, usize, usize) {
    Tower::new(blocks, 0.0, || 1.0).with(true, |problem| {
        let solved = solve(problem, &Settings::default(), &Start::default(), &GO).unwrap();
        assert_eq!(solved.outcome, Outcome::Converged);
        for (contact, r) in solved.reaction.iter().enumerate() {
            // Half of the weight above. A tower of n blocks has a condition number of n² or so.
            let expected = 0.5 * (blocks - contact / 2) as f64;
            assert!(
                (r[0] - expected).abs() <= 1e-9 * blocks as f64,
                "{contact}: {r:?}"
            );
        }
        let whole = problem.whole().unwrap().unwrap();
        let factors = whole.analysis.counts().nnz_factor;
        (
            problem.scaling.modes.values().len(),
            factors,
            solved.iterations,
        )
    })
}

#[test]
fn the_work_grows_as_the_number_of_bodies() {
    let (few, many) = (measure(100), measure(800));
    // Of R: three motions of one body or two at each of its contacts, of 6 n · 2 n entries.
    assert_eq!(many.0, 12 * 800 - 6);
    // Eight times the bodies; a factor of n log n entries would have ten times as many.
    assert!(many.1 <= 10 * few.1, "{few:?} {many:?}");
    assert!(many.2 <= few.2.max(10), "{few:?} {many:?}");
}

#[test]
fn a_sparse_basis_gives_the_residual_and_the_solution_of_an_orthonormal_one() {
    for (seed, push) in (0..).zip([0.0, 0.004, 0.01, 0.0, 0.004, 0.01]) {
        let mut rng = StdRng::seed_from_u64(seed);
        let tower = Tower::new(40, push, || 10_f64.powf(rng.random_range(-1.0..1.0)));
        let mut rng = StdRng::seed_from_u64(seed + 100);
        let r: Vec<[f64; 2]> = (0..80)
            .map(|_| [rng.random(), rng.random_range(-0.5..0.5)])
            .collect();
        let a: Vec<f64> = (0..120).map(|_| rng.random_range(-1.0..1.0)).collect();
        let eta = [true, false].map(|sparse| {
            tower.with(sparse, |problem| {
                residual(problem, &r, &problem.relative_displacement(&r, &a), &a)
            })
        });
        // The Gram matrix has the square of the condition number of R, some 1e4.
        assert!((eta[0] - eta[1]).abs() <= 1e-11 * eta[1], "{eta:?}");
        let solved = [true, false].map(|sparse| {
            tower.with(sparse, |problem| {
                solve(problem, &Settings::default(), &Start::default(), &GO).unwrap()
            })
        });
        assert_eq!(solved[0].outcome, Outcome::Converged, "seed {seed}");
        assert_eq!(solved[1].outcome, Outcome::Converged, "seed {seed}");
        let pairs = solved[0].reaction.iter().zip(&solved[1].reaction);
        let apart = pairs.fold(0.0_f64, |m, (x, y)| m.max((x[0] - y[0]).hypot(x[1] - y[1])));
        // Tolerances of 1e-10 times the condition number.
        assert!(apart <= 1e-6 * 40.0, "seed {seed}: {apart:e}");
    }
}

#[test]
fn a_path_from_inside_needs_no_dense_motions() {
    // More motions than a dense path is tried with.
    Tower::new(400, 1e-4, || 1.0).with(true, |problem| {
        let (settings, progress) = (Settings::default(), Progress::default());
        let mut monitor = Monitor::new(problem, &settings, &GO, &progress);
        let end = interior::run(problem, &mut 0, &mut monitor).ok().flatten();
        // The monitor ends a path that has converged.
        let log = monitor.into_log();
        let (r, a) = (&log.best_reaction, &log.best_rigid);
        let eta = residual(problem, r, &problem.relative_displacement(r, a), a);
        assert!(end.is_some() || eta <= settings.tol, "{eta:e}");
    });
}
