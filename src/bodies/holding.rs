//! What holds a body: supports, springs and contacts, as rows in the amounts of its rigid
//! motions. A motion is free if it moves no row.

use crate::bodies::rank::{ACCURACY, Combinations};

/// More bodies that contact alone holds are left to the direct engine: the work for each contact
/// grows with the square of their number.
pub const MOST_LOOSE: usize = 32;

/// The rows that hold a body, one column for each of its motions.
#[derive(Clone, Debug)]
pub struct Holding {
    columns: Vec<Vec<f64>>,
}

impl Holding {
    /// A body that nothing holds.
    pub fn new(motions: usize) -> Self {
        Self {
            columns: vec![Vec::new(); motions],
        }
    }

    pub fn motions(&self) -> usize {
        self.columns.len()
    }

    /// Adds a row: the displacement or the force that the motions have there.
    pub fn hold(&mut self, row: &[f64]) {
        for (column, &value) in self.columns.iter_mut().zip(row) {
            column.push(value);
        }
    }

    /// Whether no motion is free.
    pub fn is_held(&self) -> bool {
        self.find_free_motions(ACCURACY).is_empty()
    }

    /// The amounts of the free motions, orthonormal; `accuracy` is that of the rows.
    pub fn find_free_motions(&self, accuracy: f64) -> Vec<Vec<f64>> {
        let combinations = Combinations::new(self.columns.clone());
        let held: Vec<bool> = combinations.exceed(accuracy).collect();
        let amounts = combinations.amounts.into_iter().zip(held);
        amounts
            .filter_map(|(amounts, held)| (!held).then_some(amounts))
            .collect()
    }

    /// Several bodies as one, with the motions of each after those of the one before.
    pub fn join(bodies: Vec<Self>) -> Self {
        let rows = |body: &Self| body.columns.first().map_or(0, Vec::len);
        let height: usize = bodies.iter().map(rows).sum();
        let (mut columns, mut above) = (Vec::new(), 0);
        for body in bodies {
            let next = above + rows(&body);
            for own in body.columns {
                let mut column = vec![0.0; above];
                column.extend(own);
                column.resize(height, 0.0);
                columns.push(column);
            }
            above = next;
        }
        Self { columns }
    }
}
