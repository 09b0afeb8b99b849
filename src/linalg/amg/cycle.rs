//! The V-cycle.

use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::level::Level;

/// Right side and result of a coarser level.
#[derive(Clone, Debug)]
pub(super) struct CycleMemory {
    b: Vec<f32>,
    x: Vec<f32>,
}

impl CycleMemory {
    pub(super) fn new(n: usize) -> Self {
        Self {
            b: vec![0.0; n],
            x: vec![0.0; n],
        }
    }

    pub(super) fn bytes(&self) -> usize {
        4 * 2 * self.b.len()
    }
}

/// `x ≈ A⁻¹ b` on the first of `levels`, with `degree` smoothing steps; `work` holds the vectors
/// of the levels below it, of which the last is the coarsest.
pub(super) fn visit(
    levels: &mut [Level],
    work: &mut [CycleMemory],
    b: &[f32],
    x: &mut [f32],
    (coarsest, degree): (&Coarsest, usize),
) {
    let Some((level, coarser)) = levels.split_first_mut() else {
        coarsest.solve(b, x);
        return;
    };
    let Some((own, below)) = work.split_first_mut() else {
        return;
    };
    level.smooth(b, degree, true);
    level.restrict(b, &mut own.b);
    visit(coarser, below, &own.b, &mut own.x, (coarsest, degree));
    level.correct(&own.x);
    level.smooth(b, degree, false);
    x.copy_from_slice(&level.x);
}
