//! The engine in the displacements, with contacts between deformable bodies: the answers of the
//! direct path, and bounds of the work.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    clippy::unwrap_used,
    reason = "counts are small; a helper of a test may fail"
)]

use bipot_rs::Error;
use bipot_rs::condensation::condense::{Condensed, ProblemArrays, SortedProblem};
use bipot_rs::law::cone::Status;
use bipot_rs::law::contact_law::ContactLaw;
use bipot_rs::linalg::small::{Block, Vector};
use bipot_rs::linalg::sparse::rows::Rows;
use bipot_rs::path::stepping::LoadPath;
use bipot_rs::primal::certificate::{Point, contacts_alone, judge};
use bipot_rs::primal::engine::Engine;
use bipot_rs::primal::linearised::{LinearisedStep, spread};
use bipot_rs::primal::linearised_laws::LinearisedLaws;
use bipot_rs::primal::local::Local;
use bipot_rs::primal::path::{PrimalPath, PrimalStep};
use bipot_rs::primal::problem::Primal;
use bipot_rs::reduced::memory::Budget;
use bipot_rs::solver::derivatives::tangent_system::ClosedLaw;
use bipot_rs::solver::{Outcome, Settings};

use crate::common::cases::difference;
use crate::common::elasticity::{Assembled, Grid};
use crate::common::{GO, bits, random, with_threads};

/// A block on a block of the same section. The lower one is turned by half a turn around x, so
/// that its contact face too is where its last coordinate is zero.
struct Blocks {
    stiffness: Assembled,
    contact: (Vec<usize>, Vec<usize>, Vec<f64>),
    gap: Vec<[f64; 3]>,
    fixed: Vec<usize>,
    /// Fixed degrees of freedom of the upper block: component and number in `fixed`.
    driven: Vec<(usize, usize)>,
    mu: f64,
}

/// Lengths of the sides, and of the height of each block.
const SIDE: f64 = 8.0;

fn block(cells: usize, stiffness: f64) -> Assembled {
    let height = (cells / 2).max(2);
    let grid = Grid {
        cells: [cells, cells, height],
        sides: [
            SIDE / cells as f64,
            SIDE / cells as f64,
            0.5 * SIDE / height as f64,
        ],
        held: false,
        ..Grid::cube(cells)
    };
    let mut body = grid.assemble();
    for value in &mut body.values {
        *value *= stiffness;
    }
    body
}

/// Weights of the corners of the cell with the point `(x, y)` of a face, which are its nodes if
/// the point is a node.
fn weights(cells: usize, x: f64, y: f64) -> Vec<(usize, f64)> {
    let along = |x: f64| {
        let at = x / SIDE * cells as f64;
        let nearest = at.round();
        // Nodes of two grids coincide up to rounding.
        if (at - nearest).abs() < 1e-9 {
            return vec![(nearest as usize, 1.0)];
        }
        let cell = at.floor();
        vec![
            (cell as usize, 1.0 - (at - cell)),
            (cell as usize + 1, at - cell),
        ]
    };
    let mut corners = Vec::new();
    for &(j, v) in &along(y) {
        for &(i, u) in &along(x) {
            corners.push((j * (cells + 1) + i, u * v));
        }
    }
    corners
}

impl Blocks {
    /// The nodes of the upper face are the contacts. Nothing holds the upper block if `floats`.
    fn new(upper: usize, lower: usize, ratio: f64, mu: f64, floats: bool) -> Self {
        let (above, below) = (block(upper, 1.0), block(lower, ratio));
        let first = above.n();
        let (mut pointer, mut index, mut values) = (vec![0], Vec::new(), Vec::new());
        let mut gap = Vec::new();
        for node in 0..(upper + 1).pow(2) {
            let (x, y) = (above.coordinates[3 * node], above.coordinates[3 * node + 1]);
            let corners = weights(lower, x, SIDE - y);
            // Normal z, tangents x and y; half a turn changes the signs of y and z.
            for (component, sign) in [(2, 1.0), (0, -1.0), (1, 1.0)] {
                index.push(3 * node + component);
                values.push(1.0);
                for &(corner, weight) in &corners {
                    index.push(first + 3 * corner + component);
                    values.push(sign * weight);
                }
                pointer.push(index.len());
            }
            gap.push([0.0; 3]);
        }
        let stiffness = above.beside(&below, 10.0 * SIDE);
        let top = |dof: usize| stiffness.coordinates[dof - dof % 3 + 2] > 0.49 * SIDE;
        let fixed: Vec<usize> = (0..stiffness.n())
            .filter(|&dof| top(dof) && (dof >= first || !floats))
            .collect();
        let driven = fixed.iter().enumerate().filter(|(_, dof)| **dof < first);
        let driven = driven.map(|(number, &dof)| (dof % 3, number)).collect();
        Self {
            stiffness,
            contact: (pointer, index, values),
            gap,
            fixed,
            driven,
            mu,
        }
    }

