//! Anderson acceleration of a fixed-point map (type II, windowed).
//!
//! With `f = G(x) − x`, the next point is `G(x) − ΔG γ`, where `γ` is the least-squares
//! solution of `ΔF γ = f` over the last steps. Quantities that are affine in `x` (here `v`, and
//! the balance of forces) follow with the same `γ`, without a product.

use std::collections::VecDeque;

use crate::linalg::least_squares;
use crate::solver::tuning;

/// The last steps.
#[derive(Debug, Default)]
pub struct Anderson {
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// `(ΔF, ΔP)`, oldest first.
    steps: VecDeque<(Vec<f64>, Vec<f64>)>,
}

impl Anderson {
    /// Removes all steps.
    pub fn restart(&mut self) {
        self.last = None;
        self.steps.clear();
    }

    /// Takes `f` and the payload `p` of `G(x)`. Returns the extrapolated payload, or `None`
    /// without an earlier step.
    pub fn extrapolate(&mut self, f: &[f64], payload: &[f64]) -> Option<Vec<f64>> {
        if let Some((last_f, last_p)) = &self.last {
            let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x - y).collect();
            if self.steps.len() == tuning::anderson_memory() {
                let _ = self.steps.pop_front();
            }
            self.steps
                .push_back((difference(f, last_f), difference(payload, last_p)));
        }
        self.last = Some((f.to_vec(), payload.to_vec()));
        if self.steps.is_empty() {
            return None;
        }
        // Newest first: of nearly dependent steps the older one is omitted.
        let columns: Vec<&[f64]> = self.steps.iter().rev().map(|(f, _)| f.as_slice()).collect();
        let gamma = least_squares::solve(&columns, f);
        let mut next = payload.to_vec();
        for ((_, step), gamma) in self.steps.iter().rev().zip(&gamma) {
            for (value, change) in next.iter_mut().zip(step) {
                *value -= gamma * change;
            }
        }
        Some(next)
    }
}
