//! One body: a connected component of the free stiffness, condensed.

use std::sync::Arc;

use rayon::prelude::*;

use crate::condensation::rigid_motions::Geometry;
use crate::condensation::sparse::OwnedMatrix;
use crate::error::Error;
use crate::linalg::compensated::{self, Sum};
use crate::linalg::dense;
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{dot_long, norm};
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::{Counts, Symbolic};

/// Where `W` may be off by more than so many ε it has lost the digits that the judge
/// asks for: steps are then taken with `v` from `K`.
pub const DIGITS: f64 = 1e5;

/// Columns that pass the factor together, always so many: products of other widths may
/// add in another order, and a step would not have the bits it has alone.
const GROUP: usize = 4;

/// Rows of `f + Bᵀ r − K u` above so many ε of their terms are not in balance: the
/// rounding of u leaves half of one, a solve that came to a stand a few.
const BALANCED: f64 = 32.0;

/// The same of all rows together, relative to the forces: above it no digit of what
/// `K` makes of `u` is right, however small the rounding of its terms is.
const NO_DIGITS: f64 = 0.1;

/// Displacements, and how far they are from equilibrium.
#[derive(Debug)]
pub struct Recovered {
    /// A column each step.
    pub u: Vec<f64>,
    /// What rounding has cut off from `u`, where `K` amplifies it; zero elsewhere.
    pub low: Vec<f64>,
    /// One a step.
    pub left: Vec<Imbalance>,
}

/// What is left of `f + Bᵀ r − K u`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Imbalance {
    /// The largest of a row, relative to `|K||u| + |f + Bᵀ r|` of that row.
    pub by_row: f64,
    /// The degree of freedom of that row, in the caller's numbering.
    pub dof: usize,
    /// `‖f + Bᵀ r − K u‖` over `‖f + Bᵀ r‖`.
    pub of_forces: f64,
}

impl Imbalance {
    /// Whether rounding of the terms explains it.
    ///
    /// # Errors
    /// [`Error::NotBalanced`].
    pub fn check(&self) -> Result<(), Error> {
        // Written so that a NaN fails.
        if self.by_row <= BALANCED * f64::EPSILON && self.of_forces <= NO_DIGITS {
            return Ok(());
        }
        Err(Error::NotBalanced {
            dof: self.dof,
            by_row: self.by_row,
            of_forces: self.of_forces,
        })
    }
}

/// One body.
#[derive(Debug)]
pub struct Body {
    /// Its degrees of freedom in the caller's numbering.
    pub(super) dofs: Vec<usize>,
    /// `unit K`.
    pub(super) stiffness: OwnedMatrix,
    /// A power of two that makes the stiffness of order one: square roots of
    /// pivots then round alike in all units that differ by powers of two.
    pub(super) unit: f64,
    /// The unknowns that `S` is left on, local numbers.
    pub(super) kept: Vec<usize>,
    /// Place among the kept of each degree of freedom; `u32::MAX` of the others.
    pub(super) place: Vec<u32>,
    /// Where its degrees of freedom are in space, where that is known.
    pub(super) places: Option<Vec<[f64; 3]>>,
    /// What the places of all degrees of freedom say of rigid motions.
    pub(super) geometry: Option<Arc<Geometry>>,
    pub(super) symbolic: Arc<Symbolic>,
    /// Whether it had to be ordered.
    pub(super) ordered: bool,
    /// Dropped where all loads were known beforehand.
    pub(super) factor: Option<Factor>,
    /// The kept part of those loads, condensed.
    pub(super) known: Vec<Vec<f64>>,
    /// Lower Cholesky factor of `S + α R Rᵀ`, column-major.
    pub(super) cholesky: Vec<f64>,
    /// Orthonormal rigid motions `R` on the contact set.
    pub(super) modes: Vec<Vec<f64>>,
    /// The same motions of all its degrees of freedom, `Z`.
    pub(super) motions: Vec<Vec<f64>>,
    pub(super) inverse: Vec<f64>,
    pub(super) condition: f64,
    pub(super) amplification: f64,
    /// Seconds until S, and from S on.
    pub(super) seconds: [f64; 2],
}

