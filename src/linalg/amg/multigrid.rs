//! The multigrid preconditioner: its levels and their use.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::cycle::{CycleMemory, visit};
use crate::linalg::amg::hierarchy::{Made, make_levels};
use crate::linalg::amg::level::Level;
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::scaled_blocks::ScaledBlocks;
use crate::linalg::amg::settings::CycleSettings;
use crate::linalg::parallel::{largest, map2};
use crate::linalg::power_of_two::{exponent, factors};
use crate::linalg::real::Real;

/// Checks the lengths of what a hierarchy is made of.
pub(super) fn check_lengths(b: usize, nodes: usize, about: &LevelNodes, held: &[bool]) {
    let n = b * nodes;
    let m = if b == 2 { 3 } else { 6 };
    assert_eq!(held.len(), n);
    assert_eq!(about.motions.len(), n * m);
    assert!(about.coordinates.is_empty() || about.coordinates.len() == n);
    assert!(about.bodies.is_empty() || about.bodies.len() == nodes);
}

/// Smoothed aggregation for elasticity [Vaněk, Mandel & Brezina 1996], in single precision.
#[derive(Clone, Debug)]
pub struct Multigrid {
    pub(super) levels: Vec<Level>,
    coarsest: Coarsest,
    work: Vec<CycleMemory>,
    settings: CycleSettings,
    exponent: i32,
    b: Vec<f32>,
    x: Vec<f32>,
}

impl Multigrid {
    /// Builds all levels. The motions of `about` count as zero at `held` unknowns, which must be
    /// held in the matrix too.
    pub fn new(
        mut matrix: BlockMatrix,
        about: LevelNodes,
        held: &[bool],
        settings: &CycleSettings,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        check_lengths(matrix.b, matrix.nodes(), &about, held);
        for (known, &new) in matrix.held.iter_mut().zip(held) {
            *known |= new;
        }
        let mut whole = Self::empty(held.len(), matrix.exponent, settings);
        let level = |made: Made, matrix| made.level(ScaledBlocks::replace(matrix));
        let (levels, last) = make_levels(matrix, about, settings.spectrum, level, stop)?;
        whole.replace(levels, Coarsest::new(&last, stop)?);
        Ok(whole)
    }

    /// For `n` unknowns, without levels.
    pub(super) fn empty(n: usize, exponent: i32, settings: &CycleSettings) -> Self {
        Self {
            levels: Vec::new(),
            coarsest: Coarsest::none(),
            work: Vec::new(),
            settings: CycleSettings {
                degree: settings.degree.clamp(1, 4),
                ..*settings
            },
            exponent,
            b: vec![0.0; n],
            x: vec![0.0; n],
        }
    }

    /// Takes other levels.
    pub(super) fn replace(&mut self, levels: Vec<Level>, coarsest: Coarsest) {
        self.work = (1..=levels.len())
            .map(|k| match levels.get(k) {
                Some(level) => CycleMemory::new(level.x.len()),
                None => CycleMemory::new(coarsest.unknowns()),
            })
            .collect();
        self.levels = levels;
        self.coarsest = coarsest;
    }

    /// Takes another factor of the coarsest level.
    pub(super) fn replace_coarsest(&mut self, coarsest: Coarsest) {
        if let Some(work) = self.work.last_mut() {
            *work = CycleMemory::new(coarsest.unknowns());
        }
        self.coarsest = coarsest;
    }

    /// Changes the degree of the smoother.
    pub fn set_degree(&mut self, degree: usize) {
        self.settings.degree = degree.clamp(1, 4);
    }

    /// `x ≈ A⁻¹ b`.
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
        let shared = (&self.coarsest, self.settings.degree);
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

    /// Memory of all levels.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(Level::bytes).sum::<usize>()
            + self.work.iter().map(CycleMemory::bytes).sum::<usize>()
            + self.coarsest.bytes()
            + 4 * (self.b.len() + self.x.len())
    }
}
