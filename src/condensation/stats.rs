//! The cost of a condensation, counted and timed.

use crate::condensation::forecast::Forecast;

/// Counts and seconds of a condensation.
#[derive(Clone, Debug)]
pub struct Stats {
    pub forecast: Forecast,
    /// Whether the factor was kept, for displacements.
    pub factor_kept: bool,
    pub islands: usize,
    pub cond_s: f64,
    /// Bound of the relative error of `W`, in ε; at least `cond_s`.
    pub amplification: f64,
    /// Bodies that were ordered; for the others an analysis was known.
    pub orderings: usize,
    pub seconds_order: f64,
    pub seconds_symbolic: f64,
    pub seconds_factor: f64,
    pub seconds_compliance: f64,
}
