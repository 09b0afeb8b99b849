//! A body on its way to a condensed one: ordered and counted, then factored. Finds the rigid
//! motions that its supports leave free.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::condensation::body::{Body, DIGITS};
use crate::condensation::null_space::{
    DiagonalScaling, MotionBlock, SoftestMotions, part, softest, softest_interior, softest_of_all,
};
use crate::condensation::pattern_cache::Lookup;
use crate::condensation::rigid_motions::Geometry;
use crate::condensation::sparse::OwnedMatrix;
use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::jacobi::{combine, orthogonalise};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{dot_long, norm};
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::multifrontal::{Factor, Schur};
use crate::linalg::sparse::symbolic::{Counts, Options, Symbolic};

/// If all pivots are above this share of the diagonal of `K`, the matrix is definite beyond
/// doubt; below, the softest motions are examined. With a soft contact set and a stiff
/// interior, the rounding of the interior may exceed it.
const SAFE: f64 = 1e-9;

/// The same for pivots of the interior, whose inverse is not available: elimination of a
/// singular matrix without a smaller pivot would have increased its entries as much.
const SAFE_INSIDE: f64 = 1e-6;

/// If the softest motion of the interior has less energy, relative to the diagonal of `K`, it
/// may be rounding.
const DOUBTFUL: f64 = 1e-11;

/// A contact holds a rigid motion only if it moves by at least this share of the contact that
/// moves most: smaller motions are rounding of the positions of the contacts.
const PINNED: f64 = 1e-11;

/// Least ratio of the energy of the next motion to rounding, if motions beyond the rigid ones
/// have no energy. The energies of the first bending modes differ by a factor of ten to forty;
/// the elastic modes of a mechanism are far above its free motions.
const MECHANISM: f64 = 1e3;

/// The same for motions of which only the stiffness is known. The second bending mode of a
/// cantilever has 39 times the energy of the first, which counts as zero below a fifth of
/// rounding.
const CLEAR: f64 = 20.0;

/// Number of motions examined first; more if all of them are soft.
const WIDTH: usize = 9;

/// A body before its factorisation: the costs of the condensation are known.
#[derive(Debug)]
pub struct AnalysedBody {
    dofs: Vec<usize>,
    stiffness: OwnedMatrix,
    unit: f64,
    kept: Vec<usize>,
    places: Option<Vec<[f64; 3]>>,
    geometry: Option<Arc<Geometry>>,
    symbolic: Arc<Symbolic>,
    /// Whether it was ordered, because no analysis of its pattern was known.
    ordered: bool,
    /// Whether the analysis is that of the same body with other values.
    again: bool,
}

impl AnalysedBody {
    /// Orders and counts. It uses the analysis of the same body with other values, or else the
    /// analysis `known` of its pattern. `kept` are local numbers; `places` are the positions of
    /// the degrees of freedom in space, if known. `stiffest` is the size of the stiffness.
    ///
    /// # Errors
    /// [`Error::IndexRange`] for more entries than 32-bit indices can number.
    pub fn new(
        dofs: Vec<usize>,
        mut stiffness: OwnedMatrix,
        kept: Vec<usize>,
        places: Option<Vec<[f64; 3]>>,
        before: Option<&Body>,
        known: Option<Arc<Symbolic>>,
        stiffest: f64,
    ) -> Result<Self, Error> {
        let unit = times_two_to(1.0, -exponent(stiffest).clamp(-1000, 1000));
        for value in &mut stiffness.values {
            *value *= unit;
        }
        let view = stiffness.view();
        let same = |body: &&Body| {
            body.dofs == dofs && body.kept == kept && body.symbolic.check_pattern(&view).is_ok()
        };
        let before = before.filter(same).map(|body| Arc::clone(&body.symbolic));
        let again = before.is_some();
        let known = before.or(known);
        let ordered = known.is_none();
        let symbolic = match known {
            Some(symbolic) => symbolic,
            None => Arc::new(analyse(&view, &kept, places.as_deref())?),
        };
        Ok(Self {
            dofs,
            stiffness,
            unit,
            kept,
            places,
            geometry: None,
            symbolic,
            ordered,
            again,
        })
    }

