//! The hierarchy of levels: set-up and use.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::error::Error;
use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::cycle::{Shared, Work, visit};
use crate::linalg::amg::galerkin::galerkin;
use crate::linalg::amg::inverse_diagonal::inverse_diagonal;
use crate::linalg::amg::level::Level;
use crate::linalg::amg::nodes::Nodes;
use crate::linalg::amg::prolongation::Prolongation;
use crate::linalg::amg::settings::{Cycle, Settings};
use crate::linalg::amg::spectrum::bound;
use crate::linalg::amg::tentative::Tentative;
use crate::linalg::parallel::{largest, map2};
use crate::linalg::power_of_two::{exponent, factors};
use crate::linalg::real::Real;

/// At most so many unknowns are solved with a dense factor.
pub(super) const DENSE: usize = 800;
/// Each level has at most a third of the unknowns of the one before: nobody has a matrix with
/// more levels.
const MOST_LEVELS: usize = 30;
/// `ω λ` of the smoothed prolongation.
const OMEGA: f64 = 4.0 / 3.0;

/// Smoothed aggregation for elasticity [Vaněk, Mandel & Brezina 1996], in single precision.
#[derive(Clone, Debug)]
pub struct Multigrid {
    levels: Vec<Level>,
    coarsest: Coarsest,
    work: Vec<Work>,
    settings: Settings,
    exponent: i32,
    spectrum: f64,
    /// Stored numbers of all levels, and of the finest.
    entries: [usize; 2],
    b: Vec<f32>,
    x: Vec<f32>,
}

fn failure(reason: &'static str) -> Error {
    Error::Multigrid { reason }
}

impl Multigrid {
    /// Builds all levels. The motions of `about` are zeroed at `held` unknowns, which must be held
    /// in the matrix too.
    ///
    /// # Errors
    /// [`Error::Multigrid`] if a diagonal is not positive, a number leaves the range, the levels
    /// do not become coarser, or the coarsest is not positive definite; [`Error::Interrupted`]
    /// if `stop` is set.
    ///
    /// # Panics
    /// If an argument has another length.
    pub fn new(
        mut matrix: BlockMatrix<f32>,
        mut about: Nodes,
        held: &[bool],
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let n = matrix.b * matrix.nodes();
        let m = if matrix.b == 2 { 3 } else { 6 };
        assert_eq!(held.len(), n);
        assert_eq!(about.motions.len(), n * m);
        assert_eq!(about.coordinates.len(), n);
        assert!(about.bodies.is_empty() || about.bodies.len() == matrix.nodes());
        let settings = Settings {
            degree: settings.degree.clamp(1, 4),
            ..*settings
        };
        let exponent = matrix.exponent;
        let finest = matrix.values.len();
        let mut entries = 0;
        let rows = about.motions.chunks_exact_mut(m);
        for ((row, &held), &absent) in rows.zip(held).zip(&matrix.held) {
            if held || absent {
                row.fill(0.0);
            }
        }
        let running = || {
            let stopped = stop.load(Ordering::Relaxed);
            if stopped {
                Err(Error::Interrupted)
            } else {
                Ok(())
            }
        };
        let mut levels: Vec<Level> = Vec::new();
        while matrix.b * matrix.nodes() > DENSE && levels.len() < MOST_LEVELS {
            running()?;
            let inverse = inverse_diagonal(&matrix)
                .ok_or(failure("a diagonal entry is not positive, or not finite"))?;
            let known = settings.spectrum.filter(|_| levels.is_empty());
            let spectrum = known
                .or_else(|| bound(&matrix, &inverse))
                .filter(|bound| *bound > 0.0 && bound.is_finite())
                .ok_or(failure(
                    "the spectrum of a level is not positive and finite",
                ))?;
            running()?;
            let aggregates = Aggregates::new(&matrix, &about);
            let unknowns = matrix.b * matrix.nodes();
            if aggregates.count() * m * 3 > unknowns * 2 {
                return Err(failure(
                    "the nodes of a level are not coupled to one another",
                ));
            }
            let tentative = Tentative::new(&aggregates, &about.motions, matrix.b, m);
            running()?;
            let omega = OMEGA / spectrum;
            let p = Prolongation::new(&matrix, &inverse, &aggregates, &tentative, &about, omega, m);
            running()?;
            let mut coarse = galerkin(&matrix, &p);
            coarse.replace_dead(&tentative.dead);
            about = aggregates.coarse(&about, tentative.coarse);
            entries += matrix.values.len();
            levels.push(Level::new(matrix, inverse, spectrum, p));
            matrix = coarse;
        }
        running()?;
        if matrix.b * matrix.nodes() > 4 * DENSE {
            return Err(failure("the levels do not become coarser"));
        }
        entries += matrix.values.len();
        let coarsest = Coarsest::new(&matrix, stop)?;
        let count = levels.len();
        let work = (1..=count)
            .map(|k| match levels.get(k) {
                Some(level) => Work::new(level.x.len(), settings.cycle == Cycle::K),
                None => Work::new(coarsest.unknowns(), false),
            })
            .collect();
        Ok(Self {
            spectrum: levels.first().map_or(1.0, |level| level.spectrum),
            levels,
            coarsest,
            work,
            settings,
            exponent,
            entries: [entries, finest],
            b: vec![0.0; n],
            x: vec![0.0; n],
        })
    }

