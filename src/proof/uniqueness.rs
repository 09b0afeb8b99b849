//! Decides whether a solution is unique: a proof that it is, a proof that it is not, or
//! neither.

use std::cell::LazyCell;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{amax, rows_plus_scaled};
use crate::linalg::verified_cholesky::{self, Lower};
use crate::proof::fixed_point_index::index;
use crate::proof::monotonicity::{Monotonicity, Units, Weights};
use crate::proof::tuning;
use crate::proof::weights;
use crate::reduced::reduced::Reduced;
use crate::solver::enumerate;

/// What is known of the number of solutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unique {
    Proved,
    OthersExist,
    Unknown,
}

impl Unique {
    fn others_exist(proved: bool) -> Self {
        if proved {
            Self::OthersExist
        } else {
            Self::Unknown
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Proved => "proved",
            Self::OthersExist => "others exist",
            Self::Unknown => "unknown",
        }
    }
}

/// A dense island that needs more bytes is not decided: this is some seconds of work.
pub const MOST_BYTES: usize = 1 << 29;

/// Largest number of bytes of a proof with this many contacts in `D` dimensions, some with
/// friction: `Ŵ` and its factor, or the form with its terms.
pub fn bytes<const D: usize>(contacts: usize, with_friction: usize) -> usize {
    let tangents = (D - 1) * with_friction;
    let order = contacts + tangents;
    let matrices = if tangents == 0 { 2 } else { 3 };
    size_of::<f64>() * order * (matrices * order + tangents)
}

/// Decides whether the solution `r`, in the order of positions, is unique.
pub fn assess<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    if !problem.rigid.modes.is_empty() || problem.contradiction.is_some() {
        return Ok(Unique::others_exist(has_self_stress(problem, r)));
    }
    // This product needs the whole W: omit it if no island can be decided.
    let v = LazyCell::new(|| problem.relative_displacement(r, &[]));
    let mut verdict = Unique::Proved;
    for island in problem.compliance.islands() {
        let contacts = island.nodes.len();
        let laws = &problem.law[island.nodes.clone()];
        let with_friction = laws.iter().filter(|law| law.has_friction()).count();
        if island.blocks().is_some() && D * contacts > tuning::sparse_unknowns()
            || bytes::<D>(contacts, with_friction) > MOST_BYTES
        {
            verdict = Unique::Unknown;
            continue;
        }
        match assess_island(problem, island.nodes.clone(), r, &v, stop)? {
            Unique::Proved => {}
            // The other islands do not change.
            Unique::OthersExist => return Ok(Unique::OthersExist),
            Unique::Unknown => verdict = Unique::Unknown,
        }
    }
    Ok(verdict)
}

/// [`assess`] in the plane, where all statuses of few contacts can be tried.
pub fn assess_plane(
    problem: &Reduced<2>,
    r: &[[f64; 2]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    let verdict = assess(problem, r, stop)?;
    let few = problem.contacts() <= tuning::few_contacts() && enumerate::is_coulomb(problem);
    if verdict != Unique::Unknown || !few {
        return Ok(verdict);
    }
    let all = enumerate::answers(problem, stop)?;
    Ok(match (all.answers.len(), all.complete) {
        (2.., _) if apart(problem, &all.answers) => Unique::OthersExist,
        (1, true) => Unique::Proved,
        _ => Unique::Unknown,
    })
}

/// Two solutions with a smaller relative distance may be one that a condition number of 1e10
/// has split.
const APART: f64 = 1e-6;

/// Whether two solutions differ by more than rounding.
fn apart(problem: &Reduced<2>, answers: &[(Vec<[f64; 2]>, Vec<f64>)]) -> bool {
    let scaling = &problem.scaling;
    let first = &answers[0].0;
    answers[1..].iter().any(|(r, _)| {
        let change = rows_plus_scaled(r, -1.0, first);
        let size = scaling.reaction_norm(r).max(scaling.reaction_norm(first));
        scaling.reaction_norm(&change) > APART * size
    })
}

/// Whether reactions without loads may be added to those of rigid bodies: all are inside their cones,
/// where nothing moves, and there are more of them than motions.
fn has_self_stress<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> bool {
    /// A reaction is inside by this share of the largest.
    const INSIDE: f64 = 1e-9;
    let room = INSIDE * amax(r.as_flattened());
    let unknowns = |law: &ContactLaw| if law.has_friction() { D } else { 1 };
    problem.moves_rigidly()
        && problem.contradiction.is_none()
        && problem
            .law
            .iter()
            .zip(r)
            .all(|(law, r)| law.depth(r) > room)
        && problem.law.iter().map(unknowns).sum::<usize>() > problem.rigid.modes.len()
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
    let known = monotonicity.nothing_known();
    let monotone = |weights: &Weights| {
        let (form, error) = monotonicity.form(&kept, weights, &known);
        verified_cholesky::is_definite(form, n, error, stop)
    };
    let common = weights::common(&monotonicity, &lower);
    drop(lower);
    // Its least eigenvalue is 1 − κ, and the estimate of κ is too small.
    let hopeless = monotonicity.symmetric && common.kappa() >= 1.0;
    if !hopeless && monotone(&common.weights)? {
        return Ok(Unique::Proved);
    }
    let dilates = problem.law[nodes.clone()]
        .iter()
        .any(|law| law.dilatancy > 0.0);
    if !dilates // the weights of the normals are one
        && let Some(refined) = weights::refined(&monotonicity, &common, stop)?
        && monotone(&refined)?
    {
        return Ok(Unique::Proved);
    }
    drop(monotonicity);
    let index = index(problem, nodes, r, v, stop)?;
    Ok(Unique::others_exist(index == Some(-1.0)))
}
