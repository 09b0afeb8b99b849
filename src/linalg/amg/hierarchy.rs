//! Set-up of the levels.

use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_running};
use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::galerkin::galerkin;
use crate::linalg::amg::inverse_diagonal::inverse_diagonal;
use crate::linalg::amg::level::Level;
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::prolongation::{Prolongation, Smoothed};
use crate::linalg::amg::scaled_blocks::ScaledBlocks;
use crate::linalg::amg::single_rows::LevelMatrix;
use crate::linalg::amg::spectrum::bound;
use crate::linalg::amg::tentative::Tentative;
use crate::linalg::amg::tuning;

/// Each level has at most a third of the unknowns of the one before: nobody has a matrix with
/// more levels.
const MOST_LEVELS: usize = 30;
pub(super) fn failure(reason: &'static str) -> Error {
    Error::Multigrid { reason }
}

/// `ω` of a level, from the bound of its spectrum.
pub(super) fn omega(spectrum: f64) -> f64 {
    tuning::omega() / spectrum
}

/// What a level is made of, but for its own form of the matrix.
pub(super) struct Made {
    inverse: Vec<f32>,
    spectrum: f64,
    pub(super) p: Prolongation,
    pub(super) aggregates: Aggregates,
    pub(super) tentative: Tentative,
}

impl Made {
    /// The level with its own form of the matrix.
    pub(super) fn level(self, own: ScaledBlocks) -> Level {
        Level::new(own, self.inverse, self.spectrum, self.p)
    }

    /// The level, and what following needs of it: its matrix or some rows.
    pub(super) fn keep(self, own: ScaledBlocks, matrix: BlockMatrix) -> (Level, Kept) {
        let kept = Kept {
            matrix,
            aggregates: self.aggregates,
            tentative: self.tentative,
        };
        (Level::new(own, self.inverse, self.spectrum, self.p), kept)
    }
}

/// What is left of the set-up of a level.
#[derive(Debug)]
pub(super) struct Kept {
    /// The matrix of the level in single precision, or some rows.
    pub(super) matrix: BlockMatrix,
    pub(super) aggregates: Aggregates,
    pub(super) tentative: Tentative,
}

/// Makes all of a level but its own form of the matrix, and the next matrix `Pᵀ A P`, with zeros
/// for unknowns without a motion. The motions of `about` count as zero at `held` unknowns. `spectrum` is a bound
/// of the eigenvalues of `D⁻¹ A`, if it is known.
pub(super) fn level(
    matrix: LevelMatrix<'_>,
    about: &LevelNodes,
    held: &[bool],
    spectrum: Option<f64>,
    stop: &AtomicBool,
) -> Result<(Made, BlockMatrix), Error> {
    check_running(stop)?;
    let inverse = inverse_diagonal(matrix)
        .ok_or(failure("a diagonal entry is not positive, or not finite"))?;
    let spectrum = spectrum
        .or_else(|| match matrix {
            LevelMatrix::Whole(matrix) => bound(matrix.b, &inverse, |x, y| matrix.product(x, y)),
            LevelMatrix::Made(rows) => rows.spectrum(),
        })
        .filter(|bound| *bound > 0.0 && bound.is_finite())
        .ok_or(failure(
            "the spectrum of a level is not positive and finite",
        ))?;
    check_running(stop)?;
    let aggregates = Aggregates::new(matrix, about);
    let unknowns = matrix.b() * matrix.nodes();
    let m = about.motions.len() / unknowns;
    if aggregates.count() * m * 3 > unknowns * 2 {
        return Err(failure(
            "the nodes of a level are not coupled to one another",
        ));
    }
    let tentative = Tentative::new(&aggregates, &about.motions, held, matrix.b(), m);
    check_running(stop)?;
    let of = Smoothed {
        matrix,
        inverse: &inverse,
        aggregates: &aggregates,
        tentative: &tentative,
        motions: &about.motions,
        omega: omega(spectrum),
    };
    let p = Prolongation::new(&of, m);
    check_running(stop)?;
    let coarse = galerkin(matrix, &p);
    let made = Made {
        inverse,
        spectrum,
        p,
        aggregates,
        tentative,
    };
    Ok((made, coarse))
}

/// Makes levels until a dense factor is small, and the matrix of this; `spectrum` is that of the
/// finest, if it is known. `end` makes of a level and its matrix what the caller keeps.
pub(super) fn make_levels<T>(
    mut matrix: BlockMatrix,
    mut about: LevelNodes,
    mut spectrum: Option<f64>,
    end: impl Fn(Made, BlockMatrix) -> T,
    stop: &AtomicBool,
) -> Result<(Vec<T>, BlockMatrix), Error> {
    let mut list = Vec::new();
    while matrix.b * matrix.nodes() > tuning::dense_unknowns() && list.len() < MOST_LEVELS {
        let own = LevelMatrix::Whole(&matrix);
        let (made, mut coarse) = level(own, &about, &matrix.held, spectrum.take(), stop)?;
        coarse.replace_dead(&made.tentative.dead);
        about = made.aggregates.coarse(&about, &made.tentative);
        list.push(end(made, matrix));
        matrix = coarse;
    }
    check_running(stop)?;
    if matrix.b * matrix.nodes() > 4 * tuning::dense_unknowns() {
        return Err(failure("the levels do not become coarser"));
    }
    Ok((list, matrix))
}

impl BlockMatrix {
    /// Gives unknowns without a column of `T` the largest diagonal of their node: their rows and
    /// columns are zero, or were given it before.
    pub(super) fn replace_dead(&mut self, dead: &[bool]) {
        let b = self.b;
        let size = b * b;
        for (node, dead) in dead.chunks_exact(b).enumerate() {
            if !dead.contains(&true) {
                continue;
            }
            let at = self.diagonal(node);
            let block = &mut self.values[at * size..(at + 1) * size];
            let largest = (0..b).map(|l| block[l * b + l]).fold(0.0, f32::max);
            for l in (0..b).filter(|&l| dead[l]) {
                block[l * b + l] = if largest > 0.0 { largest } else { 1.0 };
            }
        }
    }
}
