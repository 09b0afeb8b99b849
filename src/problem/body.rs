//! One body: a connected component of the free stiffness, its `S`, its rigid motions.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rayon::prelude::*;

use crate::error::Error;
use crate::linalg::binary::{exponent, times_two_to};
use crate::linalg::csc::Symmetric;
use crate::linalg::dense;
use crate::linalg::multifrontal::{Factor, Schur};
use crate::linalg::small::{dot_long, norm};
use crate::linalg::symbolic::{Counts, Options, Symbolic};
use crate::problem::null_space::{null_space, start_value};
use crate::problem::sparse::Owned;

/// Below this, relative to the diagonal of `K`, an eigenvalue of `S` is zero if a
/// gap sets it apart: rounding leaves about 1e-15, and the softest support worth
/// the name more. Bodies of many unknowns sum more of the rounding of `K` itself,
/// a few ε for each.
const NULL: f64 = 1e-13;

/// A pivot above this, relative to the diagonal of `K`, leaves no doubt that a
/// matrix is definite; below it the eigenvalues are looked at. Where the contact
/// set is soft and the rest is stiff, the rounding of the stiff part may exceed it.
const SAFE: f64 = 1e-9;

/// Where `W` may be off by more than so many ε it has lost the digits that the judge
/// asks for: steps are then taken with `v` from `K`.
pub const DIGITS: f64 = 1e5;

/// A body before its numbers: what condensing it will take is known.
#[derive(Debug)]
pub struct Analysed {
    dofs: Vec<usize>,
    stiffness: Owned,
    unit: f64,
    kept: Vec<usize>,
    places: Option<Vec<[f64; 3]>>,
    symbolic: Arc<Symbolic>,
}

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
    /// The unknowns that `S` is left on, local numbers.
    kept: Vec<usize>,
    /// Place among the kept of each degree of freedom; `u32::MAX` of the others.
    place: Vec<u32>,
    /// Where its degrees of freedom are in space, where that is known.
    places: Option<Vec<[f64; 3]>>,
    symbolic: Arc<Symbolic>,
    /// Dropped where all loads were known beforehand.
    factor: Option<Factor>,
    /// The kept part of those loads, condensed.
    known: Vec<Vec<f64>>,
    /// Lower Cholesky factor of `S + α R Rᵀ`, column-major.
    cholesky: Vec<f64>,
    /// Orthonormal rigid motions `R` on the contact set.
    modes: Vec<Vec<f64>>,
    inverse: Vec<f64>,
    condition: f64,
    amplification: f64,
    /// Seconds until S, and from S on.
    seconds: [f64; 2],
}

impl Analysed {
    /// Orders and counts; the analysis of the same body with other values is used
    /// again. `kept` are local numbers, `places` those of the degrees of freedom in
    /// space, where they are known.
    ///
    /// # Errors
    /// [`Error::IndexRange`] for more entries than 32-bit indices can number.
    pub fn new(
        dofs: Vec<usize>,
        mut stiffness: Owned,
        kept: Vec<usize>,
        places: Option<Vec<[f64; 3]>>,
        before: Option<&Body>,
    ) -> Result<Self, Error> {
        let stiffest = stiffness.values.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
        let unit = times_two_to(1.0, -exponent(stiffest).clamp(-1000, 1000));
        stiffness.values.iter_mut().for_each(|a| *a *= unit);
        let view = stiffness.view()?;
        let same = |body: &&Body| {
            body.dofs == dofs && body.kept == kept && body.symbolic.check_pattern(&view).is_ok()
        };
        let symbolic = match before.filter(same) {
            Some(body) => Arc::clone(&body.symbolic),
            None => Arc::new(analyse(&view, &kept, places.as_deref())?),
        };
        Ok(Self {
            dofs,
            stiffness,
            unit,
            kept,
            places,
            symbolic,
        })
    }

    /// The same body with other unknowns kept.
    ///
    /// # Errors
    /// As [`Analysed::new`].
    pub fn again(body: &Body, kept: Vec<usize>) -> Result<Self, Error> {
        let stiffness = body.stiffness.clone();
        let symbolic = analyse(&stiffness.view()?, &kept, body.places.as_deref())?;
        Ok(Self {
            dofs: body.dofs.clone(),
            symbolic: Arc::new(symbolic),
            unit: body.unit,
            places: body.places.clone(),
            stiffness,
            kept,
        })
    }

