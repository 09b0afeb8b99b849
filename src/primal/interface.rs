//! The stiffness in the variables of contacts that join bodies: `A = Tᵀ K T`.
//!
//! It differs from `K` in the rows and columns of the contact nodes and their masters only.

use std::sync::Mutex;

use rayon::prelude::*;

use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::changed_rows::ChangedRows;
use crate::linalg::amg::multigrid::Multigrid;
use crate::linalg::small::Block;
use crate::linalg::sparse::csc::narrow;
use crate::primal::frames::Frames;

/// Rows of one task.
const ROWS: usize = 256;

/// Contacts between bodies, for the preconditioner.
#[derive(Debug)]
pub(super) struct Interface {
    /// The rows of `A` of contact nodes and masters.
    pub(super) rows: ChangedRows,
    /// The body of each node.
    pub(super) bodies: Vec<u32>,
    /// The hierarchy of the bodies glued together at all contacts, while nobody uses it.
    pub(super) glued: Mutex<Option<Multigrid>>,
}

impl Interface {
    /// Computes the rows.
    #[must_use]
    pub(super) fn new<const D: usize>(matrix: &BlockMatrix<f64>, frames: &Frames<D>) -> Self {
        let changes = Changes::new(matrix.nodes(), frames);
        // `K T` in the rows of contact nodes and masters.
        let mut number = vec![ABSENT; matrix.nodes()];
        for (row, &node) in changes.nodes.iter().enumerate() {
            number[node as usize] = narrow(row);
        }
        let nodes = changes.nodes.par_chunks(ROWS);
        let right: Vec<Row<D>> = nodes
            .flat_map_iter(|nodes| {
                let mut sum = RowSum::new(matrix.nodes());
                let rows: Vec<Row<D>> = nodes
                    .iter()
                    .map(|&node| {
                        for (q, block) in matrix.blocks_of_row(node as usize) {
                            changes.add(Block::from_column_slice(block), q, &mut sum);
                        }
                        sum.take()
                    })
                    .collect();
                rows
            })
            .collect();
        let parts: Vec<ChangedRows> = changes
            .nodes
            .par_chunks(ROWS)
            .map(|nodes| {
                let mut sum = RowSum::new(matrix.nodes());
                let mut rows = ChangedRows::new(D);
                for &node in nodes {
                    // `Tᵀ` times these rows.
                    let mut add = |left: Option<Block<D>>, row: usize| {
                        for &(column, block) in &right[number[row] as usize] {
                            sum.add(column, left.map_or(block, |left| left.tr_mul(&block)));
                        }
                    };
                    if changes.row(node as usize).is_none() {
                        add(None, node as usize);
                    }
                    for &(slave, block) in changes.column(node as usize) {
                        add(Some(block), slave as usize);
                    }
                    let mut row = sum.take();
                    row.sort_unstable_by_key(|&(column, _)| column);
                    for (column, block) in row {
                        rows.column.push(column);
                        rows.values.extend_from_slice(block.as_slice());
                    }
                    rows.nodes.push(node);
                    rows.start.push(rows.column.len());
                }
                rows
            })
            .collect();
        let mut rows = ChangedRows::new(D);
        for part in parts {
            rows.extend(part);
        }
        Self {
            rows,
            bodies: matrix.connected(),
            glued: Mutex::new(None),
        }
    }
}

const ABSENT: u32 = u32::MAX;

/// Blocks of a row by their columns.
type Row<const D: usize> = Vec<(u32, Block<D>)>;

/// `T` in the rows of contact nodes; all other rows are those of the identity.
struct Changes<const D: usize> {
    /// Number of the row of each contact node.
    number: Vec<u32>,
    rows: Vec<Row<D>>,
    /// Contact nodes and masters.
    nodes: Vec<u32>,
    /// Start of each node in `columns`.
    start: Vec<u32>,
    /// The contact nodes that follow a node, with the blocks of `T`.
    columns: Row<D>,
}

impl<const D: usize> Changes<D> {
    fn new(count: usize, frames: &Frames<D>) -> Self {
        let mut number = vec![ABSENT; count];
        let mut rows: Vec<Row<D>> = Vec::with_capacity(frames.list.len());
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

    fn row(&self, node: usize) -> Option<&Row<D>> {
        let row = self.number[node];
        (row != ABSENT).then(|| &self.rows[row as usize])
    }

    fn column(&self, node: usize) -> &[(u32, Block<D>)] {
        &self.columns[self.start[node] as usize..self.start[node + 1] as usize]
    }

    /// Adds `block` times row `node` of `T`.
    fn add(&self, block: Block<D>, node: usize, sum: &mut RowSum<D>) {
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
struct RowSum<const D: usize> {
    place: Vec<u32>,
    row: Row<D>,
}

impl<const D: usize> RowSum<D> {
    fn new(nodes: usize) -> Self {
        Self {
            place: vec![ABSENT; nodes],
            row: Row::new(),
        }
    }

    fn add(&mut self, column: u32, block: Block<D>) {
        let place = &mut self.place[column as usize];
        if *place == ABSENT {
            *place = narrow(self.row.len());
            self.row.push((column, block));
        } else {
            self.row[*place as usize].1 += block;
        }
    }

    fn take(&mut self) -> Row<D> {
        for &(column, _) in &self.row {
            self.place[column as usize] = ABSENT;
        }
        std::mem::take(&mut self.row)
    }
}
