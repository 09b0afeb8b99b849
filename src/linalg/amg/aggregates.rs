//! Aggregates: groups of coupled nodes, each of which becomes one node of the next level.

use rayon::prelude::*;

use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix, ROWS};
use crate::linalg::sparse::csc::narrow;

/// Nodes by aggregate.
#[derive(Clone, Debug)]
pub(super) struct Aggregates {
    /// The aggregate of each node. A node that is coupled to no other has [`ABSENT`]: the
    /// smoother solves its equations.
    pub(super) of_node: Vec<u32>,
    /// Start of each aggregate in `members`.
    pub(super) start: Vec<u32>,
    pub(super) members: Vec<u32>,
}

impl Aggregates {
    pub(super) fn count(&self) -> usize {
        self.start.len() - 1
    }

    /// Groups each node whose neighbours are all free with these neighbours; joins the rest to
    /// the aggregate of their strongest neighbour. All couplings count: a threshold for weak
    /// ones leaves the rotations of small aggregates to the smoother. Only couplings between
    /// nodes of different `bodies`, one for each node if there are any, do not: one motion of
    /// both is not enough for two bodies that slide along each other.
    ///
    /// One thread does this, so that the result does not depend on their number; it takes a few
    /// percent of the set-up.
    pub(super) fn new(matrix: &BlockMatrix<f32>, bodies: &[u32]) -> Self {
        let nodes = matrix.nodes();
        let couplings = couplings(matrix, bodies);
        let neighbours = |i: usize| {
            let row = matrix.row(i);
            let columns = matrix.column[row.clone()].iter().zip(&couplings[row]);
            columns.filter(|(_, size)| **size > 0.0)
        };
        let mut of_node = vec![ABSENT; nodes];
        let mut count = 0;
        for i in 0..nodes {
            if of_node[i] != ABSENT {
                continue;
            }
            let mut near = neighbours(i).peekable();
            if near.peek().is_none() || near.any(|(&j, _)| of_node[j as usize] != ABSENT) {
                continue;
            }
            of_node[i] = count;
            for (&j, _) in neighbours(i) {
                of_node[j as usize] = count;
            }
            count += 1;
        }
        let first = of_node.clone();
        for (i, own) in of_node.iter_mut().enumerate() {
            if *own != ABSENT {
                continue;
            }
            let mut strongest = (0.0, ABSENT);
            for (&j, &size) in neighbours(i) {
                let aggregate = first[j as usize];
                if aggregate != ABSENT && size > strongest.0 {
                    strongest = (size, aggregate);
                }
            }
            *own = strongest.1;
        }
        // Nodes whose neighbours had no aggregate either.
        for i in 0..nodes {
            if of_node[i] != ABSENT || neighbours(i).next().is_none() {
                continue;
            }
            of_node[i] = count;
            for (&j, _) in neighbours(i) {
                if of_node[j as usize] == ABSENT {
                    of_node[j as usize] = count;
                }
            }
            count += 1;
        }
        let (start, members) = by_group(&of_node, count as usize);
        Self {
            of_node,
            start,
            members,
        }
    }
}

/// Norm of each block beside the diagonal, zero for one that is only rounding or between bodies.
fn couplings(matrix: &BlockMatrix<f32>, bodies: &[u32]) -> Vec<f32> {
    /// Of the diagonal block. Single precision rounds at 1e-7 of an entry; assembly cancels
    /// entries to 1e-16 of their terms.
    const ROUNDING: f32 = 1e-12;
    let size = matrix.b * matrix.b;
    let norm = |block: &[f32]| {
        let squares = block.iter().map(|&x| f64::from(x) * f64::from(x));
        #[expect(clippy::cast_possible_truncation, reason = "rounding")]
        let norm = squares.sum::<f64>().sqrt() as f32;
        norm
    };
    let rows: Vec<Vec<f32>> = (0..matrix.nodes().div_ceil(ROWS))
        .into_par_iter()
        .map(|task| {
            let mut norms = Vec::new();
            for i in task * ROWS..matrix.nodes().min((task + 1) * ROWS) {
                let least = ROUNDING * norm(matrix.diagonal_block(i));
                for at in matrix.row(i) {
                    let norm = norm(&matrix.values[at * size..(at + 1) * size]);
                    let j = matrix.column[at] as usize;
                    let together = bodies.is_empty() || bodies[i] == bodies[j];
                    let coupled = j != i && together && norm > least;
                    norms.push(if coupled { norm } else { 0.0 });
                }
            }
            norms
        })
        .collect();
    rows.concat()
}

/// Indices of each group, ascending: start of each group, and all indices. [`ABSENT`] is in no
/// group.
pub(super) fn by_group(group: &[u32], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0; count + 1];
    for &g in group.iter().filter(|&&g| g != ABSENT) {
        start[g as usize + 1] += 1;
    }
    for g in 0..count {
        start[g + 1] += start[g];
    }
    let mut next = start.clone();
    let mut members = vec![0; start[count] as usize];
    for (i, &g) in group.iter().enumerate().filter(|(_, g)| **g != ABSENT) {
        members[next[g as usize] as usize] = narrow(i);
        next[g as usize] += 1;
    }
    (start, members)
}
