//! Which rows of `K` resist the rigid motions, and how much.

use crate::linalg::compensated::Sum;

/// Largest `|K z|` in a row that rounding explains, for a rigid motion of size 1, in ε of the
/// sum of sizes of the row. Each entry of an assembled stiffness has a rounding of a few ε, and
/// so has the motion; stiffnesses of first and second order, also of flat elements, give at
/// most 1.2, and more after a rotation. A spring or a support gives its share of the row.
pub const ROUNDING: f64 = 64.0;

/// The forces of rigid motions of size 1 in a row of `K` with these entries, relative to the
/// sum of their sizes, with sums in twice the precision; `None` if all of them are rounding.
/// `motion(j, k)` is motion `k` at unknown `j`; `loss` is how many times larger than the entries
/// the terms are from which they were summed.
pub fn measure_resistance(
    entries: impl Iterator<Item = (usize, f64)>,
    motions: usize,
    motion: impl Fn(usize, usize) -> f64,
    loss: f64,
) -> Option<Vec<f64>> {
    let mut forces = vec![Sum::new(0.0); motions];
    let mut size = 0.0;
    for (j, value) in entries {
        for (k, force) in forces.iter_mut().enumerate() {
            force.add_product(-value, motion(j, k));
        }
        size += loss * value.abs();
    }
    let forces: Vec<f64> = forces.iter().map(Sum::value).collect();
    let resists = |force: &f64| force.abs() > ROUNDING * f64::EPSILON * size;
    let resisting = forces.iter().any(resists);
    resisting.then(|| forces.iter().map(|force| force / size).collect())
}
