//! What the set-up knows of the nodes of a level.

/// Near-null vectors, coordinates and bodies of nodes.
#[derive(Clone, Debug)]
pub struct LevelNodes {
    /// Near-null vectors, `b × m` by rows for each node: for elasticity the rigid motions.
    pub motions: Vec<f64>,
    /// Coordinates of each node, or none. Along long cells coupled nodes are far from each other,
    /// and their coupling is weak; without coordinates all couplings count alike.
    pub coordinates: Vec<f64>,
    /// The body of each node, so that each body has coarse motions of its own; empty if all
    /// nodes belong to one.
    pub bodies: Vec<u32>,
}

impl LevelNodes {
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
}