    /// Adds a rigid wall at the side `x = 0` of the upper block. With its lower edge, the nodes
    /// there have two contacts.
    fn with_wall(mut self, edge: bool) -> Self {
        let (pointer, index, values) = &mut self.contact;
        for node in 0..self.stiffness.nodes() {
            let at = &self.stiffness.coordinates[3 * node..3 * node + 3];
            if at[0] == 0.0 && (edge || at[2] > 0.0) && !self.fixed.contains(&(3 * node)) {
                for component in 0..3 {
                    index.push(3 * node + component);
                    values.push(1.0);
                    pointer.push(index.len());
                }
                self.gap.push([0.0; 3]);
            }
        }
        self
    }

    fn arrays<R>(&self, run: impl FnOnce(ProblemArrays<'_, 3>) -> R) -> R {
        let at = |dof: usize| {
            let first = dof - dof % 3;
            std::array::from_fn(|k| self.stiffness.coordinates[first + k])
        };
        let places: Vec<[f64; 3]> = (0..self.stiffness.n()).map(at).collect();
        run(ProblemArrays {
            kinematics: None,
            stiffness: self.stiffness.view(),
            contact: Rows {
                row_ptr: &self.contact.0,
                columns: &self.contact.1,
                values: &self.contact.2,
            },
            gap: &self.gap,
            law: &ContactLaw::coulomb(&vec![self.mu; self.gap.len()]),
            fixed: &self.fixed,
            places: Some(&places),
            known: None,
            budget: Budget::default(),
        })
    }

    /// Loads and prescribed displacements of two steps: press, then shear.
    fn steps(&self) -> [(Vec<f64>, Vec<f64>); 2] {
        [0.0, 1.0].map(|sheared| {
            let mut load = vec![0.0; self.stiffness.n()];
            let mut prescribed = vec![0.0; self.fixed.len()];
            for &(component, number) in &self.driven {
                prescribed[number] = [5e-3 * sheared, 0.0, -1e-2][component];
            }
            if self.driven.is_empty() {
                let top = |node: &usize| self.stiffness.coordinates[3 * node + 2] > 0.49 * SIDE;
                let above = |node: &usize| self.stiffness.coordinates[3 * node] <= SIDE;
                let nodes: Vec<usize> = (0..self.stiffness.nodes())
                    .filter(|node| top(node) && above(node))
                    .collect();
                for &node in &nodes {
                    load[3 * node + 2] = -1.0 / nodes.len() as f64;
                    load[3 * node] = 0.1 * sheared / nodes.len() as f64;
                }
            }
            (load, prescribed)
        })
    }

    fn primal(&self) -> Vec<PrimalStep<3>> {
        let problem = self
            .arrays(|arrays| Primal::new(&arrays, None, false, &GO))
            .unwrap();
        let mut path = PrimalPath::default();
        let mut advance = |(load, prescribed): (Vec<f64>, Vec<f64>)| {
            let made = path
                .advance(&problem, &load, &prescribed, &tight(), &GO)
                .unwrap();
            assert_eq!(made.made.step.solution.outcome, Outcome::Converged);
            made
        };
        self.steps().map(&mut advance).into()
    }

    /// Compares both steps with the direct path. Returns Krylov products and statuses.
    fn agrees(&self) -> (usize, Vec<Status>) {
        let problem = self
            .arrays(|arrays| Condensed::new(SortedProblem::new(arrays)?, None, &GO))
            .unwrap();
        let mut path = LoadPath::default();
        let mut krylov = 0;
        let mut statuses = Vec::new();
        for (made, (load, prescribed)) in self.primal().into_iter().zip(self.steps()) {
            let step = path
                .advance(&problem, &load, &prescribed, &tight(), &GO)
                .unwrap();
            let (found, direct) = (&made.made.step.solution, &step.solution);
            assert_eq!(direct.outcome, Outcome::Converged);
            assert_eq!(found.status, direct.status);
            // Of the reactions: some ten times the tolerance of both.
            let error = difference(&found.reaction, &direct.reaction);
            assert!(error <= 1e-9, "reactions differ by {error}");
            krylov += made.made.krylov;
            statuses.extend(&found.status);
        }
        (krylov, statuses)
    }
}

/// The rounding of these small models stays below this.
fn tight() -> Settings {
    Settings {
        tol: 1e-11,
        ..Settings::default()
    }
}

fn share(statuses: &[Status], of: Status) -> f64 {
    let count = statuses.iter().filter(|&&status| status == of).count();
    count as f64 / statuses.len() as f64
}

/// The law of the contacts holds, and a node that they do not reach is out of balance.
#[test]
fn a_row_out_of_balance_is_no_solution() {
    let blocks = Blocks::new(4, 4, 1.0, 0.3, false);
    let problem = blocks
        .arrays(|arrays| Primal::new(&arrays, None, false, &GO))
        .unwrap();
    let [(load, prescribed), _] = blocks.steps();
    let [first, _] = blocks.primal().try_into().unwrap();
    let force = problem.force(&load, &prescribed).unwrap().values;
    let mut engine = Local::new(&problem, &GO, None);
    let y = problem.unknowns(&first.displacement);
    let mut e = engine.product(&y).unwrap();
    for (e, f) in e.iter_mut().zip(&force) {
        *e -= f;
    }
    let contacts = &problem.contacts;
    let r = engine.at_contacts(&e).unwrap();
    let mut v = engine.at_contacts(&y).unwrap();
    let offsets = contacts.frames.offsets(&contacts.gap, &prescribed);
    for (v, offset) in v.as_flattened_mut().iter_mut().zip(offsets.as_flattened()) {
        *v += offset;
    }
    let reduced = contacts_alone(contacts, &r, &v).unwrap();
    let mut point = Point { y, e, r, v };
    let mut judged = |point: &Point<_, 3>| {
        let terms = engine.terms(&point.y).unwrap();
        judge(&mut engine, contacts, &reduced, point, &force, Some(&terms)).unwrap()
    };
    let before = judged(&point);
    assert!(before.converged(1e-9));
    let size = before
        .reaction
        .as_flattened()
        .iter()
        .map(|r| r * r)
        .sum::<f64>();
    let unknowns: Vec<usize> = contacts.frames.unknowns().map(|(_, _, at)| at).collect();
    let elsewhere = (0..point.e.len())
        .find(|at| problem.stiffness.free[*at] && !unknowns.contains(at))
        .unwrap();
    point.e[elsewhere] += 1e-6 * size.sqrt();
    let after = judged(&point);
    assert!(after.certificate.converged(1e-9));
    assert!(!after.converged(1e-9));
    assert!((after.residual() - 1e-6).abs() <= 1e-9);
}

#[test]
fn blocks_on_blocks_as_the_direct_path() {
    let meshes = [(6, 6, 1e-3), (6, 6, 0.1), (6, 6, 1.0), (6, 6, 10.0)];
    let others = [(6, 6, 1e3), (6, 4, 0.1), (6, 4, 10.0), (4, 6, 0.1)];
    for (upper, lower, ratio) in meshes.into_iter().chain(others).chain([(4, 6, 10.0)]) {
        let (krylov, _) = Blocks::new(upper, lower, ratio, 0.3, false).agrees();
        // Without the exact solution on the interface it takes hundreds.
        assert!(krylov <= 75, "{upper} on {lower}, ratio {ratio}: {krylov}");
    }
    for ratio in [0.1, 10.0] {
        // Only contact holds a block: the correction that settles its motions is solved.
        let (krylov, _) = Blocks::new(6, 6, ratio, 0.3, true).agrees();
        assert!(krylov <= 120, "floating, ratio {ratio}: {krylov}");
        let (krylov, statuses) = Blocks::new(6, 6, ratio, 0.02, false).agrees();
        // The hierarchy of the glued blocks is far from this.
        assert!(share(&statuses, Status::Slip) > 0.9);
        assert!(krylov <= 75, "sliding, ratio {ratio}: {krylov}");
    }
    let mut blocks = Blocks::new(6, 4, 10.0, 0.3, true);
    for gap in &mut blocks.gap {
        gap[0] = 1e-3 * SIDE;
    }
    let (krylov, _) = blocks.agrees();
    assert!(krylov <= 100, "afloat above the other: {krylov}");
    // A second interface.
    for (edge, ratio) in [(false, 0.1), (true, 0.1), (true, 10.0)] {
        let blocks = Blocks::new(6, 6, ratio, 0.3, false).with_wall(edge);
        let (krylov, statuses) = blocks.agrees();
        assert!(share(&statuses, Status::Open) > 0.05);
        assert!(krylov <= 150, "edge {edge}, ratio {ratio}: {krylov}");
    }
}

#[test]
fn work_does_not_grow_with_the_mesh() {
    for cells in [8, 12, 16] {
        let made = Blocks::new(cells, cells, 0.1, 0.3, false).primal();
        let krylov: usize = made.iter().map(|step| step.made.krylov).sum();
        println!("{cells}: {krylov}");
        assert!(krylov <= 75, "{cells} cells: {krylov}");
    }
}

#[test]
fn same_bits_on_one_and_two_threads() {
    let blocks = Blocks::new(12, 8, 0.1, 0.3, false);
    let run = |threads| {
        let made = with_threads(threads, || blocks.primal());
        let all = |step: &PrimalStep<3>| {
            let reactions = step.made.step.solution.reaction.as_flattened();
            [bits(&step.displacement), bits(reactions)]
        };
        made.iter().flat_map(all).collect::<Vec<_>>()
    };
    assert!(run(1) == run(2));
}

#[test]
fn a_contact_needs_a_node_of_its_own() {
    let mut blocks = Blocks::new(2, 2, 1.0, 0.3, false);
    let (pointer, index, values) = &mut blocks.contact;
    for row in 0..3 {
        for at in pointer[row]..pointer[row + 1] {
            index.push(index[at]);
            values.push(values[at]);
        }
        pointer.push(index.len());
    }
    blocks.gap.push([0.0; 3]);
    let refused = blocks
        .arrays(|arrays| Primal::new(&arrays, None, false, &GO))
        .unwrap_err();
    assert!(
        matches!(
            refused,
            Error::NoOwnNode {
                contact: 0,
                oblique: false,
                ..
            }
        ),
        "{refused}"
    );
}

/// Laws of contacts with these statuses, with random slips and reactions where they slide.
fn laws_of(statuses: &[Status], compliance: f64, seed: u64) -> Vec<ClosedLaw<3>> {
    let mut laws = Vec::new();
    for (position, status) in statuses.iter().enumerate() {
        let (mut by_r, mut by_v) = (Block::<3>::zeros(), Block::<3>::zeros());
        by_v[(0, 0)] = 1.0;
        match status {
            Status::Open => continue,
            Status::Stick => by_v = Block::identity(),
            Status::Slip => {
                let x = random(3, seed + position as u64);
                let angle = 3.0 * x[0];
                let (slip, pressed) = (compliance * (1.1 + x[1]), 1.1 + x[2]);
                let p = [angle.cos(), angle.sin()];
                by_r[(1, 0)] = 0.3;
                for (k, (along, across)) in [(p[0], -p[1]), (p[1], p[0])].into_iter().enumerate() {
                    by_r[(1, 1 + k)] = along;
                    by_r[(2, 1 + k)] = slip * across;
                    by_v[(2, 1 + k)] = 0.3 * pressed * across;
                }
            }
        }
        laws.push(ClosedLaw {
            position,
            by_r,
            by_v,
        });
    }
    laws
}

/// The equations (36) with `A` and `R` as the engine and the contacts apply them, and their
/// transpose.
#[test]
fn a_linearised_step_solves_its_equations_and_their_transpose() {
    for (blocks, seed) in [
        (Blocks::new(4, 4, 0.3, 0.3, false), 1),
        (Blocks::new(4, 3, 2.0, 0.3, true), 2),
    ] {
        let problem = blocks
            .arrays(|arrays| Primal::new(&arrays, None, false, &GO))
            .unwrap();
        let statuses = blocks.primal().pop().unwrap().made.step.solution.status;
        let mixed: Vec<Status> = statuses
            .iter()
            .enumerate()
            .map(|(i, &status)| if i % 3 == 0 { Status::Slip } else { status })
            .collect();
        assert!(share(&mixed, Status::Slip) > 0.2 && share(&mixed, Status::Stick) > 0.2);
        let laws = laws_of(&mixed, problem.contacts.compliance.block(0)[(0, 0)], seed);
        let frames = &problem.contacts.frames;
        let free: Vec<f64> = problem
            .stiffness
            .free
            .iter()
            .map(|&free| f64::from(u8::from(free)))
            .collect();
        let mask = |x: Vec<f64>| -> Vec<f64> { x.iter().zip(&free).map(|(x, f)| x * f).collect() };
        let n = problem.order();
        // In units in which A and the laws are of one size.
        let unit = problem.contacts.compliance.block(0)[(0, 0)];
        let s: Vec<[f64; 3]> = random(3 * laws.len(), seed + 3).as_chunks::<3>().0.to_vec();
        let s: Vec<[f64; 3]> = s.iter().map(|s| s.map(|s| unit * s)).collect();
        let g = mask(random(n, seed + 4));
        let (mut dr, mut dy, mut hierarchy) = (s.clone(), g.clone(), None);
        let all = LinearisedLaws::new(&problem.contacts, &problem.stiffness.free, &laws);
        let mut step = LinearisedStep::new(&problem, all.unwrap());
        assert!(step.solve(&mut dr, &mut dy, &mut hierarchy, &GO).unwrap());
        let mut engine = Local::new(&problem, &GO, None);
        let whole = |own: &[[f64; 3]]| {
            let mut whole = vec![[0.0; 3]; mixed.len()];
            for (law, own) in laws.iter().zip(own) {
                whole[law.position] = *own;
            }
            whole
        };
        let v = frames.at_contacts(&dy);
        let left = |law: &ClosedLaw<3>, r: &[f64; 3], s: &[f64; 3]| {
            let v = Vector::from(v[law.position]);
            (law.by_r * Vector::from(*r) + law.by_v * v - Vector::from(*s)).amax()
        };
        let rows = laws.iter().zip(&dr).zip(&s);
        let of_laws = rows
            .map(|((law, r), s)| left(law, r, s))
            .fold(0.0, f64::max);
        // Relative residuals of 1e-11 are accepted, and the largest term is about one.
        let size = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(
            of_laws <= 1e-9 * unit * (1.0 + size(dr.as_flattened())),
            "{of_laws:e}"
        );
        let forces = spread(frames, &whole(&dr), n);
        let product = engine.product(&dy).unwrap();
        let terms = forces.iter().zip(&product).zip(&g);
        let out: Vec<f64> = terms.map(|((r, a), g)| r - a - g).collect();
        let balance = size(&mask(out));
        assert!(balance <= 1e-9 * size(&product), "{balance:e}");

        // ⟨(ρ, e), M⁻¹ (s, g)⟩ = ⟨M⁻ᵀ (ρ, e), (s, g)⟩.
        let rho: Vec<[f64; 3]> = random(3 * laws.len(), seed + 5).as_chunks::<3>().0.to_vec();
        let e = mask(random(n, seed + 6))
            .iter()
            .map(|e| e / unit)
            .collect::<Vec<_>>();
        let (mut w, mut b) = (rho.clone(), e.clone());
        assert!(
            step.solve_transposed(&mut w, &mut b, &mut hierarchy, &GO)
                .unwrap()
        );
        let terms = |x: &[[f64; 3]], y: &[f64], s: &[[f64; 3]], g: &[f64]| -> Vec<f64> {
            let first = x.as_flattened().iter().zip(s.as_flattened());
            first.chain(y.iter().zip(g)).map(|(x, y)| x * y).collect()
        };
        let (one, two) = (terms(&rho, &e, &dr, &dy), terms(&w, &b, &s, &g));
        let apart = (one.iter().sum::<f64>() - two.iter().sum::<f64>()).abs();
        let size: f64 = one.iter().chain(&two).map(|x| x.abs()).sum();
        assert!(apart <= 1e-9 * size, "{apart:e} of {size:e}");
    }
}
