//! The V-cycle, and two steps of conjugate gradients in place of one visit for the K-cycle.

use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::level::Level;
use crate::linalg::amg::settings::Cycle;
use crate::linalg::amg::tuning;
use crate::linalg::parallel::{axpy, dot, map2, norm};
use crate::linalg::real::Real;

/// What all levels of a cycle share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shared<'a> {
    pub(super) coarsest: &'a Coarsest,
    pub(super) degree: usize,
    pub(super) cycle: Cycle,
}

/// Right side and result of a coarser level, and two vectors and a product of the K-cycle.
#[derive(Clone, Debug)]
pub(super) struct CycleMemory {
    pub(super) b: Vec<f32>,
    pub(super) x: Vec<f32>,
    first: Vec<f32>,
    first_product: Vec<f32>,
    product: Vec<f32>,
}

impl CycleMemory {
    /// `inner`: whether the K-cycle iterates on this level.
    pub(super) fn new(n: usize, inner: bool) -> Self {
        let zeros = |needed: bool| vec![0.0; if needed { n } else { 0 }];
        Self {
            b: zeros(true),
            x: zeros(true),
            first: zeros(inner),
            first_product: zeros(inner),
            product: zeros(inner),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        4 * (2 * self.b.len() + 3 * self.first.len())
    }
}

/// `x ≈ A⁻¹ b` on the first of `levels`; `work` holds the vectors of the levels below it, of
/// which the last is the coarsest.
pub(super) fn visit(
    levels: &mut [Level],
    work: &mut [CycleMemory],
    b: &[f32],
    x: &mut [f32],
    shared: Shared<'_>,
) {
    let Some((level, coarser)) = levels.split_first_mut() else {
        shared.coarsest.solve(b, x);
        return;
    };
    let Some((own, below)) = work.split_first_mut() else {
        return;
    };
    level.smooth(b, shared.degree, true);
    level.restrict(b, &mut own.b);
    if shared.cycle == Cycle::K && !coarser.is_empty() {
        iterate(coarser, below, own, shared);
    } else {
        visit(coarser, below, &own.b, &mut own.x, shared);
    }
    level.correct(&own.x);
    level.smooth(b, shared.degree, false);
    x.copy_from_slice(&level.x);
}

/// At most two steps of flexible conjugate gradients on the first of `levels`.
fn iterate(
    levels: &mut [Level],
    below: &mut [CycleMemory],
    own: &mut CycleMemory,
    shared: Shared<'_>,
) {
    let CycleMemory {
        b,
        x,
        first,
        first_product,
        product,
    } = own;
    visit(levels, below, b, first, shared);
    levels[0].matrix.product(first, first_product);
    let (energy, along) = (dot(first, first_product), dot(first, b));
    if !(energy > 0.0) {
        x.copy_from_slice(first);
        return;
    }
    let step = along / energy;
    let before = norm(b);
    axpy(-step, first_product, b);
    if norm(b) <= tuning::second_step() * before {
        map2(x, first, |_, first: f32| f32::rounded(step) * first);
        return;
    }
    visit(levels, below, b, x, shared);
    levels[0].matrix.product(x, product);
    let mixed = dot(x, first_product);
    let rest = dot(x, product) - mixed * mixed / energy;
    let second = if rest > 0.0 { dot(x, b) / rest } else { 0.0 };
    let (first_step, second) = (
        f32::rounded(step - second * mixed / energy),
        f32::rounded(second),
    );
    map2(x, first, |x, first| first_step * first + second * x);
}
