//! The fitted constants of load steps in the displacements.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! Krylov iterations of four shipped scenes with 6 to 10 cells a side. Where it is missing,
//! neither changes it, as a rule because these sets do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // newton.rs
    /// Largest number of Newton steps.
    newton_steps: usize = 60;
    /// Largest number of halvings of a step.
    halvings: usize = 6;
    /// Share of the statuses that change while a coarse solution of the step is enough.
    many_changes: f64 = 0.002;
    /// Relative residual of the linear system while many statuses change, while some do, and after.
    /// A smaller one for many changes saves no Newton step and costs a fifth more iterations.
    /// Half, twice: +0.9 %, −2.6 %.
    coarse_residual: f64 = 1e-2;
    middle_residual: f64 = 1e-5;
    fine_residual: f64 = 1e-8;
    /// Points that the certificate accepts and the displacements do not, after which the method has
    /// stalled: `K` has too few digits.
    unsettled_points: usize = 4;
    /// Steps without a better point after which the method has stalled.
    patience: usize = 12;

    // load_step.rs, where statuses do not settle
    /// The first share of friction, the least increment, and the tolerance of η below the whole.
    first_share: f64 = 0.25;
    least_share: f64 = 0.01;
    tolerance_of_share: f64 = 1e-6;

    // preconditioner.rs
    /// Iterations of one linear system after which a stronger smoother is used.
    slow_iterations: usize = 40;
    stronger_degree: usize = 4;
    /// Share of slipping and open contacts, and iterations of one linear system, above which the
    /// hierarchy follows the statuses of contacts between bodies.
    /// Half, twice: −1.3 %, +4.7 %.
    loose_share: f64 = 0.6;
    slow_glued: usize = 30;

    // local.rs
    /// Iterations of one linear system after which the method has stalled, and the size of the
    /// Krylov space before a restart.
    most_iterations: usize = 400;
    basis: usize = 80;

    // linearised_laws.rs
    /// Compliance that the multiplier `M` adds to a law, relative to that of its contact: a contact
    /// that hardly slips has no stiffer spring than its inverse. The equations stay exact.
    least_compliance: f64 = 1e-3;

    // contacts.rs
    /// `W_ii K_ii` of a node on the surface of a mesh, about. It only scales the law of each
    /// contact: a wrong factor costs iterations.
    /// Half, twice: −0.4 %, +11.1 %.
    compliance_of_node: f64 = 2.0;

    // problem.rs
    /// Bytes of the hierarchy relative to the half of `K` that is stored in double precision; for
    /// the forecast.
    hierarchy_bytes: f64 = 1.35;
    /// Bytes of the vectors of GMRES and of the Newton steps for each unknown, most of them in single
    /// precision.
    vector_bytes: usize = 210;
}