    /// Adds the geometry of all degrees of freedom, from which rigid motions follow.
    #[must_use]
    pub fn with_geometry(mut self, geometry: Option<Arc<Geometry>>) -> Self {
        self.geometry = geometry;
        self
    }

    /// Stores an analysis made here for other problems with its pattern.
    pub fn share(&self) {
        if self.ordered {
            let asked = Lookup {
                matrix: self.stiffness.view(),
                kept: &self.kept,
                places: self.places.as_deref(),
            };
            asked.keep(&self.symbolic);
        }
    }

    /// The same body with other kept unknowns.
    ///
    /// # Errors
    /// As [`AnalysedBody::new`].
    pub fn again(body: &Body, kept: Vec<usize>) -> Result<Self, Error> {
        let stiffness = body.stiffness.clone();
        let symbolic = analyse(&stiffness.view(), &kept, body.places.as_deref())?;
        Ok(Self {
            dofs: body.dofs.clone(),
            symbolic: Arc::new(symbolic),
            unit: body.unit,
            places: body.places.clone(),
            geometry: body.geometry.clone(),
            stiffness,
            kept,
            ordered: true,
            again: false,
        })
    }

    /// Bytes that it holds besides those of the factorisation.
    #[must_use]
    pub fn bytes(&self) -> u128 {
        let k = &self.stiffness;
        let places = self.places.as_ref().map_or(0, |at| 24 * at.len());
        let numbers = k.pointer.len() + k.index.len() + k.values.len() + 2 * self.dofs.len();
        // Memory that earlier steps leave in the heap, as measured.
        let lists = 160 * self.dofs.len();
        (8 * numbers + places + lists) as u128
    }

    /// Bytes that it holds for the factor, from an earlier one of the same pattern.
    #[must_use]
    pub fn bytes_spare(&self) -> u128 {
        self.symbolic.bytes_spare() as u128
    }

    /// Further bytes of a repeated factorisation that leaves its stack to the next one: S is
    /// then made beside it. 0 for the first factorisation of an analysis.
    #[must_use]
    pub fn bytes_left(&self) -> u128 {
        if self.again {
            self.symbolic.bytes_stack() as u128 + 8 * (self.counts().kept as u128).pow(2)
        } else {
            0
        }
    }

    /// Whether it does so: after two matrices, more are expected.
    pub fn leave_stack(&self, leave: bool) {
        self.symbolic.keep_stack(leave && self.again);
    }

