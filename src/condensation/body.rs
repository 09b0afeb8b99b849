//! One condensed body: a connected component of the free part of the stiffness.

use std::time::Instant;

use rayon::prelude::*;

use crate::condensation::contact_stiffness::ContactStiffness;
use crate::condensation::ordered::OrderedBody;
use crate::condensation::tuning;
use crate::error::Error;
use crate::linalg::compensated::{self, Sum};
use crate::linalg::dense;
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{add_scaled, amax, dot_long, norm, place_of_largest, take_out};
use crate::linalg::sparse::multifrontal::Factor;

/// If the error of `W` may exceed this many ε, it has lost the digits that the certificate
/// needs: steps then use `v` from `K`.
pub const DIGITS: f64 = 1e5;

/// Columns solved together, always this number: products of other widths may add in another
/// order, and a step would not have the same bits as alone.
const GROUP: usize = 4;

/// A row of `f + Bᵀ r − K u` above this many ε of its terms is not in balance. The rounding of
/// u leaves half an ε, a stalled solve a few.
const BALANCED: f64 = 32.0;

/// `‖f + Bᵀ r − K u‖` over the forces: above this no digit of `K u` is correct, for any rounding
/// of its terms. Forces count as at least the rounding of what cancels
/// in them: reactions may carry the loads of their own nodes, and nothing else is left.
const NO_DIGITS: f64 = 0.1;
const CANCELLED: f64 = BALANCED * f64::EPSILON / NO_DIGITS;

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
    /// `‖f + Bᵀ r − K u‖` over `‖f + Bᵀ r‖`, or over its rounding if that is larger.
    pub of_forces: f64,
}

impl Imbalance {
    /// Whether it is explained by the rounding of the terms.
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

/// A sample of what the rounding of the entries of `K` changes.
#[derive(Clone, Debug)]
pub struct RoundingSample {
    /// On all degrees of freedom of the body.
    pub displacement: Vec<f64>,
    /// On its rigid motions.
    pub work: Vec<f64>,
}

/// Sets work within its rounding error to zero; returns whether any of it changed.
pub fn drop_rounding(work: &mut [f64], rounding: &[f64]) -> bool {
    let mut dropped = false;
    for (work, error) in work.iter_mut().zip(rounding) {
        if *work != 0.0 && work.abs() <= *error {
            *work = 0.0;
            dropped = true;
        }
    }
    dropped
}

/// The eliminated unknowns of a body.
#[derive(Debug)]
pub enum Interior {
    Factored(Factor),
    /// All loads were given in advance: their kept parts, condensed.
    OfKnownLoads(Vec<Vec<f64>>),
}

/// A body, condensed onto its kept unknowns.
#[derive(Debug)]
pub struct Body {
    ordered: OrderedBody,
    /// Index among the kept unknowns of each degree of freedom; `u32::MAX` for others.
    place: Vec<u32>,
    pub(super) contact: ContactStiffness,
    interior: Interior,
    /// Seconds until S, and after it.
    pub(super) seconds: [f64; 2],
}

impl Body {
    /// Takes the time at which its condensation began, and that at which S was made.
    pub(super) fn new(
        ordered: OrderedBody,
        contact: ContactStiffness,
        interior: Interior,
        [begin, until_s]: [Instant; 2],
    ) -> Self {
        let mut place = vec![u32::MAX; ordered.dofs.len()];
        for (k, &i) in (0_u32..).zip(&ordered.kept) {
            place[i] = k;
        }
        Self {
            ordered,
            place,
            contact,
            interior,
            seconds: [until_s - begin, until_s.elapsed()].map(|time| time.as_secs_f64()),
        }
    }

    /// What it was before its factorisation.
    pub fn ordered(&self) -> &OrderedBody {
        &self.ordered
    }

    /// Number of unknowns of `S`.
    pub fn kept(&self) -> usize {
        self.ordered.kept.len()
    }

    /// Index among the kept unknowns of a local degree of freedom.
    pub fn place(&self, dof: usize) -> Option<usize> {
        let place = self.place[dof];
        (place != u32::MAX).then_some(place as usize)
    }

    /// Its degrees of freedom in the numbering of the caller.
    pub fn dofs(&self) -> &[usize] {
        self.ordered.dofs()
    }

    /// The entries of a row of `K`, by local degrees of freedom. The unit is a power of two, so
    /// that the digits are those of the caller.
    pub fn row_of_stiffness(&self, dof: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let entries = self.ordered.stiffness.entries(dof);
        entries.map(|(j, k)| (j, k / self.ordered.unit))
    }

