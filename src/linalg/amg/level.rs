//! One level with its smoother and its work vectors.

use crate::linalg::amg::block_rows::{StepCoefficients, first_step, residual, step};
use crate::linalg::amg::prolongation::Prolongation;
use crate::linalg::amg::scaled_blocks::ScaledBlocks;
use crate::linalg::real::Real;

/// A matrix, and the way to the next level.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) matrix: ScaledBlocks,
    pub(super) inverse: Vec<f32>,
    /// Bound of the eigenvalues of `D⁻¹ A`.
    pub(super) spectrum: f64,
    pub(super) p: Prolongation,
    /// The iterate; after a cycle, its result.
    pub(super) x: Vec<f32>,
    other: Vec<f32>,
    direction: Vec<f32>,
    residual: Vec<f32>,
}

/// Factors `β` of the optimal Chebyshev smoother of the fourth kind, by degree [Phillips &
/// Fischer 2022, table 1].
const BETA: [&[f64]; 4] = [
    &[1.125],
    &[1.023_872_875_703_13, 1.264_089_053_710_85],
    &[
        1.008_425_447_820_28,
        1.088_678_392_087_30,
        1.337_531_259_096_18,
    ],
    &[
        1.003_913_104_272_85,
        1.040_358_111_885_93,
        1.148_634_985_462_54,
        1.382_688_692_410_00,
    ],
];

impl Level {
    pub(super) fn new(
        matrix: ScaledBlocks,
        inverse: Vec<f32>,
        spectrum: f64,
        p: Prolongation,
    ) -> Self {
        let zeros = || vec![0.0; matrix.b * matrix.nodes()];
        let (x, other, direction, residual) = (zeros(), zeros(), zeros(), zeros());
        Self {
            matrix,
            inverse,
            spectrum,
            p,
            x,
            other,
            direction,
            residual,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        self.matrix.bytes() + self.p.bytes() + 4 * (self.inverse.len() + 4 * self.x.len())
    }

    /// Smooths `A x = b` from `x = 0` or from the present `x`.
    pub(super) fn smooth(&mut self, b: &[f32], degree: usize, from_zero: bool) {
        for (k, beta) in BETA[degree - 1].iter().enumerate() {
            #[expect(clippy::cast_precision_loss, reason = "at most 4")]
            let i = (k + 1) as f64;
            let with = StepCoefficients {
                direction: if k == 0 {
                    0.0
                } else {
                    f32::rounded((2.0 * i - 3.0) / (2.0 * i + 1.0))
                },
                residual: f32::rounded((8.0 * i - 4.0) / (2.0 * i + 1.0) / self.spectrum),
                update: f32::rounded(*beta),
            };
            let (matrix, inverse) = (&self.matrix, &self.inverse);
            if k == 0 && from_zero {
                let (d, x) = (&mut self.direction, &mut self.x);
                first_step(matrix.b, inverse, b, d, x, with);
            } else {
                let (d, y) = (&mut self.direction, &mut self.other);
                step(matrix, inverse, &self.x, b, d, y, with);
                std::mem::swap(&mut self.x, &mut self.other);
            }
        }
    }

    /// Restricts the residual to `coarse`.
    pub(super) fn restrict(&mut self, b: &[f32], coarse: &mut [f32]) {
        residual(&self.matrix, &self.x, b, &mut self.residual);
        self.p.restrict(&self.residual, coarse);
    }

    /// Adds the correction of the next level.
    pub(super) fn correct(&mut self, coarse: &[f32]) {
        self.p.add_prolonged(coarse, &mut self.x);
    }
}
