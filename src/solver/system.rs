//! The linear system of one Newton step, (19): rows of the closed contacts and
//! the balance of forces, solved by LU, by GMRES with an older LU, or, when it is
//! large, by GMRES with the blocks of the contacts.
//!
//! Unknowns are `r̂` of the closed contacts and `â`. A frictionless contact has
//! one unknown, an open one none.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::error::Error;
use crate::law::alart_curnier::{Linearised, linearised};
use crate::law::cone::Status;
use crate::linalg::dense;
use crate::linalg::gmres;
use crate::linalg::lu::Lu;
use crate::linalg::small::{Block, Vector};
use crate::problem::reduced::Reduced;

/// A factorisation of order `n` does `n/3` times the operations of a product of
/// that order, from the cache, which is about ten times faster a piece.
const UNKNOWNS_A_PRODUCT: f64 = 30.0;

/// Unknowns above which GMRES with the contacts' blocks is tried before an LU.
const LARGE: usize = 4000;

/// Iterations of GMRES that a large system is given.
const MOST_PRODUCTS: usize = 200;

/// Share of an LU that GMRES with an older one may cost before a new one is made.
const SHARE: f64 = 0.4;

/// Rows of one closed contact: `by_r r' + by_v v' = right` at the next point.
#[derive(Clone, Debug)]
pub struct Row<const D: usize> {
    pub node: usize,
    /// Place of its first unknown, and how many it has.
    first: usize,
    width: usize,
    by_r: Block<D>,
    by_v: Block<D>,
    right: Vector<D>,
}

/// The system.
#[derive(Debug)]
pub struct System<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    rows: Vec<Row<D>>,
    /// Unknowns of the contacts; those of the rigid motions follow.
    contact: usize,
}

/// A factorisation, and the contacts whose unknowns it has, with their widths.
#[derive(Debug)]
pub struct Factored {
    lu: Lu,
    contacts: Vec<(usize, usize)>,
}

/// A solved system: the next `(r, a)`, and what it cost in products with `W`.
#[derive(Clone, Debug)]
pub struct Solved<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
}

/// What a factorisation of order `n` costs, in products with a `W` of order `m`.
#[must_use]
pub fn factorisation_cost(n: usize, m: usize) -> f64 {
    let (n, m) = (real(n), real(m));
    if n == 0.0 {
        return 0.0;
    }
    n / UNKNOWNS_A_PRODUCT * (n / m).powi(2)
}

#[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
fn real(n: usize) -> f64 {
    n as f64
}

impl<'p, const D: usize> System<'p, D> {
    /// The law linearised at `(r, v)`.
    #[must_use]
    pub fn linearised(problem: &'p Reduced<'p, D>, r: &[[f64; D]], v: &[[f64; D]]) -> Self {
        let scaling = &problem.scaling;
        Self::new(problem, |i| {
            let r = r[i].map(|c| c * scaling.to_r[i]);
            let v = v[i].map(|c| c * scaling.to_v[i]);
            let mut at = linearised(&r, &v, problem.mu[i]);
            match at.status {
                Status::Open => return None,
                Status::Stick => hold(problem, i, &mut at, &r, &v),
                Status::Slip => {}
            }
            let right = at.by_r * Vector::from(r) + at.by_v * Vector::from(v) - at.value;
            Some((at.by_r, at.by_v, right))
        })
    }

    /// Some contacts held in every direction, the others open.
    #[must_use]
    pub fn held(problem: &'p Reduced<'p, D>, holds: impl Fn(usize) -> bool) -> Self {
        Self::new(problem, |i| {
            let none = [0.0; D];
            let mut at = Linearised {
                status: Status::Stick,
                value: Vector::zeros(),
                by_r: Block::zeros(),
                by_v: Block::identity(),
            };
            hold(problem, i, &mut at, &none, &none);
            holds(i).then_some((at.by_r, at.by_v, Vector::zeros()))
        })
    }