    /// Bytes that it holds besides what the factorisation takes.
    #[must_use]
    pub fn bytes(&self) -> u128 {
        let k = &self.stiffness;
        let places = self.places.as_ref().map_or(0, |at| 24 * at.len());
        let numbers = k.pointer.len() + k.index.len() + k.values.len() + 2 * self.dofs.len();
        // What the ways from the caller to the bodies leave in the heap, as measured.
        let lists = 160 * self.dofs.len();
        (8 * numbers + places + lists) as u128
    }

    /// What the factorisation will cost.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.symbolic.counts()
    }

    /// Condenses. Of `loads`, forces on all degrees of freedom, the condensed
    /// ones are kept and the factor is not, where supports hold the body.
    ///
    /// # Errors
    /// [`Error::Indefinite`], [`Error::FloatingBody`], [`Error::Mechanism`],
    /// with the degree of freedom in the caller's numbering;
    /// [`Error::Interrupted`].
    pub fn condense(
        self,
        dimension: usize,
        loads: Option<&[Vec<f64>]>,
        stop: &AtomicBool,
    ) -> Result<Body, Error> {
        let begin = Instant::now();
        if let Some(loads) = loads
            && let Some((s, known)) = self.without_factor(loads, stop)?
        {
            let body = self.body(s, None, known, begin, stop)?;
            if body.amplification <= DIGITS {
                return Ok(body);
            }
            // Answers will be mended with K itself, by the factor.
            return body.analysed().condense(dimension, None, stop);
        }
        let view = self.stiffness.view()?;
        let mut factor = Factor::new(Arc::clone(&self.symbolic), &view, stop)
            .map_err(|e| renumber(e, &self.dofs))?;
        let diagonal = view.diagonal();
        if let Some((dof, ratio)) = factor.weakest_pivot()
            && ratio < SAFE
            && softest_interior(&factor, &diagonal, &self.kept) <= NULL
        {
            let dof = self.dofs[dof];
            return Err(Error::FloatingBody { dof });
        }
        let schur = factor.take_schur();
        let scale = scales(&self.kept, &diagonal);
        let until_s = begin.elapsed().as_secs_f64();
        let mut s = match self.definite(&schur, &scale, stop)? {
            Some(s) => s,
            None => self.with_rigid_motions(&schur, &scale, &factor, dimension, stop)?,
        };
        drop(schur);
        s.until = until_s;
        self.body(s, Some(factor), Vec::new(), begin, stop)
    }

    /// S factored and the kept part of the loads condensed, where there is no doubt
    /// that supports hold the body: a doubt is only settled with the factor.
    #[expect(clippy::type_complexity, reason = "what a body is made of")]
    fn without_factor(
        &self,
        loads: &[Vec<f64>],
        stop: &AtomicBool,
    ) -> Result<Option<(Supported, Vec<Vec<f64>>)>, Error> {
        let begin = Instant::now();
        let view = self.stiffness.view()?;
        let scaled = |force: &Vec<f64>| -> Vec<f64> {
            self.dofs.iter().map(|&i| self.unit * force[i]).collect()
        };
        let mut local: Vec<f64> = loads.iter().flat_map(scaled).collect();
        let schur = Schur::new(&self.symbolic, &view, &mut local, stop)
            .map_err(|e| renumber(e, &self.dofs))?;
        if schur.weakest_pivot().is_some_and(|(_, ratio)| ratio < SAFE) {
            return Ok(None);
        }
        let scale = scales(&self.kept, &view.diagonal());
        let until_s = begin.elapsed().as_secs_f64();
        let Some(mut s) = self.definite(schur.values(), &scale, stop)? else {
            return Ok(None);
        };
        s.until = until_s;
        let columns = local.chunks_exact(self.dofs.len().max(1));
        let part = |column: &[f64]| self.kept.iter().map(|&i| column[i]).collect();
        Ok(Some((s, columns.map(part).collect())))
    }

    /// The Cholesky factor of S, where S is positive definite beyond doubt.
    fn definite(
        &self,
        schur: &[f64],
        scale: &[f64],
        stop: &AtomicBool,
    ) -> Result<Option<Supported>, Error> {
        let m = self.kept.len();
        let mut cholesky = schur.to_vec();
        // Of a unit motion of the whole body, what independent roundings of the
        // entries make of the energy; a sum of sizes would doubt large bodies.
        let rounding = 8.0 * f64::EPSILON * norm(&self.stiffness.values);
        let sound = dense::cholesky(&mut cholesky, m, stop)?.is_none()
            && (0..m).all(|i| {
                let doubt = SAFE.max(rounding * scale[i] * scale[i]);
                (cholesky[i * (m + 1)] * scale[i]).powi(2) > doubt
            });
        Ok(sound.then(|| Supported {
            size: one_norm(schur, m),
            cholesky,
            modes: Vec::new(),
            until: 0.0,
        }))
    }

    /// The rigid motions that supports leave free, and the Cholesky factor of
    /// `S + α R Rᵀ`.
    fn with_rigid_motions(
        &self,
        schur: &[f64],
        scale: &[f64],
        factor: &Factor,
        dimension: usize,
        stop: &AtomicBool,
    ) -> Result<Supported, Error> {
        let (dofs, kept, stiffness) = (&self.dofs, &self.kept, &self.stiffness);
        let m = kept.len();
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
        let modes = null_space(schur, scale, &rounding, 2 * LIMIT[dimension], stop)?
            .ok_or_else(|| Error::Indefinite { dof: dofs[kept[0]] })?;
        if modes.len() > LIMIT[dimension] {
            return Err(Error::Mechanism {
                dof: dofs[kept[0]],
                found: modes.len(),
                limit: LIMIT[dimension],
            });
        }
        let mut cholesky = with_modes(schur, &modes);
        let size = one_norm(&cholesky, m);
        match dense::cholesky(&mut cholesky, m, stop)? {
            Some(at) => Err(Error::Indefinite {
                dof: dofs[kept[at]],
            }),
            None => Ok(Supported {
                cholesky,
                modes,
                size,
                until: 0.0,
            }),
        }
    }

    fn body(
        self,
        s: Supported,
        factor: Option<Factor>,
        known: Vec<Vec<f64>>,
        begin: Instant,
        stop: &AtomicBool,
    ) -> Result<Body, Error> {
        let m = self.kept.len();
        let mut inverse = s.cholesky.clone();
        dense::invert_from_cholesky(&mut inverse, m, stop)?;
        let flexible = one_norm(&inverse, m);
        let condition = s.size * flexible;
        let diagonal = self.stiffness.view()?.diagonal();
        let stiffest = self.kept.iter().map(|&i| diagonal[i]).fold(0.0, f64::max);
        let mut place = vec![u32::MAX; self.dofs.len()];
        for (k, &i) in (0_u32..).zip(&self.kept) {
            place[i] = k;
        }
        Ok(Body {
            dofs: self.dofs,
            stiffness: self.stiffness,
            unit: self.unit,
            kept: self.kept,
            place,
            places: self.places,
            symbolic: self.symbolic,
            factor,
            known,
            cholesky: s.cholesky,
            modes: s.modes,
            inverse,
            condition,
            amplification: condition.max(stiffest * flexible),
            seconds: [s.until, begin.elapsed().as_secs_f64() - s.until],
        })
    }
}