    /// The cost of the factorisation.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.symbolic.counts()
    }

    /// Condenses the body. If supports hold it and `loads` are given, it keeps the condensed
    /// loads and drops the factor. `loads` are forces on all degrees of freedom.
    ///
    /// # Errors
    /// [`Error::Indefinite`], [`Error::FloatingBody`], [`Error::FewDigits`], with the degree of
    /// freedom in the numbering of the caller; [`Error::Interrupted`].
    pub fn condense(self, loads: Option<&[Vec<f64>]>, stop: &AtomicBool) -> Result<Body, Error> {
        let begin = Instant::now();
        if let Some(loads) = loads
            && let Some((s, known, until_s)) = self.without_factor(loads, stop)?
        {
            let body = self.body(s, None, known, [begin, until_s]);
            if body.amplification <= DIGITS {
                return Ok(body);
            }
            // Solutions will be corrected with K itself, by the factor.
            return undo(body).condense(None, stop);
        }
        let view = self.stiffness.view();
        let made = Factor::new(Arc::clone(&self.symbolic), &view, stop);
        let mut factor = match made {
            Ok(factor) => factor,
            Err(error @ (Error::Indefinite { .. } | Error::FloatingBody { .. })) => {
                return Err(self.refusal(error, stop)?);
            }
            Err(other) => return Err(other),
        };
        if self.may_float_inside(&factor) {
            drop(factor);
            self.check_whole(stop)?;
            factor = Factor::new(Arc::clone(&self.symbolic), &view, stop)?;
        }
        let schur = factor.take_schur();
        let scale = scales(&self.kept, &view.diagonal());
        let until_s = Instant::now();
        let mut s = match self.definite(&schur, &scale, stop)? {
            Some(s) => s,
            None => self.with_rigid_motions(&schur, &scale, &factor, stop)?,
        };
        s.inside = softness(factor.weakest_pivot());
        drop(schur);
        Ok(self.body(s, Some(factor), Vec::new(), [begin, until_s]))
    }

    /// Rigid motions that supports leave free, from the positions of the degrees of freedom, if
    /// these are known.
    fn by_geometry(&self) -> Option<Vec<Vec<f64>>> {
        let geometry = self.geometry.as_ref()?;
        geometry.left_free(&self.dofs, &self.stiffness)
    }

    /// Whether the interior is so soft that motions of it may be free.
    fn may_float_inside(&self, factor: &Factor) -> bool {
        if factor
            .weakest_pivot()
            .is_none_or(|(_, ratio)| ratio >= SAFE_INSIDE)
        {
            return false;
        }
        let weights = DiagonalScaling::new(&self.stiffness);
        softest_interior(factor, &weights, &self.kept) <= DOUBTFUL
    }

    fn floating(&self, motion: &[f64]) -> Error {
        let most = (0..motion.len()).fold(0, |best, i| {
            if motion[i].abs() > motion[best].abs() {
                i
            } else {
                best
            }
        });
        Error::FloatingBody {
            dof: self.dofs[most],
        }
    }

    /// The error after a pivot that is not positive.
    fn refusal(&self, met: Error, stop: &AtomicBool) -> Result<Error, Error> {
        match self.check_whole(stop) {
            Err(Error::Interrupted) => Err(Error::Interrupted),
            Err(found) => Ok(found),
            Ok(()) => Ok(match renumber(met, &self.dofs) {
                // No motion has zero or negative energy: the pivot is rounding.
                Error::Indefinite { dof } | Error::FloatingBody { dof } => Error::FewDigits { dof },
                other => other,
            }),
        }
    }

    /// Examines the softest motions of the whole body, with contact set and interior.
    ///
    /// # Errors
    /// [`Error::FloatingBody`] if a motion without energy moves no contact,
    /// [`Error::Indefinite`], [`Error::FewDigits`]; [`Error::Interrupted`].
    fn check_whole(&self, stop: &AtomicBool) -> Result<(), Error> {
        let k = &self.stiffness;
        let nothing_holds = |&i: &usize| k.is_empty_row(i) && !self.kept.contains(&i);
        if let Some(dof) = (0..self.dofs.len()).find(nothing_holds) {
            return Err(Error::FloatingBody {
                dof: self.dofs[dof],
            });
        }
        let geometric = self.by_geometry();
        if let Some(motions) = &geometric {
            self.pin(motions)?;
        }
        let known = geometric.clone().unwrap_or_default();
        let weights = DiagonalScaling::new(k);
        let of = (k, &self.kept[..], &self.symbolic);
        let softest = |width| softest_of_all(of, &weights, known.len() + width, stop);
        let motions_found = self.look(&weights, &known, softest)?;
        let motions_found = motions_found.ok_or_else(|| self.indefinite())?;
        let more = self.believed(motions_found, geometric.is_some())?;
        if !more.is_empty() {
            self.pin(&[known, more].concat())?;
        }
        Ok(())
    }

    fn indefinite(&self) -> Error {
        Error::Indefinite { dof: self.dofs[0] }
    }

    /// The null motions among a growing number of soft ones, until some are not null; `None` if
    /// there are no soft motions.
    fn look(
        &self,
        weights: &DiagonalScaling,
        known: &[Vec<f64>],
        softest: impl Fn(usize) -> Result<Option<MotionBlock>, Error>,
    ) -> Result<Option<SoftestMotions>, Error> {
        let mut width = WIDTH;
        loop {
            let Some(block) = softest(width)? else {
                return Ok(None);
            };
            let all = block.columns.len() < width;
            let shift = block.shift;
            let motions_found = part(&self.stiffness, weights, known, block);
            if motions_found.negative {
                return Err(self.indefinite());
            }
            if all || motions_found.is_complete(shift) {
                return Ok(Some(motions_found));
            }
            width *= 2;
        }
    }

    /// The motions without energy that are free beyond doubt.
    ///
    /// # Errors
    /// [`Error::FewDigits`] if only the stiffness could decide, and has too few digits.
    fn believed(
        &self,
        motions_found: SoftestMotions,
        geometric: bool,
    ) -> Result<Vec<Vec<f64>>, Error> {
        let mut null = motions_found.null;
        if geometric {
            // A rigid motion that is held by the geometry is held, by any lever arm.
            null.retain(|x| !self.is_rigid(x));
            if motions_found.gap < MECHANISM {
                null.clear();
            }
        } else if !null.is_empty() && motions_found.gap < CLEAR {
            return Err(Error::FewDigits { dof: self.dofs[0] });
        }
        Ok(null)
    }

    fn is_rigid(&self, motion: &[f64]) -> bool {
        let geometry = self.geometry.as_ref();
        geometry.is_some_and(|geometry| geometry.is_rigid(&self.dofs, motion))
    }

    /// Motions made orthonormal on the kept unknowns: the whole and the kept part.
    ///
    /// # Errors
    /// [`Error::FloatingBody`] for a combination of motions that moves no kept unknown.
    fn pin(&self, motions: &[Vec<f64>]) -> Result<Motions, Error> {
        let of_kept = |z: &Vec<f64>| self.kept.iter().map(|&i| z[i]).collect::<Vec<f64>>();
        let mut kept: Vec<Vec<f64>> = motions.iter().map(of_kept).collect();
        let amounts = orthogonalise(&mut kept);
        let largest = kept.iter().map(|z| norm(z)).fold(0.0, f64::max);
        let mut whole = Vec::with_capacity(motions.len());
        for (z, amounts) in kept.iter_mut().zip(&amounts) {
            let length = norm(z);
            let mut motion = combine(motions, amounts);
            if !(length > PINNED * largest) {
                return Err(self.floating(&motion));
            }
            for x in z.iter_mut().chain(&mut motion) {
                *x /= length;
            }
            whole.push(motion);
        }
        Ok(Motions { whole, kept })
    }

    /// The factored S, the kept part of the loads, and the time at which S was made, if
    /// supports hold the body beyond doubt. Otherwise the decision needs the factor.
    #[expect(clippy::type_complexity, reason = "what a body is made of")]
    fn without_factor(
        &self,
        loads: &[Vec<f64>],
        stop: &AtomicBool,
    ) -> Result<Option<(Supported, Vec<Vec<f64>>, Instant)>, Error> {
        let view = self.stiffness.view();
        let scaled = |force: &Vec<f64>| -> Vec<f64> {
            self.dofs.iter().map(|&i| self.unit * force[i]).collect()
        };
        let mut local: Vec<f64> = loads.iter().flat_map(scaled).collect();
        let schur = match Schur::new(&self.symbolic, &view, &mut local, stop) {
            Ok(schur) => schur,
            Err(Error::Indefinite { .. } | Error::FloatingBody { .. }) => return Ok(None),
            Err(other) => return Err(other),
        };
        if schur
            .weakest_pivot()
            .is_some_and(|(_, ratio)| ratio < SAFE_INSIDE)
        {
            return Ok(None);
        }
        let scale = scales(&self.kept, &view.diagonal());
        let until_s = Instant::now();
        let Some(mut s) = self.definite(schur.values(), &scale, stop)? else {
            return Ok(None);
        };
        s.inside = softness(schur.weakest_pivot());
        let columns = local.chunks_exact(self.dofs.len().max(1));
        let part = |column: &[f64]| self.kept.iter().map(|&i| column[i]).collect();
        Ok(Some((s, columns.map(part).collect(), until_s)))
    }

    /// The Cholesky factor of S, if S is positive definite beyond doubt.
    fn definite(
        &self,
        schur: &[f64],
        scale: &[f64],
        stop: &AtomicBool,
    ) -> Result<Option<Supported>, Error> {
        let m = self.kept.len();
        let mut cholesky = schur.to_vec();
        // The energy that independent roundings of the entries give to a unit motion of the
        // body; a sum of absolute values would reject large bodies.
        let rounding = 8.0 * f64::EPSILON * norm(&self.stiffness.values);
        let sound = dense::cholesky(&mut cholesky, m, stop)?.is_none()
            && (0..m).all(|i| {
                let doubt = SAFE.max(rounding * scale[i] * scale[i]);
                (cholesky[i * (m + 1)] * scale[i]).powi(2) > doubt
            });
        if !sound {
            return Ok(None);
        }
        let mut inverse = cholesky.clone();
        dense::invert_from_cholesky(&mut inverse, m, stop)?;
        // The trace of an inverse bounds the softness of each motion; pivots do not.
        let softness: f64 = (0..m)
            .map(|i| inverse[i * (m + 1)] / (scale[i] * scale[i]))
            .sum();
        Ok((softness < 1.0 / SAFE).then(|| Supported {
            size: one_norm(schur, m),
            cholesky,
            inverse,
            motions: Motions::default(),
            inside: 1.0,
        }))
    }

    /// The rigid motions that supports leave free, and the Cholesky factor of `S + α R Rᵀ`.
    fn with_rigid_motions(
        &self,
        schur: &[f64],
        scale: &[f64],
        factor: &Factor,
        stop: &AtomicBool,
    ) -> Result<Supported, Error> {
        let geometric = self.by_geometry();
        let mut motions = self.pin(geometric.as_deref().unwrap_or_default())?;
        let mut s = self.with_modes(schur, &motions.kept);
        let of = (&self.stiffness, &self.kept[..], factor);
        let weights = DiagonalScaling::new(&self.stiffness);
        let softest = |width| softest(of, &s, scale, width, stop);
        let found = self.look(&weights, &motions.whole, softest)?;
        let motions_found =
            if let Some(motions_found) = found.filter(|motions_found| !motions_found.doubtful) {
                motions_found
            } else {
                // Motions extended from the contact set collect there the imbalance of the
                // whole K; for a stiff part on a soft one, S may be rounding. Motions found on
                // all unknowns leave the imbalance where it is.
                let of = (&self.stiffness, &self.kept[..], &self.symbolic);
                let width = |width| motions.whole.len() + width;
                let in_full = |more| softest_of_all(of, &weights, width(more), stop);
                let motions_found = self.look(&weights, &motions.whole, in_full)?;
                motions_found.ok_or_else(|| self.indefinite())?
            };
        let more = self.believed(motions_found, geometric.is_some())?;
        if !more.is_empty() {
            let mut all = std::mem::take(&mut motions.whole);
            all.extend(more);
            motions = self.pin(&all)?;
            s = self.with_modes(schur, &motions.kept);
        }
        let m = self.kept.len();
        let size = one_norm(&s, m);
        if let Some(at) = dense::cholesky(&mut s, m, stop)? {
            let dof = self.dofs[self.kept[at]];
            return Err(Error::FewDigits { dof });
        }
        let mut inverse = s.clone();
        dense::invert_from_cholesky(&mut inverse, m, stop)?;
        Ok(Supported {
            cholesky: s,
            inverse,
            motions,
            size,
            inside: 1.0,
        })
    }

    /// `P S P + α R Rᵀ` with `P = 1 − R Rᵀ`, `α = tr S / m`: it removes the rounding of `S R`.
    /// If all kept unknowns move rigidly, `S` is only rounding, and α is that of `K`.
    fn with_modes(&self, schur: &[f64], modes: &[Vec<f64>]) -> Vec<f64> {
        let mut sum = schur.to_vec();
        let m = self.kept.len();
        if modes.is_empty() {
            return sum;
        }
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let mean = |trace: f64| trace / m as f64;
        if modes.len() >= m {
            sum.fill(0.0);
        } else {
            // S − R (S R)ᵀ − (S R) Rᵀ + R (Rᵀ S R) Rᵀ, bitwise symmetric.
            let times = |x: &Vec<f64>| -> Vec<f64> {
                schur.chunks_exact(m).map(|row| dot_long(row, x)).collect()
            };
            let mut images: Vec<Vec<f64>> = modes.iter().map(times).collect();
            let inner: Vec<Vec<f64>> = modes
                .iter()
                .map(|mode| images.iter().map(|image| dot_long(mode, image)).collect())
                .collect();
            for (a, image) in images.iter_mut().enumerate() {
                for (mode, amounts) in modes.iter().zip(&inner) {
                    for (value, x) in image.iter_mut().zip(mode) {
                        *value -= 0.5 * amounts[a] * x;
                    }
                }
            }
            for (mode, image) in modes.iter().zip(&images) {
                for (j, column) in sum.chunks_exact_mut(m).enumerate() {
                    for (i, value) in column.iter_mut().enumerate() {
                        let (low, high) = (i.min(j), i.max(j));
                        *value -= mode[low] * image[high] + image[low] * mode[high];
                    }
                }
            }
        }
        let alpha = if modes.len() < m {
            mean((0..m).map(|i| sum[i * (m + 1)]).sum())
        } else {
            mean(self.kept.iter().map(|&i| self.stiffness.diagonal(i)).sum())
        };
        let alpha = if alpha > 0.0 { alpha } else { 1.0 };
        for mode in modes {
            for (column, a) in sum.chunks_exact_mut(m).zip(mode) {
                for (value, b) in column.iter_mut().zip(mode) {
                    *value += alpha * (a * b);
                }
            }
        }
        sum
    }

    fn body(
        self,
        s: Supported,
        factor: Option<Factor>,
        known: Vec<Vec<f64>>,
        [begin, until_s]: [Instant; 2],
    ) -> Body {
        let m = self.kept.len();
        let flexible = one_norm(&s.inverse, m);
        let condition = s.size * flexible;
        let diagonal = self.kept.iter().map(|&i| self.stiffness.diagonal(i));
        let stiffest = diagonal.fold(0.0, f64::max);
        let mut place = vec![u32::MAX; self.dofs.len()];
        for (k, &i) in (0_u32..).zip(&self.kept) {
            place[i] = k;
        }
        Body {
            dofs: self.dofs,
            stiffness: self.stiffness,
            unit: self.unit,
            kept: self.kept,
            place,
            places: self.places,
            geometry: self.geometry,
            symbolic: self.symbolic,
            ordered: self.ordered,
            factor,
            known,
            cholesky: s.cholesky,
            modes: s.motions.kept,
            motions: s.motions.whole,
            inverse: s.inverse,
            condition,
            amplification: condition.max(stiffest * flexible).max(s.inside),
            seconds: [until_s - begin, until_s.elapsed()].map(|time| time.as_secs_f64()),
        }
    }
}

