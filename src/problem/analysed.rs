//! A body before it is condensed: ordered and counted, then factored, its S and the
//! rigid motions that its supports leave free.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::error::Error;
use crate::linalg::binary::{exponent, times_two_to};
use crate::linalg::csc::Symmetric;
use crate::linalg::dense;
use crate::linalg::multifrontal::{Factor, Schur};
use crate::linalg::small::{dot_long, norm};
use crate::linalg::symbolic::{Counts, Options, Symbolic};
use crate::problem::body::{Body, DIGITS};
use crate::problem::null_space::{null_space, start_value};
use crate::problem::patterns::Asked;
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

/// A body before its numbers: what condensing it will take is known.
#[derive(Debug)]
pub struct Analysed {
    dofs: Vec<usize>,
    stiffness: Owned,
    unit: f64,
    kept: Vec<usize>,
    places: Option<Vec<[f64; 3]>>,
    symbolic: Arc<Symbolic>,
    /// Whether it had to be ordered: no analysis of its pattern was at hand.
    ordered: bool,
    /// Whether the analysis is that of the same body with other values.
    again: bool,
}

impl Analysed {
    /// Orders and counts; the analysis of the same body with other values is used
    /// again, or else the one `known` of its pattern. `kept` are local numbers, `places`
    /// those of the degrees of freedom in space, where they are known.
    ///
    /// # Errors
    /// [`Error::IndexRange`] for more entries than 32-bit indices can number.
    pub fn new(
        dofs: Vec<usize>,
        mut stiffness: Owned,
        kept: Vec<usize>,
        places: Option<Vec<[f64; 3]>>,
        before: Option<&Body>,
        known: Option<Arc<Symbolic>>,
    ) -> Result<Self, Error> {
        let stiffest = stiffness.values.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
        let unit = times_two_to(1.0, -exponent(stiffest).clamp(-1000, 1000));
        stiffness.values.iter_mut().for_each(|a| *a *= unit);
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
            symbolic,
            ordered,
            again,
        })
    }

    /// Keeps an analysis that was made here for other problems of its pattern.
    pub fn share(&self) {
        if self.ordered {
            let asked = Asked {
                matrix: self.stiffness.view(),
                kept: &self.kept,
                places: self.places.as_deref(),
            };
            asked.keep(&self.symbolic);
        }
    }

    /// The same body with other unknowns kept.
    ///
    /// # Errors
    /// As [`Analysed::new`].
    pub fn again(body: &Body, kept: Vec<usize>) -> Result<Self, Error> {
        let stiffness = body.stiffness.clone();
        let symbolic = analyse(&stiffness.view(), &kept, body.places.as_deref())?;
        Ok(Self {
            dofs: body.dofs.clone(),
            symbolic: Arc::new(symbolic),
            unit: body.unit,
            places: body.places.clone(),
            stiffness,
            kept,
            ordered: true,
            again: false,
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

    /// Bytes that it holds for the factor, from one of the same pattern that is gone.
    #[must_use]
    pub fn bytes_spare(&self) -> u128 {
        self.symbolic.bytes_spare() as u128
    }

    /// Bytes that a factorisation after another takes more, if it leaves its stack to the
    /// one after it: S is then made beside that. 0 for the first of an analysis.
    #[must_use]
    pub fn bytes_left(&self) -> u128 {
        if self.again {
            self.symbolic.bytes_stack() as u128 + 8 * (self.counts().kept as u128).pow(2)
        } else {
            0
        }
    }

    /// Says whether it does so: where there were two matrices, there will be more.
    pub fn leave_stack(&self, leave: bool) {
        self.symbolic.keep_stack(leave && self.again);
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
            && let Some((s, known, until_s)) = self.without_factor(loads, stop)?
        {
            let body = self.body(s, None, known, [begin, until_s], stop)?;
            if body.amplification <= DIGITS {
                return Ok(body);
            }
            // Answers will be mended with K itself, by the factor.
            return undo(body).condense(dimension, None, stop);
        }
        let view = self.stiffness.view();
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
        let until_s = Instant::now();
        let s = match self.definite(&schur, &scale, stop)? {
            Some(s) => s,
            None => self.with_rigid_motions(&schur, &scale, &factor, dimension, stop)?,
        };
        drop(schur);
        self.body(s, Some(factor), Vec::new(), [begin, until_s], stop)
    }

    /// S factored, the kept part of the loads condensed, and when S was done, where there
    /// is no doubt that supports hold the body: a doubt is only settled with the factor.
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
        let schur = Schur::new(&self.symbolic, &view, &mut local, stop)
            .map_err(|e| renumber(e, &self.dofs))?;
        if schur.weakest_pivot().is_some_and(|(_, ratio)| ratio < SAFE) {
            return Ok(None);
        }
        let scale = scales(&self.kept, &view.diagonal());
        let until_s = Instant::now();
        let Some(s) = self.definite(schur.values(), &scale, stop)? else {
            return Ok(None);
        };
        let columns = local.chunks_exact(self.dofs.len().max(1));
        let part = |column: &[f64]| self.kept.iter().map(|&i| column[i]).collect();
        Ok(Some((s, columns.map(part).collect(), until_s)))
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
            }),
        }
    }

    fn body(
        self,
        s: Supported,
        factor: Option<Factor>,
        known: Vec<Vec<f64>>,
        [begin, until_s]: [Instant; 2],
        stop: &AtomicBool,
    ) -> Result<Body, Error> {
        let m = self.kept.len();
        let mut inverse = s.cholesky.clone();
        dense::invert_from_cholesky(&mut inverse, m, stop)?;
        let flexible = one_norm(&inverse, m);
        let condition = s.size * flexible;
        let diagonal = self.kept.iter().map(|&i| self.stiffness.diagonal(i));
        let stiffest = diagonal.fold(0.0, f64::max);
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
            ordered: self.ordered,
            factor,
            known,
            cholesky: s.cholesky,
            modes: s.modes,
            inverse,
            condition,
            amplification: condition.max(stiffest * flexible),
            seconds: [until_s - begin, until_s.elapsed()].map(|time| time.as_secs_f64()),
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

/// A body before its numbers.
fn undo(body: Body) -> Analysed {
    Analysed {
        dofs: body.dofs,
        stiffness: body.stiffness,
        unit: body.unit,
        kept: body.kept,
        places: body.places,
        symbolic: body.symbolic,
        ordered: body.ordered,
        again: false,
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
