//! One body: a connected component of the free stiffness, its `S`, its rigid motions.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::binary::{exponent, times_two_to};
use crate::linalg::dense;
use crate::linalg::exact::Sum;
use crate::linalg::multifrontal::Factor;
use crate::linalg::small::{dot_long, norm};
use crate::linalg::symbolic::{Options, Symbolic};
use crate::problem::memory;
use crate::problem::null_space::{null_space, start_value};
use crate::problem::sparse::Owned;
use crate::problem::stats::Stats;

/// A row of `B` restricted to a body: places in its contact set, and values.
#[derive(Clone, Debug)]
pub struct Row {
    pub row: usize,
    pub entries: Vec<(usize, f64)>,
}

/// Below this, relative to the diagonal of `K`, an eigenvalue of `S` is zero if a
/// gap sets it apart: rounding leaves about 1e-15, and the softest support worth
/// the name more. Bodies of many unknowns sum more of the rounding of `K` itself,
/// a few ε for each.
const NULL: f64 = 1e-13;

/// A pivot above this, relative to the diagonal of `K`, leaves no doubt that a
/// matrix is definite; below it the eigenvalues are looked at. Where the contact
/// set is soft and the rest is stiff, the rounding of the stiff part may exceed it.
const SAFE: f64 = 1e-9;

/// One body.
#[derive(Debug)]
pub struct Body {
    /// Its degrees of freedom in the caller's numbering.
    dofs: Vec<usize>,
    /// `unit K`.
    stiffness: Owned,
    /// A power of two that makes the stiffness of order one: square roots of
    /// pivots then round alike in all units that differ by powers of two.
    unit: f64,
    /// The contact set, local numbers.
    kept: Vec<usize>,
    rows: Vec<Row>,
    factor: Factor,
    /// Lower Cholesky factor of `S + α R Rᵀ`, column-major.
    cholesky: Vec<f64>,
    /// Orthonormal rigid motions `R` on the contact set.
    modes: Vec<Vec<f64>>,
    inverse: Vec<f64>,
    condition: f64,
    amplification: f64,
}

impl Body {
    /// Condenses. `rows` come with local numbers of degrees of freedom.
    ///
    /// # Errors
    /// [`Error::Indefinite`], [`Error::FloatingBody`], [`Error::Mechanism`],
    /// with the degree of freedom in the caller's numbering;
    /// [`Error::Memory`]; [`Error::Interrupted`].
    pub fn new(
        dofs: Vec<usize>,
        mut stiffness: Owned,
        mut rows: Vec<Row>,
        dimension: usize,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let kept = contact_set(&mut rows, dofs.len());
        let stiffest = stiffness.values.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
        let unit = times_two_to(1.0, -exponent(stiffest).clamp(-1000, 1000));
        stiffness.values.iter_mut().for_each(|a| *a *= unit);
        let view = stiffness.view()?;
        let symbolic = Symbolic::analyse(&view, &kept, &Options::default())?;
        let counts = symbolic.counts();
        let square = 8 * (kept.len() as u128).pow(2);
        memory::check("the factor of K", counts.bytes_peak as u128 + 2 * square)?;
        let factor =
            Factor::new(Arc::new(symbolic), &view, stop).map_err(|e| renumber(e, &dofs))?;
        let diagonal = view.diagonal();
        if let Some((dof, ratio)) = factor.weakest_pivot()
            && ratio < SAFE
            && softest_interior(&factor, &diagonal, &kept) <= NULL
        {
            return Err(Error::FloatingBody { dof: dofs[dof] });
        }
        let m = kept.len();
        let scale: Vec<f64> = kept
            .iter()
            .map(|&i| {
                if diagonal[i] > 0.0 {
                    diagonal[i].sqrt().recip()
                } else {
                    1.0
                }
            })
            .collect();
        let schur = factor.schur();
        let mut cholesky = schur.to_vec();
        let mut size = one_norm(schur, m);
        // Of a unit motion of the whole body, what independent roundings of the
        // entries make of the energy; a sum of sizes would doubt large bodies.
        let rounding = 8.0 * f64::EPSILON * norm(&stiffness.values);
        let pivots = |l: &[f64]| {
            (0..m).all(|i| {
                let doubt = SAFE.max(rounding * scale[i] * scale[i]);
                (l[i * (m + 1)] * scale[i]).powi(2) > doubt
            })
        };
        let definite = dense::cholesky(&mut cholesky, m, stop)?.is_none() && pivots(&cholesky);
        let mut modes = Vec::new();
        if !definite {
            #[expect(clippy::cast_precision_loss, reason = "a count")]
            let bound = NULL.max(8.0 * dofs.len() as f64 * f64::EPSILON);
            // A motion that is rigid where the body is stiff has its energy from
            // terms that cancel: that of the stiffest part bounds what is left.
            let rounding = |motion: &[f64]| {
                let mut whole = vec![0.0; dofs.len()];
                for (&i, x) in kept.iter().zip(motion) {
                    whole[i] = *x;
                }
                factor.recover(&mut whole, 1);
                for x in &mut whole {
                    *x = x.abs();
                }
                bound.max(8.0 * f64::EPSILON * stiffness.absolute_form(&whole))
            };
            modes = null_space(schur, &scale, &rounding, 2 * LIMIT[dimension], stop)?
                .ok_or_else(|| Error::Indefinite { dof: dofs[kept[0]] })?;
            if modes.len() > LIMIT[dimension] {
                return Err(Error::Mechanism {
                    dof: dofs[kept[0]],
                    found: modes.len(),
                    limit: LIMIT[dimension],
                });
            }
            cholesky = with_modes(schur, &modes);
            size = one_norm(&cholesky, m);
            if let Some(at) = dense::cholesky(&mut cholesky, m, stop)? {
                return Err(Error::Indefinite {
                    dof: dofs[kept[at]],
                });
            }
        }
        let mut inverse = vec![0.0; m * m];
        dense::inverse_from_cholesky(&cholesky, m, &mut inverse, stop)?;
        let flexible = one_norm(&inverse, m);
        let condition = size * flexible;
        let stiffest = kept.iter().map(|&i| diagonal[i]).fold(0.0, f64::max);
        let amplification = condition.max(stiffest * flexible);
        Ok(Self {
            dofs,
            stiffness,
            unit,
            kept,
            rows,
            factor,
            cholesky,
            modes,
            inverse,
            condition,
            amplification,
        })
    }

