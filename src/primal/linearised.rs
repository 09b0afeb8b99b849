//! The linearised contact laws of a converged step in the displacements: the systems (33) and
//! (34) without `W`.
//!
//! The displacements take the place of the rigid motions, with `dv = R dy` and `W = 0`:
//!
//! ```text
//! ⎡ by_r   by_v R ⎤ ⎡ dr ⎤   ⎡ s ⎤
//! ⎣ Rᵀ     −A     ⎦ ⎣ dy ⎦ = ⎣ g ⎦
//! ```
//!
//! `dr` is eliminated by the second row. The laws of a contact are multiplied by a block `M`
//! such that each row holds a component, `dv_k = …`, or reads `(I + C) dr + V dv = M s`, as those
//! of a Newton step (`tangent`), whose preconditioner fits.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::amg::following::Following;
use crate::linalg::parallel::axpy;
use crate::linalg::small::{Block, Vector};
use crate::primal::engine::Engine;
use crate::primal::frames::Frames;
use crate::primal::local::Local;
use crate::primal::problem::Primal;
use crate::primal::tangent::{Sliding, Tangent};
use crate::solver::newton::tangent_system::ClosedLaw;

/// Relative residual of each linear system.
const WANTED: f64 = 1e-13;
/// Relative residual that is enough.
const ENOUGH: f64 = 1e-11;

/// Compliance that the multiplier `M` adds to a law, relative to that of its contact: a contact
/// that hardly slips has no stiffer spring than its inverse. The equations stay exact.
const LEAST_COMPLIANCE: f64 = 1e-3;

/// The law of one closed contact, multiplied by `M`.
#[derive(Clone, Debug)]
struct Multiplied<const D: usize> {
    contact: usize,
    /// Place of its first component; nothing for a contact without an unknown.
    at: Option<usize>,
    free: [bool; D],
    held: [bool; D],
    multiplier: Block<D>,
    /// `M by_r` and `M by_v` in the rows that are not held.
    by_r: Block<D>,
    by_v: Block<D>,
}

/// The system of one step.
#[derive(Debug)]
pub struct Linearised<'p, const D: usize> {
    problem: &'p Primal<D>,
    laws: Vec<Multiplied<D>>,
    statuses: Vec<Status>,
    tangent: Tangent<D>,
}

impl<'p, const D: usize> Linearised<'p, D> {
    /// The system of these laws, whose positions are numbers of contacts; `None` if one of them
    /// determines nothing.
    #[must_use]
    pub fn new(problem: &'p Primal<D>, laws: &[ClosedLaw<D>]) -> Option<Self> {
        let frames = &problem.contacts.frames;
        let made = laws.iter().map(|law| Multiplied::new(problem, law));
        let laws: Vec<_> = made.collect::<Option<_>>()?;
        let mut statuses = vec![Status::Open; problem.contacts.count()];
        let mut held: Vec<bool> = problem.stiffness.free.iter().map(|free| !free).collect();
        for (_, frame) in frames.with_node() {
            for k in 0..D {
                held[D * frame.node + k] = !frame.free[k];
            }
        }
        let mut sliding = Vec::new();
        for law in &laws {
            let sticks = law.held == law.free && law.free.contains(&true);
            statuses[law.contact] = if sticks { Status::Stick } else { Status::Slip };
            let Some(at) = law.at else { continue };
            for k in (0..D).filter(|&k| law.held[k]) {
                held[at + k] = true;
            }
            let rows = law.held.map(|held| !held);
            if rows.contains(&true) {
                let mut force = law.by_r;
                for k in (0..D).filter(|&k| rows[k]) {
                    force[(k, k)] -= 1.0;
                }
                sliding.push(Sliding {
                    contact: law.contact,
                    at,
                    free: law.free,
                    rows,
                    force,
                    spring: law.by_v,
                    target: Vector::zeros(),
                });
            }
        }
        let known = vec![0.0; held.len()];
        let tangent = Tangent {
            sliding,
            held,
            known,
        };
        Some(Self {
            problem,
            laws,
            statuses,
            tangent,
        })
    }

    /// Solves the system for `s` of each law and `g`, which the solution replaces: `dr` of each
    /// law, and `dy`. Whether the linear solver converged.
    ///
    /// # Errors
    /// [`Error::Interrupted`]; errors of the preconditioner.
    pub fn solve(
        &mut self,
        s: &mut [[f64; D]],
        g: &mut [f64],
        hierarchy: &mut Option<Following>,
        stop: &AtomicBool,
    ) -> Result<bool, Error> {
        let (problem, frames) = (self.problem, &self.problem.contacts.frames);
        for (law, s) in self.laws.iter().zip(&mut *s) {
            *s = (law.multiplier * Vector::from(*s)).into();
            let Some(at) = law.at else { continue };
            for k in (0..D).filter(|&k| law.held[k]) {
                self.tangent.known[at + k] = s[k];
            }
        }
        let targets = self.laws.iter().zip(&*s);
        let targets = targets.filter(|(law, _)| law.at.is_some() && law.held != [true; D]);
        for (one, (law, s)) in self.tangent.sliding.iter_mut().zip(targets) {
            let f = Vector::<D>::from_column_slice(&g[one.at..one.at + D]);
            one.target = Vector::from(*s) - law.by_r * f;
        }
        let mut engine = Local::new(problem, stop, hierarchy.take());
        let e = g.to_vec();
        if !engine.prepared(&self.tangent, &self.statuses)? {
            return Ok(false);
        }
        let right = engine.right_side(&self.tangent, &e);
        let found = engine.krylov(&self.tangent, &right, WANTED, false)?;
        let mut dy = found.x;
        axpy(1.0, &self.tangent.known, &mut dy);
        let moved = engine.product(&dy)?;
        *hierarchy = engine.into_hierarchy().0;
        let none = vec![[0.0; D]; frames.list.len()];
        let (v, of_a) = (frames.at_contacts(&dy), frames.at_contacts(&moved));
        let prescribed = self.tangent.prescribed_reactions(frames, &none, &v, &of_a);
        for (law, s) in self.laws.iter().zip(&mut *s) {
            // Without an unknown the law alone gives the reaction.
            let Some(at) = law.at else { continue };
            for k in 0..D {
                s[k] = if law.free[k] {
                    moved[at + k] + e[at + k]
                } else {
                    prescribed[law.contact][k]
                };
            }
        }
        g.copy_from_slice(&dy);
        Ok(found.residual <= ENOUGH)
    }

