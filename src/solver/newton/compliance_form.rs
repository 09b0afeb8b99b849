//! One Newton step (19) in the reactions: rows of the closed contacts and the balance of
//! forces. It is solved by LU; a large system by GMRES with the blocks of the contacts; a
//! sparse `W` by a sparse LU.
//!
//! Unknowns are `r̂` of the closed contacts and `â`. A frictionless contact has one unknown, an
//! open one has none without cohesion.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;
use crate::law::alart_curnier::Linearised;
use crate::law::cone::Status;
use crate::linalg::dense;
use crate::linalg::gmres;
use crate::linalg::lu::Lu;
use crate::linalg::pages;
use crate::linalg::small::{Block, Vector};
use crate::linalg::sparse::sparse_lu::{Analysis, SparseLu};
use crate::reduced::compliance::Whole;
use crate::reduced::reduced::Reduced;
use crate::solver::bordered::Border;
use crate::solver::newton::linearisation::{Linearisation, cut, factorisation_cost};
use crate::solver::tuning;
use crate::tasks;

/// Largest remainder of a sparse LU, relative to the right side: its rows are exchanged within
/// fronts only; a few products correct the error.
const LEFT: f64 = 1e-10;
/// Whether the rows of a contact say `r = 0`.
pub fn is_free<const D: usize>(problem: &Reduced<D>, node: usize, status: Status) -> bool {
    status == Status::Open && problem.law[node].cohesion == 0.0
}

/// Cost of a step with `n` unknowns, in products with `W`.
pub fn cost<const D: usize>(problem: &Reduced<D>, n: usize) -> f64 {
    match problem.whole() {
        Ok(Some(whole)) => return sparse_cost(whole),
        Ok(None) => {}
        Err(_) => return f64::INFINITY,
    }
    let m = D * problem.contacts();
    let direct = factorisation_cost(problem, n);
    if n <= tuning::iterative_order() {
        return direct;
    }
    #[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
    let share = n as f64 / m as f64;
    direct.min(tuning::gmres_products() * share)
}

/// Cost of the factors of a whole sparse `W`, in products with it.
pub fn sparse_cost<const D: usize>(whole: &Whole<D>) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let product = (D * D * whole.blocks.stored()) as f64;
    // An LU has twice the operations of a symmetric factorisation; a product has two for each
    // entry.
    whole.analysis.counts().flops / (tuning::sparse_speed() * product)
}

/// Rows of one closed contact, or of an open one with cohesion.
#[derive(Clone, Debug)]
pub struct ClosedContact<const D: usize> {
    pub node: usize,
    status: Status,
    /// Index of its first unknown, and their number.
    first: usize,
    width: usize,
    by_r: Block<D>,
    by_v: Block<D>,
    value: Vector<D>,
}

#[derive(Debug)]
pub struct ComplianceForm<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    rows: Vec<ClosedContact<D>>,
    /// Number of unknowns of the contacts; those of the rigid motions follow.
    contact: usize,
    /// Added to the diagonal of the scaled `W`.
    shift: f64,
}

/// The solution of the system: the next `(r, a)`.
#[derive(Clone, Debug)]
pub struct Solved<const D: usize> {
    pub r: Vec<[f64; D]>,
    pub rigid: Vec<f64>,
}

impl<'p, const D: usize> ComplianceForm<'p, D> {
    pub fn new(problem: &'p Reduced<'p, D>, law: &Linearisation<D>) -> Self {
        Self::of_contacts(problem, law.at.iter().enumerate(), law.shift)
    }

