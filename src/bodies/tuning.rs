//! Thresholds that were fitted. Those that follow from rounding stand beside their use.
//!
//! The set of all of them: stiffnesses of meshes of first and second order (triangles to
//! hexahedra, cells from 1:1 to 1:1000, rotated by random angles and not), steel strips of
//! 1000 mm from 0.5 to 2 mm thick with one end clamped, chains of bars, trusses and mechanisms
//! (`tests/core/condensation.rs`, `tests/python/contact/`). The comments on half and
//! twice each value follow from these measurements. `benches/tuning.py` counts the free motions of
//! 45 of these strips without coordinates: half and twice each value change none of them.

use crate::fitted::fitted;

fitted! {
    /// The rounding of `|K x|` of a motion, in ε of the terms of its row, if K alone is known.
    /// Rigid motions of assembled stiffnesses give 1.2, and the rounding of the motion itself as
    /// much again. The softest bending of a strip gives 2600 at a thickness of 2 mm and 10 at
    /// 0.5 mm: at half the value rotated meshes float less often, at twice it the strip of 0.5 mm
    /// passes this test and only [`energy_share`] stops it.
    rounding: f64 = 6.0;

    /// Largest energy of a motion without resistance, as a share of `C ε |x|ᵀ |K| |x|`. Rigid
    /// motions give 0.002 to 0.06, because roundings have either sign. The bending of a strip gives
    /// 117 at 2 mm and 0.47 at 0.5 mm, where rows alone do not decide: between 0.1 and 0.4 nothing
    /// changes.
    energy_share: f64 = 0.2;

    /// [`rounding`] if the next motion is stiffer than rounding by [`apart`]: a stiffness that was
    /// rotated, scaled or summed elsewhere has more rounding, and bending has no such gap after its
    /// first mode.
    rounding_apart: f64 = 200.0;
    apart: f64 = 1e4;

    /// Least ratio of the energy of the next motion to rounding, if motions beyond the rigid ones
    /// have no energy. The energies of the first bending modes differ by a factor of ten to forty;
    /// the elastic modes of a mechanism are far above its free motions.
    mechanism_gap: f64 = 1e3;

    /// `mechanism_gap` for motions of which only the stiffness is known. The second bending mode of a
    /// cantilever has 39 times the energy of the first, which counts as zero below a fifth of
    /// rounding.
    clear_gap: f64 = 20.0;

    /// Least share of the rows without supports that must be in balance to accept the directions
    /// of degrees of freedom: with wrong ones hardly any row is.
    believed_share: f64 = 0.25;

    /// The first shift of inverse iteration, relative to the diagonal of `K`: far above rounding,
    /// far below stiff motions. It increases with the rounding.
    first_shift: f64 = 1e-10;
    shift_growth: f64 = 100.0;
    largest_shift: f64 = 1e-4;

    /// Rounds of inverse iteration.
    inverse_rounds: usize = 5;

    /// Number of motions examined first; more if all of them are soft.
    block_width: usize = 9;

    /// A force of a rigid motion above this part of its terms is that of a spring. Below it, and
    /// above rounding, `K` may have few digits, whose errors look like weak springs: undecided.
    spring_force: f64 = 1e-4;

    /// If the softest motion of the interior has less energy, relative to the diagonal of `K`, it
    /// may be rounding.
    doubtful_energy: f64 = 1e-11;

    /// Largest difference between a motion found by iteration and a rigid one.
    near_rigid: f64 = 1e-3;
}
