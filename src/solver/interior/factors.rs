//! The matrix of a point of a path, factored, and the steps that it gives.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::second_order::{NesterovTodd, quotient};
use crate::linalg::lu::Lu;
use crate::linalg::pages;
use crate::linalg::small::{Block, Vector};
use crate::linalg::sparse::sparse_lu::{Analysis, SparseLu};
use crate::solver::interior::system::{Missed, System};
use crate::solver::monitor::Monitor;
use crate::solver::newton::compliance_form::sparse_cost;
use crate::solver::newton::linearisation::factorisation_cost;
use crate::solver::tuning;

/// A step.
pub(super) struct InteriorStep<const D: usize> {
    pub(super) z: Vec<Vector<D>>,
    pub(super) s: Vec<Vector<D>>,
    pub(super) a: Vec<f64>,
}

impl<const D: usize> InteriorStep<D> {
    pub(super) fn plus(&self, other: &Self, factor: f64) -> Self {
        let sum = |x: &[Vector<D>], y: &[Vector<D>]| {
            let pairs = x.iter().zip(y);
            pairs.map(|(x, y)| x + y * factor).collect()
        };
        Self {
            z: sum(&self.z, &other.z),
            s: sum(&self.s, &other.s),
            a: self
                .a
                .iter()
                .zip(&other.a)
                .map(|(x, y)| x + y * factor)
                .collect(),
        }
    }
}

impl<'p, const D: usize> System<'p, D> {
    /// Factors the matrix of a point; `None` if it is singular.
    pub(super) fn factor(
        &self,
        s: &[Vector<D>],
        scalings: Vec<NesterovTodd<D>>,
        monitor: &mut Monitor<D>,
    ) -> Result<Option<Factors<'_, 'p, D>>, Error> {
        let problem = self.problem;
        let compliance = &problem.compliance;
        let slopes = s
            .iter()
            .zip(&problem.law)
            .map(|(s, law)| self.slope(s, law.mu));
        let slopes: Vec<Block<D>> = slopes.collect();
        let of_law = slopes.iter().zip(&scalings);
        let of_law: Vec<Block<D>> = of_law
            .map(|(slope, p)| slope * p.forward * p.forward)
            .collect();
        let scale = |i: usize| {
            let forward = &scalings[i].forward;
            let own = self.block(i, i, &compliance.block(i)) + forward * forward;
            own.diagonal().map(|d| 1.0 / d.sqrt())
        };
        let scale: Vec<Vector<D>> = (0..s.len()).map(scale).collect();
        let entry = |i: usize, j: usize, w: &Block<D>| {
            let mut block = self.block(i, j, w);
            if i == j {
                block += of_law[i];
            }
            Block::from_fn(|k, l| scale[i][k] * block[(k, l)] * scale[j][l])
        };
        let modes = problem.scaling.modes.len();
        let inner = if let Some(whole) = problem.whole()? {
            monitor.count(sparse_cost(whole));
            let n = s.len();
            let border = |i: usize, w: &Block<D>| {
                let block = self.border(i, w);
                Block::from_fn(|k, l| scale[i][k] * block[(k, l)])
            };
            let matrix = whole.blocks.map(|i, j, w| match (i < n, j < n) {
                (true, true) => entry(i, j, w),
                (true, false) => border(i, w),
                (false, true) => border(j, &w.transpose()).transpose(),
                (false, false) if i == j => Block::identity() * -tuning::least_motion_pivot(),
                (false, false) => Block::zeros(),
            });
            SparseLu::new(&whole.analysis, &matrix, monitor.stop())?.map(Factorisation::Sparse)
        } else {
            let order = D * s.len();
            monitor.count(factorisation_cost(problem, order + modes));
            let mut matrix = pages::zeros(order * order);
            for i in 0..s.len() {
                for j in 0..s.len() {
                    let block = entry(i, j, &compliance.pair(i, j));
                    for (k, l) in (0..D).flat_map(|k| (0..D).map(move |l| (k, l))) {
                        matrix[(D * i + k) * order + D * j + l] = block[(k, l)];
                    }
                }
            }
            Lu::new(matrix, order, monitor.stop())?.map(Factorisation::Dense)
        };
        let Some(inner) = inner else { return Ok(None) };
        let mut factors = Factors {
            system: self,
            scalings,
            slopes,
            of_law,
            scale,
            inner,
            border: Vec::new(),
            balance: None,
        };
        if modes > 0 && !factors.has_motions() {
            let columns = self.motions.columns().into_iter();
            let columns = columns.map(|column| column.into_iter().map(Vector::from).collect());
            factors.border = columns
                .map(|column: Vec<_>| factors.solve_contacts(&column, &mut []))
                .collect();
            let works: Vec<_> = factors.border.iter().map(|x| self.work(x)).collect();
            let rows = (0..modes).flat_map(|c| works.iter().map(move |w| w[c]));
            let matrix: Vec<f64> = rows.collect();
            let never = AtomicBool::new(false);
            let Some(lu) = Lu::new(matrix, modes, &never)? else {
                return Ok(None);
            };
            factors.balance = Some(lu);
        }
        Ok(Some(factors))
    }
}

enum Factorisation<'w> {
    Sparse(SparseLu<&'w Analysis>),
    Dense(Lu),
}

/// `A + N P²`, `N` the slope, with the border `B`: factored.
pub(super) struct Factors<'s, 'p, const D: usize> {
    system: &'s System<'p, D>,
    pub(super) scalings: Vec<NesterovTodd<D>>,
    slopes: Vec<Block<D>>,
    /// `N P²`.
    of_law: Vec<Block<D>>,
    /// Factors of rows and columns. `P²` of open contacts grows without bound; without these
    /// factors it would hide the pivots of sticking contacts.
    scale: Vec<Vector<D>>,
    inner: Factorisation<'s>,
    /// `(A + N P²)⁻¹ B`, and `Bᵀ` times it.
    border: Vec<Vec<Vector<D>>>,
    balance: Option<Lu>,
}