    #[must_use]
    pub fn kept(&self) -> usize {
        self.kept.len()
    }

    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Number of rigid motions that its supports leave free.
    #[must_use]
    pub fn motions(&self) -> usize {
        self.modes.len()
    }

    /// Condition number of `S + α R Rᵀ` in the 1-norm.
    #[must_use]
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// What the error of `W` may be, in ε: the condition, or more where `S` is a
    /// small difference of large entries of `K`, as with flat elements at the contact.
    #[must_use]
    pub fn amplification(&self) -> f64 {
        self.amplification
    }

    /// `(S + α R Rᵀ)⁻¹ / unit`, given away with that unit: it is needed once.
    pub fn take_inverse(&mut self) -> (Vec<f64>, f64) {
        (std::mem::take(&mut self.inverse), self.unit)
    }

    /// The degree of freedom that a rigid motion moves most.
    #[must_use]
    pub fn most_moved(&self, motion: usize) -> usize {
        let mode = &self.modes[motion];
        let most = (0..mode.len()).fold(0, |best, k| {
            if mode[k].abs() > mode[best].abs() {
                k
            } else {
                best
            }
        });
        self.dofs[self.kept[most]]
    }

    /// `v += amount B_c R_k`.
    pub fn add_motion(&self, motion: usize, amount: f64, v: &mut [f64]) {
        self.add_contact(&self.modes[motion], amount, v);
    }

    /// `v += B u` for this body's part of a displacement of all degrees of freedom.
    pub fn add_to_sums(&self, u: &[f64], v: &mut [Sum]) {
        for row in &self.rows {
            for &(k, b) in &row.entries {
                v[row.row].add_product(b, u[self.dofs[self.kept[k]]]);
            }
        }
    }

    fn add_contact(&self, u: &[f64], amount: f64, v: &mut [f64]) {
        for row in &self.rows {
            v[row.row] += amount * row.entries.iter().map(|&(k, b)| b * u[k]).sum::<f64>();
        }
    }

    /// Condenses this body's part of `force`, in its unit: interior unknowns as the
    /// factor leaves them, contact forces `f_c − K_ci K_ii⁻¹ f_i`.
    #[must_use]
    pub fn condense(&self, force: &[f64]) -> Vec<f64> {
        let mut local = self.scaled(force);
        self.factor.condense(&mut local, 1);
        local
    }