    /// The system of some contacts, by their numbers; the others are open.
    pub fn of_contacts<'l>(
        problem: &'p Reduced<'p, D>,
        laws: impl Iterator<Item = (usize, &'l Linearised<D>)>,
        shift: f64,
    ) -> Self {
        let mut rows = Vec::new();
        let mut first = 0;
        for (node, at) in laws.filter(|(node, at)| !is_free(problem, *node, at.status)) {
            let width = if problem.law[node].has_friction() {
                D
            } else {
                1
            };
            rows.push(ClosedContact {
                node,
                status: at.status,
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
            shift,
        }
    }

    pub fn order(&self) -> usize {
        self.contact + self.problem.scaling.modes.len()
    }

    /// The next `(r, a)` from `(r, a)` with `imbalance = R̂ᵀ r̂ + ê`. An iterative solution is
    /// accurate to `tol` of the step. `None` if the matrix is singular.
    pub fn solve(
        &self,
        (r, rigid): (&[[f64; D]], &[f64]),
        imbalance: &[f64],
        tol: &dyn Fn() -> f64,
        count: &mut dyn FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let n = self.order();
        let mut x = self.right(r, imbalance, count);
        let apply = |x: &[f64]| self.apply(x, stop);
        if let Some(whole) = self.problem.whole()? {
            if !whole.has_memory() {
                return Ok(None); // sweeps need none
            }
            count(sparse_cost(whole));
            if let Some(factors) = ContactInverse::factors(self, whole, stop)? {
                let factors = ContactPreconditioner::new(self, factors)?;
                let precondition = |x: &mut [f64]| factors.apply(self, x);
                let found = gmres::solve(&apply, &precondition, &x, LEFT, tuning::mending_steps())?;
                #[expect(clippy::cast_precision_loss, reason = "a few")]
                count(found.products as f64);
                return Ok(self.moved_if_finite(r, rigid, &found.x));
            }
            if n > tuning::iterative_order() {
                return Ok(None);
            }
            // Singular without the rigid motions, or up to their rounding.
        } else if n > tuning::iterative_order() {
            let tol = tol();
            let blocks = ContactPreconditioner::new(self, ContactInverse::contacts(self))?;
            let precondition = |x: &mut [f64]| blocks.apply(self, x);
            let most = tuning::most_gmres_products();
            let found = gmres::solve(&apply, &precondition, &x, tol, most)?;
            #[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
            count((found.products * n) as f64 / (D * self.problem.contacts()) as f64);
            let moved = self.moved_if_finite(r, rigid, &found.x);
            if found.residual <= tol && moved.is_some() {
                return Ok(moved);
            }
        }
        count(factorisation_cost(self.problem, n));
        let Some(lu) = Lu::new(self.matrix(), n, stop)? else {
            return Ok(None);
        };
        lu.solve(&mut x);
        Ok(self.moved_if_finite(r, rigid, &x))
    }

    /// Solves a system in which all contacts are held and there are no rigid motions. Its
    /// matrix is a part of `W`, definite if `W` is symmetric.
    pub fn solve_definite(
        &self,
        r: &[[f64; D]],
        count: &mut dyn FnMut(f64),
        stop: &AtomicBool,
    ) -> Result<Option<Solved<D>>, Error> {
        let n = self.order();
        count(0.5 * factorisation_cost(self.problem, n));
        let mut x = self.right(r, &[], count);
        let mut matrix = self.matrix();
        if dense::cholesky(&mut matrix, n, stop)?.is_some() {
            return Ok(None);
        }
        dense::solve_lower(&matrix, n, &mut x, 1);
        dense::solve_lower_transpose(&matrix, n, &mut x, 1);
        Ok(self.moved_if_finite(r, &[], &x))
    }

    fn moved_if_finite(&self, r: &[[f64; D]], rigid: &[f64], x: &[f64]) -> Option<Solved<D>> {
        let finite = x.iter().all(|c| c.is_finite());
        finite.then(|| self.moved(r, rigid, x))
    }

    /// Rows of the matrix.
    pub fn matrix(&self) -> Vec<f64> {
        let n = self.order();
        let modes = &self.problem.scaling.modes;
        let mut matrix = pages::zeros(n * n);
        let (contact, border) = matrix.split_at_mut(self.contact * n);
        let of_rows = cut(&self.rows, |row| row.width * n, contact);
        let scaling = &self.problem.scaling;
        tasks::for_each_together(of_rows, 16, |_, (row, out)| {
            let to_v = scaling.to_v[row.node];
            for other in &self.rows {
                let w = self.problem.compliance.pair(row.node, other.node);
                let scale = to_v / scaling.to_r[other.node];
                for (i, out) in out.chunks_exact_mut(n).enumerate() {
                    for (j, value) in out[other.first..][..other.width].iter_mut().enumerate() {
                        let terms = (0..D).map(|k| row.by_v[(i, k)] * w[(k, j)]);
                        *value = terms.sum::<f64>() * scale;
                    }
                }
            }
            for i in 0..row.width {
                for j in 0..row.width {
                    out[i * n + row.first + j] += row.by_r[(i, j)] + self.shift * row.by_v[(i, j)];
                }
            }
            for (c, mode) in modes.at(row.node) {
                let motion = row.by_v * Vector::from(*mode);
                for i in 0..row.width {
                    out[i * n + self.contact + c] = motion[i];
                }
            }
        });
        for row in &self.rows {
            for (c, mode) in modes.at(row.node) {
                border[c * n + row.first..][..row.width].copy_from_slice(&mode[..row.width]);
            }
        }
        matrix
    }

    /// `−F` of the closed contacts minus the effect of opening contacts, and the forces out of
    /// balance.
    pub fn right(&self, r: &[[f64; D]], imbalance: &[f64], count: &mut dyn FnMut(f64)) -> Vec<f64> {
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
        let gone = scaling.modes.work(&released, &scaling.to_r);
        right.extend(imbalance.iter().zip(gone).map(|(s, gone)| -s - gone));
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
            for (k, value) in x[row.places()].iter().enumerate() {
                dr[row.node][k] = value / to_r;
            }
        }
        dr
    }

    /// `(r, a)` after the increments `x`; open contacts have no pressure, and without cohesion no
    /// reaction.
    pub fn moved(&self, r: &[[f64; D]], rigid: &[f64], x: &[f64]) -> Solved<D> {
        let mut next = self.unpack(x);
        for row in &self.rows {
            for k in 0..row.width {
                next[row.node][k] += r[row.node][k];
            }
            if row.status == Status::Open {
                next[row.node][0] = 0.0;
            }
        }
        let change = self.problem.scaling.rigid_from_scaled(&x[self.contact..]);
        Solved {
            r: next,
            rigid: rigid.iter().zip(change).map(|(a, da)| a + da).collect(),
        }
    }

    /// The product with the matrix, computed with `W`.
    fn apply(&self, x: &[f64], stop: &AtomicBool) -> Result<Vec<f64>, Error> {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let scaling = &self.problem.scaling;
        let compliance = &self.problem.compliance;
        let v = compliance.product_at(&self.nodes(), &self.unpack(x));
        let amounts = &x[self.contact..];
        let mut y = Vec::with_capacity(x.len());
        for (row, v) in self.rows.iter().zip(v) {
            let mut v = Vector::from(v) * scaling.to_v[row.node];
            for (c, mode) in scaling.modes.at(row.node) {
                v += Vector::from(*mode) * amounts[c];
            }
            let mut own = Vector::<D>::zeros();
            for k in 0..row.width {
                own[k] = x[row.first + k];
            }
            let value = row.by_r * own + row.by_v * (v + own * self.shift);
            y.extend(&value.as_slice()[..row.width]);
        }
        y.extend(balance(self, x));
        Ok(y)
    }
}

/// The approximate inverse of the rows and columns of the contacts.
enum ContactInverse<'w, const D: usize> {
    /// The inverses of the diagonal blocks.
    Contacts(Vec<Block<D>>),
    /// The factors of the whole matrix.
    Factors(SparseLu<&'w Analysis>),
}

impl<'w, const D: usize> ContactInverse<'w, D> {
    fn contacts(system: &ComplianceForm<D>) -> Self {
        let scaling = &system.problem.scaling;
        let inverse = system.rows.iter().map(|row| {
            let w = system.problem.compliance.block(row.node);
            let scale = scaling.to_v[row.node] / scaling.to_r[row.node];
            let own = row.own(&(w * scale), system.shift);
            own.try_inverse().unwrap_or_else(Block::identity)
        });
        Self::Contacts(inverse.collect())
    }