/// S made definite.
struct Supported {
    /// Lower Cholesky factor of `S + α R Rᵀ`, column-major.
    cholesky: Vec<f64>,
    /// Orthonormal rigid motions `R` on the kept unknowns.
    modes: Vec<Vec<f64>>,
    /// 1-norm of `S + α R Rᵀ`.
    size: f64,
    /// Seconds that S took.
    until: f64,
}

/// What makes the diagonal of K one at the kept unknowns.
fn scales(kept: &[usize], diagonal: &[f64]) -> Vec<f64> {
    let scale = |&i: &usize| {
        if diagonal[i] > 0.0 {
            diagonal[i].sqrt().recip()
        } else {
            1.0
        }
    };
    kept.iter().map(scale).collect()
}

impl Body {
    /// The body before its numbers.
    fn analysed(self) -> Analysed {
        Analysed {
            dofs: self.dofs,
            stiffness: self.stiffness,
            unit: self.unit,
            kept: self.kept,
            places: self.places,
            symbolic: self.symbolic,
        }
    }

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
        let k = &self.stiffness;
        let of = |i: usize| {
            let column = k.pointer[i]..k.pointer[i + 1];
            let at = k.index[column.clone()].binary_search(&i);
            at.map_or(0.0, |at| k.values[column.start + at] / self.unit)
        };
        dofs.map(of).fold(0.0, f64::max)
    }

    /// The factor, unless it was dropped.
    #[must_use]
    pub fn factor(&self) -> Option<&Factor> {
        self.factor.as_ref()
    }

    /// Rigid motions on the kept unknowns.
    #[must_use]
    pub fn modes(&self) -> &[Vec<f64>] {
        &self.modes
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
    ) -> Result<Vec<f64>, Error> {
        /// Corrections at the most.
        const MOST: usize = 8;
        let n = self.dofs.len();
        let factor = self.factor.as_ref().ok_or(Error::FactorDropped)?;
        let mut forces: Vec<f64> = forces.iter().flat_map(|f| self.scaled(f)).collect();
        let mut u = self.response(factor, &forces, Some(pushes), rigid);
        for (f, p) in forces.iter_mut().zip(pushes) {
            *f += p;
        }
        let mut last = vec![f64::INFINITY; rigid.len()];
        for _ in 0..MOST {
            // Columns that are done take no further part.
            let open: Vec<usize> = (0..last.len()).filter(|&k| last[k] > 0.0).collect();
            if n == 0 || open.is_empty() {
                break;
            }
            let mut left = vec![0.0; n * open.len()];
            left.par_chunks_mut(n).zip(&open).for_each(|(left, &k)| {
                let (u, force) = (&u[k * n..(k + 1) * n], &forces[k * n..(k + 1) * n]);
                left.copy_from_slice(&self.stiffness.residual(u, force));
            });
            let changes = self.response(factor, &left, None, &vec![&[][..]; open.len()]);
            for (change, k) in changes.chunks_exact(n).zip(open) {
                let u = &mut u[k * n..(k + 1) * n];
                let moved = norm(change) / norm(u).max(f64::MIN_POSITIVE);
                // Corrections that do not fall are rounding of the correction itself.
                if !(moved < 0.5 * last[k]) {
                    last[k] = 0.0;
                    continue;
                }
                for (value, change) in u.iter_mut().zip(change) {
                    *value += change;
                }
                // What is left is the square of what was corrected.
                last[k] = if moved * moved <= f64::EPSILON {
                    0.0
                } else {
                    moved
                };
            }
        }
        Ok(u)
    }

    /// `u` of forces with their rigid part taken out, of reactions as they are
    /// (their rigid part is what `a` was found with), and of rigid motions; a
    /// column each.
    fn response(
        &self,
        factor: &Factor,
        forces: &[f64],
        pushes: Option<&[f64]>,
        rigid: &[&[f64]],
    ) -> Vec<f64> {
        let (n, m, columns) = (self.dofs.len(), self.kept.len(), rigid.len());
        let mut local = forces.to_vec();
        factor.condense(&mut local, columns);
        let part = |local: &[f64]| -> Vec<f64> {
            let columns = local.chunks_exact(n.max(1));
            columns.flat_map(|x| self.contact_part(x)).collect()
        };
        let mut contact = part(&local);
        contact
            .chunks_exact_mut(m.max(1))
            .for_each(|f| self.balance(f));
        if let Some(pushes) = pushes {
            let inside = |(k, &p): (usize, &f64)| p != 0.0 && self.place[k % n] == u32::MAX;
            let mut pushed = Cow::Borrowed(pushes);
            if pushes.iter().enumerate().any(inside) {
                factor.condense(pushed.to_mut(), columns);
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
        for (contact, amounts) in contact.chunks_exact_mut(m.max(1)).zip(rigid) {
            for (mode, amount) in self.modes.iter().zip(*amounts) {
                for (value, m) in contact.iter_mut().zip(mode) {
                    *value += amount * m;
                }
            }
        }
        for (local, contact) in local
            .chunks_exact_mut(n.max(1))
            .zip(contact.chunks_exact(m.max(1)))
        {
            for (&i, value) in self.kept.iter().zip(contact) {
                local[i] = *value;
            }
        }
        factor.recover(&mut local, columns);
        local
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
        let nothing = vec![0.0; self.dofs.len()];
        let force = self.scaled(force);
        let mut forces: Vec<f64> = force.iter().map(|f| f.abs()).collect();
        let deformed = self.response(factor, &force, None, &[&[]]);
        self.stiffness.add_absolute_product(&deformed, &mut forces);
        let of_motion = |k: usize| {
            let mut amounts = vec![0.0; self.modes.len()];
            amounts[k] = 1.0;
            let motion = self.response(factor, &nothing, None, &[&amounts]);
            let work = motion.iter().zip(&forces).map(|(d, f)| (d * f).abs());
            16.0 * f64::EPSILON * work.sum::<f64>() / self.unit
        };
        Ok((0..self.modes.len()).map(of_motion).collect())
    }
}

fn analyse(
    view: &Symmetric,
    kept: &[usize],
    coordinates: Option<&[[f64; 3]]>,
) -> Result<Symbolic, Error> {
    Symbolic::analyse(view, kept, &Options { coordinates })
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
