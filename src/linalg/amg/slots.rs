//! The columns met in one row of a sparse product, each with a slot.

use crate::linalg::amg::block_matrix::ABSENT;
use crate::linalg::sparse::csc::narrow;

/// Numbers the columns of one row in the order in which they are met.
#[derive(Clone, Debug)]
pub(super) struct Slots {
    of_column: Vec<u32>,
    /// The column of each slot.
    pub(super) columns: Vec<u32>,
}

impl Slots {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            of_column: vec![ABSENT; columns],
            columns: Vec::new(),
        }
    }

    /// The slot of a column, and whether it is new.
    #[inline]
    pub(super) fn slot(&mut self, column: u32) -> (usize, bool) {
        let slot = &mut self.of_column[column as usize];
        let new = *slot == ABSENT;
        if new {
            *slot = narrow(self.columns.len());
            self.columns.push(column);
        }
        (*slot as usize, new)
    }

    /// Forgets the row.
    pub(super) fn clear(&mut self) {
        for &column in &self.columns {
            self.of_column[column as usize] = ABSENT;
        }
        self.columns.clear();
    }
}
