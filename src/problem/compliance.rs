//! The compliance `W` of (3): dense blocks of contacts that feel each other.
//!
//! Contacts are stored island by island, so that every island is a range of
//! positions and its part of `W` one dense matrix; `order` leads back to the
//! caller's numbering. Rows are contiguous. `W` is used as it is given: an
//! asymmetric one keeps its transpose beside it for the column updates of a sweep.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;

use crate::error::Error;
use crate::linalg::binary::{exponent, times_two_to};
use crate::linalg::dense;
use crate::linalg::exact::{self, Sum};
use crate::linalg::small::{Block, dot_long};
use crate::problem::memory;

/// Below this many rows a product is not worth a second thread.
const PARALLEL_ROWS: usize = 768;

/// Contacts that feel each other, and their dense part of `W`.
#[derive(Clone, Debug)]
pub struct Island<'a> {
    /// Their positions.
    pub nodes: Range<usize>,
    /// Row-major, of order `D · nodes.len()`.
    matrix: Cow<'a, [f64]>,
    /// The transpose, where the matrix is not symmetric to the bit.
    transpose: Option<Vec<f64>>,
    /// The inverse, made when it is first asked for; nothing where there is none.
    inverse: OnceLock<Option<Vec<f64>>>,
}

impl Island<'_> {
    fn matrix(&self) -> &[f64] {
        &self.matrix
    }

    /// The inverse; empty where it was not made.
    fn inverse(&self) -> &[f64] {
        let made = self.inverse.get().and_then(Option::as_deref);
        made.unwrap_or(&[])
    }
}

/// `W` over all contacts, block by block.
#[derive(Clone, Debug)]
pub struct Compliance<'a, const D: usize> {
    islands: Vec<Island<'a>>,
    /// Caller's number of the contact at each position.
    order: Vec<usize>,
    /// Island of each position.
    island_of: Vec<usize>,
}

impl<'a, const D: usize> Compliance<'a, D> {
    /// From islands: the caller's numbers of the contacts of each, and its
    /// dense matrix, row-major, blocks in the order of those numbers.
    ///
    /// # Errors
    /// [`Error::Shape`] for a matrix of the wrong size, [`Error::EntryNotFinite`]
    /// for a NaN or an infinity. The islands must partition `0..n_c`.
    pub fn new(parts: Vec<(Vec<usize>, Cow<'a, [f64]>)>) -> Result<Self, Error> {
        let mut islands = Vec::with_capacity(parts.len());
        let mut order = Vec::new();
        let mut island_of = Vec::new();
        for (nodes, matrix) in parts {
            let m = D * nodes.len();
            if matrix.len() != m * m {
                return Err(Error::Shape {
                    what: "W",
                    expected: m * m,
                    found: matrix.len(),
                });
            }
            if let Some(at) = matrix.iter().position(|c| !c.is_finite()) {
                let caller = |k: usize| D * nodes[k / D] + k % D;
                return Err(Error::EntryNotFinite {
                    what: "W",
                    row: caller(at / m),
                    column: caller(at % m),
                    value: matrix[at],
                });
            }
            let transpose = asymmetric_transpose(&matrix, m);
            island_of.resize(order.len() + nodes.len(), islands.len());
            islands.push(Island {
                nodes: order.len()..order.len() + nodes.len(),
                matrix,
                transpose,
                inverse: OnceLock::new(),
            });
            order.extend(nodes);
        }
        Ok(Self {
            islands,
            order,
            island_of,
        })
    }

    /// From a dense row-major matrix of order `D n_c`, whole.
    ///
    /// # Errors
    /// As [`Compliance::new`].
    pub fn from_dense(contacts: usize, matrix: Cow<'a, [f64]>) -> Result<Self, Error> {
        Self::new(vec![((0..contacts).collect(), matrix)])
    }

    #[must_use]
    pub fn contacts(&self) -> usize {
        self.order.len()
    }

    #[must_use]
    pub fn islands(&self) -> &[Island<'a>] {
        &self.islands
    }

    /// Caller's number of the contact at each position.
    #[must_use]
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// Caller's node values in the order of positions.
    #[must_use]
    pub fn gather<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.order.iter().map(|&i| values[i]).collect()
    }