/// S, made definite.
struct Supported {
    /// Lower Cholesky factor of `S + α R Rᵀ`, column-major.
    cholesky: Vec<f64>,
    /// `(S + α R Rᵀ)⁻¹`.
    inverse: Vec<f64>,
    motions: Motions,
    /// 1-norm of `S + α R Rᵀ`.
    size: f64,
    /// The softness of the interior relative to its diagonal, `1 / weakest pivot`.
    inside: f64,
}

/// The motions without energy.
#[derive(Default)]
struct Motions {
    /// On all degrees of freedom of the body.
    whole: Vec<Vec<f64>>,
    /// `R`, orthonormal on the kept unknowns.
    kept: Vec<Vec<f64>>,
}

/// The softness of an interior relative to its diagonal, from its weakest pivot.
fn softness(weakest: Option<(usize, f64)>) -> f64 {
    weakest.map_or(1.0, |(_, ratio)| ratio.recip())
}

/// Scaling that makes the diagonal of K one at the kept unknowns.
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

/// Undoes the condensation.
fn undo(body: Body) -> AnalysedBody {
    AnalysedBody {
        dofs: body.dofs,
        stiffness: body.stiffness,
        unit: body.unit,
        kept: body.kept,
        places: body.places,
        geometry: body.geometry,
        symbolic: body.symbolic,
        ordered: body.ordered,
        again: false,
    }
}

/// The largest entry of a matrix by absolute value.
#[must_use]
pub fn largest(matrix: &OwnedMatrix) -> f64 {
    matrix.values.iter().fold(0.0, |most, a| a.abs().max(most))
}

fn analyse(
    view: &Symmetric,
    kept: &[usize],
    coordinates: Option<&[[f64; 3]]>,
) -> Result<Symbolic, Error> {
    Symbolic::analyse(view, kept, &Options { coordinates })
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
