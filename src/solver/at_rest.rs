//! Asks statics: whether reactions balance the loads on the rigid motions.
//!
//! If only rigid motions displace the contacts, `W = 0` and `q = R b` to rounding, reactions that
//! balance the loads are a solution: with `a = −b` nothing moves. Otherwise they are necessary for
//! one, and a proof that there are none ends the search.

use std::sync::atomic::AtomicBool;

use crate::equilibrium::decide::{Decision, Verdict, decide};
use crate::equilibrium::programme::Limits;
use crate::equilibrium::statics::Statics;
use crate::error::Error;
use crate::linalg::small::norm;
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::reduced::existence::works;
use crate::reduced::reduced::Reduced;
use crate::reduced::runaway::of_largest_one;

/// Rounding of `q`, relative to its terms `R b`.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// The contacts of a problem, in its order.
pub fn of_problem<const D: usize>(problem: &Reduced<D>) -> Result<Statics, Error> {
    let mut rows = OwnedMatrix::default();
    for contact in 0..problem.contacts() {
        for k in 0..D {
            let moved = problem.rigid.modes.at(contact);
            let moved = moved.map(|(motion, mode)| (motion, mode[k]));
            rows.push(moved.filter(|(_, value)| *value != 0.0));
        }
    }
    let view = Rows {
        row_ptr: &rows.pointer,
        columns: &rows.index,
        values: &rows.values,
    };
    let friction = problem.law.iter().flat_map(|law| [law.mu; D]).collect();
    let cohesion = problem.law.iter().map(|law| law.cohesion).collect();
    let sizes = vec![D; problem.contacts()];
    Statics::new(view, problem.rigid.modes.len(), &sizes, friction, cohesion)
}

/// Decides whether reactions balance the loads. A proof that the rounding of the loads may
/// explain is withdrawn.
pub(super) fn ask<const D: usize>(
    problem: &Reduced<D>,
    stop: &AtomicBool,
    seconds: f64,
) -> Result<Decision, Error> {
    let limits = Limits::new(stop, seconds);
    let mut decision = decide(&of_problem(problem)?, &problem.rigid.load, limits)?;
    if decision.verdict == Verdict::None && !works(problem, &decision.motion) {
        decision.verdict = Verdict::Undecided;
    }
    if decision.verdict == Verdict::None {
        decision.motion = of_largest_one(problem, decision.motion);
    }
    Ok(decision)
}

/// The rigid motion with which nothing moves, if only rigid motions displace the contacts.
pub(super) fn find_rest<const D: usize>(problem: &Reduced<D>) -> Option<Vec<f64>> {
    let modes = &problem.rigid.modes;
    let rigid = !modes.is_empty()
        && (0..problem.contacts()).all(|i| problem.compliance.block(i).amax() == 0.0);
    let still = problem.q.as_flattened().iter().all(|&q| q == 0.0);
    if !rigid || still {
        return rigid.then(|| vec![0.0; modes.len()]);
    }
    let (scaling, nothing) = (&problem.scaling, vec![[0.0; D]; problem.contacts()]);
    let mut motion = vec![0.0; modes.len()];
    let mut left = problem.q.clone();
    // The second and third step correct the rounding of the first.
    for _ in 0..3 {
        let scaled = left.iter().zip(&scaling.to_v);
        let scaled: Vec<[f64; D]> = scaled.map(|(v, s)| v.map(|x| x * s)).collect();
        let step = scaling.rigid_from_scaled(&scaling.fit(&scaled));
        motion.iter_mut().zip(step).for_each(|(a, step)| *a -= step);
        left = problem.relative_displacement(&nothing, &motion);
    }
    let sizes = modes.lengths().into_iter().zip(&motion);
    let terms = sizes.map(|(length, a)| length * a.abs()).sum::<f64>();
    let terms = norm(problem.q.as_flattened()) + terms;
    (norm(left.as_flattened()) <= ROUNDING * terms).then_some(motion)
}
