//! The predicted cost of a condensation.

use std::sync::{Arc, Mutex, PoisonError};

/// Counts of the analysis, summed over the bodies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecast {
    pub bodies: usize,
    /// Unknowns after the condensation.
    pub contact_dofs: usize,
    pub nnz_factor: usize,
    /// Additions and multiplications of the partial factorisation.
    pub flops: f64,
    pub bytes_factor: usize,
    /// Largest number of bytes during the condensation.
    pub bytes_peak: u128,
    pub ordering: &'static str,
}

/// Passes a forecast to another thread.
#[derive(Clone, Debug, Default)]
pub struct Notice(Arc<Mutex<Option<Forecast>>>);

impl Notice {
    /// A later forecast replaces one that was not read: bodies that a few contacts do not hold
    /// are analysed again with all contacts.
    pub fn leave(&self, forecast: Forecast) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(forecast);
    }

    /// The forecast, once.
    pub fn take(&self) -> Option<Forecast> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
