//! The fitted constants of multigrid.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`:
//! Krylov iterations of four shipped scenes with 6 to 10 cells a side. Where it is missing,
//! neither changes it, as a rule because these sets do not reach the constant.

use crate::fitted::fitted;

fitted! {
    // aggregates.rs
    /// A neighbour that is so many times as far as the nearest one is weakly coupled: a cell couples
    /// in proportion to the inverse squares of its sides. Diagonals of cubes, and two cells of the
    /// second order, stay below.
    /// Half, twice: −3.4 %, +2.1 %.
    far: f64 = 3.0;
    /// Fewer neighbours than this stand in a line: their neighbours join the aggregate too, because
    /// three nodes in a line would become one with nearly as many unknowns.
    /// Half, twice: −2.1 %, −3.4 %.
    plane: usize = 3;

    // spectrum.rs
    /// Steps of the Lanczos iteration: the largest Ritz value is then within a few percent of the
    /// largest eigenvalue.
    /// Half, twice: −1.7 %, same.
    spectrum_steps: usize = 10;
    /// Factor that turns the Ritz value into a bound. The smoother also damps what is slightly
    /// above its bound.
    /// Half, twice: −31.9 %, +26.8 %.
    spectrum_safety: f64 = 1.05;

    // tentative.rs
    /// A larger one is that of a motion that the aggregate hardly has.
    largest_extension: f64 = 64.0;

    // hierarchy.rs
    /// `ω λ` of the smoothed prolongation.
    /// Half, twice: +8.9 %, +3.0 %.
    omega: f64 = 4.0 / 3.0;
    /// At most so many unknowns are solved with a dense factor.
    /// Half, twice: same, −6.8 %.
    dense_unknowns: usize = 800;

    // inverse_diagonal.rs
    least_pivot: f64 = 1e-6;

    // soft_motions.rs
    /// Cycles for each vector: more do not save iterations later.
    softening_cycles: usize = 6;
    /// Products of the check that nothing is free to move.
    check_products: usize = 300;
}
