//! The stiffness in the variables of contacts that join bodies: `A = Tᵀ K T`.
//!
//! It differs from `K` in the rows and columns of the contact nodes and their masters only.

use std::sync::Mutex;

use crate::linalg::amg::changed_rows::ChangedRows;
use crate::linalg::amg::multigrid::Multigrid;
use crate::linalg::amg::symmetric_blocks::SymmetricBlocks;
use crate::linalg::small::Block;
use crate::linalg::sparse::csc::narrow;
use crate::primal::frames::Frames;
use crate::primal::transformation::{ABSENT, RowSum, Transformation, TransformedRow};
use crate::tasks;

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
    pub(super) fn new<const D: usize>(matrix: &SymmetricBlocks, frames: &Frames<D>) -> Self {
        let changes = Transformation::new(matrix.nodes(), frames);
        // `K T` in the rows of contact nodes and masters.
        let mut number = vec![ABSENT; matrix.nodes()];
        for (row, &node) in changes.nodes.iter().enumerate() {
            number[node as usize] = narrow(row);
        }
        let right = tasks::map(changes.nodes.chunks(ROWS), |_, nodes| {
            let mut sum = RowSum::new(matrix.nodes());
            let of_node = |&node: &u32| {
                matrix.for_each_block(node as usize, |q, block| {
                    changes.add(Block::from_column_slice(block), q, &mut sum);
                });
                sum.take()
            };
            nodes
                .iter()
                .map(of_node)
                .collect::<Vec<TransformedRow<D>>>()
        });
        let right: Vec<TransformedRow<D>> = right.into_iter().flatten().collect();
        let parts = tasks::map(changes.nodes.chunks(ROWS), |_, nodes| {
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
        });
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
