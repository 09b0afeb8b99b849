//! The cells of a mesh of one kind: the nodes of each.

use crate::error::{Error, check_length};
use crate::linalg::sparse::csc::Index;

/// Nodes of cells, with the same number in each.
#[derive(Clone, Debug)]
pub struct Cells {
    node: Vec<u32>,
    corners: usize,
    nodes: usize,
}

impl Cells {
    /// From the arrays of scikit-fem: `given` has a row for each node of a cell, and a column
    /// for each cell. The mesh has `nodes` nodes.
    pub fn new<I: Index>(given: &[I], corners: usize, nodes: usize) -> Result<Self, Error> {
        let count = given.len() / corners.max(1);
        check_length("cells", given.len(), count * corners)?;
        // The largest number is free to mark nodes that were not seen.
        let limit = u32::MAX as usize;
        if nodes > limit {
            return Err(Error::IndexRange {
                what: "cells",
                position: 0,
                found: nodes,
                limit,
            });
        }
        let limit = nodes;
        let mut node = vec![0; given.len()];
        for (position, &found) in given.iter().enumerate() {
            let (corner, cell) = (position / count, position % count);
            let found = found.at();
            node[cell * corners + corner] = u32::try_from(found)
                .ok()
                .filter(|_| found < limit)
                .ok_or(Error::IndexRange {
                    what: "cells",
                    position,
                    found,
                    limit,
                })?;
        }
        Ok(Self {
            node,
            corners,
            nodes,
        })
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.node.len() / self.corners.max(1)
    }

    /// Number of nodes of each cell.
    pub fn corners(&self) -> usize {
        self.corners
    }

    /// Number of nodes of the mesh.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Nodes of one cell.
    pub fn of(&self, cell: usize) -> &[u32] {
        &self.node[cell * self.corners..][..self.corners]
    }

    /// Nodes of all cells, one cell after the other.
    pub fn flat(&self) -> &[u32] {
        &self.node
    }
}
