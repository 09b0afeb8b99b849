//! The engine of one machine: our own multigrid, and flexible GMRES.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::{Error, check_running};
use crate::law::cone::Status;
use crate::linalg::amg::following::Following;
use crate::linalg::flexible_gmres::{self, FlexibleSolution, Limits};
use crate::linalg::parallel::{axpy, largest, norm};
use crate::primal::engine::{Correction, Engine, Terms};
use crate::primal::preconditioner::Preconditioner;
use crate::primal::problem::{Force, Primal};
use crate::primal::tangent::Tangent;
use crate::primal::tuning;

/// The engine of one load step.
#[derive(Debug)]
pub struct Local<'p, const D: usize> {
    problem: &'p Primal<D>,
    stop: &'p AtomicBool,
    preconditioner: Preconditioner<'p, D>,
    /// The forces of the step; empty for derivatives, which have none.
    force: Force,
    work: Vec<f64>,
}

impl<'p, const D: usize> Local<'p, D> {
    /// `hierarchy` is that of an earlier load step of this problem, if there is one.
    pub fn new(problem: &'p Primal<D>, stop: &'p AtomicBool, hierarchy: Option<Following>) -> Self {
        Self {
            problem,
            stop,
            preconditioner: Preconditioner::new(problem, hierarchy),
            force: Force::default(),
            work: Vec::new(),
        }
    }

    /// For a load step with these forces.
    pub fn with_force(self, force: Force) -> Self {
        Self { force, ..self }
    }

    /// The hierarchy, for the next load step, and the memory of the largest one.
    pub fn into_hierarchy(mut self) -> (Option<Following>, usize) {
        (self.preconditioner.hierarchy(), self.preconditioner.bytes)
    }

    /// The right side of the system of a Newton step.
    pub(super) fn right_side(&self, tangent: &Tangent<D>, e: &[f64]) -> Vec<f64> {
        let mut moved = self.problem.product_of_contacts(&tangent.known);
        tangent.right_side(e, &mut moved)
    }

    /// Makes the preconditioner; whether there is one.
    pub(super) fn prepared(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
    ) -> Result<bool, Error> {
        match self.preconditioner.prepare(tangent, statuses, self.stop) {
            Ok(()) => Ok(true),
            Err(
                Error::Multigrid { .. } | Error::Indefinite { .. } | Error::FloatingBody { .. },
            ) => Ok(false),
            Err(other) => Err(other),
        }
    }

    /// Solves `J x = right`, or `Jᵀ x = right`, in the rows and columns that are not held, with
    /// the preconditioner that is prepared.
    pub(super) fn krylov(
        &mut self,
        tangent: &Tangent<D>,
        right: &[f64],
        tol: f64,
        transposed: bool,
    ) -> Result<FlexibleSolution, Error> {
        let (problem, work) = (self.problem, &mut self.work);
        let preconditioner = &mut self.preconditioner;
        let mut pulled = Vec::new();
        let solved = flexible_gmres::solve(
            |x, out| {
                if transposed {
                    pulled.clear();
                    pulled.extend_from_slice(x);
                    tangent.pull(&mut pulled);
                    problem.product(&pulled, work, out);
                    tangent.add_transposed(x, out);
                } else {
                    problem.product(x, work, out);
                    tangent.add_laws(x, out);
                }
                tangent.clear(out);
            },
            |b, x| {
                preconditioner.apply(b, x);
                tangent.clear(x);
            },
            right,
            Limits {
                tol,
                restart: tuning::basis(),
                most: tuning::most_iterations(),
            },
            self.stop,
        )?;
        check_running(self.stop)?;
        self.preconditioner.solved_in(solved.products);
        Ok(solved)
    }
}

impl<const D: usize> Engine<D> for Local<'_, D> {
    type Vector = Vec<f64>;
    type Error = Error;

    fn free(&self) -> &[bool] {
        &self.problem.stiffness.free
    }

    fn floating(&self) -> Vec<Vec<usize>> {
        self.problem.floating()
    }

    fn may_be_soft(&mut self) -> Result<bool, Error> {
        Ok(!self.problem.stiffness.supports.are_firm)
    }

    fn is_held(&self, tangent: &Tangent<D>, statuses: &[Status]) -> bool {
        self.problem.is_held(tangent, statuses)
    }

    fn product(&mut self, y: &Vec<f64>) -> Result<Vec<f64>, Error> {
        let mut out = vec![0.0; y.len()];
        self.problem.product(y, &mut self.work, &mut out);
        Ok(out)
    }

    /// The forces are those of the step, with their low digits.
    fn unbalanced(&mut self, y: &Vec<f64>, _: &Vec<f64>) -> Result<Vec<f64>, Error> {
        Ok(self.problem.imbalance(y, &self.force))
    }

    fn add(&mut self, mut y: Vec<f64>, s: f64, x: &Vec<f64>) -> Result<Vec<f64>, Error> {
        axpy(s, x, &mut y);
        Ok(y)
    }

    fn at_contacts(&mut self, y: &Vec<f64>) -> Result<Vec<[f64; D]>, Error> {
        Ok(self.problem.contacts.frames.at_contacts(y))
    }

    fn norm(&mut self, y: &Vec<f64>) -> Result<f64, Error> {
        Ok(norm(y))
    }

    fn largest(&mut self, y: &Vec<f64>) -> Result<f64, Error> {
        Ok(largest(y))
    }

    fn imbalance(&mut self, e: &Vec<f64>, reaction: &[[f64; D]]) -> Result<f64, Error> {
        let mut left = e.clone();
        for (i, k, at) in self.problem.contacts.frames.unknowns() {
            left[at] -= reaction[i][k];
        }
        Ok(norm(&left))
    }

    fn terms(&mut self, y: &Vec<f64>) -> Result<Terms<D>, Error> {
        let terms = self.problem.terms(y);
        Ok(Terms {
            norm: norm(&terms),
            at_contacts: self.problem.contacts.frames.at_contacts(&terms),
        })
    }

    fn correction(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        e: &Vec<f64>,
        tol: f64,
    ) -> Result<Option<Correction<Vec<f64>>>, Error> {
        if !self.prepared(tangent, statuses)? {
            return Ok(None);
        }
        let right = self.right_side(tangent, e);
        let solved = self.krylov(tangent, &right, tol, false)?;
        let mut dy = solved.x;
        axpy(1.0, &tangent.known, &mut dy);
        Ok(Some(Correction {
            dy,
            products: solved.products,
            reached: solved.reached,
        }))
    }

    fn estimate(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        e: &Vec<f64>,
    ) -> Result<Option<Vec<f64>>, Error> {
        match self.preconditioner.prepare(tangent, statuses, self.stop) {
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Err(_) => return Ok(None),
            Ok(()) => {}
        }
        let right = self.right_side(tangent, e);
        let mut change = vec![0.0; right.len()];
        self.preconditioner.apply(&right, &mut change);
        tangent.clear(&mut change);
        axpy(1.0, &tangent.known, &mut change);
        Ok(Some(change))
    }

    fn is_late(&mut self, start: Instant, seconds: f64) -> Result<bool, Error> {
        Ok(start.elapsed().as_secs_f64() > seconds)
    }
}
