//! Separates soft motions into those without energy and others, part 2 of the theorem.
//!
//! A motion `x` of a body is free only if `|K x| ≤ C ε |K| |x|` in each row, with `K x` in
//! twice the precision: the digits of K allow no sharper test. A motion that bends softly fails
//! this test and stays elastic, even if its eigenvalue is much smaller than the largest.

use rayon::prelude::*;

use crate::bodies::softest::{DiagonalScaling, MotionBlock, Raised, scale};
use crate::bodies::tuning;
use crate::linalg::compensated;
use crate::linalg::dense;
use crate::linalg::jacobi::combine;
use crate::linalg::small::{amax, dot_long};
use crate::linalg::sparse::rows::OwnedMatrix;

/// Motions stiffer than this many times the shift vanish from the block within the rounds of
/// inverse iteration, up to rounding: its fifth power is 1e15. A block that contains such a
/// motion contains all softer ones.
const LOST: f64 = 1e3;

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
    stiffest: f64,
}

/// A motion of unit length, orthogonal in energy to the others, and its energy `xᵀ K x`.
struct RitzMotion {
    x: Vec<f64>,
    energy: f64,
}

impl SoftestMotions {
    /// Separates a block of soft motions by Rayleigh–Ritz with energies in twice the precision;
    /// `removed` are motions that are known to be free.
    pub(super) fn separate(
        k: &OwnedMatrix,
        weights: &DiagonalScaling,
        removed: &[Vec<f64>],
        MotionBlock {
            columns: mut block,
            raised,
            ..
        }: MotionBlock,
    ) -> Self {
        let mut softest = Self {
            null: Vec::new(),
            gap: f64::INFINITY,
            negative: false,
            doubtful: false,
            stiffest: 0.0,
        };
        weights.orthonormalise(removed, &mut block);
        // Stiff motions of the block disturb the energies of soft ones by rounding: they are
        // removed round by round.
        for aside in [1e-4, 1e-8, 1e-12] {
            let motions = softest.find_ritz_motions(k, &block);
            block = softest.set_aside(k, motions, aside);
        }
        let mut motions = softest.find_ritz_motions(k, &block);
        if let Some(raised) = &raised {
            sharpen(k, weights, raised, &mut motions);
        }
        softest.judge(k, motions);
        softest
    }

    /// Whether the block contained all motions that may be null.
    pub(super) fn is_complete(&self, shift: f64) -> bool {
        self.stiffest >= LOST * shift
    }

    /// The motions of the space of a block, softest first.
    fn find_ritz_motions(&mut self, k: &OwnedMatrix, block: &[Vec<f64>]) -> Vec<RitzMotion> {
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
        let ritz = |&j: &usize| RitzMotion {
            x: combine(block, &energies[j * width..(j + 1) * width]),
            energy: values[j],
        };
        let motions: Vec<RitzMotion> = order.iter().map(ritz).collect();
        let stiffest = motions.last().map_or(0.0, |motion| motion.energy.abs());
        self.stiffest = stiffest.max(self.stiffest);
        motions
    }

    /// The motions with at most this energy; of the others it keeps what tells.
    fn set_aside(
        &mut self,
        k: &OwnedMatrix,
        motions: Vec<RitzMotion>,
        aside: f64,
    ) -> Vec<Vec<f64>> {
        let is_soft = |motion: &&RitzMotion| motion.energy.abs() <= aside;
        let soft = motions.iter().take_while(is_soft).count();
        if let Some(next) = motions.get(soft) {
            self.gap = self.gap.min(next.over_rounding(k));
        }
        let is_negative =
            |motion: &RitzMotion| motion.energy < 0.0 && motion.over_rounding(k) > 1.0;
        self.negative |= motions[soft..].iter().any(is_negative);
        motions
            .into_iter()
            .take(soft)
            .map(|motion| motion.x)
            .collect()
    }

