//! Rigid bodies with more reactions than motions, `W = H M⁻¹ Hᵀ`: proximal points and
//! interior-point paths, each alone.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use crate::common::GO;
use bipot_rs::law::cone::project;
use bipot_rs::law::contact_law::ContactLaw;
use bipot_rs::linalg::small::Block;
use bipot_rs::linalg::sparse::blocks::Blocks;
use bipot_rs::reduced::compliance::{Compliance, Part};
use bipot_rs::reduced::reduced::{Reduced, Rigid};
use bipot_rs::reduced::residual::residual;
use bipot_rs::solver::monitor::{Monitor, Progress};
use bipot_rs::solver::outcome::Ended;
use bipot_rs::solver::{Outcome, Settings, Start, interior, proximal, solve};
use std::borrow::Cow;

/// A row of `H`: discs, and the factors of their `x`, `y` and turn.
type Row = Vec<(usize, [f64; 3])>;

/// A square wall of discs of radius 1 and mass 1 on a floor, in one step under gravity. The disc
/// at the upper right is pushed to the left.
struct Wall {
    discs: usize,
    rows: Vec<[Row; 2]>,
    free: Vec<[f64; 3]>,
}

/// `M⁻¹`: discs have the moment of inertia one half.
const LIGHT: [f64; 3] = [1.0, 1.0, 2.0];

impl Wall {
    fn new(wide: usize, high: usize, push: f64) -> Self {
        let disc = |column: usize, layer: usize| layer * wide + column;
        let mut rows = Vec::new();
        for layer in 0..high {
            for column in 0..wide {
                let upper = disc(column, layer);
                let mut contact = [
                    vec![(upper, [0.0, 1.0, 0.0])],
                    vec![(upper, [1.0, 0.0, 1.0])],
                ];
                if layer > 0 {
                    let lower = disc(column, layer - 1);
                    contact[0].push((lower, [0.0, -1.0, 0.0]));
                    contact[1].push((lower, [-1.0, 0.0, 1.0]));
                }
                rows.push(contact);
                if column > 0 {
                    let (right, left) = (upper, disc(column - 1, layer));
                    rows.push([
                        vec![(right, [1.0, 0.0, 0.0]), (left, [-1.0, 0.0, 0.0])],
                        vec![(right, [0.0, 1.0, -1.0]), (left, [0.0, -1.0, -1.0])],
                    ]);
                }
            }
        }
        let mut free = vec![[0.0, -1.0, 0.0]; wide * high];
        free[wide * high - 1][0] = -push;
        Self {
            discs: wide * high,
            rows,
            free,
        }
    }

    /// `H u`.
    fn relative(&self, u: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let row = |row: &Row| -> f64 {
            let part =
                |(disc, h): &(usize, [f64; 3])| (0..3).map(|k| h[k] * u[*disc][k]).sum::<f64>();
            row.iter().map(part).sum()
        };
        self.rows
            .iter()
            .map(|rows| rows.each_ref().map(row))
            .collect()
    }

    /// Velocities after the step: `u + M⁻¹ Hᵀ r`.
    fn moved(&self, r: &[[f64; 2]]) -> Vec<[f64; 3]> {
        let mut u = self.free.clone();
        for (rows, r) in self.rows.iter().zip(r) {
            for (row, r) in rows.iter().zip(r) {
                for (disc, h) in row {
                    (0..3).for_each(|k| u[*disc][k] += LIGHT[k] * h[k] * r);
                }
            }
        }
        u
    }

    fn compliance(&self) -> Compliance<'static, 2> {
        let block = |i: usize, j: usize| {
            Block::<2>::from_fn(|k, l| {
                let mut sum = 0.0;
                for (disc, h) in &self.rows[i][k] {
                    for (_, g) in self.rows[j][l].iter().filter(|(other, _)| other == disc) {
                        sum += (0..3).map(|k| h[k] * LIGHT[k] * g[k]).sum::<f64>();
                    }
                }
                sum
            })
        };
        let n = self.rows.len();
        let row = |i: usize, add: &mut dyn FnMut(usize, Block<2>)| {
            for j in 0..n {
                let w = block(i, j);
                if w.amax() > 0.0 {
                    add(j, w);
                }
            }
        };
        let blocks = Blocks::from_rows(n, row);
        Compliance::new(vec![((0..n).collect(), Part::Sparse(Cow::Owned(blocks)))]).unwrap()
    }

    /// The distance from Coulomb's law of the velocities that reactions make, relative to 1: the
    /// speed of free fall in the step.
    fn misses(&self, r: &[[f64; 2]], mu: f64) -> f64 {
        let v = self.relative(&self.moved(r));
        let miss = |(r, v): (&[f64; 2], &[f64; 2])| {
            let tau = [r[0] - v[0] - mu * v[1].abs(), r[1] - v[1]];
            let onto = project(&tau, mu).0;
            (r[0] - onto[0]).hypot(r[1] - onto[1])
        };
        r.iter().zip(&v).map(miss).fold(0.0, f64::max)
    }
}

