//! The change of variables `u = T y`, by rows of blocks.

use crate::linalg::small::Block;
use crate::linalg::sparse::csc::narrow;
use crate::primal::frames::Frames;

pub(super) const ABSENT: u32 = u32::MAX;

/// Blocks of a row by their columns.
pub type TransformedRow<const D: usize> = Vec<(u32, Block<D>)>;

/// `T` in the rows of contact nodes; all other rows are those of the identity.
#[derive(Clone, Debug)]
pub struct Transformation<const D: usize> {
    /// Number of the row of each contact node.
    number: Vec<u32>,
    rows: Vec<TransformedRow<D>>,
    /// Contact nodes and masters.
    pub(super) nodes: Vec<u32>,
    /// Start of each node in `columns`.
    start: Vec<u32>,
    /// The contact nodes that follow a node, with the blocks of `T`.
    columns: TransformedRow<D>,
}

impl<const D: usize> Transformation<D> {
    /// `count` is the number of nodes.
    pub fn new(count: usize, frames: &Frames<D>) -> Self {
        let mut number = vec![ABSENT; count];
        let mut rows: Vec<TransformedRow<D>> = Vec::with_capacity(frames.list.len());
        let mut owners = Vec::with_capacity(frames.list.len());
        let mut sum = RowSum::new(count);
        // A master may be the node of a contact whose row is known.
        for (i, frame) in frames.with_node().rev() {
            sum.add(narrow(frame.node), frame.from_local);
            for (node, block) in frames.masters(i) {
                let block = -frame.from_local * block;
                match number[*node] {
                    ABSENT => sum.add(narrow(*node), block),
                    row => {
                        for &(column, other) in &rows[row as usize] {
                            sum.add(column, block * other);
                        }
                    }
                }
            }
            number[frame.node] = narrow(rows.len());
            rows.push(sum.take());
            owners.push(narrow(frame.node));
        }
        let mut start = vec![0_u32; count + 1];
        for (column, _) in rows.iter().flatten() {
            start[*column as usize + 1] += 1;
        }
        let nodes = (0..count).filter(|&node| start[node + 1] > 0).map(narrow);
        let nodes = nodes.collect();
        for node in 0..count {
            start[node + 1] += start[node];
        }
        let mut next = start.clone();
        let mut columns = vec![(ABSENT, Block::zeros()); start[count] as usize];
        for (owner, row) in owners.iter().zip(&rows) {
            for (column, block) in row {
                let at = &mut next[*column as usize];
                columns[*at as usize] = (*owner, *block);
                *at += 1;
            }
        }
        Self {
            number,
            rows,
            nodes,
            start,
            columns,
        }
    }

    /// The blocks of the row of a contact node; `None` for other nodes.
    pub fn row(&self, node: usize) -> Option<&TransformedRow<D>> {
        let row = self.number[node];
        (row != ABSENT).then(|| &self.rows[row as usize])
    }

    /// The contact nodes that follow a node, with the blocks of `T`.
    pub(super) fn column(&self, node: usize) -> &[(u32, Block<D>)] {
        &self.columns[self.start[node] as usize..self.start[node + 1] as usize]
    }

    /// Adds `block` times row `node` of `T`.
    pub(super) fn add(&self, block: Block<D>, node: usize, sum: &mut RowSum<D>) {
        let Some(row) = self.row(node) else {
            sum.add(narrow(node), block);
            return;
        };
        for &(column, other) in row {
            sum.add(column, block * other);
        }
    }
}

/// A row of blocks in the making.
pub(super) struct RowSum<const D: usize> {
    place: Vec<u32>,
    row: TransformedRow<D>,
}

impl<const D: usize> RowSum<D> {
    pub(super) fn new(nodes: usize) -> Self {
        Self {
            place: vec![ABSENT; nodes],
            row: TransformedRow::new(),
        }
    }

    pub(super) fn add(&mut self, column: u32, block: Block<D>) {
        let place = &mut self.place[column as usize];
        if *place == ABSENT {
            *place = narrow(self.row.len());
            self.row.push((column, block));
        } else {
            self.row[*place as usize].1 += block;
        }
    }

    pub(super) fn take(&mut self) -> TransformedRow<D> {
        for &(column, _) in &self.row {
            self.place[column as usize] = ABSENT;
        }
        std::mem::take(&mut self.row)
    }
}