    /// This body's part of forces on all degrees of freedom, in its unit.
    fn scaled(&self, force: &[f64]) -> Vec<f64> {
        self.dofs.iter().map(|&i| self.unit * force[i]).collect()
    }

    fn contact_part(&self, local: &[f64]) -> Vec<f64> {
        self.kept.iter().map(|&i| local[i]).collect()
    }

    /// `e = Rᵀ f_c`.
    #[must_use]
    pub fn rigid_load(&self, condensed: &[f64]) -> Vec<f64> {
        let contact = self.contact_part(condensed);
        self.modes
            .iter()
            .map(|mode| {
                let work = dot_long(mode, &contact);
                let terms: f64 = mode.iter().zip(&contact).map(|(m, f)| (m * f).abs()).sum();
                // Loads that balance one another leave only their rounding.
                if work.abs() <= 16.0 * f64::EPSILON * terms {
                    0.0
                } else {
                    work / self.unit
                }
            })
            .collect()
    }

    /// `v += B_c (S + α R Rᵀ)⁻¹ (I − R Rᵀ) f_c`.
    pub fn add_free_displacement(&self, condensed: &[f64], v: &mut [f64]) {
        let mut u = self.contact_part(condensed);
        self.balance(&mut u);
        self.solve_contact(&mut u);
        self.add_contact(&u, 1.0, v);
    }

    /// `f ← (I − R Rᵀ) f`.
    fn balance(&self, f: &mut [f64]) {
        for mode in &self.modes {
            let along = dot_long(mode, f);
            for (value, m) in f.iter_mut().zip(mode) {
                *value -= along * m;
            }
        }
    }

    fn solve_contact(&self, f: &mut [f64]) {
        dense::solve_lower(&self.cholesky, self.kept.len(), f, 1);
        dense::solve_lower_transpose(&self.cholesky, self.kept.len(), f, 1);
    }

    /// Writes this body's displacement: free part, reactions, rigid motions, with
    /// what the factorisation's rounding leaves of `f + Bᵀ r − K u` taken out.
    pub fn displacement(&self, force: &[f64], reaction: &[f64], rigid: &[f64], out: &mut [f64]) {
        /// Corrections at the most.
        const MOST: usize = 8;
        let mut push = vec![0.0; self.kept.len()];
        for row in &self.rows {
            for &(k, b) in &row.entries {
                push[k] += b * self.unit * reaction[row.row];
            }
        }
        let mut force = self.scaled(force);
        let mut u = self.response(&force, Some(&push), rigid);
        for (&i, p) in self.kept.iter().zip(&push) {
            force[i] += p;
        }
        let mut last = f64::INFINITY;
        for _ in 0..MOST {
            let change = self.response(&self.stiffness.residual(&u, &force), None, &[]);
            let moved = norm(&change) / norm(&u).max(f64::MIN_POSITIVE);
            // Corrections that do not fall are rounding of the correction itself.
            if !(moved < 0.5 * last) {
                break;
            }
            for (value, change) in u.iter_mut().zip(change) {
                *value += change;
            }
            // What is left is the square of what was corrected.
            if moved * moved <= f64::EPSILON {
                break;
            }
            last = moved;
        }
        for (&i, value) in self.dofs.iter().zip(u) {
            out[i] = value;
        }
    }

    /// `u` of a force with its rigid part taken out, of reactions as they are
    /// (their rigid part is what `a` was found with), and of rigid motions.
    fn response(&self, force: &[f64], push: Option<&[f64]>, rigid: &[f64]) -> Vec<f64> {
        let mut local = force.to_vec();
        self.factor.condense(&mut local, 1);
        let mut contact = self.contact_part(&local);
        self.balance(&mut contact);
        for (value, p) in contact.iter_mut().zip(push.unwrap_or(&[])) {
            *value += p;
        }
        self.solve_contact(&mut contact);
        for (mode, amount) in self.modes.iter().zip(rigid) {
            for (value, m) in contact.iter_mut().zip(mode) {
                *value += amount * m;
            }
        }
        for (&i, value) in self.kept.iter().zip(contact) {
            local[i] = value;
        }
        self.factor.recover(&mut local, 1);
        local
    }

