//! One Newton step (19) in the reactions: rows of the closed contacts and the
//! balance of forces, solved by LU, or by GMRES with the blocks of the contacts
//! where it is large.
//!
//! Unknowns are `r̂` of the closed contacts and `â`. A frictionless contact has
//! one unknown, an open one none.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::dense;
use crate::linalg::gmres;
use crate::linalg::lu::Lu;
use crate::linalg::small::{Block, Vector};
use crate::problem::reduced::Reduced;
use crate::solver::linearisation::{Linearisation, factorisation_cost};

/// Unknowns above which GMRES with the contacts' blocks comes before an LU:
/// measured, it takes as long at 700 and half as long at 1300, on cubes pressed
/// and sheared over a whole face.
const LARGE: usize = 1000;

/// Products that it takes there for a step, and what it is given.
const PRODUCTS: f64 = 40.0;
const MOST_PRODUCTS: usize = 200;

/// What a step with `n` unknowns costs, in products with a `W` of order `m`.
#[must_use]
pub fn cost(n: usize, m: usize) -> f64 {
    let direct = factorisation_cost(n, m);
    if n <= LARGE {
        return direct;
    }
    #[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
    let share = n as f64 / m as f64;
    direct.min(PRODUCTS * share)
}

/// Rows of one closed contact.
#[derive(Clone, Debug)]
pub struct Row<const D: usize> {
    pub node: usize,
    /// Place of its first unknown, and how many it has.
    first: usize,
    width: usize,
    by_r: Block<D>,
    by_v: Block<D>,
    value: Vector<D>,
}

/// The system.
#[derive(Debug)]
pub struct ComplianceForm<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    rows: Vec<Row<D>>,
    /// Unknowns of the contacts; those of the rigid motions follow.
    contact: usize,
}

/// A solved system: the next `(r, a)`.
#[derive(Clone, Debug)]
pub struct Solved<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
}

impl<'p, const D: usize> ComplianceForm<'p, D> {
    #[must_use]
    pub fn new(problem: &'p Reduced<'p, D>, law: &Linearisation<D>) -> Self {
        let mut rows = Vec::new();
        let mut first = 0;
        for (node, at) in law.at.iter().enumerate() {
            if at.status == Status::Open {
                continue;
            }
            let width = if problem.mu[node] > 0.0 { D } else { 1 };
            rows.push(Row {
                node,
                first,
                width,
                by_r: at.by_r,
                by_v: at.by_v,
                value: at.value,
            });
            first += width;
        }
        Self {
            problem,
            rows,
            contact: first,
        }
    }

    /// Unknowns.
    #[must_use]
    pub fn order(&self) -> usize {
        self.contact + self.problem.scaling.modes.len()
    }

