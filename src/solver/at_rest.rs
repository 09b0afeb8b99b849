//! Asks statics: whether reactions balance the loads on the rigid motions.
//!
//! If only rigid motions displace the contacts, `W = 0` and `q = R b` to rounding, reactions that
//! balance the loads are a solution: with `a = −b` nothing moves. Otherwise they are necessary for
//! one, and a proof that there are none ends the search.

use crate::equilibrium::decide::{Decision, Verdict, decide};
use crate::equilibrium::programme::Limits;
use crate::equilibrium::statics::Statics;
use crate::error::Error;
use crate::linalg::small::{add_scaled, dot_long, norm, scale_rows};
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::reduced::existence::{LEAST_WORK, works};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::merit;
use crate::solver::monitor::Monitor;
use crate::solver::outcome::Ended;
use crate::solver::settings::Start;
use crate::solver::tuning;

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

/// Decides whether reactions balance the loads, and ends the solve if a motion proves that none do. A
/// proof that the rounding of the loads may explain is withdrawn.
pub(super) fn ask<const D: usize>(
    problem: &Reduced<D>,
    monitor: &mut Monitor<D>,
    seconds: f64,
) -> Result<Decision, Ended> {
    let limits = Limits::new(monitor.stop(), seconds);
    let mut decision = decide(&of_problem(problem)?, &problem.rigid.load, limits)?;
    if decision.verdict == Verdict::None {
        if works(problem, &decision.motion) {
            let motion = of_largest_one(problem, decision.motion);
            return Err(monitor.exclude_reactions(motion));
        }
        decision.verdict = Verdict::Undecided;
    }
    monitor.balanced |= decision.verdict == Verdict::Balanced;
    Ok(decision)
}

/// Looks for a solution without any motion of contacts, with the rigid `motion`: the start, if it is
/// one, or reactions that balance the loads. Those that do not to the tolerance are a start.
pub(super) fn rest<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    motion: Vec<f64>,
    monitor: &mut Monitor<D>,
) -> Result<Option<Start<D>>, Ended> {
    if !start.reaction.is_empty() {
        let given = start.rigid.len() == motion.len();
        let rigid = if given { &start.rigid } else { &motion };
        monitor.look_at(&start.reaction, rigid, false)?;
    }
    let decision = ask(problem, monitor, monitor.seconds_left())?;
    if decision.verdict != Verdict::Balanced {
        return Ok(None);
    }
    let reaction = decision.reaction.as_chunks::<D>().0.to_vec();
    monitor.look_at(&reaction, &motion, false)?;
    Ok(Some(Start {
        reaction,
        rigid: motion,
        closed: start.closed.clone(),
    }))
}

/// The rigid motion with which nothing moves, if only rigid motions displace the contacts.
pub(super) fn find_rest<const D: usize>(problem: &Reduced<D>) -> Option<Vec<f64>> {
    let modes = &problem.rigid.modes;
    if !problem.moves_rigidly() {
        return None;
    }
    if problem.q.as_flattened().iter().all(|&q| q == 0.0) {
        return Some(vec![0.0; modes.len()]);
    }
    let (scaling, nothing) = (&problem.scaling, vec![[0.0; D]; problem.contacts()]);
    let mut motion = vec![0.0; modes.len()];
    let mut left = problem.q.clone();
    // The second and third step correct the rounding of the first.
    for _ in 0..3 {
        let step = scaling.fit(&scale_rows(&left, &scaling.to_v));
        add_scaled(&mut motion, -1.0, &scaling.rigid_from_scaled(&step));
        left = problem.relative_displacement(&nothing, &motion);
    }
    let sizes = modes.lengths().into_iter().zip(&motion);
    let terms = sizes.map(|(length, a)| length * a.abs()).sum::<f64>();
    let terms = norm(problem.q.as_flattened()) + terms;
    (norm(left.as_flattened()) <= ROUNDING * terms).then_some(motion)
}

/// The direction of a rigid motion `a` of an iteration at reactions `r`, if a body seems to slide away
/// along it, which statics has not decided: the motion is much larger than the deformation, the loads work on it, no normal
/// force stops it, and twice the motion leaves no larger merit: then contacts open or slide along
/// it, and it grows. Without any deformation there is nothing to compare it with. It is not a
/// proof that friction does not stop it.
pub(super) fn runaway<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    a: &[f64],
) -> Option<Vec<f64>> {
    let scaling = &problem.scaling;
    let motion = scaling.rigid_to_scaled(a);
    let length = scaling.motion_norm(&motion);
    let deformed = scaling.displacement_norm(&problem.relative_displacement(r, &[]));
    let is_large = length.is_finite() && length > tuning::runaway_motion() * deformed;
    if deformed == 0.0 || !is_large {
        return None;
    }
    let twice: Vec<f64> = a.iter().map(|a| 2.0 * a).collect();
    let merit_at = |a: &[f64]| merit(problem, r, &problem.relative_displacement(r, a));
    if merit_at(&twice) > (1.0 + tuning::runaway_penetration()) * merit_at(a) {
        return None;
    }
    let motion: Vec<f64> = motion.iter().map(|x| x / length).collect();
    let mut moved = vec![[0.0; D]; r.len()];
    scaling.modes.add_product(&motion, &mut moved);
    // The iteration finds the motion inexactly: tolerate a penetration of a thousandth.
    let opens = |i: usize| {
        let rows = scaling.modes.at(i).flat_map(|(_, mode)| mode);
        let size = rows.map(|x| x * x).sum::<f64>().sqrt();
        moved[i][0] >= -tuning::runaway_penetration() * size
    };
    let work = dot_long(&motion, &scaling.load);
    let free = work > LEAST_WORK * scaling.force_norm(&scaling.load) && (0..r.len()).all(opens);
    free.then(|| of_largest_one(problem, scaling.rigid_from_scaled(&motion)))
}

/// The rigid motion along `a` whose largest motion of a contact is 1.
fn of_largest_one<const D: usize>(problem: &Reduced<D>, mut a: Vec<f64>) -> Vec<f64> {
    let mut moved = vec![[0.0; D]; problem.contacts()];
    problem.add_rigid(&a, &mut moved);
    let length = |v: &[f64; D]| v.iter().fold(0.0_f64, |sum, x| sum.hypot(*x));
    let largest = moved.iter().map(length).fold(0.0_f64, f64::max);
    if largest.is_normal() {
        for x in &mut a {
            *x /= largest;
        }
    }
    a
}
