//! The fitted constants of the methods.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! products with `W` to η = 1e-10, summed over seeds 0–11 of the random sets of
//! `benches/problems.py`. Where it is missing, neither changes it, as a rule because these sets
//! do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // auto.rs
    /// Sweeps before the first Newton attempt, if each changes a status.
    /// Half, twice, where they do not end with the statuses: −18.8 %, +25.6 %.
    first_sweeps: usize = 5;
    /// Sweeps after the first failure of Newton; the number doubles after each further failure.
    /// Half, twice: −5.5 %, −13.9 %.
    next_sweeps: usize = 20;
    most_sweeps: usize = 1280;
    /// With this many contacts and a sparse `W`, Newton steps take so long that proximal points
    /// follow the first failure and the interior-point method their first attempt.
    many_contacts: usize = 500;
    /// Newton steps of proximal points before the first interior-point path and after it.
    steps_before_interior: usize = 20;
    steps_after_interior: usize = 250;
    /// With at most this many plane contacts, all statuses are tried in milliseconds.
    few_contacts: usize = 6;
    /// Sweeps continue from the result of another method if it has reduced η at least by this
    /// factor. With 1, one floating body in four hundred is not solved.
    /// Half, twice: same, −0.2 %.
    gain: f64 = 0.3;

    // solve.rs
    /// A bilateral start with a larger residual leaves most of the load unbalanced; a start from
    /// zero has 1.
    /// Half, twice: −0.2 %, +0.8 %.
    trusted_start: f64 = 0.5;

    // at_rest.rs
    /// A body slides away if its rigid motion is this many times its deformation.
    runaway_motion: f64 = 30.0;
    /// The iteration finds that motion inexactly: it may penetrate a contact by this share.
    runaway_penetration: f64 = 1e-3;

    // fallback.rs
    /// With at most this many contacts, all statuses are tried in milliseconds.
    quick_contacts: usize = 7;
    /// Factor of the tolerance: a pressure above this share of the loads is visible.
    visible_pressure: f64 = 100.0;

    // monitor.rs
    /// Iterations without a better point after which a solver has stalled.
    monitor_patience: usize = 5000;
    /// If η is below the rounding floor but above the tolerance, iterations continue while they
    /// halve η within this number.
    rest: usize = 5;
    /// An iteration is better only if its residual is below this share of the least one.
    better_share: f64 = 0.999;

    // anderson.rs
    /// Number of stored steps.
    /// Half, twice: −4.2 %, +23.3 %.
    anderson_memory: usize = 10;

    // gauss_seidel.rs
    /// The proximal parameter δ in scaled variables. With a smaller value a sweep hardly changes
    /// the rigid motions; with a larger one only the updates of `â` balance the forces.
    /// Half, twice: −0.3 %, +18.9 %.
    sweep_delta: f64 = 0.3;
    /// An extrapolated point is accepted if its residual is below this many times that of its
    /// sweep. It need not be better at once, but a much worse one destroys the result of the
    /// sweeps.
    /// Half, twice: +0.7 %, +2.4 %.
    extrapolation_trust: f64 = 1.2;
    /// Sweeps between two fresh evaluations of `v`, whose running sum accumulates rounding.
    sweep_refresh: usize = 50;

    // newton.rs
    /// Largest number of Newton steps.
    /// Half, twice: +5.8 %, −0.9 %.
    newton_steps: usize = 40;
    /// Largest number of shares of a step that are tried.
    /// Half, twice: +19.9 %, same.
    newton_halvings: usize = 12;
    /// Last points whose worst merit a step must reduce, here and in the displacements.
    /// Half, twice: −15.5 %, +6.8 %.
    newton_memory: usize = 4;
    /// The remainder of an iterative solution of a step is this share of its expected decrease,
    /// between these bounds.
    newton_forcing: f64 = 0.1;
    /// Number of steps that share one inverse of `W`.
    /// Half, twice: +4.3 %, +2.0 %.
    inverse_shared_by: f64 = 3.0;
    least_forcing: f64 = 1e-10;
    most_forcing: f64 = 1e-4;
    /// After a step of a smaller share Newton's method creeps: sweeps do better.
    /// Half, twice: −6.0 %, −5.7 %.
    creeping_share: f64 = 1e-2;

    // linearisation.rs
    /// A factorisation of order `n` has `n/3` times the operations of a product of this order. It
    /// works in the cache, where an operation is about ten times faster.
    /// Half, twice: +26.3 %, −12.7 %.
    unknowns_a_product: f64 = 30.0;

    // compliance_form.rs
    /// With more unknowns, GMRES with the blocks of the contacts comes before an LU. Measured on
    /// pressed and sheared cubes with a whole face in contact, it takes as long at 700 unknowns and
    /// half as long at 1300.
    iterative_order: usize = 1000;
    /// Usual products of GMRES for a step, and their limit.
    gmres_products: f64 = 40.0;
    most_gmres_products: usize = 200;
    /// Operations of a sparse LU that take as long as one of a sparse product: its fronts are
    /// small, but stay in the cache.
    sparse_speed: f64 = 2.0;
    mending_steps: usize = 5;
    /// Pivot of a rigid motion that is eliminated before its contacts, relative to a column of
    /// length 1: products correct the error.
    least_motion_pivot: f64 = 1e-9;

    // refine.rs
    /// Largest number of corrections. If `W` has lost most of its digits, each correction settles
    /// the statuses of a few contacts at the edge of the pressed zone. Strips 2000 times as long as
    /// thick take up to 40.
    most_corrections: usize = 150;
    /// Largest number of consecutive corrections that do not halve the smallest one.
    idle_corrections: usize = 5;
    /// Largest remainder of the iterative solution of a correction.
    correction_forcing: f64 = 1e-4;
    /// Smaller corrections change no status except at the boundary between two.
    settled_correction: f64 = 1e-6;

    // proximal.rs
    /// Factor of `α` after a success.
    /// Half, twice: −17.0 %, −16.7 %.
    alpha_fall: f64 = 0.2;
    /// Factor of `α` after a failure, and the factor of that factor after each further one; two
    /// consecutive successes reset it. On flows of 7000 grains a fixed factor alternates between
    /// the same two values of `α`.
    /// Half, twice: −21.4 %, −15.0 %.
    alpha_rise: f64 = 5.0;
    steepest_rise: f64 = 1e4;
    /// An outer iteration reduces the merit to this share.
    /// Half, twice: −0.9 %, −1.1 %.
    proximal_enough: f64 = 0.05;
    /// Outer iterations of an attempt.
    /// Half, twice: +14.0 %, +61.6 %.
    proximal_outer: usize = 60;
    /// Initial `α` in units of the compliance of a contact itself, for each attempt in turn. With a
    /// single value, 2 of 150 assemblies of rigid bodies are not solved.
    /// Half, twice: −8.1 %, +5.9 %.
    alpha_first: f64 = 0.1;
    alpha_second: f64 = 1.0;
    alpha_third: f64 = 0.01;

    // interior.rs
    /// Largest number of steps, and steps within which the remainder must halve. Walls of 1,600
    /// disks take 90 to 200 steps, up to 50 of them at one turn.
    path_steps: usize = 260;
    path_patience: usize = 100;
    /// Newton and proximal points follow a path that has reached this `σ`. They solve most problems
    /// that reach it and few others, for which another path costs less.
    path_enough: f64 = 1e-3;
    /// Share of the distance to the boundary of the cone that a step keeps.
    path_rim: f64 = 0.9;
    /// Lengths of steps along the path, where 1 reaches the boundary: the largest and first, the
    /// smallest, the factor after two steps near the path, the factor after one far from it, and
    /// the largest distance from the path.
    longest_reach: f64 = 0.7;
    least_reach: f64 = 0.1;
    reach_growth: f64 = 1.3;
    reach_shrink: f64 = 0.4;
    most_astray: f64 = 1.0;
    /// Share of the way back to the path from beyond [`most_astray`], in the same lengths. Full Newton
    /// steps there jump across a kink without end.
    way_back: f64 = 0.5;
    /// A longer second-order term is omitted.
    most_bent: f64 = 2.0;
    /// With more unknowns, a matrix that is not sparse is too large to factor repeatedly.
    most_dense: usize = 1000;

    // uzawa.rs
    /// Above the first ratio ρ decreases; below the second it increases.
    /// Half, twice: +26.4 %, +4 unsolved, −19.9 %, +16 unsolved.
    cut_above: f64 = 0.9;
    /// Half, twice: −0.4 %, +1 unsolved, +9.2 %, −2 unsolved.
    grow_below: f64 = 0.3;
    rho_cut: f64 = 2.0 / 3.0;
    rho_growth: f64 = 1.5;
    /// The proximal parameter for bodies that only contact holds, in scaled variables. It is softer
    /// than for sweeps, because it limits ρ.
    projection_delta: f64 = 1.0;
    /// Iterations between two updates of the rigid motions.
    steps_a_phase: usize = 5;
    /// Iterations between two measurements of the rounding floor.
    /// Half, twice: +0.9 %, −0.5 %.
    projection_refresh: usize = 200;

    // multipliers.rs
    /// The penalty in units of the stiffness of a contact alone, ρ of (15). The error of one
    /// solution falls with it; the rounding of `ε v` in the trial reaction grows with it.
    penalty: f64 = 1e3;
    /// Factors of the penalty after a failure of Newton's method, and after a success with a smaller
    /// penalty. A soft contact changes its status less abruptly.
    penalty_fall: f64 = 0.1;
    penalty_rise: f64 = 10.0;
    least_penalty: f64 = 1.0;
    /// Steps with momentum if Newton's method fails with the smallest penalty too, as where a body
    /// that only contact holds starts without a closed contact. The number doubles each time.
    multiplier_burst: usize = 20;
    /// A solution with given multipliers reduces the merit to this share of that of the law itself.
    multiplier_enough: f64 = 0.05;

    // convex.rs
    /// Steps with momentum after the first failure of Newton; the number doubles after each further
    /// failure.
    principle_burst: usize = 20;
    /// Newton attempts in one problem.
    principle_rounds: usize = 7;
    /// A problem is solved when its merit is this share of the merit of Coulomb's problem.
    principle_share: f64 = 0.1;
    /// Passes without a better point after which a principle has stalled. If it does not contract,
    /// it cycles or stops at a point that is no solution.
    principle_patience: usize = 30;

    // minimising_sequence.rs
    /// Largest merit of a step relative to the squared error of the whole. `B` is of second order
    /// in that error, and a step solved only to first order could increase it.
    sequence_share: f64 = 0.01;
    /// Attempts, each a hundredth as large, until `B` does not increase. If none does, the field
    /// before is kept.
    sequence_refinements: usize = 4;

    // pivoting.rs
    /// Corners of a regular polygon.
    polygon_corners: usize = 8;
    /// Corners on each side of a known direction, `spacing` apart.
    fan_corners: usize = 4;
    /// Their first and their largest spacing: they stay within two coarse corners.
    widest_spacing: f64 = 0.1;
    /// Smallest factor of the spacing in one refinement.
    finest_refinement: f64 = 1.0 / 16.0;
    /// Largest number of refinements.
    refinements: usize = 100;
    /// Largest number of consecutive refinements that do not halve η.
    refinement_patience: usize = 10;
    /// Corrections of the linear law of the final cells.
    cell_corrections: usize = 3;
    /// Pivots between two fresh evaluations of `v`, whose running sum drifts.
    /// Half, twice: +5.4 %, +2.4 %.
    pivot_refresh: usize = 50;
    /// A path that starts at `t = 1` and exceeds this has turned back.
    turned_back: f64 = 2.0;
    /// A start on a boundary is moved away by this share of its size.
    off_boundary: f64 = 1e-6;

    // tangent_stiffness_form.rs
    /// The form pays if it has so many times fewer unknowns than the other: both make a matrix, and
    /// this one multiplies by `W` and its inverse.
    fewer_unknowns: usize = 2;

    // enumerate.rs
    /// Nodes that a solver visits at most, some seconds of work. The bounds that cut most of the
    /// tree for an elastic W cut nothing for an indefinite one.
    most_nodes: usize = 200_000;
}

/// `θ` and the initial `z = s`, in units of `e`, of each attempt to follow a path: one may succeed
/// where another stalls. Paths that start far inside turn less often. Each further attempt solves
/// some problems of the collection that those before it do not; its order changes only the time.
pub(crate) const PATHS: [(f64, f64); 6] = [
    (0.9, 10.0),
    (0.8, 10.0),
    (0.7, 10.0),
    (0.85, 100.0),
    (0.6, 1.0),
    (0.8, 1.0),
];
