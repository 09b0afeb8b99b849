//! The cost of a condensation, counted and timed.

/// Counts and seconds of a condensation.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    pub nnz_factor: usize,
    pub flops: f64,
    pub bytes_factor: usize,
    /// Predicted before the allocation.
    pub bytes_peak: u128,
    /// Whether the factor was kept, for displacements.
    pub factor_kept: bool,
    pub contact_dofs: usize,
    pub bodies: usize,
    pub islands: usize,
    pub cond_s: f64,
    /// Bound of the relative error of `W`, in ε; at least `cond_s`.
    pub amplification: f64,
    pub ordering: &'static str,
    /// Bodies that were ordered; for the others an analysis was known.
    pub orderings: usize,
    pub seconds_order: f64,
    pub seconds_symbolic: f64,
    pub seconds_factor: f64,
    pub seconds_compliance: f64,
}