    /// `x ≈ A⁻¹ b`.
    ///
    /// # Panics
    /// If `b` or `x` has another length than the matrix.
    pub fn apply(&mut self, b: &[f64], x: &mut [f64]) {
        assert_eq!(b.len(), self.b.len());
        assert_eq!(x.len(), self.b.len());
        let size = largest(b);
        if size == 0.0 || !size.is_finite() {
            x.fill(if size == 0.0 { 0.0 } else { f64::NAN });
            return;
        }
        let shift = exponent(size);
        let [first, second] = factors(-shift);
        map2(&mut self.b, b, |_, b| f32::rounded(b * first * second));
        let shared = Shared {
            coarsest: &self.coarsest,
            degree: self.settings.degree,
            cycle: self.settings.cycle,
        };
        visit(
            &mut self.levels,
            &mut self.work,
            &self.b,
            &mut self.x,
            shared,
        );
        let [first, second] = factors(shift - self.exponent);
        map2(x, &self.x, |_, x: f32| x.double() * first * second);
    }

    /// The bound of [`Multigrid::spectrum`] for a matrix, without its levels; `None` if a diagonal
    /// is not positive, or numbers are not finite.
    #[must_use]
    pub fn spectrum_of(matrix: &BlockMatrix<f32>) -> Option<f64> {
        let inverse = inverse_diagonal(matrix)?;
        bound(matrix, &inverse).filter(|bound| *bound > 0.0 && bound.is_finite())
    }

    /// A bound of the eigenvalues of `D⁻¹ A` on the finest level. It holds for every matrix that
    /// holds more unknowns, or adds positive semidefinite diagonal blocks: both restrict the
    /// Rayleigh quotient or move it towards one.
    #[must_use]
    pub fn spectrum(&self) -> f64 {
        self.spectrum
    }

    /// Number of levels, with the coarsest.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.levels.len() + 1
    }

    /// Stored numbers of all matrices, relative to those of the finest.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a ratio of counts")]
    pub fn operator_complexity(&self) -> f64 {
        self.entries[0] as f64 / self.entries[1] as f64
    }

    /// Memory of all levels.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(Level::bytes).sum::<usize>()
            + self.work.iter().map(Work::bytes).sum::<usize>()
            + self.coarsest.bytes()
            + 4 * (self.b.len() + self.x.len())
    }
}

impl BlockMatrix<f32> {
    /// Gives unknowns without a column of `T` the mean diagonal of their node: their rows and
    /// columns are zero.
    fn replace_dead(&mut self, dead: &[bool]) {
        let b = self.b;
        let size = b * b;
        let own: Vec<usize> = (0..self.nodes())
            .into_par_iter()
            .map(|i| self.diagonal(i))
            .collect();
        for (&at, dead) in own.iter().zip(dead.chunks_exact(b)) {
            if !dead.contains(&true) {
                continue;
            }
            let block = &mut self.values[at * size..(at + 1) * size];
            let largest = (0..b).map(|l| block[l * b + l]).fold(0.0, f32::max);
            for l in (0..b).filter(|&l| dead[l]) {
                block[l * b + l] = if largest > 0.0 { largest } else { 1.0 };
            }
        }
    }
}
