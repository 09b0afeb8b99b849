//! Near-null vectors of elasticity from coordinates.

use rayon::prelude::*;

use crate::linalg::pages::zeros;

/// Nodes of one task.
const NODES: usize = 4096;

/// Rigid motions of nodes with `b` coordinates each, `b × m` by rows for each node: `b`
/// translations, then the rotations, `m` = 3 for `b` = 2 and 6 for `b` = 3.
///
/// Coordinates are taken from the centre of the nodes, in units of their largest extent, so that
/// neither the origin nor the unit of length changes a digit that matters.
///
/// # Panics
/// If `b` is neither 2 nor 3, or the coordinates are not `b` for each node.
#[must_use]
pub fn rigid_motions(coordinates: &[f64], b: usize) -> Vec<f64> {
    assert!(b == 2 || b == 3, "bodies are in the plane or in space");
    assert_eq!(coordinates.len() % b, 0);
    let mut centre = [0.0; 3];
    let mut extent = 0.0_f64;
    for c in 0..b {
        let along = coordinates[c..].iter().step_by(b);
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
            (low.min(x), high.max(x))
        });
        centre[c] = 0.5 * low + 0.5 * high;
        extent = extent.max(high - low);
    }
    let scale = if extent > 0.0 { extent } else { 1.0 };
    let m = 3 * (b - 1);
    // Rotations in the planes of these axes.
    let planes = [(0, 1), (1, 2), (2, 0)];
    let mut vectors = zeros(coordinates.len() * m);
    vectors
        .par_chunks_mut(NODES * b * m)
        .zip(coordinates.par_chunks(NODES * b))
        .for_each(|(vectors, coordinates)| {
            let nodes = vectors
                .chunks_exact_mut(b * m)
                .zip(coordinates.chunks_exact(b));
            for (rows, at) in nodes {
                let x = |c: usize| (at[c] - centre[c]) / scale;
                for c in 0..b {
                    rows[c * m + c] = 1.0;
                }
                for (k, &(first, second)) in planes[..m - b].iter().enumerate() {
                    rows[first * m + b + k] = -x(second);
                    rows[second * m + b + k] = x(first);
                }
            }
        });
    vectors
}

/// The form of [`rigid_motions`] without coordinates: rotations are zero.
#[must_use]
pub fn translations(nodes: usize, b: usize) -> Vec<f64> {
    let m = 3 * (b - 1);
    let mut vectors = zeros(nodes * b * m);
    for rows in vectors.chunks_exact_mut(b * m) {
        for c in 0..b {
            rows[c * m + c] = 1.0;
        }
    }
    vectors
}
