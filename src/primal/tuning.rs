//! The fitted constants of load steps in the displacements. `benches/tuning.py` prints what half
//! and twice each value does.

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
    coarse_residual: f64 = 1e-2;
    middle_residual: f64 = 1e-5;
    fine_residual: f64 = 1e-8;
    /// Points that the certificate accepts and the displacements do not, after which the method has
    /// stalled: `K` has too few digits.
    unsettled_points: usize = 4;
    /// Steps without a better point after which the method has stalled.
    patience: usize = 12;

    // preconditioner.rs
    /// Iterations of one linear system after which a stronger smoother is used.
    slow_iterations: usize = 40;
    stronger_degree: usize = 4;
    /// Share of slipping and open contacts, and iterations of one linear system, above which the
    /// hierarchy follows the statuses of contacts between bodies.
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
    compliance_of_node: f64 = 2.0;
}
