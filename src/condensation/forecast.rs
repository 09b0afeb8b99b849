//! What a condensation will cost, told before its numbers.

use std::sync::{Arc, Mutex, PoisonError};

/// Counts of the analysis, summed over the bodies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecast {
    pub bodies: usize,
    /// Unknowns that the bodies are condensed onto.
    pub contact_dofs: usize,
    pub nnz_factor: usize,
    /// Additions and multiplications of the partial factorisation.
    pub flops: f64,
    pub bytes_factor: usize,
    /// Bytes at the height of the condensation.
    pub bytes_peak: u128,
    pub ordering: &'static str,
}

/// Where a forecast is left for whoever waits for it on another thread.
#[derive(Clone, Debug, Default)]
pub struct Notice(Arc<Mutex<Option<Forecast>>>);

impl Notice {
    /// A later forecast takes the place of one that nobody has taken: bodies that few
    /// contacts do not hold are analysed again with all.
    pub fn leave(&self, forecast: Forecast) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(forecast);
    }

    /// The forecast, once.
    #[must_use]
    pub fn take(&self) -> Option<Forecast> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
