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
                    let i = node as usize;
                    if let Some(contact) = changes.contact(i) {
                        add(Some(frames.list[contact].from_local), i);
                    } else {
                        add(None, i);
                        for &(slave, block) in changes.slaves(i) {
                            add(Some(block), slave as usize);
                        }
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

/// `T` by rows, and its columns at masters.
struct Changes<'a, const D: usize> {
    frames: &'a Frames<D>,
    /// The contact of each contact node.
    contact: Vec<u32>,
    /// Contact nodes and masters.
    nodes: Vec<u32>,
    /// Start of each node in `slaves`.
    start: Vec<u32>,
    /// The contact nodes that follow a node, with `−B_s⁻¹ B_m`.
    slaves: Vec<(u32, Block<D>)>,
}

impl<'a, const D: usize> Changes<'a, D> {
    fn new(count: usize, frames: &'a Frames<D>) -> Self {
        let mut contact = vec![ABSENT; count];
        let mut start = vec![0_u32; count + 1];
        for (i, frame) in frames.list.iter().enumerate() {
            if frame.node != usize::MAX {
                contact[frame.node] = narrow(i);
            }
            for (node, _) in frames.masters(i) {
                start[node + 1] += 1;
            }
        }
        let touched = |&node: &usize| contact[node] != ABSENT || start[node + 1] > 0;
        let nodes = (0..count).filter(touched).map(narrow).collect();
        for node in 0..count {
            start[node + 1] += start[node];
        }
        let mut next = start.clone();
        let mut slaves = vec![(ABSENT, Block::zeros()); start[count] as usize];
        for (i, frame) in frames.list.iter().enumerate() {
            for (node, block) in frames.masters(i) {
                slaves[next[*node] as usize] = (narrow(frame.node), -frame.from_local * block);
                next[*node] += 1;
            }
        }
        Self {
            frames,
            contact,
            nodes,
            start,
            slaves,
        }
    }

    fn contact(&self, node: usize) -> Option<usize> {
        let contact = self.contact[node];
        (contact != ABSENT).then_some(contact as usize)
    }

    fn slaves(&self, node: usize) -> &[(u32, Block<D>)] {
        &self.slaves[self.start[node] as usize..self.start[node + 1] as usize]
    }

    /// Adds `block` times row `node` of `T`.
    fn add(&self, block: Block<D>, node: usize, sum: &mut RowSum<D>) {
        let Some(contact) = self.contact(node) else {
            sum.add(narrow(node), block);
            return;
        };
        let own = block * self.frames.list[contact].from_local;
        sum.add(narrow(node), own);
        for (master, columns) in self.frames.masters(contact) {
            sum.add(narrow(*master), -own * columns);
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