    /// The power of two by which its stiffness is multiplied.
    pub fn unit(&self) -> f64 {
        self.ordered.unit
    }

    /// The largest stiffness on the diagonal of K at some local degrees of freedom.
    pub fn stiffest(&self, dofs: impl Iterator<Item = usize>) -> f64 {
        let of = |i| self.ordered.stiffness.diagonal(i) / self.unit();
        dofs.map(of).fold(0.0, f64::max)
    }

    /// The factor, unless it was dropped.
    pub fn factor(&self) -> Option<&Factor> {
        match &self.interior {
            Interior::Factored(factor) => Some(factor),
            Interior::OfKnownLoads(_) => None,
        }
    }

    fn require_factor(&self) -> Result<&Factor, Error> {
        self.factor().ok_or(Error::FactorDropped)
    }

    /// A rigid motion of all its degrees of freedom.
    pub fn motion(&self, motion: usize) -> &[f64] {
        &self.contact.motions.whole[motion]
    }

    /// Number of rigid motions that its supports leave free.
    pub fn motions(&self) -> usize {
        self.contact.motions.kept.len()
    }

    /// `(S + α R Rᵀ)⁻¹ / unit`, moved out with this unit: it is needed once.
    pub fn take_inverse(&mut self) -> (Vec<f64>, f64) {
        (std::mem::take(&mut self.contact.inverse), self.unit())
    }

    /// The degree of freedom with the largest displacement in a rigid motion.
    pub fn most_moved(&self, motion: usize) -> usize {
        let mode = &self.contact.motions.kept[motion];
        self.dofs()[self.ordered.kept[place_of_largest(mode)]]
    }

    /// Amounts of its rigid motions in a rigid displacement of all degrees of freedom.
    pub fn motion_amounts(&self, u: &[f64]) -> Vec<f64> {
        let kept = self.ordered.kept.iter();
        let kept: Vec<f64> = kept.map(|&i| u[self.dofs()[i]]).collect();
        let modes = self.contact.motions.kept.iter();
        modes.map(|mode| dot_long(mode, &kept)).collect()
    }

    /// Condenses the part of a force on this body, in its unit: interior unknowns after the
    /// forward solve, contact forces `f_c − K_ci K_ii⁻¹ f_i`. Without the factor, the latter
    /// for a force with its number among those given in advance.
    pub fn condense(&self, force: &[f64], known: Option<usize>) -> Vec<f64> {
        let mut local = self.ordered.scale_forces(force);
        match &self.interior {
            Interior::Factored(factor) => factor.condense(&mut local, 1),
            Interior::OfKnownLoads(loads) => {
                let load = known.map_or(&[][..], |k| &loads[k]);
                for (&i, value) in self.ordered.kept.iter().zip(load) {
                    local[i] = *value;
                }
            }
        }
        local
    }

    /// `e = Zᵀ f` of a load on all degrees of freedom. It is equal to `Rᵀ f_c`, because
    /// `K Z = 0`, without the rounding of a soft interior. Prescribed displacements do no work
    /// on rigid motions, but `force`, which contains theirs, deforms the body.
    ///
    /// Work within its rounding error is zero: no reaction must balance it. If `K` amplifies
    /// rounding, it stays: there the motions have the same error, and with reactions that
    /// balance the body both cancel.
    pub fn rigid_load(&self, load: &[f64], force: &[f64]) -> Vec<f64> {
        /// Work above this share of its largest possible value is above its error: 16 ε
        /// [`DIGITS`], and a thousand for the interior.
        const CLEAR: f64 = 1e-6;
        if self.motions() == 0 {
            return Vec::new();
        }
        let of_body = |values: &[f64]| -> Vec<f64> {
            let dofs = self.dofs().iter();
            dofs.map(|&i| values[i]).collect()
        };
        let (load, size) = (
            of_body(load),
            of_body(force).iter().map(|f| f.abs()).sum::<f64>(),
        );
        let of_motion = |motion: &Vec<f64>| {
            let work = compensated::dot(motion, &load).value();
            let terms: f64 = motion.iter().zip(&load).map(|(m, f)| (m * f).abs()).sum();
            // Loads that balance each other leave only rounding.
            if work.abs() <= 16.0 * f64::EPSILON * terms {
                0.0
            } else {
                work
            }
        };
        let motions = &self.contact.motions.whole;
        let mut work: Vec<f64> = motions.iter().map(of_motion).collect();
        let is_clear = |(motion, work): (&Vec<f64>, &f64)| {
            *work == 0.0 || work.abs() > CLEAR * amax(motion) * size
        };
        if self.contact.amplification <= DIGITS
            && !motions.iter().zip(&work).all(is_clear)
            && let Ok(rounding) = self.load_rounding(force)
        {
            let _ = drop_rounding(&mut work, &rounding);
        }
        work
    }

