//! Finds motions without energy, if only the stiffness itself is known.
//!
//! A motion `x` of a body is null only if `|K x| ≤ C ε |K| |x|` in each row, with `K x` in
//! twice the precision: the digits of K allow no sharper test. A motion that bends softly fails
//! this test and stays elastic, even if its eigenvalue is much smaller than the largest.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;

use crate::condensation::sparse::OwnedMatrix;
use crate::error::Error;
use crate::linalg::compensated;
use crate::linalg::dense;
use crate::linalg::jacobi::combine;
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{dot_long, norm};
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::Symbolic;

/// The shift of inverse iteration, relative to the diagonal of `K`: far above rounding, far
/// below stiff motions. It increases with the rounding.
const SHIFT: f64 = 1e-10;
const RAISE: f64 = 100.0;
const MOST_SHIFT: f64 = 1e-4;

/// Rounds of inverse iteration.
const ROUNDS: usize = 5;

/// Motions stiffer than this many times the shift vanish from the block within [`ROUNDS`], up
/// to rounding. A block that contains such a motion contains all softer ones.
const LOST: f64 = 1e3;

/// `C`. Rigid motions of assembled stiffnesses give 1.2, and the rounding of the motion itself
/// as much again. The softest bending of a steel strip of 1000 mm, clamped at one end, gives
/// 2600 at a thickness of 2 mm and 10 at 0.5 mm.
const ROUNDING: f64 = 6.0;

/// Largest energy of a null motion, as a share of `C ε |x|ᵀ |K| |x|`. Rigid motions give 0.002
/// to 0.06, because roundings have either sign. The bending above gives 117 at 2 mm and 0.47 at
/// 0.5 mm, where rows alone do not decide.
const SHARE: f64 = 0.2;

/// The same if the next motion is stiffer than rounding by [`APART`]: a stiffness that was
/// rotated, scaled or summed elsewhere has more rounding, and bending has no such gap after its
/// first mode.
const ROUNDING_APART: f64 = 200.0;
const APART: f64 = 1e4;

/// Smaller components of a motion count as this share of the largest: they are sums that
/// cancel, and have its rounding.
const LEAST: f64 = 0.1;

/// The softest motions of a body.
#[derive(Debug)]
pub(super) struct SoftestMotions {
    /// Motions without energy, a basis over all degrees of freedom.
    pub null: Vec<Vec<f64>>,
    /// Energy of the next one over its rounding; infinite if there is no next one.
    pub gap: f64,
    /// Whether a motion has negative energy beyond rounding.
    pub negative: bool,
    /// Whether a motion that is not null may have only rounding as its energy.
    pub doubtful: bool,
    /// The largest energy found, relative to the diagonal of K.
    pub stiffest: f64,
}

/// A block of the softest motions, and its shift.
#[derive(Debug)]
pub(super) struct MotionBlock {
    pub columns: Vec<Vec<f64>>,
    pub shift: f64,
    /// `K` with its diagonal increased, if it was factored.
    raised: Option<Raised>,
}

/// `K` with its diagonal increased, factored.
#[derive(Debug)]
struct Raised {
    factor: Factor,
    /// Lower Cholesky factor of its Schur complement.
    s: Vec<f64>,
    kept: Vec<usize>,
}

impl Raised {
    fn solve(&self, f: &mut [f64]) {
        self.factor.condense(f, 1);
        let mut contact: Vec<f64> = self.kept.iter().map(|&i| f[i]).collect();
        dense::solve_lower(&self.s, self.kept.len(), &mut contact, 1);
        dense::solve_lower_transpose(&self.s, self.kept.len(), &mut contact, 1);
        for (&i, value) in self.kept.iter().zip(&contact) {
            f[i] = *value;
        }
        self.factor.recover(f, 1);
    }

    /// `x − (K + σ D)⁻¹ K x` with `K x` in twice the precision: it keeps the part of `x`
    /// without energy to the last digit and removes the stiff part.
    fn soften(&self, k: &OwnedMatrix, x: &mut [f64]) {
        for _ in 0..2 {
            let mut change = k.residual(x, &vec![0.0; x.len()]);
            self.solve(&mut change);
            for (value, change) in x.iter_mut().zip(&change) {
                *value += change;
            }
        }
    }
}

impl SoftestMotions {
    /// Whether the block contained all motions that may be null.
    pub(super) fn is_complete(&self, shift: f64) -> bool {
        self.stiffest >= LOST * shift
    }
}

/// Scaling that makes the diagonal of K one.
#[derive(Debug)]
pub(super) struct DiagonalScaling {
    roots: Vec<f64>,
}

