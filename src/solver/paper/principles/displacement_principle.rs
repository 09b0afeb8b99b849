//! The displacement principle [dSF91, 67, 68]: unilateral contact and friction in one convex
//! problem, with friction limits from the last pressures.
//!
//! In displacements, it minimises `½ uᵀK u − fᵀu + Σ s ‖v_t‖` over `v_n ≥ 0` with `s = μ r_n`
//! fixed. Its dual is solved: minimise `½ rᵀW r + qᵀr` over `r_n ≥ 0`, `‖r_t‖ ≤ s`. There `r_n`
//! is the multiplier of `v_n ≥ 0` in [dSF91, 38b]. With cohesion `s = c + μ r_n`. With dilatancy the
//! constraint is `v_n ≥ β‖v_t‖`, and the dual has `‖r_t‖ ≤ β r_n + c + (μ − β) r_n^k` with the last
//! pressures `r_n^k`: an associated law.

use crate::law::contact_law::ContactLaw;
use crate::law::frozen::Frozen;
use crate::reduced::reduced::Reduced;

/// The laws of a pass, with friction limits from the pressures of `r`.
pub fn frozen<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<Frozen<D>> {
    let limit = |(r, law): (&[f64; D], &ContactLaw)| {
        let pressure = r[0].max(0.0);
        if law.dilatancy == 0.0 {
            let limit = law.limit(pressure);
            return Frozen::Tresca { limit };
        }
        let law = ContactLaw {
            mu: law.dilatancy,
            cohesion: law.cohesion + law.correction() * pressure,
            dilatancy: law.dilatancy,
        };
        Frozen::Cone { law, slip: 0.0 }
    };
    r.iter().zip(&problem.law).map(limit).collect()
}
