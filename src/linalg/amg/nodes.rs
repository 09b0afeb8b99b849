//! What the set-up knows of the nodes of a level.

use rayon::prelude::*;

use crate::linalg::amg::aggregates::Aggregates;

/// Near-null vectors, coordinates and bodies of nodes.
#[derive(Clone, Debug)]
pub struct Nodes {
    /// Near-null vectors, `b × m` by rows for each node, as
    /// [`rigid_motions`](super::rigid_motions::rigid_motions) gives them.
    pub motions: Vec<f64>,
    /// Coordinates of each node. Along long cells coupled nodes are far from each other, and
    /// their coupling is weak.
    pub coordinates: Vec<f64>,
    /// The body of each node, so that each body has coarse motions of its own; empty if all
    /// nodes belong to one.
    pub bodies: Vec<u32>,
}

impl Nodes {
    /// Squared distance of two of `count` nodes.
    #[inline]
    pub(super) fn squared_distance(&self, count: usize, i: usize, j: usize) -> f64 {
        let d = self.coordinates.len() / count;
        let (from, to) = (&self.coordinates[i * d..], &self.coordinates[j * d..]);
        let squares = from.iter().zip(to).take(d).map(|(x, y)| (x - y) * (x - y));
        squares.sum()
    }

    /// Whether two nodes belong to one body.
    #[inline]
    pub(super) fn together(&self, i: usize, j: usize) -> bool {
        self.bodies.is_empty() || self.bodies[i] == self.bodies[j]
    }

    /// The nodes of the next level, in the middle of their members, with the near-null vectors
    /// `motions`.
    pub(super) fn coarse(&self, aggregates: &Aggregates, motions: Vec<f64>) -> Self {
        let d = self.coordinates.len() / aggregates.of_node.len().max(1);
        let count = aggregates.count();
        let mut coordinates = vec![0.0; count * d];
        let centres = coordinates.par_chunks_mut(d).enumerate();
        centres.with_min_len(1 << 10).for_each(|(g, centre)| {
            let own = aggregates.members_of(g);
            #[expect(clippy::cast_precision_loss, reason = "a count of members")]
            let share = (own.len() as f64).recip();
            for (k, centre) in centre.iter_mut().enumerate() {
                let along = own.iter().map(|&i| self.coordinates[i as usize * d + k]);
                *centre = share * along.sum::<f64>();
            }
        });
        let bodies = if self.bodies.is_empty() {
            Vec::new()
        } else {
            let first = |g| self.bodies[aggregates.members_of(g)[0] as usize];
            (0..count).map(first).collect()
        };
        Self {
            motions,
            coordinates,
            bodies,
        }
    }
}
