//! Return mapping [G89]: contact as an elastoplastic law. The trial reaction is elastic, and
//! returns to the half-line of the normal law, then to the disc of the friction law,
//!
//! ```text
//! τ = c − ε v,    r_n = max(τ_n, 0),    r_t = min(1, μ r_n/‖τ_t‖) τ_t                 (20e)
//! ```
//!
//! The reaction is a function of the displacement, whose derivative is the consistent tangent of
//! Newton's method. It is the map (19) with the step `ρ = ε`, applied to `v'` of (20d): in
//! `r − ε v' = c − ε v` the reaction cancels, and `F = r − r(v)`.

use crate::error::Error;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::multipliers;
use crate::solver::newton::newton::Near;
use crate::solver::outcome::Outcome;
use crate::solver::settings::Start;

/// [`multipliers::regularised`] with the step ε.
#[must_use]
pub fn regularised<const D: usize>(penalty: f64, multipliers: Vec<[f64; D]>) -> Near<D> {
    Near {
        rho: penalty,
        ..multipliers::regularised(penalty, multipliers)
    }
}

/// Runs until the monitor stops it or new multipliers give no improvement.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    multipliers::run(problem, start, monitor, regularised)
}