    /// The inverse of [`Compliance::gather`].
    #[must_use]
    pub fn scatter<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let mut out = values.to_vec();
        for (&i, &value) in self.order.iter().zip(values) {
            out[i] = value;
        }
        out
    }

    /// Bytes held by the matrices.
    #[must_use]
    pub fn bytes(&self) -> usize {
        8 * self.islands.iter().map(|i| i.matrix.len()).sum::<usize>()
    }

    /// Bytes held beside them, by transposes and inverses.
    #[must_use]
    pub fn bytes_beside(&self) -> usize {
        let of_island = |i: &Island| {
            let inverse = i.inverse.get().and_then(Option::as_ref);
            i.transpose.as_ref().map_or(0, Vec::len) + inverse.map_or(0, Vec::len)
        };
        8 * self.islands.iter().map(of_island).sum::<usize>()
    }

    /// Largest `|W_ij − W_ji|` over the largest entry: zero for an elastic `W`.
    #[must_use]
    pub fn asymmetry(&self) -> f64 {
        let difference = |i: &Island| {
            i.transpose.as_ref().map_or(0.0, |t| {
                i.matrix
                    .iter()
                    .zip(t)
                    .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()))
            })
        };
        let size = |i: &Island| i.matrix.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
        let largest = self.islands.iter().map(size).fold(0.0, f64::max);
        if largest == 0.0 {
            return 0.0;
        }
        self.islands.iter().map(difference).fold(0.0, f64::max) / largest
    }

    /// The diagonal block of the contact at `position`.
    #[must_use]
    pub fn block(&self, position: usize) -> Block<D> {
        self.pair(position, position)
    }

    /// Whether any reaction moves the contact at `position` along its normal.
    #[must_use]
    pub fn moves(&self, position: usize) -> bool {
        let island = &self.islands[self.island_of[position]];
        let m = D * island.nodes.len();
        let row = D * (position - island.nodes.start) * m;
        island.matrix[row..row + m].iter().any(|&w| w != 0.0)
    }

    /// The block by which the reaction at one position moves the contact at another.
    #[must_use]
    pub fn pair(&self, moved: usize, pushed: usize) -> Block<D> {
        self.block_of(Island::matrix, moved, pushed)
    }

    fn block_of(
        &self,
        matrix: impl for<'i> Fn(&'i Island<'a>) -> &'i [f64],
        moved: usize,
        pushed: usize,
    ) -> Block<D> {
        let island = &self.islands[self.island_of[moved]];
        if !island.nodes.contains(&pushed) {
            return Block::zeros();
        }
        let m = D * island.nodes.len();
        let (row, column) = (
            D * (moved - island.nodes.start),
            D * (pushed - island.nodes.start),
        );
        let matrix = matrix(island);
        Block::from_fn(|i, j| matrix[(row + i) * m + column + j])
    }

    /// `y = W r`.
    pub fn product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each_row(Island::matrix, y, |row, island| {
            dot_long(row, r[island].as_flattened())
        });
    }

    /// Component `k` of `W r` at a position, in twice the precision.
    #[must_use]
    pub fn exact_row(&self, position: usize, k: usize, r: &[[f64; D]]) -> Sum {
        let island = &self.islands[self.island_of[position]];
        let m = D * island.nodes.len();
        let row = D * (position - island.nodes.start) + k;
        let r = r[island.nodes.clone()].as_flattened();
        exact::dot(&island.matrix[row * m..(row + 1) * m], r)
    }

    /// `W r` at some positions only, in their order.
    #[must_use]
    pub fn product_at(&self, positions: &[usize], r: &[[f64; D]]) -> Vec<[f64; D]> {
        let at = |&position: &usize| {
            let island = &self.islands[self.island_of[position]];
            let m = D * island.nodes.len();
            let first = D * (position - island.nodes.start) * m;
            let r = r[island.nodes.clone()].as_flattened();
            std::array::from_fn(|k| dot_long(&island.matrix[first + k * m..][..m], r))
        };
        if D * positions.len() < PARALLEL_ROWS {
            positions.iter().map(at).collect()
        } else {
            positions.par_iter().with_min_len(32).map(at).collect()
        }
    }

    /// Whether `W` is symmetric to the bit.
    #[must_use]
    pub fn is_symmetric(&self) -> bool {
        self.islands.iter().all(|island| island.transpose.is_none())
    }

    /// `y = |W| |r|`: what rounding in [`Compliance::product`] is measured against.
    pub fn absolute_product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each_row(Island::matrix, y, |row, island| {
            let r = r[island].as_flattened();
            row.iter().zip(r).map(|(w, x)| (w * x).abs()).sum()
        });
    }

    /// Every row by one thread from left to right: the bits do not depend on
    /// the number of threads.
    fn each_row(
        &self,
        matrix: impl for<'i> Fn(&'i Island<'a>) -> &'i [f64],
        y: &mut [[f64; D]],
        of_row: impl Fn(&[f64], Range<usize>) -> f64 + Sync,
    ) {
        for island in &self.islands {
            let matrix = matrix(island);
            let m = (D * island.nodes.len()).max(1);
            let out = y[island.nodes.clone()].as_flattened_mut();
            if m < PARALLEL_ROWS {
                for (value, row) in out.iter_mut().zip(matrix.chunks_exact(m)) {
                    *value = of_row(row, island.nodes.clone());
                }
            } else {
                out.par_iter_mut()
                    .with_min_len(64)
                    .zip(matrix.par_chunks_exact(m))
                    .for_each(|(value, row)| *value = of_row(row, island.nodes.clone()));
            }
        }
    }

    /// `y += W_{·i} dr` for the contact at `position`: the effect of one
    /// reaction on every contact of its island.
    pub fn add_column(&self, position: usize, dr: &[f64; D], y: &mut [[f64; D]]) {
        let island = &self.islands[self.island_of[position]];
        let m = D * island.nodes.len();
        let columns = island.transpose.as_deref().unwrap_or(&island.matrix);
        let first = D * (position - island.nodes.start) * m;
        let out = y[island.nodes.clone()].as_flattened_mut();
        let column = |k: usize| &columns[first + k * m..first + (k + 1) * m];
        if D == 2 {
            for ((value, a), b) in out.iter_mut().zip(column(0)).zip(column(1)) {
                *value += a * dr[0] + b * dr[1];
            }
        } else {
            let three = column(0).iter().zip(column(1)).zip(column(2));
            for (value, ((a, b), c)) in out.iter_mut().zip(three) {
                *value += a * dr[0] + b * dr[1] + c * dr[2];
            }
        }
    }

    /// `y += W dr` for some components of the reactions only: the part of the
    /// product that belongs to their columns, and no more memory read than that.
    pub fn add_columns(&self, parts: Range<usize>, dr: &[[f64; D]], y: &mut [[f64; D]]) {
        /// Entries of `y` that a task holds in the cache while columns go by.
        const ROWS: usize = 256;
        for island in &self.islands {
            let m = D * island.nodes.len();
            let columns = island.transpose.as_deref().unwrap_or(&island.matrix);
            let of_rows = |(task, out): (usize, &mut [f64])| {
                let rows = task * ROWS..task * ROWS + out.len();
                for (local, dr) in dr[island.nodes.clone()].iter().enumerate() {
                    for k in parts.clone().filter(|&k| dr[k] != 0.0) {
                        let column = &columns[(D * local + k) * m..][rows.clone()];
                        for (value, w) in out.iter_mut().zip(column) {
                            *value += w * dr[k];
                        }
                    }
                }
            };
            let out = y[island.nodes.clone()].as_flattened_mut();
            if m < PARALLEL_ROWS {
                out.chunks_mut(ROWS).enumerate().for_each(of_rows);
            } else {
                out.par_chunks_mut(ROWS).enumerate().for_each(of_rows);
            }
        }
    }

    /// Whether the inverse of `W` is at hand, or known not to be had.
    #[must_use]
    pub fn inverse_known(&self) -> Option<bool> {
        if !self.is_symmetric() {
            return Some(false);
        }
        let mut known = self.islands.iter().map(|i| i.inverse.get());
        known.try_fold(true, |all, i| Some(all && i?.is_some()))
    }

    /// Makes the inverse of every island that has none yet; whether `W` has one
    /// that is worth the name.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn make_inverse(&self, stop: &AtomicBool) -> Result<bool, Error> {
        if !self.is_symmetric() {
            return Ok(false);
        }
        for island in &self.islands {
            if island.inverse.get().is_none() {
                let made = inverse(&island.matrix, D * island.nodes.len(), stop)?;
                island.inverse.get_or_init(|| made);
            }
        }
        Ok(self.inverse_known() == Some(true))
    }

    /// `y = W⁻¹ x`, with the inverse that was made.
    pub fn inverse_product(&self, x: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each_row(Island::inverse, y, |row, island| {
            dot_long(row, x[island].as_flattened())
        });
    }

    /// A block of the inverse that was made.
    #[must_use]
    pub fn inverse_pair(&self, moved: usize, pushed: usize) -> Block<D> {
        self.block_of(Island::inverse, moved, pushed)
    }

    /// The whole matrix in the caller's numbering, row-major.
    #[must_use]
    pub fn to_dense(&self) -> Vec<f64> {
        let n = D * self.order.len();
        let mut dense = vec![0.0; n * n];
        for island in &self.islands {
            let nodes = &self.order[island.nodes.clone()];
            let m = D * nodes.len();
            for (local, row) in island.matrix.chunks_exact(m.max(1)).enumerate() {
                let start = (D * nodes[local / D] + local % D) * n;
                for (values, &node) in row.as_chunks::<D>().0.iter().zip(nodes) {
                    dense[start + D * node..start + D * (node + 1)].copy_from_slice(values);
                }
            }
        }
        dense
    }
}

