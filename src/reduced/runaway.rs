//! The rigid motion along which an iteration has gone without end.
//!
//! Which motions are free is not asked here: [`bodies`](crate::bodies) has decided it, by rows of
//! `K`, which act in both directions. Contacts push only.

use crate::linalg::small::{dot_long, norm};
use crate::reduced::existence::LEAST_WORK;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual;
use crate::reduced::tuning;

/// The direction of a rigid motion `a`, if it shows why an iteration at reactions `r` did not
/// converge: the motion is much larger than the deformation, the loads work on it, no normal
/// force stops it, and twice the motion leaves no larger merit: then contacts open or slide along
/// it, and it grows. Without any deformation there is nothing to compare it with. It is not a
/// proof that friction does not stop it.
pub fn runaway<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    a: &[f64],
) -> Option<Vec<f64>> {
    let scaling = &problem.scaling;
    let motion = scaling.rigid_to_scaled(a);
    let length = scaling.motion_norm(&motion);
    let still = problem.relative_displacement(r, &[]);
    let deformed = still.iter().zip(&scaling.to_v);
    let deformed: Vec<f64> = deformed
        .flat_map(|(v, scale)| v.map(|c| c * scale))
        .collect();
    let deformed = norm(&deformed);
    let is_large = length.is_finite() && length > tuning::runaway_motion() * deformed;
    if deformed == 0.0 || !is_large {
        return None;
    }
    let twice: Vec<f64> = a.iter().map(|a| 2.0 * a).collect();
    let merit = |a: &[f64]| residual::merit(problem, r, &problem.relative_displacement(r, a));
    if merit(&twice) > (1.0 + tuning::runaway_penetration()) * merit(a) {
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
pub fn of_largest_one<const D: usize>(problem: &Reduced<D>, mut a: Vec<f64>) -> Vec<f64> {
    let mut moved = vec![[0.0; D]; problem.contacts()];
    problem.add_rigid(&a, &mut moved);
    let lengths = moved
        .iter()
        .map(|v| v.iter().fold(0.0_f64, |sum, x| sum.hypot(*x)));
    let largest = lengths.fold(0.0_f64, f64::max);
    if largest.is_normal() {
        for x in &mut a {
            *x /= largest;
        }
    }
    a
}