    /// What rounding may have made of `e`, a number each rigid motion.
    ///
    /// `K` itself is known to ε: a motion `d` that costs nothing is known to be one
    /// to the forces `ε |K||d|`, and these work on what the loads make of the body.
    #[must_use]
    pub fn load_rounding(&self, force: &[f64]) -> Vec<f64> {
        let nothing = vec![0.0; self.dofs.len()];
        let force = self.scaled(force);
        let mut forces: Vec<f64> = force.iter().map(|f| f.abs()).collect();
        let deformed = self.response(&force, None, &[]);
        self.stiffness.add_absolute_product(&deformed, &mut forces);
        let of_motion = |k: usize| {
            let mut amounts = vec![0.0; self.modes.len()];
            amounts[k] = 1.0;
            let motion = self.response(&nothing, None, &amounts);
            let work = motion.iter().zip(&forces).map(|(d, f)| (d * f).abs());
            16.0 * f64::EPSILON * work.sum::<f64>() / self.unit
        };
        (0..self.modes.len()).map(of_motion).collect()
    }

    /// Adds this body's counts.
    pub fn add_to(&self, stats: &mut Stats) {
        let counts = self.factor.symbolic().counts();
        stats.nnz_factor += counts.nnz_factor;
        stats.flops += counts.flops;
        stats.bytes_factor += counts.bytes_factor;
        stats.bytes_peak += counts.bytes_peak + 24 * self.kept.len().pow(2);
        stats.contact_dofs += self.kept.len();
        stats.seconds_order += counts.seconds_order;
        stats.seconds_symbolic += counts.seconds_symbolic;
        if stats.ordering.is_empty() {
            stats.ordering = counts.ordering;
        }
    }
}

/// `S + α R Rᵀ`, `α = tr S / m`.
fn with_modes(schur: &[f64], modes: &[Vec<f64>]) -> Vec<f64> {
    let mut sum = schur.to_vec();
    let Some(m) = modes.first().map(Vec::len) else {
        return sum;
    };
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let mean = (0..m).map(|i| schur[i * (m + 1)]).sum::<f64>() / m as f64;
    let alpha = if mean > 0.0 { mean } else { 1.0 };
    for mode in modes {
        for (column, a) in sum.chunks_exact_mut(m).zip(mode) {
            for (value, b) in column.iter_mut().zip(mode) {
                *value += alpha * a * b;
            }
        }
    }
    sum
}

/// Rigid motions that a body in `d` dimensions can have.
const LIMIT: [usize; 4] = [0, 1, 3, 6];

/// Degrees of freedom that the rows touch, in the order they are met; the rows
/// are given places in that list.
fn contact_set(rows: &mut [Row], order: usize) -> Vec<usize> {
    let mut place = vec![usize::MAX; order];
    let mut kept = Vec::new();
    for (dof, _) in rows.iter_mut().flat_map(|row| &mut row.entries) {
        if place[*dof] == usize::MAX {
            place[*dof] = kept.len();
            kept.push(*dof);
        }
        *dof = place[*dof];
    }
    kept
}

fn renumber(error: Error, dofs: &[usize]) -> Error {
    match error {
        Error::Indefinite { dof } => Error::Indefinite { dof: dofs[dof] },
        Error::FloatingBody { dof } => Error::FloatingBody { dof: dofs[dof] },
        other => other,
    }
}

fn one_norm(a: &[f64], m: usize) -> f64 {
    a.chunks_exact(m.max(1))
        .map(|c| c.iter().map(|x| x.abs()).sum())
        .fold(0.0, f64::max)
}

/// Smallest Rayleigh quotient of `K_ii`, relative to its diagonal, that inverse
/// iteration finds.
fn softest_interior(factor: &Factor, diagonal: &[f64], kept: &[usize]) -> f64 {
    let mut x: Vec<f64> = (0..diagonal.len()).map(start_value).collect();
    let mut quotient = f64::INFINITY;
    for _ in 0..4 {
        for &i in kept {
            x[i] = 0.0;
        }
        let weighted: Vec<f64> = x.iter().zip(diagonal).map(|(x, d)| x * d).collect();
        let mut y = weighted.clone();
        factor.condense(&mut y, 1);
        for &i in kept {
            y[i] = 0.0;
        }
        factor.recover(&mut y, 1);
        // With K y = D x: yᵀ K y / yᵀ D y = yᵀ D x / yᵀ D y.
        let energy = dot_long(&y, &weighted);
        let size: f64 = y.iter().zip(diagonal).map(|(y, d)| y * y * d).sum();
        if !size.is_finite() || size == 0.0 {
            return 0.0;
        }
        quotient = quotient.min(energy / size);
        let length = size.sqrt();
        x = y.iter().map(|y| y / length).collect();
    }
    quotient
}