/// The transpose of a row-major matrix, or nothing where it equals the matrix.
fn asymmetric_transpose(matrix: &[f64], m: usize) -> Option<Vec<f64>> {
    /// Rows and columns looked at together: both sides of the diagonal stay in
    /// the cache.
    const TILE: usize = 32;
    #[expect(clippy::float_cmp, reason = "symmetric to the bit is what is asked")]
    let same = |i: usize, j: usize| matrix[i * m + j] == matrix[j * m + i];
    let tile_is_symmetric = |i: usize, j: usize| {
        let rows = i..(i + TILE).min(m);
        rows.clone()
            .all(|a| (j..(j + TILE).min(a)).all(|b| same(a, b)))
    };
    let tiles = (0..m).step_by(TILE);
    if tiles
        .clone()
        .all(|i| (0..=i).step_by(TILE).all(|j| tile_is_symmetric(i, j)))
    {
        return None;
    }
    let mut transpose = vec![0.0; m * m];
    for (i, j) in tiles.flat_map(|i| (0..m).step_by(TILE).map(move |j| (i, j))) {
        for a in i..(i + TILE).min(m) {
            for b in j..(j + TILE).min(m) {
                transpose[b * m + a] = matrix[a * m + b];
            }
        }
    }
    Some(transpose)
}

