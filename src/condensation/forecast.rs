//! The predicted cost of a condensation.

use std::sync::{Arc, Mutex};

use crate::linalg::sparse::symbolic::Counts;
use crate::tasks::lock;

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

impl Forecast {
    /// Of bodies with these counts.
    pub fn new<'a>(bytes_peak: u128, bodies: impl Iterator<Item = &'a Counts>) -> Self {
        let mut told = Self {
            bytes_peak,
            ..Self::default()
        };
        for counts in bodies {
            told.bodies += 1;
            told.contact_dofs += counts.kept;
            told.nnz_factor += counts.nnz_factor;
            told.flops += counts.flops;
            told.bytes_factor += counts.bytes_factor;
            if told.ordering.is_empty() {
                told.ordering = counts.ordering;
            }
        }
        told
    }
}

/// Passes a forecast to another thread.
#[derive(Clone, Debug, Default)]
pub struct Notice(Arc<Mutex<Option<Forecast>>>);

impl Notice {
    /// A later forecast replaces one that was not read: bodies that a few contacts do not hold
    /// are analysed again with all contacts.
    pub fn leave(&self, forecast: Forecast) {
        *lock(&self.0) = Some(forecast);
    }

    /// The forecast, once.
    pub fn take(&self) -> Option<Forecast> {
        lock(&self.0).take()
    }
}