    /// `(S + α R Rᵀ)⁻¹ (I − R Rᵀ) f_c`.
    pub fn free_displacement(&self, condensed: &[f64]) -> Vec<f64> {
        let mut u = self.ordered.at_contacts(condensed);
        self.balance(&mut u);
        self.solve_contact(&mut u, 1);
        u
    }

    /// `f ← (I − R Rᵀ) f`.
    fn balance(&self, f: &mut [f64]) {
        for mode in &self.contact.motions.kept {
            let _ = take_out(f, mode);
        }
    }

    fn solve_contact(&self, f: &mut [f64], columns: usize) {
        dense::solve_lower(&self.contact.cholesky, self.kept(), f, columns);
        dense::solve_lower_transpose(&self.contact.cholesky, self.kept(), f, columns);
    }

    /// `f ← L⁻¹ f` for columns of forces on the kept unknowns, `L Lᵀ = S + α R Rᵀ`.
    pub fn half_solve_contact(&self, f: &mut [f64], columns: usize) {
        dense::solve_lower(&self.contact.cholesky, self.kept(), f, columns);
    }

    /// The displacements of this body, one column for each step: free part, reactions and rigid
    /// motions, after refinement with `f + Bᵀ r − K u`. `pushes` are `unit Bᵀ r` at the local
    /// degrees of freedom.
    pub fn displacements(
        &self,
        forces: &[&[f64]],
        pushes: &[f64],
        rigid: &[&[f64]],
    ) -> Result<Recovered, Error> {
        /// Displacements of contacts may be this much smaller than the largest one.
        const FINE: f64 = 1e-8;
        let (n, count) = (self.dofs().len(), rigid.len());
        let factor = self.require_factor()?;
        let mut forces: Vec<f64> = forces
            .iter()
            .flat_map(|f| self.ordered.scale_forces(f))
            .collect();
        let mut u = self.response(factor, &forces, Some(pushes), rigid);
        let mut terms = forces.clone();
        for ((f, term), p) in forces.iter_mut().zip(&mut terms).zip(pushes) {
            *term = term.abs() + p.abs();
            *f += p;
        }
        // If contacts of a slender body hardly move, the rounding of its displacements is large
        // relative to theirs.
        let fine = self.contact.amplification > DIGITS;
        let mut low = vec![0.0; u.len()];
        let column = |k: usize| k * n..(k + 1) * n;
        let mut left = vec![Imbalance::default(); count];
        let mut last = vec![f64::INFINITY; count];
        // Finished columns are left out.
        let mut open: Vec<usize> = (0..count).filter(|_| n > 0).collect();
        for _ in 0..=tuning::most_corrections() {
            let imbalance = |&k: &usize| {
                let low = fine.then(|| &low[column(k)]);
                let rounding = CANCELLED * norm(&terms[column(k)]);
                self.left(&u[column(k)], low, &forces[column(k)], rounding)
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

    /// Displacements without refinement, for a K that does not amplify the rounding of its factor.
    pub fn changes(
        &self,
        forces: &[&[f64]],
        pushes: &[f64],
        rigid: &[&[f64]],
    ) -> Result<Recovered, Error> {
        if self.contact.amplification > DIGITS {
            return self.displacements(forces, pushes, rigid);
        }
        let factor = self.require_factor()?;
        let forces: Vec<f64> = forces
            .iter()
            .flat_map(|f| self.ordered.scale_forces(f))
            .collect();
        Ok(Recovered {
            u: self.response(factor, &forces, Some(pushes), rigid),
            low: Vec::new(),
            left: Vec::new(),
        })
    }

    /// `f − K u` without its rigid part, which contact balances up to the tolerance, and its
    /// size.
    fn left(
        &self,
        u: &[f64],
        low: Option<&[f64]>,
        force: &[f64],
        rounding: f64,
    ) -> (Vec<f64>, Imbalance) {
        let (mut rest, size) = self.ordered.stiffness.residual_and_size(u, low, force);
        let work: Vec<f64> = self
            .contact
            .motions
            .whole
            .iter()
            .map(|z| dot_long(z, &rest))
            .collect();
        for (mode, work) in self.contact.motions.kept.iter().zip(&work) {
            for (&i, m) in self.ordered.kept.iter().zip(mode) {
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
        let forces = norm(force).max(rounding);
        let left = Imbalance {
            by_row,
            dof: self.dofs()[row],
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
        let n = self.dofs().len();
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
        let (n, m, columns) = (self.dofs().len(), self.kept(), GROUP);
        factor.condense(&mut local, columns);
        let part = |local: &[f64]| -> Vec<f64> {
            let columns = local.chunks_exact(n.max(1));
            columns.flat_map(|x| self.ordered.at_contacts(x)).collect()
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
            add_scaled(&mut contact, 1.0, &part(&pushed));
        }
        self.solve_contact(&mut contact, columns);
        for (local, contact) in local
            .chunks_exact_mut(n.max(1))
            .zip(contact.chunks_exact(m.max(1)))
        {
            for (&i, value) in self.ordered.kept.iter().zip(contact) {
                local[i] = *value;
            }
        }
        factor.recover(&mut local, columns);
        for (local, amounts) in local.chunks_exact_mut(n.max(1)).zip(rigid) {
            for (motion, amount) in self.contact.motions.whole.iter().zip(*amounts) {
                add_scaled(local, *amount, motion);
            }
        }
        local
    }

    /// Four samples of what the rounding `δK` of the entries of `K` changes at a displacement
    /// `u`: the displacement of this body without its rigid part, `K⁻¹ δK u`, and the work of
    /// `δK u` on its rigid motions.
    ///
    /// In three samples a row of `δK u` is `2 ε √(Σ_j (K_ij u_j)²)` with a random sign, because
    /// independent roundings of sums of elements add up in this way. In the fourth it is a
    /// quarter of this along `u`: equal elements in a row are rounded equally, and their errors
    /// do not cancel.
    pub fn stiffness_rounding(&self, u: &[f64]) -> Result<Vec<RoundingSample>, Error> {
        let factor = self.require_factor()?;
        let u: Vec<f64> = self.dofs().iter().map(|&i| u[i]).collect();
        let size = |i: usize| {
            let terms = self.ordered.stiffness.entries(i);
            let squares: f64 = terms.map(|(j, k)| (k * u[j]).powi(2)).sum();
            2.0 * f64::EPSILON * squares.sqrt()
        };
        let sizes: Vec<f64> = (0..u.len()).map(size).collect();
        let mut forces = Vec::with_capacity(GROUP * u.len());
        for seed in 1..GROUP as u64 {
            let signs = random_signs(u.len(), seed).into_iter();
            forces.extend(signs.zip(&sizes).map(|(sign, size)| sign * size));
        }
        let along = u.iter().zip(&sizes);
        forces.extend(along.map(|(u, size)| 0.25 * size * u.signum()));
        let displacements = self.response(factor, &forces, None, &[&[][..]; GROUP]);
        let order = u.len().max(1);
        let samples = displacements.chunks(order).zip(forces.chunks(order));
        let sample = |(displacement, force): (&[f64], &[f64])| RoundingSample {
            displacement: displacement.to_vec(),
            work: {
                let motions = self.contact.motions.whole.iter();
                motions.map(|z| dot_long(z, force) / self.unit()).collect()
            },
        };
        Ok(samples.map(sample).collect())
    }

    /// The rounding error of `e`, one number for each rigid motion.
    ///
    /// `K` has an error of ε. So a motion `d` without energy is known up to the forces
    /// `ε |K||d|`, which do work on the displacement of the body under the loads.
    pub fn load_rounding(&self, force: &[f64]) -> Result<Vec<f64>, Error> {
        if self.motions() == 0 {
            return Ok(Vec::new());
        }
        let factor = self.require_factor()?;
        let force = self.ordered.scale_forces(force);
        let mut forces: Vec<f64> = force.iter().map(|f| f.abs()).collect();
        let deformed = self.response(factor, &force, None, &[&[]]);
        self.ordered
            .stiffness
            .add_absolute_product(&deformed, &mut forces);
        let of_motion = |motion: &Vec<f64>| {
            let work = motion.iter().zip(&forces).map(|(d, f)| (d * f).abs());
            16.0 * f64::EPSILON * work.sum::<f64>() / self.unit()
        };
        Ok(self.contact.motions.whole.iter().map(of_motion).collect())
    }
}