    /// The next `(r, a)` from `(r, a)`, which leaves `imbalance = R̂ᵀ r̂ + ê`; to
    /// `tol` of what is to be gained where it iterates. `None` where the matrix is
    /// singular.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn solve(
        &self,
        (r, rigid): (&[[f64; D]], &[f64]),
        imbalance: &[f64],
        tol: f64,
        count: &mut impl FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let n = self.order();
        let mut x = self.right(r, imbalance, count);
        if n > LARGE {
            let blocks = Blocks::new(self)?;
            let apply = |x: &[f64]| self.apply(x, stop);
            let precondition = |x: &mut [f64]| blocks.apply(self, x);
            let found = gmres::solve(apply, precondition, &x, tol, MOST_PRODUCTS)?;
            #[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
            count((found.products * n) as f64 / (D * self.problem.contacts()) as f64);
            if found.residual <= tol && found.x.iter().all(|c| c.is_finite()) {
                return Ok(Some(self.moved(r, rigid, &found.x)));
            }
        }
        count(factorisation_cost(n, D * self.problem.contacts()));
        let Some(lu) = Lu::new(self.matrix(), n, stop)? else {
            return Ok(None);
        };
        lu.solve(&mut x);
        Ok(x.iter()
            .all(|c| c.is_finite())
            .then(|| self.moved(r, rigid, &x)))
    }

    /// Solves a system of contacts that are all held, without rigid motions: its
    /// matrix is a part of `W`, for a symmetric one definite.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn solve_definite(
        &self,
        r: &[[f64; D]],
        count: &mut impl FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let n = self.order();
        count(0.5 * factorisation_cost(n, D * self.problem.contacts()));
        let mut x = self.right(r, &[], count);
        let mut matrix = self.matrix();
        if dense::cholesky(&mut matrix, n, stop)?.is_some() {
            return Ok(None);
        }
        dense::solve_lower(&matrix, n, &mut x, 1);
        dense::solve_lower_transpose(&matrix, n, &mut x, 1);
        Ok(x.iter()
            .all(|c| c.is_finite())
            .then(|| self.moved(r, &[], &x)))
    }

    /// Rows of the matrix.
    #[must_use]
    pub fn matrix(&self) -> Vec<f64> {
        let n = self.order();
        let modes = &self.problem.scaling.modes;
        let mut matrix = dense::zeros(n * n);
        let (contact, border) = matrix.split_at_mut(self.contact * n);
        let mut of_rows: Vec<(&Row<D>, &mut [f64])> = Vec::with_capacity(self.rows.len());
        let mut rest = contact;
        for row in &self.rows {
            let (own, after) = rest.split_at_mut(row.width * n);
            of_rows.push((row, own));
            rest = after;
        }
        let scaling = &self.problem.scaling;
        of_rows
            .into_par_iter()
            .with_min_len(16)
            .for_each(|(row, out)| {
                let to_v = scaling.to_v[row.node];
                for other in &self.rows {
                    let w = self.problem.compliance.pair(row.node, other.node);
                    let block = row.by_v * w * (to_v / scaling.to_r[other.node]);
                    for i in 0..row.width {
                        for j in 0..other.width {
                            out[i * n + other.first + j] = block[(i, j)];
                        }
                    }
                }
                for i in 0..row.width {
                    for j in 0..row.width {
                        out[i * n + row.first + j] += row.by_r[(i, j)];
                    }
                }
                for (c, mode) in modes.iter().enumerate() {
                    let motion = row.by_v * Vector::from(mode[row.node]);
                    for i in 0..row.width {
                        out[i * n + self.contact + c] = motion[i];
                    }
                }
            });
        for (mode, out) in modes.iter().zip(border.chunks_exact_mut(n.max(1))) {
            for row in &self.rows {
                out[row.first..row.first + row.width].copy_from_slice(&mode[row.node][..row.width]);
            }
        }
        matrix
    }

    /// `−F` of the closed contacts, less what happens when open ones let go, and
    /// the forces out of balance.
    fn right(&self, r: &[[f64; D]], imbalance: &[f64], count: &mut impl FnMut(f64)) -> Vec<f64> {
        let scaling = &self.problem.scaling;
        let mut released: Vec<[f64; D]> = r.iter().map(|r| r.map(|c| -c)).collect();
        for row in &self.rows {
            released[row.node][..row.width].fill(0.0);
        }
        let mut right: Vec<f64> = Vec::with_capacity(self.order());
        let mut effect = vec![[0.0; D]; self.rows.len()];
        if released.as_flattened().iter().any(|&c| c != 0.0) {
            effect = self.problem.compliance.product_at(&self.nodes(), &released);
            count(1.0);
        }
        for (row, v) in self.rows.iter().zip(effect) {
            let v = Vector::from(v) * scaling.to_v[row.node];
            let known = -row.value - row.by_v * v;
            right.extend(&known.as_slice()[..row.width]);
        }
        for (mode, s) in scaling.modes.iter().zip(imbalance) {
            let terms = mode.iter().zip(&released).zip(&scaling.to_r);
            let gone: f64 = terms
                .map(|((m, r), s)| (0..D).map(|k| m[k] * r[k]).sum::<f64>() * s)
                .sum();
            right.push(-s - gone);
        }
        right
    }

    fn nodes(&self) -> Vec<usize> {
        self.rows.iter().map(|row| row.node).collect()
    }

    /// The unknowns as increments of `r`.
    fn unpack(&self, x: &[f64]) -> Vec<[f64; D]> {
        let mut dr = vec![[0.0; D]; self.problem.contacts()];
        for row in &self.rows {
            let to_r = self.problem.scaling.to_r[row.node];
            for (k, value) in x[row.first..row.first + row.width].iter().enumerate() {
                dr[row.node][k] = value / to_r;
            }
        }
        dr
    }

    /// `(r, a)` after the increments `x`; open contacts carry nothing.
    fn moved(&self, r: &[[f64; D]], rigid: &[f64], x: &[f64]) -> Solved<D> {
        let mut next = self.unpack(x);
        for row in &self.rows {
            for k in 0..row.width {
                next[row.node][k] += r[row.node][k];
            }
        }
        let change = self.problem.scaling.rigid_from_scaled(&x[self.contact..]);
        Solved {
            r: next,
            rigid: rigid.iter().zip(change).map(|(a, da)| a + da).collect(),
        }
    }

    /// The product with the matrix, from `W` itself.
    fn apply(&self, x: &[f64], stop: &AtomicBool) -> Result<Vec<f64>, Error> {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let scaling = &self.problem.scaling;
        let v = self
            .problem
            .compliance
            .product_at(&self.nodes(), &self.unpack(x));
        let amounts = &x[self.contact..];
        let mut y = Vec::with_capacity(x.len());
        for (row, v) in self.rows.iter().zip(v) {
            let mut v = Vector::from(v) * scaling.to_v[row.node];
            for (mode, amount) in scaling.modes.iter().zip(amounts) {
                v += Vector::from(mode[row.node]) * *amount;
            }
            let mut own = Vector::<D>::zeros();
            for k in 0..row.width {
                own[k] = x[row.first + k];
            }
            let value = row.by_r * own + row.by_v * v;
            y.extend(&value.as_slice()[..row.width]);
        }
        let own = scaling.modes.iter().map(|mode| balance(self, mode, x));
        y.extend(own);
        Ok(y)
    }
}

