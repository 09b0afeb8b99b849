//! `K` from its rows, in parts if there is nobody who has all of them.

use std::sync::OnceLock;

use crate::error::Error;
use crate::linalg::amg::block_matrix::ABSENT;
use crate::linalg::amg::symmetric_blocks::{SymmetricBlocks, UpperBlocks};
use crate::linalg::sparse::csc::positions;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::primal::nodes::Nodes;
use crate::primal::problem::Stiffness;
use crate::primal::supports::Supports;

/// The rows of `K` of the first nodes.
#[derive(Debug)]
pub struct StiffnessRows {
    nodes: Nodes,
    fixed: Vec<usize>,
    /// Number of each prescribed degree of freedom.
    position: Vec<Option<usize>>,
    /// Columns of `K` at the prescribed degrees of freedom; rows of free ones only.
    coupling: OwnedMatrix,
    upper: UpperBlocks,
    /// Sum of the diagonal entries of prescribed degrees of freedom.
    trace: f64,
}

impl StiffnessRows {
    /// Without a row.
    pub fn new(nodes: Nodes, fixed: &[usize]) -> Result<Self, Error> {
        let n = nodes.place.len();
        let position = positions("fixed", fixed, n)?;
        let free = |(&at, position): (&u32, &Option<usize>)| position.map_or(at, |_| ABSENT);
        let place = nodes.place.iter().zip(&position).map(free).collect();
        Ok(Self {
            upper: UpperBlocks::new(place, nodes.count, n / nodes.count.max(1)),
            nodes,
            fixed: fixed.to_vec(),
            position,
            coupling: OwnedMatrix::default(),
            trace: 0.0,
        })
    }

    /// Degrees of freedom of the nodes whose rows are known, if they are numbered by nodes.
    pub fn known(&self) -> usize {
        self.nodes.place.len() / self.nodes.count.max(1) * self.upper.known()
    }

    /// Adds the rows of the next nodes, up to `end`; `row` gives the columns and the values of a
    /// degree of freedom. In parts, prescribed degrees of freedom ascend.
    pub fn append<R: Iterator<Item = (usize, f64)>>(
        &mut self,
        end: usize,
        row: impl Fn(usize) -> R + Sync,
    ) {
        self.upper.append(end, &row);
        let known = self.known();
        let next = self.coupling.pointer.len() - 1;
        for &j in self.fixed[next..]
            .iter()
            .take_while(|&&j| (self.nodes.place[j] as usize) < known)
        {
            for (i, value) in row(j) {
                if self.position[i].is_none() {
                    self.coupling.index.push(i);
                    self.coupling.values.push(value);
                } else if i == j {
                    self.trace += value;
                }
            }
            self.coupling.pointer.push(self.coupling.index.len());
        }
    }

    /// The rows of all nodes, together.
    pub(super) fn finish(self) -> Result<Stiffness, Error> {
        let (n, row) = (self.nodes.place.len(), self.known());
        if row < n || self.coupling.pointer.len() <= self.fixed.len() {
            return Err(Error::SparseStructure { what: "K", row });
        }
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let mean = (self.upper.trace() + self.trace) / n.max(1) as f64;
        let mut free = vec![false; n];
        for (&at, position) in self.nodes.place.iter().zip(&self.position) {
            free[at as usize] = position.is_none();
        }
        Ok(Stiffness {
            matrix: SymmetricBlocks::new(self.upper, mean),
            nodes: self.nodes,
            free,
            fixed: self.fixed,
            coupling: self.coupling,
            position: self.position,
            spectrum: OnceLock::new(),
            motions: None,
            supports: Supports::default(),
        })
    }
}