/// Newton alone stops at singular matrices here. Each way ends at a point that satisfies the law
/// with velocities computed from the bodies.
#[test]
fn reactions_that_are_not_determined_are_found() {
    let settings = Settings::default();
    // The small wall has a dense matrix, the larger one a sparse one.
    for (wide, high, mu, push) in [(3, 3, 0.5, 0.5), (3, 3, 0.2, 2.0), (8, 6, 0.4, 1.0)] {
        let wall = Wall::new(wide, high, push);
        let compliance = wall.compliance();
        let (n, q) = (wall.rows.len(), wall.relative(&wall.free));
        let laws = vec![ContactLaw::from(mu); n];
        let problem = Reduced::new(&compliance, &q, &laws, &Rigid::default()).unwrap();
        let solution = solve(&problem, &settings, &Start::default(), &GO).unwrap();
        assert_eq!(solution.outcome, Outcome::Converged);
        // The tolerance of η times the sizes of reactions, which carry up to six discs.
        let missed = wall.misses(&solution.reaction, mu);
        assert!(missed <= 1e-8, "{missed:e}");
        // The floor holds the weight of the wall unless discs still fall.
        let fall: f64 = wall.moved(&solution.reaction).iter().map(|u| u[1]).sum();
        let floor: f64 = wall
            .rows
            .iter()
            .zip(&solution.reaction)
            .filter(|(rows, _)| rows[0].len() == 1)
            .map(|(_, r)| r[0])
            .sum();
        let weight = f64::from(u32::try_from(wall.discs).unwrap());
        assert!((floor - weight - fall).abs() <= 1e-8 * weight);

        let zero = vec![[0.0; 2]; n];
        for attempt in 0..3 {
            let progress = Progress::default();
            let mut monitor = Monitor::new(&problem, &settings, &GO, &progress);
            let ended = proximal::run(&problem, &zero, &[], &mut monitor, (attempt, usize::MAX));
            let ended = matches!(ended, Err(Ended::Stopped(Outcome::Converged)));
            assert!(ended, "{wide} {mu} {attempt}: {:e}", progress.read().2);
            assert!(progress.read().2 <= settings.tol);
            // With few steps allowed, a point on the way.
            let mut monitor = Monitor::new(&problem, &settings, &GO, &progress);
            let end = proximal::run(&problem, &zero, &[], &mut monitor, (attempt, 2));
            if let Ok(end) = end {
                assert!(wall.misses(&end.r, mu) < wall.misses(&zero, mu));
            }
        }
        let (mut path, mut ends) = (0, 0);
        loop {
            let progress = Progress::default();
            let mut monitor = Monitor::new(&problem, &settings, &GO, &progress);
            let end = match interior::run(&problem, &mut path, &mut monitor) {
                Ok(Some(end)) => end,
                Ok(None) => break,
                Err(ended) => {
                    // The path itself has led to a solution.
                    let converged = matches!(ended, Ended::Stopped(Outcome::Converged));
                    assert!(converged && progress.read().2 <= settings.tol);
                    ends += 1;
                    continue;
                }
            };
            ends += 1;
            // σ = 1e-3 at the end of a path.
            let v = problem.relative_displacement(&end.r, &[]);
            let eta = residual(&problem, &end.r, &v, &[]);
            assert!(eta <= 1e-2, "{eta:e}");
            let start = Start {
                reaction: end.r,
                ..Start::default()
            };
            let solution = solve(&problem, &settings, &start, &GO).unwrap();
            assert_eq!(solution.outcome, Outcome::Converged);
        }
        // Each of the six paths once; most of them lead to the end.
        assert!(ends >= 3, "{ends}");
    }
}
