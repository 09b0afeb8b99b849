//! Whether an answer is the only one: a proof that it is, a proof that it is
//! not, or neither.

use std::cell::LazyCell;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::verified_cholesky::{self, Lower};
use crate::proof::fixed_point_index::index;
use crate::proof::monotonicity::{KnownSlip, Monotonicity, Units, Weights};
use crate::proof::weights;
use crate::reduced::reduced::Reduced;
use crate::solver::enumerate;

/// What is known of the number of answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unique {
    Proved,
    OthersExist,
    Unknown,
}

impl Unique {
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Proved => "proved",
            Self::OthersExist => "others exist",
            Self::Unknown => "unknown",
        }
    }
}

/// Up to this many plane contacts, 4⁶ leaves in milliseconds, statuses are
/// exhausted where both criteria are silent.
const FEW: usize = 6;

/// Unknowns of a sparse island above which nothing is proved: both criteria form
/// dense matrices, which a sparse `W` was given to avoid.
const LARGEST: usize = 3000;

/// Bytes above which nothing is proved of a dense island either: some seconds' work.
pub const MOST_BYTES: usize = 1 << 29;

/// Bytes at the height of a proof, of as many contacts in `D` dimensions of which some
/// have friction: `Ŵ` and its factor, or the form, the parts of it and what they are of.
#[must_use]
pub fn bytes<const D: usize>(contacts: usize, with_friction: usize) -> usize {
    let tangents = (D - 1) * with_friction;
    let order = contacts + tangents;
    let matrices = if tangents == 0 { 2 } else { 3 };
    size_of::<f64>() * order * (matrices * order + tangents)
}

/// Whether the answer `r`, in the order of positions, is the only one.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn assess<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    if !problem.rigid.modes.is_empty() || problem.contradiction.is_some() {
        return Ok(Unique::Unknown);
    }
    // A product with all of W, which nothing needs where no island is judged.
    let v = LazyCell::new(|| problem.relative_displacement(r, &[]));
    let mut verdict = Unique::Proved;
    for island in problem.compliance.islands() {
        let contacts = island.nodes.len();
        let mu = &problem.mu[island.nodes.clone()];
        let with_friction = mu.iter().filter(|&&mu| mu > 0.0).count();
        if island.blocks().is_some() && D * contacts > LARGEST
            || bytes::<D>(contacts, with_friction) > MOST_BYTES
        {
            verdict = Unique::Unknown;
            continue;
        }
        match assess_island(problem, island.nodes.clone(), r, &v, stop)? {
            Unique::Proved => {}
            // The other islands may stay as they are.
            Unique::OthersExist => return Ok(Unique::OthersExist),
            Unique::Unknown => verdict = Unique::Unknown,
        }
    }
    Ok(verdict)
}

/// [`assess`] in the plane, where few contacts can be exhausted.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn assess_plane(
    problem: &Reduced<2>,
    r: &[[f64; 2]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    let verdict = assess(problem, r, stop)?;
    if verdict != Unique::Unknown || problem.contacts() > FEW {
        return Ok(verdict);
    }
    let all = enumerate::answers(problem, stop)?;
    Ok(match (all.answers.len(), all.complete) {
        (2.., _) if apart(problem, &all.answers) => Unique::OthersExist,
        (1, true) => Unique::Proved,
        _ => Unique::Unknown,
    })
}

/// Two answers nearer than this, beside their size, may be one that a condition of
/// ten digits has split.
const APART: f64 = 1e-6;

/// Whether some two answers differ by more than rounding can make of one.
fn apart(problem: &Reduced<2>, answers: &[(Vec<[f64; 2]>, Vec<f64>)]) -> bool {
    let scaling = &problem.scaling;
    let first = &answers[0].0;
    answers[1..].iter().any(|(r, _)| {
        let change: Vec<[f64; 2]> = r
            .iter()
            .zip(first)
            .map(|(x, y)| [x[0] - y[0], x[1] - y[1]])
            .collect();
        let size = scaling.reaction_norm(r).max(scaling.reaction_norm(first));
        scaling.reaction_norm(&change) > APART * size
    })
}

fn assess_island<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    let units = Units::of(problem);
    let Ok(monotonicity) = Monotonicity::new(problem, &units, nodes.clone()) else {
        return Ok(Unique::Unknown);
    };
    let (kept, n) = (monotonicity.all(), monotonicity.order());
    let (half, error) = monotonicity.symmetric_part(&kept);
    let Some(lower) = Lower::new(half, n, error, stop)? else {
        return Ok(Unique::Unknown);
    };
    if monotonicity.mu.iter().all(|&mu| mu == 0.0) {
        return Ok(Unique::Proved);
    }
    let known = vec![KnownSlip::Nothing; monotonicity.mu.len()];
    let monotone = |weights: &Weights| {
        let (form, error) = monotonicity.form(&kept, weights, &known);
        verified_cholesky::is_definite(form, n, error, stop)
    };
    let common = weights::common(&monotonicity, &lower);
    drop(lower);
    // Its least eigenvalue is 1 − κ, and κ is estimated from below.
    let hopeless = monotonicity.symmetric && common.kappa() >= 1.0;
    if !hopeless && monotone(&common.weights)? {
        return Ok(Unique::Proved);
    }
    if let Some(refined) = weights::refined(&monotonicity, &common, stop)?
        && monotone(&refined)?
    {
        return Ok(Unique::Proved);
    }
    drop(monotonicity);
    let index = index(problem, nodes, r, v, stop)?;
    Ok(if index == Some(-1.0) {
        Unique::OthersExist
    } else {
        Unique::Unknown
    })
}