impl Body {
    /// Number of unknowns that `S` is left on.
    #[must_use]
    pub fn kept(&self) -> usize {
        self.kept.len()
    }

    /// Place among the kept unknowns of a local degree of freedom.
    #[must_use]
    pub fn place(&self, dof: usize) -> Option<usize> {
        let place = self.place[dof];
        (place != u32::MAX).then_some(place as usize)
    }

    /// Its degrees of freedom in the caller's numbering.
    #[must_use]
    pub fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    /// The power of two that its stiffness is multiplied by.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// The largest stiffness on the diagonal of K at some local degrees of freedom.
    #[must_use]
    pub fn stiffest(&self, dofs: impl Iterator<Item = usize>) -> f64 {
        let of = |i| self.stiffness.diagonal(i) / self.unit;
        dofs.map(of).fold(0.0, f64::max)
    }

    /// The factor, unless it was dropped.
    #[must_use]
    pub fn factor(&self) -> Option<&Factor> {
        self.factor.as_ref()
    }

    /// A rigid motion of all its degrees of freedom.
    #[must_use]
    pub fn motion(&self, motion: usize) -> &[f64] {
        &self.motions[motion]
    }

    /// Seconds until S, and from S on.
    #[must_use]
    pub fn seconds(&self) -> [f64; 2] {
        self.seconds
    }