impl DiagonalScaling {
    pub(super) fn new(k: &OwnedMatrix) -> Self {
        let diagonal = k.view().diagonal();
        let root = |&x: &f64| if x > 0.0 { x.sqrt() } else { 1.0 };
        Self {
            roots: diagonal.iter().map(root).collect(),
        }
    }

    /// Gram–Schmidt, twice, in variables in which the diagonal of K is one; first against
    /// `known`. Columns that vanish are dropped.
    fn orthonormalise(&self, known: &[Vec<f64>], block: &mut Vec<Vec<f64>>) {
        let mut done: Vec<Vec<f64>> = Vec::with_capacity(known.len() + block.len());
        for given in known.iter().chain(&*block) {
            let mut x: Vec<f64> = given.iter().zip(&self.roots).map(|(x, w)| x * w).collect();
            let mut lost = false;
            for _ in 0..2 {
                let length = norm(&x);
                if !(length > 0.0 && length.is_finite()) {
                    lost = true;
                    break;
                }
                scale(&mut x, length);
                for q in &done {
                    let along = dot_long(q, &x);
                    for (value, a) in x.iter_mut().zip(q) {
                        *value -= along * a;
                    }
                }
                lost |= norm(&x) < 1e-12;
            }
            let length = norm(&x);
            if lost || !(length > 0.5) {
                continue;
            }
            scale(&mut x, length);
            done.push(x);
        }
        let first = done.len().min(known.len());
        *block = done.split_off(first);
        for x in block {
            for (value, w) in x.iter_mut().zip(&self.roots) {
                *value /= w;
            }
        }
    }

    /// `D x`, D the diagonal of K.
    fn times(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.roots).map(|(x, w)| x * w * w).collect()
    }
}

/// The softest motions of a body with a definite interior: inverse iteration on `S`, whose kept
/// unknowns are scaled to order one, with `x_i = −K_ii⁻¹ K_ic x_c`, corrected until the
/// interior rows are in balance. `None` if `S` is far from semidefinite.
///
/// # Errors
/// [`Error::Interrupted`].
pub(super) fn softest(
    (k, kept, factor): (&OwnedMatrix, &[usize], &Factor),
    schur: &[f64],
    scale: &[f64],
    width: usize,
    stop: &AtomicBool,
) -> Result<Option<MotionBlock>, Error> {
    let m = scale.len();
    let shifted = |shift: f64| {
        let mut a = vec![0.0; m * m];
        let columns = a.chunks_exact_mut(m.max(1));
        for (j, (column, s)) in columns.zip(schur.chunks_exact(m.max(1))).enumerate() {
            for (i, (value, s)) in column.iter_mut().zip(s).enumerate() {
                *value = s * scale[i] * scale[j];
            }
            column[j] += shift;
        }
        a
    };
    let mut shift = SHIFT;
    let factored = loop {
        let mut a = shifted(shift);
        if dense::cholesky(&mut a, m, stop)?.is_none() {
            break a;
        }
        shift *= RAISE;
        if shift > MOST_SHIFT {
            return Ok(None);
        }
    };
    let mut block = starts(m, width.min(m));
    for _ in 0..ROUNDS {
        for column in &mut block {
            dense::solve_lower(&factored, m, column, 1);
            dense::solve_lower_transpose(&factored, m, column, 1);
        }
        orthonormalise_plain(&mut block);
    }
    let whole = |column: &Vec<f64>| {
        let mut x = vec![0.0; k.pointer.len() - 1];
        for ((&i, value), s) in kept.iter().zip(column).zip(scale) {
            x[i] = value * s;
        }
        factor.recover(&mut x, 1);
        for _ in 0..2 {
            let mut left = k.residual(&x, &vec![0.0; x.len()]);
            solve_interior(factor, kept, &mut left);
            for (value, change) in x.iter_mut().zip(&left) {
                *value += change;
            }
        }
        x
    };
    Ok(Some(MotionBlock {
        columns: block.iter().map(whole).collect(),
        shift,
        raised: None,
    }))
}

