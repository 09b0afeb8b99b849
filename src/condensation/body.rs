//! One condensed body: a connected component of the free part of the stiffness.

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

/// If the error of `W` may exceed this many ε, it has lost the digits that the certificate
/// needs: steps then use `v` from `K`.
pub const DIGITS: f64 = 1e5;

/// Columns solved together, always this number: products of other widths may add in another
/// order, and a step would not have the same bits as alone.
const GROUP: usize = 4;

/// A row of `f + Bᵀ r − K u` above this many ε of its terms is not in balance. The rounding of
/// u leaves half an ε, a stalled solve a few.
const BALANCED: f64 = 32.0;

/// The same for all rows together, relative to the forces: above it no digit of `K u` is
/// correct, for any rounding of its terms.
const NO_DIGITS: f64 = 0.1;

/// Displacements and their distance from equilibrium.
#[derive(Debug)]
pub struct Recovered {
    /// One column for each step.
    pub u: Vec<f64>,
    /// The digits of `u` below its rounding, if `K` amplifies them; otherwise zero.
    pub low: Vec<f64>,
    /// One for each step.
    pub left: Vec<Imbalance>,
}

/// The imbalance `f + Bᵀ r − K u`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Imbalance {
    /// The largest of all rows, each relative to its `|K||u| + |f + Bᵀ r|`.
    pub by_row: f64,
    /// The degree of freedom of this row, in the numbering of the caller.
    pub dof: usize,
    /// `‖f + Bᵀ r − K u‖` over `‖f + Bᵀ r‖`.
    pub of_forces: f64,
}

impl Imbalance {
    /// Whether it is explained by the rounding of the terms.
    ///
    /// # Errors
    /// [`Error::NotBalanced`].
    pub fn check(&self) -> Result<(), Error> {
        // Written such that a NaN fails.
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
    /// Its degrees of freedom in the numbering of the caller.
    pub(super) dofs: Vec<usize>,
    /// `unit K`.
    pub(super) stiffness: OwnedMatrix,
    /// A power of two that makes the stiffness of order one: square roots of pivots then round
    /// equally in all units that differ by powers of two.
    pub(super) unit: f64,
    /// The unknowns of `S`, as local numbers.
    pub(super) kept: Vec<usize>,
    /// Index among the kept unknowns of each degree of freedom; `u32::MAX` for others.
    pub(super) place: Vec<u32>,
    /// The positions of its degrees of freedom in space, if known.
    pub(super) places: Option<Vec<[f64; 3]>>,
    /// The geometry of all degrees of freedom, from which rigid motions follow.
    pub(super) geometry: Option<Arc<Geometry>>,
    pub(super) symbolic: Arc<Symbolic>,
    /// Whether it was ordered.
    pub(super) ordered: bool,
    /// `None` if all loads were given in advance.
    pub(super) factor: Option<Factor>,
    /// The kept part of these loads, condensed.
    pub(super) known: Vec<Vec<f64>>,
    /// Lower Cholesky factor of `S + α R Rᵀ`, column-major.
    pub(super) cholesky: Vec<f64>,
    /// Orthonormal rigid motions `R` on the contact set.
    pub(super) modes: Vec<Vec<f64>>,
    /// The same motions on all its degrees of freedom, `Z`.
    pub(super) motions: Vec<Vec<f64>>,
    pub(super) inverse: Vec<f64>,
    pub(super) condition: f64,
    pub(super) amplification: f64,
    /// Seconds until S, and after it.
    pub(super) seconds: [f64; 2],
}

impl Body {
    /// Number of unknowns of `S`.
    #[must_use]
    pub fn kept(&self) -> usize {
        self.kept.len()
    }

    /// Index among the kept unknowns of a local degree of freedom.
    #[must_use]
    pub fn place(&self, dof: usize) -> Option<usize> {
        let place = self.place[dof];
        (place != u32::MAX).then_some(place as usize)
    }

    /// Its degrees of freedom in the numbering of the caller.
    #[must_use]
    pub fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    /// The power of two by which its stiffness is multiplied.
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

    /// Seconds until S, and after it.
    #[must_use]
    pub fn seconds(&self) -> [f64; 2] {
        self.seconds
    }

    /// The cost of the factorisation.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.symbolic.counts()
    }

    /// Whether it was ordered, because no analysis of its pattern was known.
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

    /// Bound of the error of `W`, in ε: the condition number, or more if `S` is a small
    /// difference of large entries of `K`, as for flat elements at the contact, or if the
    /// interior rests on much softer parts.
    #[must_use]
    pub fn amplification(&self) -> f64 {
        self.amplification
    }

    /// `(S + α R Rᵀ)⁻¹ / unit`, moved out with this unit: it is needed once.
    pub fn take_inverse(&mut self) -> (Vec<f64>, f64) {
        (std::mem::take(&mut self.inverse), self.unit)
    }