    /// What the factorisation cost.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.symbolic.counts()
    }

    /// Whether it had to be ordered: no analysis of its pattern was at hand.
    #[must_use]
    pub fn ordered(&self) -> bool {
        self.ordered
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
    /// small difference of large entries of `K`, as with flat elements at the contact,
    /// or where the interior rests on much softer parts of itself.
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

    /// Amounts of its rigid motions in a rigid displacement of all degrees of freedom.
    #[must_use]
    pub fn motion_amounts(&self, u: &[f64]) -> Vec<f64> {
        let kept: Vec<f64> = self.kept.iter().map(|&i| u[self.dofs[i]]).collect();
        let modes = self.modes.iter();
        modes.map(|mode| dot_long(mode, &kept)).collect()
    }

    /// Condenses this body's part of a force, in its unit: interior unknowns as the
    /// factor leaves them, contact forces `f_c − K_ci K_ii⁻¹ f_i`. Where the factor
    /// was dropped, the latter of a force with its number among those known beforehand.
    #[must_use]
    pub fn condense(&self, force: &[f64], known: Option<usize>) -> Vec<f64> {
        let mut local = self.scaled(force);
        match (&self.factor, known) {
            (Some(factor), _) => factor.condense(&mut local, 1),
            (None, known) => {
                let known = known.map_or(&[][..], |k| &self.known[k]);
                for (&i, value) in self.kept.iter().zip(known) {
                    local[i] = *value;
                }
            }
        }
        local
    }

    /// This body's part of forces on all degrees of freedom, in its unit.
    fn scaled(&self, force: &[f64]) -> Vec<f64> {
        self.dofs.iter().map(|&i| self.unit * force[i]).collect()
    }

    fn contact_part(&self, local: &[f64]) -> Vec<f64> {
        self.kept.iter().map(|&i| local[i]).collect()
    }

    /// `e = Zᵀ f` of a load on all degrees of freedom, which is `Rᵀ f_c` since `K Z = 0`,
    /// without the rounding of a soft interior. Prescribed displacements do not work on
    /// rigid motions.
    #[must_use]
    pub fn rigid_load(&self, load: &[f64]) -> Vec<f64> {
        if self.motions.is_empty() {
            return Vec::new();
        }
        let own: Vec<f64> = self.dofs.iter().map(|&i| load[i]).collect();
        let of_motion = |motion: &Vec<f64>| {
            let work = compensated::dot(motion, &own).value();
            let terms: f64 = motion.iter().zip(&own).map(|(m, f)| (m * f).abs()).sum();
            // Loads that balance one another leave only their rounding.
            if work.abs() <= 16.0 * f64::EPSILON * terms {
                0.0
            } else {
                work
            }
        };
        self.motions.iter().map(of_motion).collect()
    }

    /// `(S + α R Rᵀ)⁻¹ (I − R Rᵀ) f_c`.
    #[must_use]
    pub fn free_displacement(&self, condensed: &[f64]) -> Vec<f64> {
        let mut u = self.contact_part(condensed);
        self.balance(&mut u);
        self.solve_contact(&mut u, 1);
        u
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

    fn solve_contact(&self, f: &mut [f64], columns: usize) {
        dense::solve_lower(&self.cholesky, self.kept.len(), f, columns);
        dense::solve_lower_transpose(&self.cholesky, self.kept.len(), f, columns);
    }

    /// `f ← L⁻¹ f` for columns of forces on the kept unknowns, `L Lᵀ = S + α R Rᵀ`.
    pub fn half_solve_contact(&self, f: &mut [f64], columns: usize) {
        dense::solve_lower(&self.cholesky, self.kept.len(), f, columns);
    }

    /// This body's displacements, a column each step: free part, reactions, rigid
    /// motions, with what the factorisation's rounding leaves of `f + Bᵀ r − K u`
    /// taken out. `pushes` are `unit Bᵀ r` at the local degrees of freedom.
    ///
    /// # Errors
    /// [`Error::FactorDropped`].
    pub fn displacements(
        &self,
        forces: &[&[f64]],
        pushes: &[f64],
        rigid: &[&[f64]],
    ) -> Result<Recovered, Error> {
        /// Corrections at the most.
        const MOST: usize = 30;
        /// Beside the largest displacement those of contacts may be so much smaller.
        const FINE: f64 = 1e-8;
        let (n, count) = (self.dofs.len(), rigid.len());
        let factor = self.factor.as_ref().ok_or(Error::FactorDropped)?;
        let mut forces: Vec<f64> = forces.iter().flat_map(|f| self.scaled(f)).collect();
        let mut u = self.response(factor, &forces, Some(pushes), rigid);
        for (f, p) in forces.iter_mut().zip(pushes) {
            *f += p;
        }
        // Where contacts hardly move beside the rest of a slender body, the rounding of
        // its displacements is much of theirs.
        let fine = self.amplification > DIGITS;
        let mut low = vec![0.0; u.len()];
        let column = |k: usize| k * n..(k + 1) * n;
        let mut left = vec![Imbalance::default(); count];
        let mut last = vec![f64::INFINITY; count];
        // Columns that are done take no further part.
        let mut open: Vec<usize> = (0..count).filter(|_| n > 0).collect();
        for _ in 0..=MOST {
            let imbalance = |&k: &usize| {
                let low = fine.then(|| &low[column(k)]);
                self.left(&u[column(k)], low, &forces[column(k)])
            };
            let found: Vec<(Vec<f64>, Imbalance)> = open.par_iter().map(imbalance).collect();
            let mut rest = Vec::new();
            for (&k, (own, left_of_k)) in open.iter().zip(found) {
                left[k] = left_of_k;
                if last[k] > 0.0 {
                    rest.extend(own);
                }
            }
            open.retain(|&k| last[k] > 0.0);
            if open.is_empty() {
                break;
            }
            let changes = self.response(factor, &rest, None, &vec![&[][..]; open.len()]);
            for (change, &k) in changes.chunks_exact(n).zip(&open) {
                let moved = norm(change) / norm(&u[column(k)]).max(f64::MIN_POSITIVE);
                // Corrections that do not fall are rounding of the correction itself.
                if !(moved < 0.5 * last[k]) {
                    last[k] = 0.0;
                    continue;
                }
                let values = u[column(k)].iter_mut().zip(&mut low[column(k)]);
                for ((value, low), change) in values.zip(change) {
                    if fine {
                        let mut sum = Sum::new(*value);
                        sum.add(*low + change);
                        *value = sum.value();
                        sum.add(-*value);
                        *low = sum.value();
                    } else {
                        *value += change;
                    }
                }
                // What is left is the square of what was corrected.
                let enough = if fine {
                    moved <= FINE * f64::EPSILON
                } else {
                    moved * moved <= f64::EPSILON
                };
                last[k] = if enough { 0.0 } else { moved };
            }
        }
        Ok(Recovered { u, low, left })
    }

    /// `f − K u` without its rigid part, which contact has balanced as well as it is
    /// asked to, and what it comes to.
    fn left(&self, u: &[f64], low: Option<&[f64]>, force: &[f64]) -> (Vec<f64>, Imbalance) {
        let (mut rest, size) = self.stiffness.residual_and_size(u, low, force);
        let work: Vec<f64> = self.motions.iter().map(|z| dot_long(z, &rest)).collect();
        for (mode, work) in self.modes.iter().zip(&work) {
            for (&i, m) in self.kept.iter().zip(mode) {
                rest[i] -= work * m;
            }
        }
        let of_row = |(rest, size): (&f64, &f64)| {
            if *rest == 0.0 { 0.0 } else { rest.abs() / size }
        };
        let rows = rest.iter().zip(&size).map(of_row).enumerate();
        let (row, by_row) = rows.fold((0, 0.0), |worst, row| {
            if row.1 > worst.1 || row.1.is_nan() {
                row
            } else {
                worst
            }
        });
        let forces = norm(force);
        let left = Imbalance {
            by_row,
            dof: self.dofs[row],
            of_forces: if forces > 0.0 {
                norm(&rest) / forces
            } else {
                0.0
            },
        };
        (rest, left)
    }

    /// `u` of forces with their rigid part taken out, of reactions as they are
    /// (their rigid part is what `a` was found with), and of rigid motions; a
    /// column each, to the bits that it has alone.
    fn response(
        &self,
        factor: &Factor,
        forces: &[f64],
        pushes: Option<&[f64]>,
        rigid: &[&[f64]],
    ) -> Vec<f64> {
        let n = self.dofs.len();
        let mut all = Vec::with_capacity(forces.len());
        for (k, rigid) in rigid.chunks(GROUP).enumerate() {
            let own = k * GROUP * n..(k * GROUP + rigid.len()) * n;
            let filled = |columns: &[f64]| {
                let mut group = vec![0.0; n * GROUP];
                group[..own.len()].copy_from_slice(&columns[own.clone()]);
                group
            };
            let pushes = pushes.map(filled);
            let mut u = self.response_of_group(factor, filled(forces), pushes, rigid);
            u.truncate(own.len());
            all.extend(u);
        }
        all
    }

    fn response_of_group(
        &self,
        factor: &Factor,
        mut local: Vec<f64>,
        pushes: Option<Vec<f64>>,
        rigid: &[&[f64]],
    ) -> Vec<f64> {
        let (n, m, columns) = (self.dofs.len(), self.kept.len(), GROUP);
        factor.condense(&mut local, columns);
        let part = |local: &[f64]| -> Vec<f64> {
            let columns = local.chunks_exact(n.max(1));
            columns.flat_map(|x| self.contact_part(x)).collect()
        };
        let mut contact = part(&local);
        contact
            .chunks_exact_mut(m.max(1))
            .for_each(|f| self.balance(f));
        if let Some(mut pushed) = pushes {
            let inside = |(k, &p): (usize, &f64)| p != 0.0 && self.place[k % n] == u32::MAX;
            if pushed.iter().enumerate().any(inside) {
                factor.condense(&mut pushed, columns);
                for (k, (value, p)) in local.iter_mut().zip(pushed.iter()).enumerate() {
                    if self.place[k % n] == u32::MAX {
                        *value += p;
                    }
                }
            }
            for (value, p) in contact.iter_mut().zip(part(&pushed)) {
                *value += p;
            }
        }
        self.solve_contact(&mut contact, columns);
        for (local, contact) in local
            .chunks_exact_mut(n.max(1))
            .zip(contact.chunks_exact(m.max(1)))
        {
            for (&i, value) in self.kept.iter().zip(contact) {
                local[i] = *value;
            }
        }
        factor.recover(&mut local, columns);
        for (local, amounts) in local.chunks_exact_mut(n.max(1)).zip(rigid) {
            for (motion, amount) in self.motions.iter().zip(*amounts) {
                for (value, z) in local.iter_mut().zip(motion) {
                    *value += amount * z;
                }
            }
        }
        local
    }

    /// What the rounding of the entries of `K` may have made of this body's part of a
    /// displacement: `K⁻¹ δK u`, its rigid part taken out, the largest of four samples.
    ///
    /// In three of them a row of `δK u` is `2 ε √(Σ_j (K_ij u_j)²)` with a random sign, as
    /// independent roundings of sums of elements add up. In the fourth it is a quarter of
    /// that along `u`: equal elements in a row are rounded alike, and their errors do not
    /// cancel.
    ///
    /// # Errors
    /// [`Error::FactorDropped`].
    pub fn stiffness_rounding(&self, u: &[f64]) -> Result<Vec<f64>, Error> {
        let factor = self.factor.as_ref().ok_or(Error::FactorDropped)?;
        let own: Vec<f64> = self.dofs.iter().map(|&i| u[i]).collect();
        let size = |i: usize| {
            let terms = self.stiffness.entries(i);
            let squares: f64 = terms.map(|(j, k)| (k * own[j]).powi(2)).sum();
            2.0 * f64::EPSILON * squares.sqrt()
        };
        let sizes: Vec<f64> = (0..own.len()).map(size).collect();
        let mut forces = Vec::with_capacity(GROUP * own.len());
        for seed in 1..GROUP as u64 {
            let signs = random_signs(own.len(), seed).into_iter();
            forces.extend(signs.zip(&sizes).map(|(sign, size)| sign * size));
        }
        let along = own.iter().zip(&sizes);
        forces.extend(along.map(|(u, size)| 0.25 * size * u.signum()));
        let samples = self.response(factor, &forces, None, &[&[][..]; GROUP]);
        let samples = samples.chunks_exact(own.len().max(1));
        let largest = samples.max_by(|a, b| norm(a).total_cmp(&norm(b)));
        Ok(largest.map_or_else(Vec::new, <[f64]>::to_vec))
    }

    /// What rounding may have made of `e`, a number each rigid motion.
    ///
    /// `K` itself is known to ε: a motion `d` that costs nothing is known to be one
    /// to the forces `ε |K||d|`, and these work on what the loads make of the body.
    ///
    /// # Errors
    /// [`Error::FactorDropped`].
    pub fn load_rounding(&self, force: &[f64]) -> Result<Vec<f64>, Error> {
        if self.modes.is_empty() {
            return Ok(Vec::new());
        }
        let factor = self.factor.as_ref().ok_or(Error::FactorDropped)?;
        let force = self.scaled(force);
        let mut forces: Vec<f64> = force.iter().map(|f| f.abs()).collect();
        let deformed = self.response(factor, &force, None, &[&[]]);
        self.stiffness.add_absolute_product(&deformed, &mut forces);
        let of_motion = |motion: &Vec<f64>| {
            let work = motion.iter().zip(&forces).map(|(d, f)| (d * f).abs());
            16.0 * f64::EPSILON * work.sum::<f64>() / self.unit
        };
        Ok(self.motions.iter().map(of_motion).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::{BALANCED, Imbalance, NO_DIGITS};
    use crate::error::Error;

    #[test]
    fn what_rounding_explains_passes_and_nothing_else() {
        let passes = |by_row: f64, of_forces: f64| {
            let left = Imbalance {
                by_row,
                dof: 7,
                of_forces,
            };
            match left.check() {
                Ok(()) => true,
                Err(Error::NotBalanced { dof: 7, .. }) => false,
                Err(other) => panic!("{other}"),
            }
        };
        let most = BALANCED * f64::EPSILON;
        assert!(passes(0.0, 0.0) && passes(most, NO_DIGITS));
        assert!(!passes(2.0 * most, 0.0) && !passes(0.0, 2.0 * NO_DIGITS));
        assert!(!passes(f64::NAN, 0.0) && !passes(0.0, f64::NAN));
    }
}
