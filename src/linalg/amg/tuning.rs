//! The fitted constants of multigrid. `benches/tuning.py` prints what half and twice each value
//! does.

use crate::fitted::fitted;

fitted! {
    // cycle.rs
    /// A residual this much smaller needs no second step.
    second_step: f64 = 0.25;

    // aggregates.rs
    /// A neighbour that is so many times as far as the nearest one is weakly coupled: a cell couples
    /// in proportion to the inverse squares of its sides. Diagonals of cubes, and two cells of the
    /// second order, stay below.
    far: f64 = 3.0;
    /// Fewer neighbours than this stand in a line: their neighbours join the aggregate too, because
    /// three nodes in a line would become one with nearly as many unknowns.
    plane: usize = 3;

    // spectrum.rs
    /// Steps of the Lanczos iteration: the largest Ritz value is then within a few percent of the
    /// largest eigenvalue.
    spectrum_steps: usize = 10;
    /// Factor that turns the Ritz value into a bound. The smoother also damps what is slightly
    /// above its bound.
    spectrum_safety: f64 = 1.05;

    // tentative.rs
    /// A larger one is that of a motion that the aggregate hardly has.
    largest_extension: f64 = 64.0;

    // hierarchy.rs
    /// `ω λ` of the smoothed prolongation.
    omega: f64 = 4.0 / 3.0;

    // inverse_diagonal.rs
    least_pivot: f64 = 1e-6;
}