    /// Solves the transposed system for `ρ` of each law and `e`, which the solution replaces:
    /// `w` of each law, and `b`. Whether the linear solver converged.
    ///
    /// # Errors
    /// As [`Linearised::solve`].
    pub fn solve_transposed(
        &mut self,
        rho: &mut [[f64; D]],
        e: &mut [f64],
        hierarchy: &mut Option<Following>,
        stop: &AtomicBool,
    ) -> Result<bool, Error> {
        let problem = self.problem;
        // b = ρ − by_rᵀ w at the contacts, in the second row.
        let mut b = vec![0.0; e.len()];
        for (law, rho) in self.laws.iter().zip(&*rho) {
            let Some(at) = law.at else { continue };
            // A row without an unknown has w_l = ρ_l.
            let alone = Vector::<D>::from_fn(|k, _| if law.free[k] { 0.0 } else { rho[k] });
            let (pulled, pushed) = (law.by_r.tr_mul(&alone), law.by_v.tr_mul(&alone));
            for k in (0..D).filter(|&k| law.free[k]) {
                b[at + k] = rho[k] - pulled[k];
                e[at + k] -= pushed[k];
            }
        }
        axpy(1.0, &problem.product_of_contacts(&b), e);
        let mut right = e.to_vec();
        self.tangent.clear(&mut right);
        let mut engine = Local::new(problem, stop, hierarchy.take());
        if !engine.prepared(&self.tangent, &self.statuses)? {
            return Ok(false);
        }
        let found = engine.krylov(&self.tangent, &right, WANTED, true)?;
        let z = found.x;
        let mut u = z.clone();
        self.tangent.pull(&mut u);
        let mut moved = engine.product(&u)?;
        *hierarchy = engine.into_hierarchy().0;
        self.tangent.add_transposed(&z, &mut moved);
        for (law, rho) in self.laws.iter().zip(&mut *rho) {
            let of = |k: usize| match law.at {
                Some(at) if law.held[k] => e[at + k] - moved[at + k],
                Some(at) if law.free[k] => z[at + k],
                _ => rho[k],
            };
            let omega = Vector::<D>::from_fn(|k, _| of(k));
            *rho = law.multiplier.tr_mul(&omega).into();
        }
        axpy(-1.0, &u, &mut b);
        e.copy_from_slice(&b);
        Ok(found.residual <= ENOUGH)
    }
}

impl<const D: usize> Multiplied<D> {
    fn new(problem: &Primal<D>, law: &ClosedLaw<D>) -> Option<Self> {
        let frame = &problem.contacts.frames.list[law.position];
        let mut by_v = law.by_v;
        for k in (0..D).filter(|&k| !frame.free[k]) {
            by_v.fill_column(k, 0.0);
        }
        let held: [bool; D] = std::array::from_fn(|k| {
            let others = (0..D).filter(|&l| l != k);
            let alone = others.map(|l| by_v[(k, l)].abs()).sum::<f64>() == 0.0;
            frame.free[k] && alone && by_v[(k, k)] != 0.0 && law.by_r.row(k).amax() == 0.0
        });
        let compliance = problem.contacts.compliance.block(law.position).diagonal();
        #[expect(clippy::cast_precision_loss, reason = "a dimension")]
        let least = LEAST_COMPLIANCE * compliance.sum() / D as f64;
        let mut multiplied = law.by_r + by_v * least;
        for k in (0..D).filter(|&k| held[k]) {
            multiplied.fill_row(k, 0.0);
            multiplied.fill_column(k, 0.0);
            multiplied[(k, k)] = by_v[(k, k)];
        }
        let multiplier = multiplied.try_inverse()?;
        let (mut by_r, mut by_v) = (multiplier * law.by_r, multiplier * by_v);
        for k in (0..D).filter(|&k| held[k]) {
            by_r.fill_row(k, 0.0);
            by_v.fill_row(k, 0.0);
        }
        Some(Self {
            contact: law.position,
            at: (frame.node != usize::MAX).then(|| D * frame.node),
            free: frame.free,
            held,
            multiplier,
            by_r,
            by_v,
        })
    }
}

/// `Rᵀ v` of values at the contacts.
#[must_use]
pub fn spread<const D: usize>(frames: &Frames<D>, v: &[[f64; D]], places: usize) -> Vec<f64> {
    let mut y = vec![0.0; places];
    for (i, k, at) in frames.unknowns() {
        y[at] = v[i][k];
    }
    y
}