    /// The degree of freedom with the largest displacement in a rigid motion.
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

    /// Condenses the part of a force on this body, in its unit: interior unknowns after the
    /// forward solve, contact forces `f_c − K_ci K_ii⁻¹ f_i`. Without the factor, the latter
    /// for a force with its number among those given in advance.
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

    /// The part of forces on all degrees of freedom on this body, in its unit.
    fn scaled(&self, force: &[f64]) -> Vec<f64> {
        self.dofs.iter().map(|&i| self.unit * force[i]).collect()
    }

    fn contact_part(&self, local: &[f64]) -> Vec<f64> {
        self.kept.iter().map(|&i| local[i]).collect()
    }

    /// `e = Zᵀ f` of a load on all degrees of freedom. It is equal to `Rᵀ f_c`, because
    /// `K Z = 0`, without the rounding of a soft interior. Prescribed displacements do no work
    /// on rigid motions.
    #[must_use]
    pub fn rigid_load(&self, load: &[f64]) -> Vec<f64> {
        if self.motions.is_empty() {
            return Vec::new();
        }
        let own: Vec<f64> = self.dofs.iter().map(|&i| load[i]).collect();
        let of_motion = |motion: &Vec<f64>| {
            let work = compensated::dot(motion, &own).value();
            let terms: f64 = motion.iter().zip(&own).map(|(m, f)| (m * f).abs()).sum();
            // Loads that balance each other leave only rounding.
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

    /// The displacements of this body, one column for each step: free part, reactions and rigid
    /// motions, after refinement with `f + Bᵀ r − K u`. `pushes` are `unit Bᵀ r` at the local
    /// degrees of freedom.
    ///
    /// # Errors
    /// [`Error::FactorDropped`].
    pub fn displacements(
        &self,
        forces: &[&[f64]],
        pushes: &[f64],
        rigid: &[&[f64]],
    ) -> Result<Recovered, Error> {
        /// Largest number of corrections.
        const MOST: usize = 30;
        /// Displacements of contacts may be this much smaller than the largest one.
        const FINE: f64 = 1e-8;
        let (n, count) = (self.dofs.len(), rigid.len());
        let factor = self.factor.as_ref().ok_or(Error::FactorDropped)?;
        let mut forces: Vec<f64> = forces.iter().flat_map(|f| self.scaled(f)).collect();
        let mut u = self.response(factor, &forces, Some(pushes), rigid);
        for (f, p) in forces.iter_mut().zip(pushes) {
            *f += p;
        }
        // If contacts of a slender body hardly move, the rounding of its displacements is large
        // relative to theirs.
        let fine = self.amplification > DIGITS;
        let mut low = vec![0.0; u.len()];
        let column = |k: usize| k * n..(k + 1) * n;
        let mut left = vec![Imbalance::default(); count];
        let mut last = vec![f64::INFINITY; count];
        // Finished columns are left out.
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
                // Corrections that do not decrease are rounding of the correction itself.
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
                // The remaining error is the square of the correction.
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

    /// The same without refinement, if K does not amplify the rounding of its factor.
    ///
    /// # Errors
    /// [`Error::FactorDropped`].
    pub fn changes(
        &self,
        forces: &[&[f64]],
        pushes: &[f64],
        rigid: &[&[f64]],
    ) -> Result<Recovered, Error> {
        if self.amplification > DIGITS {
            return self.displacements(forces, pushes, rigid);
        }
        let factor = self.factor.as_ref().ok_or(Error::FactorDropped)?;
        let forces: Vec<f64> = forces.iter().flat_map(|f| self.scaled(f)).collect();
        Ok(Recovered {
            u: self.response(factor, &forces, Some(pushes), rigid),
            low: Vec::new(),
            left: Vec::new(),
        })
    }

    /// `f − K u` without its rigid part, which contact balances up to the tolerance, and its
    /// size.
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

    /// `u` of forces without their rigid part, of reactions as they are (`a` was found with
    /// their rigid part), and of rigid motions; one column each, with the same bits as alone.
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

    /// The change of the displacement of this body by the rounding of the entries of `K`:
    /// `K⁻¹ δK u` without its rigid part, the largest of four samples.
    ///
    /// In three samples a row of `δK u` is `2 ε √(Σ_j (K_ij u_j)²)` with a random sign, because
    /// independent roundings of sums of elements add up in this way. In the fourth it is a
    /// quarter of this along `u`: equal elements in a row are rounded equally, and their errors
    /// do not cancel.
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

    /// The rounding error of `e`, one number for each rigid motion.
    ///
    /// `K` has an error of ε. So a motion `d` without energy is known up to the forces
    /// `ε |K||d|`, which do work on the displacement of the body under the loads.
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
