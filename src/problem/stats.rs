//! What a condensation cost, counted and timed.

/// Counts and seconds of a condensation.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    pub nnz_factor: usize,
    pub flops: f64,
    pub bytes_factor: usize,
    pub bytes_peak: usize,
    pub contact_dofs: usize,
    pub bodies: usize,
    pub islands: usize,
    pub cond_s: f64,
    /// Relative error that `W` may have, in ε; at least `cond_s`.
    pub amplification: f64,
    pub ordering: &'static str,
    pub seconds_order: f64,
    pub seconds_symbolic: f64,
    pub seconds_factor: f64,
    pub seconds_compliance: f64,
}