/// The softest motions of a body whose interior may be singular: inverse iteration on the whole
/// K with its diagonal increased. `None` if this matrix is indefinite.
///
/// # Errors
/// [`Error::Interrupted`].
pub(super) fn softest_of_all(
    (k, kept, symbolic): (&OwnedMatrix, &[usize], &Arc<Symbolic>),
    weights: &DiagonalScaling,
    width: usize,
    stop: &AtomicBool,
) -> Result<Option<MotionBlock>, Error> {
    let mut shift = SHIFT;
    let (factor, s) = loop {
        let mut raised = k.clone();
        for j in 0..raised.pointer.len() - 1 {
            for at in raised.pointer[j]..raised.pointer[j + 1] {
                if raised.index[at] == j {
                    raised.values[at] *= 1.0 + shift;
                }
            }
        }
        match Factor::new(Arc::clone(symbolic), &raised.view(), stop) {
            Ok(mut factor) => {
                let mut s = factor.take_schur();
                if dense::cholesky(&mut s, kept.len(), stop)?.is_none() {
                    break (factor, s);
                }
            }
            Err(Error::Indefinite { .. } | Error::FloatingBody { .. }) => {}
            Err(other) => return Err(other),
        }
        shift *= RAISE;
        if shift > MOST_SHIFT {
            return Ok(None);
        }
    };
    let raised = Raised {
        factor,
        s,
        kept: kept.to_vec(),
    };
    let n = k.pointer.len() - 1;
    let mut block = starts(n, width.min(n));
    for _ in 0..ROUNDS {
        for x in &mut block {
            let mut y = weights.times(x);
            raised.solve(&mut y);
            *x = y;
        }
        weights.orthonormalise(&[], &mut block);
    }
    Ok(Some(MotionBlock {
        columns: block,
        shift,
        raised: Some(raised),
    }))
}

/// The energy of the softest motion of the interior alone that inverse iteration finds,
/// relative to that of the diagonal.
pub(super) fn softest_interior(factor: &Factor, weights: &DiagonalScaling, kept: &[usize]) -> f64 {
    let mut x: Vec<f64> = (0..weights.roots.len()).map(start_value).collect();
    let mut quotient = f64::INFINITY;
    for _ in 0..3 {
        for &i in kept {
            x[i] = 0.0;
        }
        let weighted = weights.times(&x);
        let mut y = weighted.clone();
        solve_interior(factor, kept, &mut y);
        // With K y = D x: yᵀ K y / yᵀ D y = yᵀ D x / yᵀ D y.
        let size = dot_long(&y, &weights.times(&y));
        if !size.is_finite() || size == 0.0 {
            return 0.0;
        }
        quotient = quotient.min(dot_long(&y, &weighted) / size);
        let length = size.sqrt();
        x = y.iter().map(|y| y / length).collect();
    }
    quotient
}

/// `K_ii⁻¹ f_i`, and zero at the kept unknowns.
fn solve_interior(factor: &Factor, kept: &[usize], f: &mut [f64]) {
    factor.condense(f, 1);
    for &i in kept {
        f[i] = 0.0;
    }
    factor.recover(f, 1);
}

/// A start for inverse iteration that is orthogonal to no rigid motion.
fn start_value(k: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a fixed, uneven sequence")]
    let phase = k as f64 * 0.618_033_988_749_895;
    0.5 + phase.fract()
}

/// Independent columns; a basis of the whole space if there are as many.
fn starts(n: usize, width: usize) -> Vec<Vec<f64>> {
    let column = |c: usize| -> Vec<f64> {
        let signs = random_signs(n, c as u64 + 1).into_iter().enumerate();
        signs
            .map(|(k, sign)| sign * start_value(k * width + c + 1))
            .collect()
    };
    (0..width).map(column).collect()
}

/// Gram–Schmidt, twice.
fn orthonormalise_plain(block: &mut [Vec<f64>]) {
    for j in 0..block.len() {
        let (done, rest) = block.split_at_mut(j);
        let column = &mut rest[0];
        for _ in 0..2 {
            normalise(column);
            for q in done.iter() {
                let along = dot_long(q, column);
                for (value, a) in column.iter_mut().zip(q) {
                    *value -= along * a;
                }
            }
        }
        normalise(column);
    }
}

fn scale(column: &mut [f64], length: f64) {
    for x in column {
        *x /= length;
    }
}

fn normalise(column: &mut [f64]) {
    let length = norm(column);
    if length > 0.0 {
        scale(column, length);
    }
}

/// The largest `|K x|` relative to the terms of its row, in ε.
fn rows_of(k: &OwnedMatrix, x: &[f64]) -> f64 {
    let forces = k.residual(x, &vec![0.0; x.len()]);
    let largest = x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let sizes: Vec<f64> = x.iter().map(|x| x.abs().max(LEAST * largest)).collect();
    let mut terms = vec![0.0; x.len()];
    k.add_absolute_product(&sizes, &mut terms);
    let of_row = |(f, t): (&f64, &f64)| if *f == 0.0 { 0.0 } else { f.abs() / t };
    forces.iter().zip(&terms).map(of_row).fold(0.0, f64::max) / f64::EPSILON
}

