//! Aggregates: groups of coupled nodes, each of which becomes one node of the next level.

use crate::linalg::amg::block_matrix::{ABSENT, ROWS};
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::single_rows::LevelMatrix;
use crate::linalg::amg::tentative::Tentative;
use crate::linalg::amg::tuning;
use crate::linalg::sparse::csc::narrow;
use crate::tasks;

/// LevelNodes by aggregate.
#[derive(Clone, Debug)]
pub(super) struct Aggregates {
    /// The aggregate of each node. A node that is coupled to no other has [`ABSENT`]: the
    /// smoother solves its equations.
    pub(super) of_node: Vec<u32>,
    /// Start of each aggregate in `members`.
    pub(super) start: Vec<u32>,
    pub(super) members: Vec<u32>,
    /// Place of each node in `members`.
    pub(super) place: Vec<u32>,
    /// Whether each block of the matrix couples its nodes.
    pub(super) coupled: Vec<bool>,
}

/// A distance below this part of the largest one is that of nodes at the same place.
const SAME_PLACE: f64 = 1e-6;

impl Aggregates {
    pub(super) fn count(&self) -> usize {
        self.start.len() - 1
    }

    pub(super) fn bytes(&self) -> usize {
        let numbers = [&self.of_node, &self.start, &self.members, &self.place];
        numbers.map(|all| 4 * all.len()).iter().sum::<usize>() + self.coupled.len()
    }

    pub(super) fn members_of(&self, aggregate: usize) -> &[u32] {
        &self.members[self.start[aggregate] as usize..self.start[aggregate + 1] as usize]
    }

    /// The nodes of the next level, in the middle of their members.
    pub(super) fn coarse(&self, about: &LevelNodes, tentative: &Tentative) -> LevelNodes {
        let d = about.coordinates.len() / self.of_node.len().max(1);
        let count = self.count();
        let mut coordinates = vec![0.0; count * d];
        // Without coordinates there is no chunk.
        for (g, centre) in coordinates.chunks_mut(d.max(1)).enumerate() {
            let own = self.members_of(g);
            #[expect(clippy::cast_precision_loss, reason = "a count of members")]
            let share = (own.len() as f64).recip();
            for (k, centre) in centre.iter_mut().enumerate() {
                let along = own.iter().map(|&i| about.coordinates[i as usize * d + k]);
                *centre = share * along.sum::<f64>();
            }
        }
        let bodies = if about.bodies.is_empty() {
            Vec::new()
        } else {
            let first = |g| about.bodies[self.members_of(g)[0] as usize];
            (0..count).map(first).collect()
        };
        LevelNodes {
            motions: tentative.coarse.clone(),
            coordinates,
            bodies,
        }
    }

    /// Groups each node whose neighbours are all free with these neighbours; joins the rest to
    /// the aggregate of their strongest neighbour. Coupled are nodes of one body that are near
    /// each other. The size of a block says less: a threshold leaves the rotations of small
    /// aggregates to the smoother, and along long cells the couplings of the mass across are as
    /// large as those across. One motion is not enough for two bodies that slide along each other.
    ///
    /// One thread does this, so that the result does not depend on their number; it takes a few
    /// percent of the set-up.
    pub(super) fn new(matrix: LevelMatrix<'_>, about: &LevelNodes) -> Self {
        let nodes = matrix.nodes();
        let couplings = couplings(matrix, about);
        let neighbours = |i: usize| {
            let columns = matrix.columns(i).iter().zip(&couplings[matrix.row(i)]);
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
            let mut ring = 0;
            for (&j, _) in neighbours(i) {
                of_node[j as usize] = count;
                ring += 1;
            }
            if ring < tuning::plane() {
                for (&l, _) in neighbours(i).flat_map(|(&j, _)| neighbours(j as usize)) {
                    if of_node[l as usize] == ABSENT {
                        of_node[l as usize] = count;
                    }
                }
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
        // LevelNodes whose neighbours had no aggregate either.
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
        let mut place = vec![ABSENT; nodes];
        for (at, &i) in members.iter().enumerate() {
            place[i as usize] = narrow(at);
        }
        Self {
            of_node,
            start,
            members,
            place,
            coupled: couplings.iter().map(|&size| size > 0.0).collect(),
        }
    }
}

/// Norm of each block beside the diagonal, zero for one that is only rounding, between bodies or
/// of nodes far from each other.
fn couplings(matrix: LevelMatrix<'_>, about: &LevelNodes) -> Vec<f32> {
    /// Of the diagonal block. Single precision rounds at 1e-7 of an entry; assembly cancels
    /// entries to 1e-16 of their terms.
    const ROUNDING: f32 = 1e-12;
    let size = matrix.b() * matrix.b();
    let norm = |block: &[f32]| {
        let squares = block.iter().map(|&x| f64::from(x) * f64::from(x));
        #[expect(clippy::cast_possible_truncation, reason = "rounding")]
        let norm = squares.sum::<f64>().sqrt() as f32;
        norm
    };
    let rows = tasks::map(0..matrix.nodes().div_ceil(ROWS), |_, task| {
        let (mut norms, mut distances) = (Vec::new(), Vec::new());
        let rows = task * ROWS..matrix.nodes().min((task + 1) * ROWS);
        let (values, first) = matrix.load(rows.clone());
        for i in rows {
            let columns = matrix.columns(i);
            let block = |k: usize| &values[(matrix.row(i).start + k - first) * size..][..size];
            let least = ROUNDING * norm(block(columns.partition_point(|&j| (j as usize) < i)));
            distances.clear();
            distances.extend(columns.iter().map(|&j| match j as usize {
                j if j != i && about.together(i, j) => about.squared_distance(matrix.nodes(), i, j),
                _ => f64::INFINITY,
            }));
            let far = farthest(&distances);
            for (k, &distance) in distances.iter().enumerate() {
                let near = distance <= far && distance < f64::INFINITY;
                let norm = if near { norm(block(k)) } else { 0.0 };
                norms.push(if norm > least { norm } else { 0.0 });
            }
        }
        norms
    });
    rows.concat()
}

/// The largest squared distance of a coupled node, from those of all neighbours.
fn farthest(distances: &[f64]) -> f64 {
    let finite = distances.iter().filter(|d| d.is_finite());
    let largest = finite.clone().copied().fold(0.0, f64::max);
    let apart = finite.filter(|&&d| d > SAME_PLACE * SAME_PLACE * largest);
    tuning::far() * tuning::far() * apart.copied().fold(f64::INFINITY, f64::min)
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
