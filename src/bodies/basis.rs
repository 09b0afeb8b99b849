//! Rigid motions: the only basis of the program.
//!
//! A translation along an axis moves a displacement along it by 1. A rotation `e_axis × x / reach`
//! is about a centre, in units of the size of the body, so that all motions have size one and
//! neither the origin nor the unit of length changes a digit that matters.

use rayon::prelude::*;

use crate::bodies::directions::DofDirection;
use crate::linalg::pages::zeros;

/// Nodes of one task.
const NODES: usize = 4096;

/// A rigid motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigidMotion {
    Translation(usize),
    Rotation(usize),
}

/// All rigid motions: translations, then rotations. In the plane the only rotation is about z.
pub fn list_motions(dimension: usize) -> Vec<RigidMotion> {
    let axes = if dimension == 2 { 2..3 } else { 0..3 };
    let translations = (0..dimension).map(RigidMotion::Translation);
    translations
        .chain(axes.map(RigidMotion::Rotation))
        .collect()
}

impl RigidMotion {
    /// The motion of a degree of freedom at `arm` from the centre.
    pub fn at(self, direction: DofDirection, arm: [f64; 3], reach: f64) -> f64 {
        match (self, direction) {
            (Self::Translation(axis), DofDirection::Along(k)) => f64::from(u8::from(axis == k)),
            (Self::Rotation(axis), DofDirection::Along(k)) => {
                // e_axis × x has −x_b along a and x_a along b, (axis, a, b) in cyclic order.
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                if k == a {
                    -arm[b] / reach
                } else if k == b {
                    arm[a] / reach
                } else {
                    0.0
                }
            }
            (Self::Rotation(axis), DofDirection::About(k)) if k == axis => reach.recip(),
            (_, DofDirection::About(_)) => 0.0,
        }
    }
}

/// Rigid motions of nodes with `b` coordinates each, `b × m` by rows for each node: `b`
/// translations, then the rotations in the planes xy, yz, zx; `m` = 3 for `b` = 2 and 6 for
/// `b` = 3. The centre is that of the box around the nodes, the reach its largest side. With a
/// choice, the motions of other nodes than the `wanted` ones are zero.
pub fn motions_of_nodes(coordinates: &[f64], b: usize, wanted: Option<&[bool]>) -> Vec<f64> {
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
    let reach = if extent > 0.0 { extent } else { 1.0 };
    let m = 3 * (b - 1);
    let mut motions: Vec<RigidMotion> = (0..b).map(RigidMotion::Translation).collect();
    motions.extend([2, 0, 1].into_iter().take(m - b).map(RigidMotion::Rotation));
    let mut vectors = zeros(coordinates.len() * m);
    vectors
        .par_chunks_mut(NODES * b * m)
        .zip(coordinates.par_chunks(NODES * b))
        .enumerate()
        .for_each(|(task, (vectors, coordinates))| {
            let nodes = vectors
                .chunks_exact_mut(b * m)
                .zip(coordinates.chunks_exact(b));
            let nodes = (task * NODES..).zip(nodes);
            let read = |&(node, _): &(usize, _)| wanted.is_none_or(|wanted| wanted[node]);
            for (_, (rows, at)) in nodes.filter(read) {
                let mut arm = [0.0; 3];
                for c in 0..b {
                    arm[c] = at[c] - centre[c];
                }
                for (c, row) in rows.chunks_exact_mut(m).enumerate() {
                    for (value, motion) in row.iter_mut().zip(&motions) {
                        *value = motion.at(DofDirection::Along(c), arm, reach);
                    }
                }
            }
        });
    vectors
}

/// The form of [`motions_of_nodes`] without coordinates: rotations are zero.
pub fn translations_of_nodes(nodes: usize, b: usize) -> Vec<f64> {
    let m = 3 * (b - 1);
    let mut vectors = zeros(nodes * b * m);
    for rows in vectors.chunks_exact_mut(b * m) {
        for c in 0..b {
            rows[c * m + c] = 1.0;
        }
    }
    vectors
}
