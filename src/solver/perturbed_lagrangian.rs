//! Newton's method on the perturbed Lagrangian [SWT85],
//!
//! ```text
//! ½ uᵀK u − fᵀu − Σ ( r·v + ‖r − c‖²/(2 ε) ),
//! ```
//!
//! whose saddle point over `r` in the set of the law satisfies (20d). Displacements and reactions
//! both remain unknowns: the map is (19) with `ρ = 1`, and no number is multiplied by ε.

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::multipliers;
use crate::solver::outcome::Outcome;
use crate::solver::settings::Start;

/// Runs until the monitor stops it or new multipliers give no improvement.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    multipliers::run(problem, start, monitor, multipliers::regularised)
}
