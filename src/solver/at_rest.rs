//! Asks statics: whether reactions balance the loads on the rigid motions.
//!
//! If only rigid motions displace the contacts, `W = 0` and `q = R b` to rounding, reactions that
//! balance the loads are a solution: with `a = −b` nothing moves. Otherwise they are necessary for
//! one, and a proof that there are none ends the search.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::equilibrium::balance_norm::measure_imbalance;
use crate::equilibrium::decide::{Decision, Verdict, decide};
use crate::equilibrium::programme::Limits;
use crate::equilibrium::statics::Statics;
use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::least_squares;
use crate::linalg::small::norm;
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::reduced::existence::works;
use crate::reduced::reduced::Reduced;
use crate::solver::outcome::Outcome;
use crate::solver::solution::Solution;

/// Rounding of `q`, relative to its terms `R b`.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// With more motions, whether they cancel `q` is not asked unless it is zero.
const FEW_MOTIONS: usize = 200;

/// The contacts of a problem, in its order.
///
/// # Errors
/// As [`Statics::new`].
pub fn of_problem<const D: usize>(problem: &Reduced<D>) -> Result<Statics, Error> {
    let mut rows = OwnedMatrix::default();
    for contact in 0..problem.contacts() {
        for k in 0..D {
            for (motion, mode) in problem.rigid.modes.iter().enumerate() {
                if mode[contact][k] != 0.0 {
                    rows.index.push(motion);
                    rows.values.push(mode[contact][k]);
                }
            }
            rows.pointer.push(rows.index.len());
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
    let limits = Limits { stop, seconds };
    let mut decision = decide(&of_problem(problem)?, &problem.rigid.load, limits)?;
    if decision.verdict == Verdict::None && !works(problem, &decision.motion) {
        decision.verdict = Verdict::Undecided;
    }
    Ok(decision)
}

/// The rigid motion with which nothing moves, if only rigid motions displace the contacts.
#[must_use]
pub(super) fn find_rest<const D: usize>(problem: &Reduced<D>) -> Option<Vec<f64>> {
    let modes = &problem.rigid.modes;
    let rigid = !modes.is_empty()
        && (0..problem.contacts()).all(|i| problem.compliance.block(i).amax() == 0.0);
    let still = problem.q.as_flattened().iter().all(|&q| q == 0.0);
    if !rigid || still {
        return rigid.then(|| vec![0.0; modes.len()]);
    }
    if modes.len() > FEW_MOTIONS {
        return None;
    }
    let columns: Vec<&[f64]> = modes.iter().map(|mode| mode.as_flattened()).collect();
    let right: Vec<f64> = problem.q.as_flattened().iter().map(|q| -q).collect();
    let motion = least_squares::solve(&columns, &right);
    let mut terms = norm(&right);
    for (column, amount) in columns.iter().zip(&motion) {
        terms += norm(column) * amount.abs();
    }
    let left = problem.relative_displacement(&vec![[0.0; D]; problem.contacts()], &motion);
    (norm(left.as_flattened()) <= ROUNDING * terms).then_some(motion)
}

/// The answer of statics as a solution of many rigid bodies: `W = 0`, `q = 0`.
///
/// # Errors
/// [`Error::DependentMotion`], [`Error::Interrupted`].
pub fn solve_at_rest<const D: usize>(
    statics: &Statics,
    load: &[f64],
    tol: f64,
    limits: Limits,
) -> Result<Solution<D>, Error> {
    let started = Instant::now();
    let decision = decide(statics, load, limits)?;
    let (residual, floor) = measure_imbalance(statics, &decision.reaction, load, limits.stop)?;
    let tolerance = tol.max(floor);
    let seconds = started.elapsed().as_secs_f64();
    let reaction = decision.reaction.as_chunks::<D>().0.to_vec();
    let status = |(contact, r): (usize, &[f64; D])| {
        if r.iter().all(|&c| c == 0.0) {
            Status::Open
        } else if statics.rubs(contact) {
            Status::Stick
        } else {
            Status::Slip
        }
    };
    let contacts = reaction.len();
    Ok(Solution {
        relative_displacement: vec![[0.0; D]; contacts],
        status: reaction.iter().enumerate().map(status).collect(),
        opened: vec![false; contacts],
        bipotential_gap: vec![0.0; contacts],
        rigid_motion: vec![0.0; load.len()],
        outcome: match decision.verdict {
            Verdict::None => Outcome::NoEquilibrium,
            Verdict::Balanced if residual <= tolerance => Outcome::Converged,
            _ if seconds >= limits.seconds => Outcome::TimeLimit,
            _ => Outcome::Stalled,
        },
        free_motion: decision.motion,
        reaction,
        residual,
        floor,
        tolerance,
        history: vec![(0.0, residual)],
        seconds,
        ..Solution::default()
    })
}
