//! Bodies: nodes that a matrix couples, directly or through others.

use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::sparse::csc::narrow;
use crate::linalg::union::Union;

impl BlockMatrix<f64> {
    /// The body of each node, numbered in the order of first appearance. A block of zeros does
    /// not couple.
    #[must_use]
    pub fn connected(&self) -> Vec<u32> {
        let (nodes, size) = (self.nodes(), self.b * self.b);
        let mut sets = Union::new(nodes);
        for i in 0..nodes {
            for at in self.row(i) {
                let j = self.column[at] as usize;
                let block = &self.values[at * size..(at + 1) * size];
                if j > i && block.iter().any(|&value| value != 0.0) {
                    sets.join(i, j);
                }
            }
        }
        sets.numbers().into_iter().map(narrow).collect()
    }
}
