//! Contacts that contradict each other: walls that overlap, whatever the bodies do.

use crate::linalg::small::tangential_norm;
use crate::reduced::reduced::Reduced;

/// Whether the normal reactions at which an iteration ended prove that contacts
/// contradict each other: they push against one another and nothing else,
/// `W d = 0`, `Rᵀ d = 0`, while `d·q < 0`. No displacement opens all of them, for
/// `d·v` is that product whatever the reactions are, and a sum of `d_n v_n ≥ 0`.
#[must_use]
pub fn overlap<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> bool {
    /// Beside blocks of mean diagonal one, below this the rounding of a sum.
    const NOTHING: f64 = 1e-9;
    let scaling = &problem.scaling;
    let d: Vec<[f64; D]> = r
        .iter()
        .map(|r| std::array::from_fn(|k| if k == 0 { r[0] } else { 0.0 }))
        .collect();
    let length = scaling.reaction_norm(&d);
    let mut moved = vec![[0.0; D]; r.len()];
    problem.compliance.product(&d, &mut moved);
    let (mut motion, mut work, mut size) = (0.0_f64, 0.0, 0.0_f64);
    for (i, (d, q)) in d.iter().zip(&problem.q).enumerate() {
        motion = motion.hypot(tangential_norm(&moved[i]).hypot(moved[i][0]) * scaling.to_v[i]);
        let free = q[0] * scaling.to_v[i];
        work += d[0] * scaling.to_r[i] * free;
        if d[0] > 0.0 {
            size = size.hypot(free);
        }
    }
    let balanced = scaling.modes.iter().all(|mode| {
        let terms = mode.iter().zip(&d).zip(&scaling.to_r);
        let sum: f64 = terms.map(|((m, d), s)| m[0] * d[0] * s).sum();
        sum.abs() <= NOTHING * length
    });
    length > 0.0 && motion <= NOTHING * length && balanced && work < -1e-6 * size * length
}