    /// Decides which of the last motions have no energy.
    fn judge(&mut self, k: &OwnedMatrix, motions: Vec<RitzMotion>) {
        let rows: Vec<f64> = motions.iter().map(|motion| motion.largest_row(k)).collect();
        let gaps: Vec<f64> = motions
            .iter()
            .map(|motion| motion.over_rounding(k))
            .collect();
        let clear = rows
            .iter()
            .take_while(|&&row| row <= tuning::rounding_apart())
            .count();
        let next = gaps[clear..]
            .iter()
            .fold(self.gap, |least, &gap| least.min(gap));
        let (bound, share) = if next >= tuning::apart() {
            (tuning::rounding_apart(), f64::INFINITY)
        } else {
            (tuning::rounding(), tuning::energy_share())
        };
        for (motion, (row, gap)) in motions.into_iter().zip(rows.into_iter().zip(gaps)) {
            if row <= bound && gap <= share {
                self.null.push(motion.x);
                continue;
            }
            self.negative |= motion.energy < 0.0 && gap > 1.0;
            self.doubtful |= gap <= 1.0;
            self.gap = self.gap.min(gap);
        }
    }
}

/// Removes the stiff part of motions. If a soft part moves with a stiff one, unit length is that
/// of the stiff one, and its rounding is large relative to the small entries of the soft one.
fn sharpen(
    k: &OwnedMatrix,
    weights: &DiagonalScaling,
    raised: &Raised,
    motions: &mut [RitzMotion],
) {
    motions.par_iter_mut().for_each(|motion| {
        raised.soften(k, &mut motion.x);
        let length = dot_long(&motion.x, &weights.times(&motion.x)).sqrt();
        scale(&mut motion.x, length);
    });
    for motion in motions {
        let forces = k.residual(&motion.x, &vec![0.0; motion.x.len()]);
        motion.energy = -compensated::dot(&motion.x, &forces).value();
    }
}

/// The rounding of an entry of a sparse `K` is ε of it. The entries of a full `K` of order `n`,
/// a condensed stiffness, are sums of `n` products, which may be as large as its largest entry:
/// 4 n ε against the [`tuning::rounding`] of a sparse one, and this entry; for a sparse one zero.
fn rounding_of(k: &OwnedMatrix) -> (f64, f64) {
    let n = k.pointer.len() - 1;
    // `K` holds one triangle or both.
    if 2 * k.values.len() < n * (n + 1) {
        return (f64::EPSILON, 0.0);
    }
    #[expect(clippy::cast_precision_loss, reason = "an estimate")]
    let terms = 4.0 * n as f64 / tuning::rounding();
    (terms.max(1.0) * f64::EPSILON, amax(&k.values))
}

impl RitzMotion {
    /// The largest `|K x|` relative to the terms of its row, in roundings of `K`.
    fn largest_row(&self, k: &OwnedMatrix) -> f64 {
        let x = &self.x;
        let forces = k.residual(x, &vec![0.0; x.len()]);
        let largest = amax(x);
        let sizes: Vec<f64> = x.iter().map(|x| x.abs().max(LEAST * largest)).collect();
        let mut terms = vec![0.0; x.len()];
        k.add_absolute_product(&sizes, &mut terms);
        let (rounding, entry) = rounding_of(k);
        for term in &mut terms {
            *term = term.max(entry * largest);
        }
        let of_row = |(f, t): (&f64, &f64)| if *f == 0.0 { 0.0 } else { f.abs() / t };
        let worst = forces.iter().zip(&terms).map(of_row).fold(0.0, f64::max);
        worst / rounding
    }

    /// The energy over the rounding error of K.
    fn over_rounding(&self, k: &OwnedMatrix) -> f64 {
        let sizes: Vec<f64> = self.x.iter().map(|x| x.abs()).collect();
        let (rounding, entry) = rounding_of(k);
        let terms = k
            .absolute_form(&sizes)
            .max(entry * dot_long(&sizes, &sizes));
        let rounding = tuning::rounding() * rounding * terms;
        self.energy.abs() / rounding.max(f64::MIN_POSITIVE)
    }
}
