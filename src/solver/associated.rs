//! Convex problems: those of associated laws, `β = μ`, also without friction.
//!
//! The law (9) is then the condition of the least `½ rᵀW r + qᵀr` over the reactions in their cones that
//! balance the loads, and the rigid motions are its multipliers.

use crate::equilibrium::minimise::ConeSet;
use crate::equilibrium::programme::Limits;
use crate::error::Error;
use crate::linalg::small::norm;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::newton::compliance_form::{Solved, cost};
use crate::solver::tuning;

/// Factorisations of a programme.
const STEPS: f64 = 20.0;

/// A point near the solution; `None` if the problem is not convex, too large, or was not solved.
pub(super) fn solve<const D: usize>(
    problem: &Reduced<D>,
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Error> {
    let (compliance, scaling) = (&problem.compliance, &problem.scaling);
    let (n, motions) = (problem.contacts(), scaling.modes.len());
    let associated = problem.law.iter().all(|law| law.correction() == 0.0);
    let small = compliance.is_sparse() || D * n <= tuning::most_dense();
    if !(associated && small && compliance.is_symmetric()) {
        return Ok(None);
    }
    monitor.count(STEPS * cost(problem, D * n + motions));
    // Beside a large q, the reactions of stiff contacts would be below the tolerances.
    let force = norm(&scaling.load);
    let force = if force > 0.0 { force } else { 1.0 };
    let width = |i: usize| if problem.law[i].has_friction() { D } else { 1 };
    let first: Vec<usize> = (0..n)
        .scan(0, |next, i| Some(std::mem::replace(next, *next + width(i))))
        .collect();
    let mut set = ConeSet::default();
    let mut free = Vec::new();
    let mut works = vec![Vec::new(); motions];
    for i in 0..n {
        let law = problem.scaled_law(i);
        for k in 0..width(i) {
            let mut row = Vec::new();
            compliance.row_blocks(i, &mut |j, w| {
                let factor = force * scaling.to_v[i] / scaling.to_r[j];
                row.extend((0..width(j)).map(|l| (first[j] + l, factor * w[(k, l)])));
            });
            set.quadratic
                .push(row.into_iter().filter(|entry| entry.1 != 0.0));
            free.push(problem.q[i][k] * scaling.to_v[i]);
            let slope = if k == 0 && width(i) > 1 { law.mu } else { 1.0 };
            set.rows.push([(first[i] + k, slope)]);
            set.offset
                .push(if k == 0 { law.cohesion / force } else { 0.0 });
            for (c, motion) in scaling.modes.at(i) {
                works[c].push((first[i] + k, motion[k]));
            }
        }
        set.sizes.push(width(i));
        if law.cohesion > 0.0 {
            set.rows.push([(first[i], 1.0)]);
            set.offset.push(0.0);
            set.sizes.push(1);
        }
    }
    set.unknowns = free.len();
    set.right = scaling.load.iter().map(|e| -e / force).collect();
    for row in works {
        set.equations.push(row);
    }
    let found = set.minimise(&free, Limits::new(monitor.stop(), monitor.seconds_left()))?;
    let reaction = |i: usize| {
        let of = |k: usize| {
            if k < width(i) {
                found.y[first[i] + k]
            } else {
                0.0
            }
        };
        std::array::from_fn(|k| force * of(k) / scaling.to_r[i])
    };
    let motion: Vec<f64> = found.multipliers.iter().map(|w| -w).collect();
    Ok(found.gap.is_finite().then(|| Solved {
        r: (0..n).map(reaction).collect(),
        rigid: scaling.rigid_from_scaled(&motion),
    }))
}
