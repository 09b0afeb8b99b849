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
//! of a Newton step (`linearised_laws`), whose preconditioner fits.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::following::Following;
use crate::linalg::parallel::axpy;
use crate::primal::engine::Engine;
use crate::primal::frames::Frames;
use crate::primal::linearised_laws::LinearisedLaws;
use crate::primal::local::Local;
use crate::primal::problem::Primal;

/// Relative residual of each linear system.
const WANTED: f64 = 1e-13;
/// Relative residual that is enough.
const ENOUGH: f64 = 1e-11;

/// The system of one step.
#[derive(Debug)]
pub struct LinearisedStep<'p, const D: usize> {
    problem: &'p Primal<D>,
    laws: LinearisedLaws<D>,
}

impl<'p, const D: usize> LinearisedStep<'p, D> {
    /// The system of laws of the contacts of the problem.
    pub fn new(problem: &'p Primal<D>, laws: LinearisedLaws<D>) -> Self {
        Self { problem, laws }
    }

    /// Solves the system for `s` of each law and `g`, which the solution replaces: `dr` of each
    /// law, and `dy`. Whether the linear solver converged.
    pub fn solve(
        &mut self,
        s: &mut [[f64; D]],
        g: &mut [f64],
        hierarchy: &mut Option<Following>,
        stop: &AtomicBool,
    ) -> Result<bool, Error> {
        self.laws.aim(s, g);
        let tangent = &self.laws.tangent;
        let mut engine = Local::new(self.problem, stop, hierarchy.take());
        if !engine.prepared(tangent, &self.laws.statuses)? {
            return Ok(false);
        }
        let right = engine.right_side(tangent, g);
        let found = engine.krylov(tangent, &right, WANTED, false)?;
        let mut dy = found.x;
        axpy(1.0, &tangent.known, &mut dy);
        let moved = engine.product(&dy)?;
        *hierarchy = engine.into_hierarchy().0;
        let frames = &self.problem.contacts.frames;
        self.laws.reactions(frames, s, g, (&dy, &moved));
        g.copy_from_slice(&dy);
        Ok(found.residual <= ENOUGH)
    }

    /// Solves the transposed system for `ρ` of each law and `e`, which the solution replaces:
    /// `w` of each law, and `b`. Whether the linear solver converged.
    pub fn solve_transposed(
        &mut self,
        rho: &mut [[f64; D]],
        e: &mut [f64],
        hierarchy: &mut Option<Following>,
        stop: &AtomicBool,
    ) -> Result<bool, Error> {
        let (problem, tangent) = (self.problem, &self.laws.tangent);
        let mut b = self.laws.pulled(rho, e);
        axpy(1.0, &problem.product_of_contacts(&b), e);
        let mut right = e.to_vec();
        tangent.clear(&mut right);
        let mut engine = Local::new(problem, stop, hierarchy.take());
        if !engine.prepared(tangent, &self.laws.statuses)? {
            return Ok(false);
        }
        let found = engine.krylov(tangent, &right, WANTED, true)?;
        let z = found.x;
        let mut u = z.clone();
        tangent.pull(&mut u);
        let mut moved = engine.product(&u)?;
        *hierarchy = engine.into_hierarchy().0;
        self.laws.multipliers(rho, e, &z, &mut moved);
        axpy(-1.0, &u, &mut b);
        e.copy_from_slice(&b);
        Ok(found.residual <= ENOUGH)
    }
}

/// `Rᵀ v` of values at the contacts.
pub fn spread<const D: usize>(frames: &Frames<D>, v: &[[f64; D]], places: usize) -> Vec<f64> {
    let mut y = vec![0.0; places];
    for (i, k, at) in frames.unknowns() {
        y[at] = v[i][k];
    }
    y
}
