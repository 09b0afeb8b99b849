//! Factors of the systems of Newton-like steps: of a dense or a sparse matrix, and the elimination of
//! the rigid motions from a system whose contacts are factored.

use std::borrow::Borrow;
use std::ops::{Mul, SubAssign};
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::lu::Lu;
use crate::linalg::sparse::sparse_lu::{Analysis, SparseLu};

/// The factors of a matrix.
#[derive(Debug)]
pub(super) enum Factors<A> {
    Dense(Lu),
    /// Its last unknowns fill a block, and have no effect.
    Sparse(SparseLu<A>),
}

impl<A: Borrow<Analysis>> Factors<A> {
    /// The sign of the determinant.
    pub(super) fn sign(&self) -> f64 {
        match self {
            Self::Dense(lu) => lu.sign(),
            Self::Sparse(lu) => lu.sign(),
        }
    }

    /// `x ← A⁻¹ x`, or `A⁻ᵀ x`.
    pub(super) fn solve(&self, x: &mut [f64], transposed: bool) {
        match (self, transposed) {
            (Self::Dense(lu), false) => lu.solve(x),
            (Self::Dense(lu), true) => lu.solve_transposed(x),
            (Self::Sparse(lu), _) => {
                let mut filled = x.to_vec();
                filled.resize(lu.order(), 0.0);
                if transposed {
                    lu.solve_transposed(&mut filled);
                } else {
                    lu.solve(&mut filled);
                }
                x.copy_from_slice(&filled[..x.len()]);
            }
        }
    }
}

/// The columns `C` of rigid motions beside a matrix `A` of contacts, and the balance `Rᵀ x = s` below it,
/// eliminated: `Rᵀ A⁻¹ C a = Rᵀ A⁻¹ b − s`.
#[derive(Debug)]
pub(super) struct Border<T> {
    /// `A⁻¹ C`.
    columns: Vec<Vec<T>>,
    /// `Rᵀ A⁻¹ C`, factored.
    balance: Lu,
}

impl<T: Copy + Mul<f64, Output = T> + SubAssign> Border<T> {
    /// Takes the columns of `A⁻¹ C`, and `Rᵀ` as a function; `None` if the motions are dependent.
    pub(super) fn new(
        columns: Vec<Vec<T>>,
        work: impl Fn(&[T]) -> Vec<f64>,
    ) -> Result<Option<Self>, Error> {
        let works: Vec<_> = columns.iter().map(|x| work(x)).collect();
        let rows = (0..columns.len()).flat_map(|c| works.iter().map(move |w| w[c]));
        let never = AtomicBool::new(false);
        let balance = Lu::new(rows.collect(), columns.len(), &never)?;
        Ok(balance.map(|balance| Self { columns, balance }))
    }

    pub(super) fn sign(&self) -> f64 {
        self.balance.sign()
    }

    /// Replaces `x = A⁻¹ b` with `work = Rᵀ x`, and `s`, by the solution.
    pub(super) fn eliminate(&self, x: &mut [T], s: &mut [f64], work: &[f64]) {
        for (amount, work) in s.iter_mut().zip(work) {
            *amount = work - *amount;
        }
        self.balance.solve(s);
        for (column, amount) in self.columns.iter().zip(&*s) {
            for (value, c) in x.iter_mut().zip(column) {
                *value -= *c * *amount;
            }
        }
    }
}