/// An inverse whose matrix has a condition above this, with its diagonal scaled
/// to one, is mostly rounding.
const WORST_CONDITION: f64 = 1e10;

/// The inverse of a symmetric positive definite matrix; nothing for another.
fn inverse(matrix: &[f64], m: usize, stop: &AtomicBool) -> Result<Option<Vec<f64>>, Error> {
    if memory::check("the inverse of W", 3 * 8 * (m as u128).pow(2)).is_err() {
        return Ok(None); // steps are taken without it
    }
    let diagonal: Vec<f64> = (0..m).map(|i| matrix[i * (m + 1)]).collect();
    // A power of two leaves no trace: bits are those of any other unit.
    let unit = -exponent(diagonal.iter().fold(0.0_f64, |a, &b| a.max(b)));
    let mut factor: Vec<f64> = matrix.iter().map(|&w| times_two_to(w, unit)).collect();
    if dense::cholesky(&mut factor, m, stop)?.is_some() {
        return Ok(None);
    }
    let mut inverse = dense::zeros(m * m);
    dense::inverse_from_cholesky(&factor, m, &mut inverse, stop)?;
    for t in &mut inverse {
        *t = times_two_to(*t, unit);
    }
    let root: Vec<f64> = diagonal.iter().map(|w| w.sqrt()).collect();
    let norm = |a: &[f64], scale: &dyn Fn(f64, f64) -> f64| {
        let of_row = |(row, &s): (&[f64], &f64)| {
            let terms = row.iter().zip(&root);
            terms.map(|(a, &t)| scale(a.abs(), s * t)).sum::<f64>()
        };
        let rows = a.chunks_exact(m.max(1)).zip(&root).map(of_row);
        rows.fold(0.0_f64, f64::max)
    };
    let condition = norm(matrix, &|a, s| a / s) * norm(&inverse, &|a, s| a * s);
    Ok((condition <= WORST_CONDITION).then_some(inverse))
}