    fn factors(
        system: &ComplianceForm<D>,
        whole: &'w Whole<D>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let scaling = &system.problem.scaling;
        let mut rows: Vec<Option<&ClosedContact<D>>> = vec![None; system.problem.contacts()];
        for row in &system.rows {
            rows[row.node] = Some(row);
        }
        let n = rows.len();
        let matrix = whole.blocks.map(|i, j, w| {
            if i >= n {
                return match rows.get(j) {
                    Some(Some(row)) => row.columns(w),
                    None if i == j => Block::identity() * -tuning::least_motion_pivot(),
                    _ => Block::zeros(),
                };
            }
            let scale = if j < n {
                scaling.to_v[i] / scaling.to_r[j]
            } else {
                1.0
            };
            match rows[i] {
                Some(row) if i == j => row.own(&(w * scale), system.shift),
                Some(row) => row.of_others(&(w * scale)),
                None if i == j => Block::identity(),
                None => Block::zeros(),
            }
        });
        let factors = SparseLu::new(&whole.analysis, &matrix, stop)?;
        Ok(factors.map(Self::Factors))
    }

    fn solve(&self, system: &ComplianceForm<D>, x: &mut [f64]) {
        match self {
            Self::Contacts(inverse) => {
                for (row, inverse) in system.rows.iter().zip(inverse) {
                    let own = &mut x[row.places()];
                    let mut value = Vector::<D>::zeros();
                    value.as_mut_slice()[..row.width].copy_from_slice(own);
                    let solved = inverse * value;
                    own.copy_from_slice(&solved.as_slice()[..row.width]);
                }
            }
            Self::Factors(factors) => {
                let mut all = vec![0.0; factors.order()];
                for row in &system.rows {
                    all[D * row.node..][..row.width].copy_from_slice(&x[row.places()]);
                }
                // None, unless the factors have those of rigid motions.
                let first = D * system.problem.contacts();
                for (value, x) in all[first..].iter_mut().zip(&x[system.contact..]) {
                    *value = *x;
                }
                factors.solve(&mut all);
                for (value, x) in all[first..].iter().zip(&mut x[system.contact..]) {
                    *x = *value;
                }
                for row in &system.rows {
                    x[row.places()].copy_from_slice(&all[D * row.node..][..row.width]);
                }
            }
        }
    }
}

impl<const D: usize> ClosedContact<D> {
    fn places(&self) -> Range<usize> {
        self.first..self.first + self.width
    }

