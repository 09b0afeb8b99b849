//! Exact solution of the equations of an interface alone, all other unknowns held.
//!
//! Springs between stiff and soft bodies couple the unknowns of an interface so differently that
//! no smoother serves all of them. Their number is small: a sparse factor is cheap.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::changed_rows::ChangedRows;
use crate::linalg::small::{Block, Vector};
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::{Options, Symbolic};
use crate::primal::nodes::{add_to_node, at_node};
use crate::tasks;

/// A factor of `P_cc`, `c` the free components of the relative displacements and of the masters.
#[derive(Debug)]
pub(super) struct Filter<const D: usize> {
    factor: Factor,
    /// Place of each unknown of `c`, ascending.
    places: Vec<u32>,
    /// Springs at the nodes of the rows.
    springs: Vec<Option<Block<D>>>,
}

impl<const D: usize> Filter<D> {
    /// Factors the part of `rows` that is not held, with springs at some nodes.
    /// `coordinates` are `D` for each node.
    pub(super) fn new(
        rows: &ChangedRows,
        springs: impl Iterator<Item = (usize, Block<D>)>,
        held: &[bool],
        coordinates: Option<&[f64]>,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let mut of_row = vec![None; rows.nodes.len()];
        for (node, spring) in springs {
            if let Ok(row) = rows
                .nodes
                .binary_search_by(|&other| (other as usize).cmp(&node))
            {
                of_row[row] = Some(spring);
            }
        }
        let components = rows.nodes.iter().flat_map(|&node| {
            let first = narrow_dim::<D>() * node;
            first..first + narrow_dim::<D>()
        });
        let places: Vec<u32> = components.filter(|&at| !held[at as usize]).collect();
        let mut number = vec![u32::MAX; held.len()];
        for (k, &at) in (0..).zip(&places) {
            number[at as usize] = k;
        }
        let (mut pointer, mut index, mut values) = (vec![0], Vec::new(), Vec::new());
        for (row, &node) in rows.nodes.iter().enumerate() {
            let first = D * node as usize;
            for r in (0..D).filter(|r| !held[first + r]) {
                for (column, block) in rows.row(row) {
                    for c in 0..D {
                        let at = number[D * column + c];
                        if at == u32::MAX {
                            continue;
                        }
                        let mut value = block[c * D + r];
                        if column == node as usize
                            && let Some(spring) = of_row[row]
                        {
                            value += spring[(r, c)];
                        }
                        index.push(at as usize);
                        values.push(value);
                    }
                }
                pointer.push(index.len());
            }
        }
        let coordinates: Option<Vec<[f64; 3]>> = coordinates.map(|coordinates| {
            let of_place = |&at: &u32| {
                let node = at as usize / D;
                std::array::from_fn(|k| {
                    if k < D {
                        coordinates[D * node + k]
                    } else {
                        0.0
                    }
                })
            };
            places.iter().map(of_place).collect()
        });
        let options = Options {
            coordinates: coordinates.as_deref(),
        };
        let matrix = Symmetric::of_checked(&pointer, &index, &values);
        let symbolic = Arc::new(Symbolic::analyse(&matrix, &[], &options)?);
        Ok(Self {
            factor: Factor::new(symbolic, &matrix, stop)?,
            places,
            springs: of_row,
        })
    }

    /// Memory of the factor.
    pub(super) fn bytes(&self) -> usize {
        self.factor.symbolic().counts().bytes_factor
    }

    /// `P_cc⁻¹ b_c`, by unknowns of `c`.
    pub(super) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.places.iter().map(|&at| b[at as usize]).collect();
        self.factor.condense(&mut x, 1);
        self.factor.recover(&mut x, 1);
        x
    }

    /// Adds values by unknowns of `c` to values by places.
    pub(super) fn add(&self, own: &[f64], x: &mut [f64]) {
        for (&at, own) in self.places.iter().zip(own) {
            x[at as usize] += own;
        }
    }

    /// `r ← r − P x` for an `x` that is zero outside `c`.
    pub(super) fn subtract_columns(&self, rows: &ChangedRows, x: &[f64], r: &mut [f64]) {
        for (row, &node) in rows.nodes.iter().enumerate() {
            let own = at_node::<D>(x, node as usize);
            for (column, block) in rows.row(row) {
                let change = Block::<D>::from_column_slice(block).tr_mul(&own);
                add_to_node(r, column, -change);
            }
            if let Some(spring) = &self.springs[row] {
                add_to_node(r, node as usize, -(spring * own));
            }
        }
    }

    /// The rows of `b − P x` at the nodes of the interface; others keep the `b` that `r` has.
    pub(super) fn subtract_rows(&self, rows: &ChangedRows, x: &[f64], r: &mut [f64]) {
        let products = tasks::collect(rows.nodes.len(), |row| {
            let parts = rows.row(row).map(|(column, block)| {
                Block::<D>::from_column_slice(block) * at_node::<D>(x, column)
            });
            let mut sum: Vector<D> = parts.sum();
            if let Some(spring) = &self.springs[row] {
                sum += spring * at_node::<D>(x, rows.nodes[row] as usize);
            }
            sum
        });
        for (&node, product) in rows.nodes.iter().zip(products) {
            add_to_node(r, node as usize, -product);
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "2 or 3")]
const fn narrow_dim<const D: usize>() -> u32 {
    D as u32
}