    fn new(
        problem: &'p Reduced<'p, D>,
        of_node: impl Fn(usize) -> Option<(Block<D>, Block<D>, Vector<D>)>,
    ) -> Self {
        let mut rows = Vec::new();
        let mut first = 0;
        for node in 0..problem.contacts() {
            if !movable(problem, node, 0) {
                continue;
            }
            let Some((by_r, by_v, right)) = of_node(node) else {
                continue;
            };
            let width = if problem.mu[node] > 0.0 { D } else { 1 };
            rows.push(Row {
                node,
                first,
                width,
                by_r,
                by_v,
                right,
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

    fn contacts(&self) -> Vec<(usize, usize)> {
        self.rows.iter().map(|row| (row.node, row.width)).collect()
    }

    /// Solves from `(r, a)`. `older` is a factorisation of a system like this one,
    /// or becomes one. `None` where the matrix is singular.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn solve(
        &self,
        (r, rigid): (&[[f64; D]], &[f64]),
        tol: f64,
        older: &mut Option<Factored>,
        count: &mut impl FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let n = self.order();
        let whole = D * self.problem.contacts();
        let cost = factorisation_cost(n, whole);
        let right = self.right();
        // A product reads the rows of W that are closed; two triangles are n² long.
        let closed = real(n) / real(whole.max(1));
        let mut iterated = None;
        if let Some(older) = older.as_ref() {
            let most = SHARE * cost / (closed + closed * closed);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a small count"
            )]
            let most = most as usize;
            if most >= 2 {
                let blocks = Blocks::new(self)?;
                let by = |x: &mut [f64]| self.by_older(older, &blocks, x);
                iterated = Some((
                    by_tolerance(self, (r, rigid), &right, &by, tol, most, stop)?,
                    closed + closed * closed,
                ));
            }
        } else if n > LARGE {
            let blocks = Blocks::new(self)?;
            let by = |x: &mut [f64]| blocks.apply(self, x);
            iterated = Some((
                by_tolerance(self, (r, rigid), &right, &by, tol, MOST_PRODUCTS, stop)?,
                closed,
            ));
        }
        if let Some(((found, products), each)) = iterated {
            count(real(products) * each);
            if let Some(x) = found {
                return Ok(Some(self.unpack(&x)));
            }
        }
        count(cost);
        let Some(lu) = Lu::new(self.matrix(), n, stop)? else {
            return Ok(None);
        };
        let mut x = right;
        lu.solve(&mut x);
        *older = Some(Factored {
            lu,
            contacts: self.contacts(),
        });
        Ok(x.iter().all(|c| c.is_finite()).then(|| self.unpack(&x)))
    }

    /// Solves a system of contacts that are all held, without rigid motions: its
    /// matrix is a part of `W`, for a symmetric one definite.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn solve_definite(
        &self,
        count: &mut impl FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let n = self.order();
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        count(0.5 * factorisation_cost(n, D * self.problem.contacts()));
        let mut matrix = self.matrix();
        if dense::cholesky(&mut matrix, n).is_err() {
            return Ok(None);
        }
        let mut x = self.right();
        dense::solve_lower(&matrix, n, &mut x, 1);
        dense::solve_lower_transpose(&matrix, n, &mut x, 1);
        Ok(x.iter().all(|c| c.is_finite()).then(|| self.unpack(&x)))
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

    /// The right side for the next `(r̂, â)` as a whole.
    fn right(&self) -> Vec<f64> {
        let mut right = Vec::with_capacity(self.order());
        for row in &self.rows {
            let free = Vector::from(self.problem.q[row.node]) * self.problem.scaling.to_v[row.node];
            let known = row.right - row.by_v * free;
            right.extend(&known.as_slice()[..row.width]);
        }
        right.extend(self.problem.scaling.load.iter().map(|load| -load));
        right
    }

    fn unpack(&self, x: &[f64]) -> Solved<D> {
        let scaling = &self.problem.scaling;
        let mut r = vec![[0.0; D]; self.problem.contacts()];
        for row in &self.rows {
            for (k, value) in x[row.first..row.first + row.width].iter().enumerate() {
                r[row.node][k] = value / scaling.to_r[row.node];
            }
        }
        Solved {
            r,
            rigid: scaling.rigid_from_scaled(&x[self.contact..]),
        }
    }

    fn pack(&self, r: &[[f64; D]], rigid: &[f64]) -> Vec<f64> {
        let scaling = &self.problem.scaling;
        let mut x = Vec::with_capacity(self.order());
        for row in &self.rows {
            let to_r = scaling.to_r[row.node];
            x.extend(r[row.node][..row.width].iter().map(|c| c * to_r));
        }
        x.extend(scaling.rigid_to_scaled(rigid));
        x
    }

    /// The product with the matrix, from `W` itself.
    fn apply(&self, x: &[f64], stop: &AtomicBool) -> Result<Vec<f64>, Error> {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let Solved { r, .. } = self.unpack(x);
        let scaling = &self.problem.scaling;
        let nodes: Vec<usize> = self.rows.iter().map(|row| row.node).collect();
        let v = self.problem.compliance.product_at(&nodes, &r);
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
        for mode in &scaling.modes {
            let of_row = |row: &Row<D>| {
                let own = &x[row.first..row.first + row.width];
                own.iter()
                    .zip(&mode[row.node])
                    .map(|(x, m)| x * m)
                    .sum::<f64>()
            };
            y.push(self.rows.iter().map(of_row).sum());
        }
        Ok(y)
    }

    /// `M⁻¹ x` by a factorisation with other contacts; those it lacks by their blocks.
    fn by_older(&self, older: &Factored, blocks: &Blocks<D>, x: &mut [f64]) {
        let mut place = vec![usize::MAX; self.problem.contacts()];
        for (k, row) in self.rows.iter().enumerate() {
            place[row.node] = k;
        }
        let mut old = Vec::with_capacity(older.lu.order());
        let mut known = vec![false; self.rows.len()];
        for &(node, width) in &older.contacts {
            match self.rows.get(place[node]) {
                Some(row) => {
                    known[place[node]] = true;
                    old.extend(&x[row.first..row.first + width]);
                }
                None => old.resize(old.len() + width, 0.0),
            }
        }
        old.extend(&x[self.contact..]);
        older.lu.solve(&mut old);
        let mut rest = old.as_slice();
        for &(node, width) in &older.contacts {
            let (own, after) = rest.split_at(width);
            rest = after;
            if let Some(row) = self.rows.get(place[node]) {
                x[row.first..row.first + width].copy_from_slice(own);
            }
        }
        x[self.contact..].copy_from_slice(rest);
        for (k, row) in self.rows.iter().enumerate() {
            if !known[k] {
                blocks.solve(row, k, x);
            }
        }
    }
}

/// GMRES from the point at hand; nothing where it did not reach `tol`. Beside it
/// the products spent.
fn by_tolerance<const D: usize>(
    system: &System<D>,
    (r, rigid): (&[[f64; D]], &[f64]),
    right: &[f64],
    precondition: &impl Fn(&mut [f64]),
    tol: f64,
    most: usize,
    stop: &AtomicBool,
) -> Result<(Option<Vec<f64>>, usize), Error> {
    let mut x = system.pack(r, rigid);
    let there = system.apply(&x, stop)?;
    let rest: Vec<f64> = right.iter().zip(there).map(|(b, y)| b - y).collect();
    let found = gmres::solve(|x| system.apply(x, stop), precondition, &rest, tol, most)?;
    let spent = found.products + 1;
    if !(found.residual <= tol) || found.x.iter().any(|c| !c.is_finite()) {
        return Ok((None, spent));
    }
    for (value, change) in x.iter_mut().zip(found.x) {
        *value += change;
    }
    Ok((Some(x), spent))
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
    fn new(system: &System<D>) -> Result<Self, Error> {
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

    fn apply(&self, system: &System<D>, x: &mut [f64]) {
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
fn balance<const D: usize>(system: &System<D>, mode: &[[f64; D]], x: &[f64]) -> f64 {
    let of_row = |row: &Row<D>| {
        let own = &x[row.first..row.first + row.width];
        own.iter()
            .zip(&mode[row.node])
            .map(|(x, m)| x * m)
            .sum::<f64>()
    };
    system.rows.iter().map(of_row).sum()
}

/// Whether anything moves a component of a contact.
fn movable<const D: usize>(problem: &Reduced<D>, node: usize, k: usize) -> bool {
    let mut modes = problem.scaling.modes.iter();
    problem.compliance.block(node)[(k, k)] > 0.0 || modes.any(|mode| mode[node][k] != 0.0)
}

/// Makes rows of `v = 0` ask for no reaction along a component that is
/// prescribed: it cannot be held.
fn hold<const D: usize>(
    problem: &Reduced<D>,
    node: usize,
    at: &mut Linearised<D>,
    r: &[f64; D],
    v: &[f64; D],
) {
    at.by_v = Block::from_fn(|i, j| f64::from(u8::from(i == j && movable(problem, node, i))));
    at.by_r = Block::identity() - at.by_v;
    at.value = at.by_r * Vector::from(*r) + at.by_v * Vector::from(*v);
}