    /// Its block of another column of `Ŵ`.
    fn of_others(&self, w: &Block<D>) -> Block<D> {
        let mut block = self.by_v * w;
        for k in self.width..D {
            block.fill_row(k, 0.0);
        }
        block
    }

    /// The block of its columns in the rows of rigid motions.
    fn columns(&self, w: &Block<D>) -> Block<D> {
        let mut block = *w;
        for k in self.width..D {
            block.fill_column(k, 0.0);
        }
        block
    }

    /// Its diagonal block; components that are not unknowns are unchanged.
    fn own(&self, w: &Block<D>, shift: f64) -> Block<D> {
        let mut block = self.by_r + self.by_v * (w + Block::identity() * shift);
        for k in self.width..D {
            block.fill_row(k, 0.0);
            block.fill_column(k, 0.0);
            block[(k, k)] = 1.0;
        }
        block
    }
}

/// The preconditioner of the contacts, with the columns of rigid motions unless the factors have
/// them.
struct ContactPreconditioner<'w, const D: usize> {
    inner: ContactInverse<'w, D>,
    border: Option<Border<f64>>,
}

impl<'w, const D: usize> ContactPreconditioner<'w, D> {
    fn new(system: &ComplianceForm<D>, inner: ContactInverse<'w, D>) -> Result<Self, Error> {
        let scaling = &system.problem.scaling;
        let has_motions = scaling.is_sparse() && matches!(inner, ContactInverse::Factors(_));
        if has_motions || scaling.modes.is_empty() {
            return Ok(Self {
                inner,
                border: None,
            });
        }
        let solved = |mode: Vec<[f64; D]>| {
            let mut column = vec![0.0; system.contact];
            for row in &system.rows {
                let motion = row.by_v * Vector::from(mode[row.node]);
                column[row.places()].copy_from_slice(&motion.as_slice()[..row.width]);
            }
            inner.solve(system, &mut column);
            column
        };
        let columns = scaling.modes.columns().into_iter().map(solved).collect();
        let border = Border::new(columns, |x| balance(system, x))?;
        Ok(Self { inner, border })
    }

    fn apply(&self, system: &ComplianceForm<D>, x: &mut [f64]) {
        let Some(border) = &self.border else {
            self.inner.solve(system, x);
            return;
        };
        let (contact, amounts) = x.split_at_mut(system.contact);
        self.inner.solve(system, contact);
        let work = balance(system, contact);
        border.eliminate(contact, amounts, &work);
    }
}

/// The work of the contact unknowns on each rigid motion.
fn balance<const D: usize>(system: &ComplianceForm<D>, x: &[f64]) -> Vec<f64> {
    let modes = &system.problem.scaling.modes;
    let mut work = vec![0.0; modes.len()];
    for row in &system.rows {
        let own = &x[row.places()];
        for (c, mode) in modes.at(row.node) {
            work[c] += own.iter().zip(mode).map(|(x, m)| x * m).sum::<f64>();
        }
    }
    work
}
