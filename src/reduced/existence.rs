//! Decides whether a witness is a proof. Solvers and Python search for witnesses; the
//! thresholds of all of them stand here.
//!
//! | witness | condition | what it proves |
//! |---|---|---|
//! | amounts `λ ≥ 0` of normal displacements | `Wᵀ λ = 0`, `Rᵀ λ = 0`, `λ·q < 0` | no equilibrium: `λ·v = λ·q < 0` for each `r` and `a` |
//!
//! Rounding leaves an error `δ` in each equation. A proof of no equilibrium then excludes
//! only reactions below `work / ‖δ‖`. It counts if these include all reactions up to
//! [`LARGEST_REACTION`] times the loads.

use crate::linalg::small::dot_long;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::WORST_FLOOR;

/// Loads that are out of balance by a smaller share count as balanced, and work that is a
/// smaller share proves nothing. It is ten times the default tolerance of a solution, and
/// far above the rounding of loads that come from condensation.
pub const LEAST_WORK: f64 = 1e-9;

/// Reactions that are this many times the loads are not a solution: the rounding of their
/// balance, 4 ε of them, is above [`WORST_FLOOR`].
pub const LARGEST_REACTION: f64 = WORST_FLOOR / (4.0 * f64::EPSILON);

/// Whether work on a witness with an error `lack` excludes all reactions up to
/// [`LARGEST_REACTION`] times the `size` of the loads.
pub fn excludes(work: f64, lack: f64, size: f64) -> bool {
    work > 0.0 && work >= LARGEST_REACTION * lack * size
}

/// Whether the loads work on a rigid motion `a` by more than their rounding.
pub fn works<const D: usize>(problem: &Reduced<D>, a: &[f64]) -> bool {
    let rounding = problem.load_rounding.iter().zip(a);
    let least: f64 = rounding.map(|(e, a)| e * a.abs()).sum();
    dot_long(&problem.rigid.load, a) > least
}

/// Whether amounts of normal displacements prove that contacts contradict each other, as
/// walls that overlap do.
///
/// `Wᵀ λ` must vanish because its terms cancel. Where they are only small beside a compliance
/// along the surface, the reactions are finite: `r_N = −q_N / W_NN` of a body on soft springs.
pub fn is_contradiction<const D: usize>(problem: &Reduced<D>, amounts: &[f64]) -> bool {
    let scaling = &problem.scaling;
    let normal = |&n: &f64| std::array::from_fn(|k| if k == 0 { n } else { 0.0 });
    let normal: Vec<[f64; D]> = amounts.iter().map(normal).collect();
    let mut moved = vec![[0.0; D]; amounts.len()];
    let mut terms = moved.clone();
    problem.compliance.transposed_product(&normal, &mut moved);
    problem.compliance.absolute_product(&normal, &mut terms);
    let (mut bent, mut whole) = (0.0_f64, 0.0_f64);
    let sums = scaling.modes.work(&normal, &scaling.to_r);
    let (mut lack, mut work, mut size) = (scaling.force_norm(&sums), 0.0, 0.0_f64);
    for (i, amount) in amounts.iter().enumerate() {
        // A contact without friction has no tangential reaction.
        let components = if problem.law[i].has_friction() { D } else { 1 };
        for (w, term) in moved[i][..components].iter().zip(terms[i]) {
            bent = bent.hypot(w * scaling.to_v[i]);
            whole = whole.hypot(term * scaling.to_v[i]);
        }
        let free = problem.q[i][0] * scaling.to_v[i];
        work -= amount * scaling.to_r[i] * free;
        if *amount > 0.0 {
            size = size.hypot(free);
        }
    }
    lack = lack.hypot(bent);
    let nonnegative = amounts.iter().all(|&amount| amount >= 0.0) && bent <= WORST_FLOOR * whole;
    let least = LEAST_WORK * size * scaling.reaction_norm(&normal);
    nonnegative && work > least && excludes(work, lack, size)
}
