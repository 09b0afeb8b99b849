//! Rotates the frames of contacts: `B` becomes `Q B` with an orthogonal block `Q_i` of each contact.
//!
//! The frame of a contact with a moving obstacle changes from step to step. With `v' = Q v` and
//! `r' = Q r`, the problem `v = W r + R a + q`, `Rᵀ r + e = 0` keeps its form with `Q W Qᵀ`, `Q R`
//! and `Q q`. Nothing is condensed again.

use std::cmp::Ordering;

use crate::linalg::small::{Block, Vector};
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::reduced::elliptic_scaling::EllipticScaling;

/// `Q_i` of each contact, in the numbering of the caller.
#[derive(Clone, Debug)]
pub struct Rotation<const D: usize> {
    blocks: Vec<Block<D>>,
}

impl<const D: usize> Rotation<D> {
    /// Takes the rows of all blocks, one block after the other. In scaled variables
    /// ([`EllipticScaling`]) the blocks are `T Q T⁻¹`, because `v' = Q v` is about the
    /// variables of the caller.
    pub fn new(rows: &[[f64; D]], elliptic: Option<&EllipticScaling>) -> Self {
        let factor = |i: usize, k: usize| elliptic.map_or(1.0, |scaling| scaling.factor(i, k));
        let block = |(i, rows): (usize, &[[f64; D]])| {
            Block::from_fn(|k, l| rows[k][l] * factor(i, k) / factor(i, l))
        };
        Self {
            blocks: rows.chunks_exact(D).enumerate().map(block).collect(),
        }
    }

    pub fn contacts(&self) -> usize {
        self.blocks.len()
    }

    /// `Q_i w Q_jᵀ` of the block `W_ij`. A symmetric `W` stays bitwise symmetric.
    pub fn block(&self, w: &Block<D>, moved: usize, pushed: usize) -> Block<D> {
        let (left, right) = (&self.blocks[moved], &self.blocks[pushed]);
        match moved.cmp(&pushed) {
            Ordering::Less => left * w * right.transpose(),
            Ordering::Greater => (right * w.transpose() * left.transpose()).transpose(),
            Ordering::Equal => {
                let whole = left * w * right.transpose();
                (whole + whole.transpose()) * 0.5
            }
        }
    }

    /// `Q x`.
    pub fn times(&self, x: &[[f64; D]]) -> Vec<[f64; D]> {
        let at = |(block, x): (&Block<D>, &[f64; D])| (block * Vector::from(*x)).into();
        self.blocks.iter().zip(x).map(at).collect()
    }

    /// The rows of `B` of a contact, times `Q_i`, from their entries `(row, column, value)`.
    /// Columns are ascending; entries that become zero are left out.
    pub fn rows(
        &self,
        contact: usize,
        entries: impl Iterator<Item = (usize, usize, f64)>,
    ) -> [Vec<(usize, f64)>; D] {
        let mut columns: Vec<(usize, Vector<D>)> = Vec::new();
        for (k, column, value) in entries {
            let at = columns.iter().position(|(other, _)| *other == column);
            let at = at.unwrap_or_else(|| {
                columns.push((column, Vector::zeros()));
                columns.len() - 1
            });
            columns[at].1[k] += value;
        }
        columns.sort_unstable_by_key(|(column, _)| *column);
        let mut rows = std::array::from_fn(|_| Vec::with_capacity(columns.len()));
        for (column, values) in columns {
            let turned = self.blocks[contact] * values;
            for (row, &value) in rows.iter_mut().zip(turned.iter()) {
                if value != 0.0 {
                    row.push((column, value));
                }
            }
        }
        rows
    }
}

impl OwnedMatrix {
    /// `Q A` of a matrix by rows, with `D` rows for each contact.
    pub fn rotated<const D: usize>(&self, rotation: &Rotation<D>) -> Self {
        let mut out = Self::default();
        for contact in 0..rotation.contacts() {
            let of_row = |k| {
                self.entries(D * contact + k)
                    .map(move |(j, value)| (k, j, value))
            };
            for row in rotation.rows(contact, (0..D).flat_map(of_row)) {
                for (j, value) in row {
                    out.index.push(j);
                    out.values.push(value);
                }
                out.pointer.push(out.index.len());
            }
        }
        out
    }
}