/// Separates a block of soft motions into those without energy and others, by Rayleigh–Ritz
/// with energies in twice the precision.
pub(super) fn part(
    k: &OwnedMatrix,
    weights: &DiagonalScaling,
    known: &[Vec<f64>],
    MotionBlock {
        columns: mut block,
        raised,
        ..
    }: MotionBlock,
) -> SoftestMotions {
    let mut motions_found = SoftestMotions {
        null: Vec::new(),
        gap: f64::INFINITY,
        negative: false,
        doubtful: false,
        stiffest: 0.0,
    };
    weights.orthonormalise(known, &mut block);
    // Stiff motions of the block disturb the energies of soft ones by rounding: they are
    // removed round by round.
    for aside in [1e-4, 1e-8, 1e-12, 0.0] {
        let images: Vec<Vec<f64>> = block
            .par_iter()
            .map(|x| k.residual(x, &vec![0.0; x.len()]))
            .collect();
        let width = block.len();
        let mut energies = vec![0.0; width * width];
        for i in 0..width {
            for j in 0..=i {
                let value = -compensated::dot(&block[i], &images[j]).value();
                energies[j * width + i] = value;
                energies[i * width + j] = value;
            }
        }
        let mut values = vec![0.0; width];
        dense::symmetric_eigen(&mut energies, width, &mut values);
        let mut order: Vec<usize> = (0..width).collect();
        order.sort_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs()));
        let ritz = |&j: &usize| combine(&block, &energies[j * width..(j + 1) * width]);
        let mut all: Vec<Vec<f64>> = order.iter().map(ritz).collect();
        let mut values: Vec<f64> = order.iter().map(|&j| values[j]).collect();
        motions_found.stiffest = values
            .last()
            .map_or(0.0, |v| v.abs())
            .max(motions_found.stiffest);
        if aside > 0.0 {
            let soft = values.iter().take_while(|v| v.abs() <= aside).count();
            if soft < width {
                motions_found.gap =
                    motions_found
                        .gap
                        .min(over_rounding(k, &all[soft], values[soft]));
                let stiff = values[soft..].iter().zip(&all[soft..]);
                let negative =
                    |(v, x): (&f64, &Vec<f64>)| *v < 0.0 && over_rounding(k, x, *v) > 1.0;
                motions_found.negative |= stiff.into_iter().any(negative);
            }
            block = all.into_iter().take(soft).collect();
            continue;
        }
        if let Some(raised) = &raised {
            // If a soft part moves with a stiff one, unit length is that of the stiff one, and
            // its rounding is large relative to the small entries of the soft one.
            all.par_iter_mut().for_each(|x| {
                raised.soften(k, x);
                let length = dot_long(x, &weights.times(x)).sqrt();
                scale(x, length);
            });
            values = all.iter().map(|x| energy(k, x)).collect();
        }
        let rows: Vec<f64> = all.iter().map(|x| rows_of(k, x)).collect();
        let gaps = all.iter().zip(&values);
        let gaps: Vec<f64> = gaps.map(|(x, &v)| over_rounding(k, x, v)).collect();
        let rest = motions_found.gap;
        let clear = rows
            .iter()
            .take_while(|&&row| row <= ROUNDING_APART)
            .count();
        let next = gaps[clear..]
            .iter()
            .fold(rest, |least, &gap| least.min(gap));
        let (bound, share) = if next >= APART {
            (ROUNDING_APART, f64::INFINITY)
        } else {
            (ROUNDING, SHARE)
        };
        for (at, x) in all.into_iter().enumerate() {
            if rows[at] <= bound && gaps[at] <= share {
                motions_found.null.push(x);
                continue;
            }
            motions_found.negative |= values[at] < 0.0 && gaps[at] > 1.0;
            motions_found.doubtful |= gaps[at] <= 1.0;
            motions_found.gap = motions_found.gap.min(gaps[at]);
        }
    }
    motions_found
}

/// `xᵀ K x`.
fn energy(k: &OwnedMatrix, x: &[f64]) -> f64 {
    -compensated::dot(x, &k.residual(x, &vec![0.0; x.len()])).value()
}

/// An energy `xᵀ K x` over the rounding error of K.
fn over_rounding(k: &OwnedMatrix, x: &[f64], energy: f64) -> f64 {
    let sizes: Vec<f64> = x.iter().map(|x| x.abs()).collect();
    energy.abs() / (ROUNDING * f64::EPSILON * k.absolute_form(&sizes)).max(f64::MIN_POSITIVE)
}
