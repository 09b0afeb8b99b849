//! Anderson acceleration of a fixed-point map (type II, windowed).
//!
//! With `f = G(x) − x`, the next point is `G(x) − ΔG γ`, where `γ` is the least-squares
//! solution of `ΔF γ = f` over the last steps. Quantities that are affine in `x` (here `v`, and
//! the balance of forces) follow with the same `γ`, without a product.

use std::collections::VecDeque;

use crate::linalg::least_squares;
use crate::linalg::small::{add_scaled, plus_scaled};
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
    pub fn extrapolate(&mut self, f: Vec<f64>, payload: Vec<f64>) -> Option<Vec<f64>> {
        if let Some((last_f, last_p)) = self.last.take() {
            let of_f = plus_scaled(&f, -1.0, &last_f);
            if self.steps.len() == tuning::anderson_memory() {
                let _ = self.steps.pop_front();
            }
            let of_payload = plus_scaled(&payload, -1.0, &last_p);
            self.steps.push_back((of_f, of_payload));
        }
        let mut extrapolated = None;
        if !self.steps.is_empty() {
            // Newest first: of nearly dependent steps the older one is omitted.
            let steps = self.steps.iter().rev();
            let gamma = least_squares::solve(steps.clone().map(|(f, _)| f.as_slice()), &f);
            let mut next = payload.clone();
            for ((_, step), gamma) in steps.zip(&gamma) {
                add_scaled(&mut next, -gamma, step);
            }
            extrapolated = Some(next);
        }
        self.last = Some((f, payload));
        extrapolated
    }
}