/// Inverses of the contacts' own blocks, and what they make of the border.
struct Blocks<const D: usize> {
    inverse: Vec<Block<D>>,
    /// `D⁻¹ C`, `C` the columns of `â`, one a rigid motion.
    border: Vec<Vec<f64>>,
    /// `R̂ᵀ D⁻¹ C`, factored.
    balance: Option<Lu>,
}

impl<const D: usize> Blocks<D> {
    fn new(system: &ComplianceForm<D>) -> Result<Self, Error> {
        let scaling = &system.problem.scaling;
        let inverse = system.rows.iter().map(|row| {
            let w = system.problem.compliance.block(row.node);
            let scale = scaling.to_v[row.node] / scaling.to_r[row.node];
            let mut block = row.by_r + row.by_v * w * scale;
            for k in row.width..D {
                block.fill_row(k, 0.0);
                block.fill_column(k, 0.0);
                block[(k, k)] = 1.0;
            }
            block.try_inverse().unwrap_or_else(Block::identity)
        });
        let mut blocks = Self {
            inverse: inverse.collect(),
            border: Vec::new(),
            balance: None,
        };
        for mode in &scaling.modes {
            let mut column = vec![0.0; system.contact];
            for row in &system.rows {
                let motion = row.by_v * Vector::from(mode[row.node]);
                column[row.first..row.first + row.width]
                    .copy_from_slice(&motion.as_slice()[..row.width]);
            }
            for (k, row) in system.rows.iter().enumerate() {
                blocks.solve(row, k, &mut column);
            }
            blocks.border.push(column);
        }
        if !scaling.modes.is_empty() {
            let rows = scaling.modes.iter();
            let matrix = rows.flat_map(|mode| {
                let along = |column: &Vec<f64>| balance(system, mode, column);
                blocks.border.iter().map(along).collect::<Vec<_>>()
            });
            let matrix: Vec<f64> = matrix.collect();
            let never = AtomicBool::new(false);
            blocks.balance = Lu::new(matrix, scaling.modes.len(), &never)?;
        }
        Ok(blocks)
    }

    /// The block of the `k`-th contact, in place.
    fn solve(&self, row: &Row<D>, k: usize, x: &mut [f64]) {
        let own = &mut x[row.first..row.first + row.width];
        let mut value = Vector::<D>::zeros();
        value.as_mut_slice()[..row.width].copy_from_slice(own);
        let solved = self.inverse[k] * value;
        own.copy_from_slice(&solved.as_slice()[..row.width]);
    }

    fn apply(&self, system: &ComplianceForm<D>, x: &mut [f64]) {
        for (k, row) in system.rows.iter().enumerate() {
            self.solve(row, k, x);
        }
        let Some(lu) = &self.balance else { return };
        let modes = &system.problem.scaling.modes;
        let (contact, amounts) = x.split_at_mut(system.contact);
        for (amount, mode) in amounts.iter_mut().zip(modes) {
            *amount = balance(system, mode, contact) - *amount;
        }
        lu.solve(amounts);
        for (column, amount) in self.border.iter().zip(amounts) {
            for (value, c) in contact.iter_mut().zip(column) {
                *value -= *amount * c;
            }
        }
    }
}

/// What contact unknowns do on one rigid motion.
fn balance<const D: usize>(system: &ComplianceForm<D>, mode: &[[f64; D]], x: &[f64]) -> f64 {
    let of_row = |row: &Row<D>| {
        let own = &x[row.first..row.first + row.width];
        own.iter()
            .zip(&mode[row.node])
            .map(|(x, m)| x * m)
            .sum::<f64>()
    };
    system.rows.iter().map(of_row).sum()
}