impl<const D: usize> Factors<'_, '_, D> {
    /// The sign of the determinant.
    pub(super) fn sign(&self) -> f64 {
        let inner = match &self.inner {
            Factorisation::Sparse(factors) => factors.sign(),
            Factorisation::Dense(factors) => factors.sign(),
        };
        self.balance.as_ref().map_or(inner, |lu| inner * lu.sign())
    }

    /// `P dz` and `P⁻¹ ds`, in units of the root of `aim`.
    pub(super) fn scale_step(
        &self,
        way: &InteriorStep<D>,
        aim: f64,
    ) -> Vec<(Vector<D>, Vector<D>)> {
        let unit = 1.0 / aim.sqrt();
        let pairs = self.scalings.iter().zip(way.z.iter().zip(&way.s));
        pairs
            .map(|(p, (z, s))| (p.forward * z * unit, p.inverse * s * unit))
            .collect()
    }

    /// Whether the factors are those of the matrix with its border.
    fn has_motions(&self) -> bool {
        let sparse = matches!(self.inner, Factorisation::Sparse(_));
        sparse && self.system.problem.scaling.is_sparse()
    }

    /// `(A + N P²)⁻¹ b`; with a border, its solution for `a` too.
    fn solve_contacts(&self, b: &[Vector<D>], a: &mut [f64]) -> Vec<Vector<D>> {
        let scaled = b.iter().zip(&self.scale);
        let mut x: Vec<f64> = scaled
            .flat_map(|(b, scale)| <[f64; D]>::from(b.component_mul(scale)))
            .collect();
        match &self.inner {
            Factorisation::Sparse(factors) => {
                x.extend(&*a);
                x.resize(factors.order(), 0.0);
                factors.solve(&mut x);
                a.copy_from_slice(&x[D * b.len()..][..a.len()]);
            }
            Factorisation::Dense(factors) => factors.solve(&mut x),
        }
        let (x, _) = x.as_chunks::<D>();
        let scaled = x.iter().zip(&self.scale);
        scaled
            .map(|(x, scale)| Vector::from(*x).component_mul(scale))
            .collect()
    }

    fn solve_bordered(&self, b: &[Vector<D>], balance: &[f64]) -> (Vec<Vector<D>>, Vec<f64>) {
        if self.has_motions() {
            let mut a = balance.to_vec();
            return (self.solve_contacts(b, &mut a), a);
        }
        let mut x = self.solve_contacts(b, &mut []);
        let mut a = Vec::new();
        if let Some(lu) = &self.balance {
            let work = self.system.work(&x);
            a = work.iter().zip(balance).map(|(w, s)| w - s).collect();
            lu.solve(&mut a);
            for (column, amount) in self.border.iter().zip(&a) {
                for (x, c) in x.iter_mut().zip(column) {
                    *x -= c * *amount;
                }
            }
        }
        (x, a)
    }

    /// `b − (A + N P²) x − B a` and `balance − Bᵀ x`.
    fn find_remainder(
        &self,
        (b, balance): (&[Vector<D>], &[f64]),
        (x, a): (&[Vector<D>], &[f64]),
    ) -> (Vec<Vector<D>>, Vec<f64>) {
        let system = self.system;
        let r = system.reaction(x);
        let mut v = vec![[0.0; D]; r.len()];
        system.problem.compliance.product(&r, &mut v);
        let mut left = system.displacement(&v);
        for (i, value) in left.iter_mut().enumerate() {
            *value = b[i] - *value - self.of_law[i] * x[i];
        }
        for (i, value) in left.iter_mut().enumerate() {
            for (c, m) in system.motions.at(i) {
                *value -= Vector::from(*m) * a[c];
            }
        }
        let work = system.work(x);
        let unbalanced = balance.iter().zip(work).map(|(s, w)| s - w).collect();
        (left, unbalanced)
    }

    /// The step for which `λ ∘ (P dz + P⁻¹ ds)` is `aim`.
    pub(super) fn direction(&self, aim: &[Vector<D>], right: &Missed<D>) -> InteriorStep<D> {
        let known = aim.iter().zip(&self.scalings);
        let known: Vec<Vector<D>> = known
            .map(|(aim, p)| p.forward * quotient(aim, &p.point))
            .collect();
        let b: Vec<Vector<D>> = (0..aim.len())
            .map(|i| self.slopes[i] * known[i] + right.contacts[i])
            .collect();
        let balance: Vec<f64> = right.imbalance.iter().map(|x| -x).collect();
        let (mut z, mut a) = self.solve_bordered(&b, &balance);
        // Rows are exchanged within fronts only: one refinement corrects the error, and more that
        // of the pivots of motions.
        for _ in 0..if self.has_motions() { 3 } else { 1 } {
            let (left, unbalanced) = self.find_remainder((&b, &balance), (&z, &a));
            let (dz, da) = self.solve_bordered(&left, &unbalanced);
            for (z, dz) in z.iter_mut().zip(&dz) {
                *z += dz;
            }
            for (a, da) in a.iter_mut().zip(&da) {
                *a += da;
            }
        }
        let s = (0..z.len())
            .map(|i| {
                let forward = &self.scalings[i].forward;
                known[i] - forward * (forward * z[i])
            })
            .collect();
        InteriorStep { z, s, a }
    }
}
