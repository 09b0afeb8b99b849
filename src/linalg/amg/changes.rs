//! Changes of variables at some nodes.

use crate::linalg::amg::block_matrix::{BlockMatrix, ROWS, cut};
use crate::tasks;

/// A node that keeps its variables.
const SAME: u32 = u32::MAX;

impl BlockMatrix {
    /// Replaces `A` by `Tᵀ A T`. `T` is the identity but for a few nodes, each with its block,
    /// `b × b` by columns.
    ///
    /// # Panics
    /// If there is no such node, or a block has not `b²` entries.
    pub fn change_variables<'a>(&mut self, blocks: impl Iterator<Item = (usize, &'a [f64])>) {
        let (b, nodes) = (self.b, self.nodes());
        let mut which = vec![SAME; nodes];
        let mut changes: Vec<f32> = Vec::new();
        for (number, (node, block)) in (0..).zip(blocks) {
            assert_eq!(block.len(), b * b);
            which[node] = number;
            #[expect(clippy::cast_possible_truncation, reason = "a preconditioner")]
            changes.extend(block.iter().map(|&value| value as f32));
        }
        let change = |node: usize| {
            let number = which[node];
            (number != SAME).then(|| &changes[number as usize * b * b..][..b * b])
        };
        let (start, column) = (&self.start, &self.column);
        let parts = cut(&mut self.values, nodes, |i| start[i] as usize * b * b);
        tasks::for_each(parts, |task, part| {
            let mut blocks = part.chunks_exact_mut(b * b);
            let mut old = vec![0.0_f32; b * b];
            for i in task * ROWS..nodes.min((task + 1) * ROWS) {
                let left = change(i);
                for &j in &column[start[i] as usize..start[i + 1] as usize] {
                    let Some(block) = blocks.next() else { return };
                    if let Some(left) = left {
                        old.copy_from_slice(block);
                        for c in 0..b {
                            for r in 0..b {
                                let terms = (0..b).map(|l| left[r * b + l] * old[c * b + l]);
                                block[c * b + r] = terms.sum();
                            }
                        }
                    }
                    if let Some(right) = change(j as usize) {
                        old.copy_from_slice(block);
                        for c in 0..b {
                            for r in 0..b {
                                let terms = (0..b).map(|l| old[l * b + r] * right[c * b + l]);
                                block[c * b + r] = terms.sum();
                            }
                        }
                    }
                }
            }
        });
        // A variable without an unknown has lost its diagonal.
        for node in (0..nodes).filter(|&node| which[node] != SAME) {
            self.fill_diagonal(node);
        }
    }
}
