//! The matrix of a point of a path, factored, and the steps that it gives.

use std::ops::{Add, Mul};

use crate::error::Error;
use crate::law::second_order::{NesterovTodd, quotient};
use crate::linalg::lu::Lu;
use crate::linalg::pages;
use crate::linalg::small::{Block, Vector};
use crate::linalg::sparse::sparse_lu::{Analysis, SparseLu};
use crate::solver::bordered::{Border, Factors};
use crate::solver::interior::system::{Missed, System};
use crate::solver::monitor::Monitor;
use crate::solver::newton::compliance_form::sparse_cost;
use crate::solver::newton::linearisation::factorisation_cost;
use crate::solver::tuning;

/// A point, or a step.
pub(super) struct InteriorStep<const D: usize> {
    pub(super) z: Vec<Vector<D>>,
    pub(super) s: Vec<Vector<D>>,
    pub(super) a: Vec<f64>,
}

impl<const D: usize> InteriorStep<D> {
    pub(super) fn plus(&self, other: &Self, factor: f64) -> Self {
        Self {
            z: plus(&self.z, &other.z, factor),
            s: plus(&self.s, &other.s, factor),
            a: plus(&self.a, &other.a, factor),
        }
    }
}

/// `x + factor y`.
pub(super) fn plus<T: Copy + Add<Output = T> + Mul<f64, Output = T>>(
    x: &[T],
    y: &[T],
    factor: f64,
) -> Vec<T> {
    let pairs = x.iter().zip(y);
    pairs.map(|(x, y)| *x + *y * factor).collect()
}

impl<'p, const D: usize> System<'p, D> {
    /// Factors the matrix of a point; `None` if it is singular.
    pub(super) fn factor(
        &self,
        s: &[Vector<D>],
        scalings: Vec<NesterovTodd<D>>,
        monitor: &mut Monitor<D>,
    ) -> Result<Option<InteriorFactors<'_, 'p, D>>, Error> {
        let problem = self.problem;
        let compliance = &problem.compliance;
        let slopes = s.iter().zip(&problem.law);
        let slopes: Vec<Block<D>> = slopes.map(|(s, law)| self.slope(s, law.mu)).collect();
        let of_law = slopes.iter().zip(&scalings);
        let of_law = of_law.map(|(slope, p)| slope * p.forward * p.forward);
        let of_law: Vec<Block<D>> = of_law.collect();
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
            SparseLu::new(&whole.analysis, &matrix, monitor.stop())?.map(Factors::Sparse)
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
            Lu::new(matrix, order, monitor.stop())?.map(Factors::Dense)
        };
        let Some(inner) = inner else { return Ok(None) };
        let mut factors = InteriorFactors {
            system: self,
            scalings,
            slopes,
            of_law,
            scale,
            inner,
            border: None,
        };
        if modes > 0 && !factors.has_motions() {
            let columns = self.motions.columns().into_iter().map(|column| {
                let column: Vec<_> = column.into_iter().map(Vector::from).collect();
                factors.solve_contacts(&column, &mut [])
            });
            let border = Border::new(columns.collect(), |x| self.work(x))?;
            if border.is_none() {
                return Ok(None);
            }
            factors.border = border;
        }
        Ok(Some(factors))
    }
}

/// `A + N P²`, `N` the slope, with the border `B`: factored.
pub(super) struct InteriorFactors<'s, 'p, const D: usize> {
    system: &'s System<'p, D>,
    pub(super) scalings: Vec<NesterovTodd<D>>,
    slopes: Vec<Block<D>>,
    /// `N P²`.
    of_law: Vec<Block<D>>,
    /// Factors of rows and columns. `P²` of open contacts grows without bound; without these
    /// factors it would hide the pivots of sticking contacts.
    scale: Vec<Vector<D>>,
    inner: Factors<&'s Analysis>,
    /// `B`, unless the factors have it.
    border: Option<Border<Vector<D>>>,
}

impl<const D: usize> InteriorFactors<'_, '_, D> {
    /// The sign of the determinant.
    pub(super) fn sign(&self) -> f64 {
        let inner = self.inner.sign();
        (self.border.as_ref()).map_or(inner, |border| inner * border.sign())
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
        let sparse = matches!(self.inner, Factors::Sparse(_));
        sparse && self.system.problem.scaling.is_sparse()
    }

    /// `(A + N P²)⁻¹ b`; with a border, its solution for `a` too.
    fn solve_contacts(&self, b: &[Vector<D>], a: &mut [f64]) -> Vec<Vector<D>> {
        let scaled = b.iter().zip(&self.scale);
        let mut x: Vec<f64> = scaled
            .flat_map(|(b, scale)| <[f64; D]>::from(b.component_mul(scale)))
            .collect();
        x.extend(&*a);
        self.inner.solve(&mut x, false);
        a.copy_from_slice(&x[D * b.len()..]);
        let (x, _) = x[..D * b.len()].as_chunks::<D>();
        let scaled = x.iter().zip(&self.scale);
        scaled
            .map(|(x, scale)| Vector::from(*x).component_mul(scale))
            .collect()
    }

    fn solve_bordered(&self, b: &[Vector<D>], balance: &[f64]) -> (Vec<Vector<D>>, Vec<f64>) {
        let mut a = balance.to_vec();
        if self.has_motions() {
            return (self.solve_contacts(b, &mut a), a);
        }
        let mut x = self.solve_contacts(b, &mut []);
        if let Some(border) = &self.border {
            let work = self.system.work(&x);
            border.eliminate(&mut x, &mut a, &work);
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
            for (c, m) in system.motions.at(i) {
                *value -= Vector::from(*m) * a[c];
            }
        }
        (left, plus(balance, &system.work(x), -1.0))
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
            (z, a) = (plus(&z, &dz, 1.0), plus(&a, &da, 1.0));
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
