//! The part of `W` of one island: contacts that are coupled by `W`. It is dense, or sparse if
//! the caller gives sparse blocks.
//!
//! All indices are positions within the island. Dense rows are contiguous; an asymmetric matrix
//! also stores its transpose, for access to columns.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_length};
use crate::linalg::compensated::{self, Sum};
use crate::linalg::dense;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{Block, Vector, amax, dot_long};
use crate::linalg::sparse::blocks::Blocks;
use crate::reduced::memory;
use crate::tasks;

/// With fewer rows, a second thread does not make a product faster.
pub(super) const PARALLEL_ROWS: usize = 768;

/// The matrix of an island.
#[derive(Clone, Debug)]
pub enum Part<'a, const D: usize> {
    /// Row-major, of order `D` times the contacts.
    Dense(Cow<'a, [f64]>),
    Sparse(Cow<'a, Blocks<D>>),
}

impl<const D: usize> Part<'_, D> {
    /// Each block `W_ij` replaced by `of(i, j, block)`.
    pub fn map(
        &self,
        contacts: usize,
        of: impl Fn(usize, usize, &Block<D>) -> Block<D> + Sync,
    ) -> Part<'static, D> {
        match self {
            Part::Sparse(blocks) => Part::Sparse(Cow::Owned(blocks.map(of))),
            Part::Dense(matrix) => {
                let n = D * contacts;
                let mut mapped = vec![0.0; matrix.len()];
                let rows = mapped.chunks_exact_mut((D * n).max(1));
                tasks::for_each(rows, |i, rows| {
                    for j in 0..contacts {
                        let at = |k: usize, l: usize| matrix[(D * i + k) * n + D * j + l];
                        let block = of(i, j, &Block::from_fn(at));
                        for (k, row) in rows.chunks_exact_mut(n).enumerate() {
                            for (l, value) in row[D * j..D * (j + 1)].iter_mut().enumerate() {
                                *value = block[(k, l)];
                            }
                        }
                    }
                });
                Part::Dense(Cow::Owned(mapped))
            }
        }
    }
}

/// Contacts coupled by `W`.
#[derive(Clone, Debug)]
pub struct Island<'a, const D: usize> {
    /// Their positions in the whole `W`.
    pub nodes: Range<usize>,
    part: Part<'a, D>,
    /// The transpose of a dense matrix that is not bitwise symmetric.
    transpose: Option<Vec<f64>>,
    /// The inverse, made on first use; `None` if there is none.
    inverse: OnceLock<Option<Vec<f64>>>,
}

impl<'a, const D: usize> Island<'a, D> {
    /// Makes an island at the positions `nodes`, with `caller` the contact numbers there.
    pub fn new(nodes: Range<usize>, caller: &[usize], part: Part<'a, D>) -> Result<Self, Error> {
        let m = D * nodes.len();
        let mut transpose = None;
        let (found, expected) = match &part {
            Part::Dense(matrix) => (matrix.len(), m * m),
            Part::Sparse(blocks) => (D * blocks.rows(), m),
        };
        check_length("W", found, expected)?;
        if let Part::Dense(matrix) = &part {
            if let Some(at) = matrix.iter().position(|c| !c.is_finite()) {
                let caller = |k: usize| D * caller[k / D] + k % D;
                return Err(Error::EntryNotFinite {
                    what: "W",
                    row: caller(at / m),
                    column: caller(at % m),
                    value: matrix[at],
                });
            }
            transpose = asymmetric_transpose(matrix, m);
        }
        Ok(Self {
            nodes,
            part,
            transpose,
            inverse: OnceLock::new(),
        })
    }

    fn order(&self) -> usize {
        D * self.nodes.len()
    }

    pub fn part(&self) -> &Part<'a, D> {
        &self.part
    }

    pub fn blocks(&self) -> Option<&Blocks<D>> {
        match &self.part {
            Part::Dense(_) => None,
            Part::Sparse(blocks) => Some(blocks),
        }
    }

    /// Entries that a product reads.
    pub fn entries(&self) -> usize {
        match &self.part {
            Part::Dense(matrix) => matrix.len(),
            Part::Sparse(blocks) => D * D * blocks.stored(),
        }
    }

    /// Bytes of the transpose and the inverse.
    pub fn bytes_beside(&self) -> usize {
        let inverse = self.inverse.get().and_then(Option::as_ref);
        8 * (self.transpose.as_ref().map_or(0, Vec::len) + inverse.map_or(0, Vec::len))
    }

    pub fn is_symmetric(&self) -> bool {
        match &self.part {
            Part::Dense(_) => self.transpose.is_none(),
            Part::Sparse(blocks) => blocks.is_symmetric(),
        }
    }

    /// Largest difference between an entry and its mirror entry, and largest entry.
    pub fn asymmetry(&self) -> (f64, f64) {
        match &self.part {
            Part::Sparse(blocks) => (blocks.asymmetry(), blocks.largest()),
            Part::Dense(matrix) => {
                let pairs = self.transpose.iter().flat_map(|t| matrix.iter().zip(t));
                let apart = pairs.fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                (apart, amax(matrix))
            }
        }
    }

    /// The block `W_ij` with `i` the contact moved and `j` the contact pushed.
    pub fn pair(&self, moved: usize, pushed: usize) -> Block<D> {
        match &self.part {
            Part::Dense(matrix) => self.block_of(matrix, moved, pushed),
            Part::Sparse(blocks) => blocks.at(moved, pushed),
        }
    }

    /// Calls `add(j, block)` for every block of a contact's row.
    pub fn row_blocks(&self, contact: usize, add: &mut dyn FnMut(usize, Block<D>)) {
        match &self.part {
            Part::Dense(_) => {
                for other in 0..self.nodes.len() {
                    add(other, self.pair(contact, other));
                }
            }
            Part::Sparse(blocks) => blocks.in_row(contact).for_each(|(j, w)| add(j, *w)),
        }
    }

    fn block_of(&self, matrix: &[f64], moved: usize, pushed: usize) -> Block<D> {
        let m = self.order();
        let (row, column) = (D * moved, D * pushed);
        Block::from_fn(|i, j| matrix[(row + i) * m + column + j])
    }

    /// Whether a reaction moves a contact along its normal.
    pub fn moves(&self, contact: usize) -> bool {
        match &self.part {
            Part::Dense(matrix) => self.row(matrix, contact, 0).iter().any(|&w| w != 0.0),
            Part::Sparse(blocks) => {
                let mut row = blocks.in_row(contact);
                row.any(|(_, w)| w.row(0).iter().any(|&w| w != 0.0))
            }
        }
    }

    fn row<'m>(&self, matrix: &'m [f64], contact: usize, k: usize) -> &'m [f64] {
        let m = self.order();
        &matrix[(D * contact + k) * m..][..m]
    }

    /// `y = W r`.
    pub fn product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        match &self.part {
            Part::Dense(matrix) => {
                self.each_row(matrix, y, |row| dot_long(row, r.as_flattened()));
            }
            Part::Sparse(blocks) => each(y, |i| blocks.row_product(i, r)),
        }
    }

    /// The part of `W r` of one contact.
    pub fn product_at(&self, contact: usize, r: &[[f64; D]]) -> [f64; D] {
        match &self.part {
            Part::Dense(matrix) => {
                std::array::from_fn(|k| dot_long(self.row(matrix, contact, k), r.as_flattened()))
            }
            Part::Sparse(blocks) => blocks.row_product(contact, r),
        }
    }

    /// Component `k` of `W r` at a contact, with sums in twice the precision.
    pub fn exact_row(&self, contact: usize, k: usize, r: &[[f64; D]]) -> Sum {
        match &self.part {
            Part::Dense(matrix) => compensated::dot(self.row(matrix, contact, k), r.as_flattened()),
            Part::Sparse(blocks) => {
                let mut sum = Sum::default();
                for (j, block) in blocks.in_row(contact) {
                    for (l, r) in r[j].iter().enumerate() {
                        sum.add_product(block[(k, l)], *r);
                    }
                }
                sum
            }
        }
    }

    /// `y = |W| |r|`.
    pub fn absolute_product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        match &self.part {
            Part::Dense(matrix) => self.each_row(matrix, y, |row| {
                let terms = row.iter().zip(r.as_flattened());
                terms.map(|(w, x)| (w * x).abs()).sum()
            }),
            Part::Sparse(blocks) => each(y, |i| {
                let sizes = |(j, w): (usize, &Block<D>)| w.abs() * Vector::from(r[j]).abs();
                blocks.in_row(i).map(sizes).sum::<Vector<D>>().into()
            }),
        }
    }

    /// One thread sums each row from left to right: the bits do not depend on the number of
    /// threads.
    fn each_row(&self, matrix: &[f64], y: &mut [[f64; D]], of_row: impl Fn(&[f64]) -> f64 + Sync) {
        let m = self.order().max(1);
        let out = y.as_flattened_mut();
        if m < PARALLEL_ROWS {
            for (value, row) in out.iter_mut().zip(matrix.chunks_exact(m)) {
                *value = of_row(row);
            }
        } else {
            tasks::for_each(
                out.chunks_mut(64).zip(matrix.chunks(64 * m)),
                |_, (out, rows)| {
                    for (value, row) in out.iter_mut().zip(rows.chunks_exact(m)) {
                        *value = of_row(row);
                    }
                },
            );
        }
    }

    /// `y += W_{·i} dr`.
    pub fn add_column(&self, contact: usize, dr: &[f64; D], y: &mut [[f64; D]]) {
        let matrix = match &self.part {
            Part::Dense(matrix) => matrix,
            Part::Sparse(blocks) => {
                for (i, block) in blocks.in_column(contact) {
                    let dv = block * Vector::from(*dr);
                    for (value, dv) in y[i].iter_mut().zip(dv.iter()) {
                        *value += dv;
                    }
                }
                return;
            }
        };
        let columns = self.transpose.as_deref().unwrap_or(matrix);
        let out = y.as_flattened_mut();
        let column = |k: usize| self.row(columns, contact, k);
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

    /// `y += W dr` for some components of the reactions; reads only their columns.
    pub fn add_columns(&self, parts: Range<usize>, dr: &[[f64; D]], y: &mut [[f64; D]]) {
        /// Entries of `y` in one task. They stay in the cache.
        const ROWS: usize = 256;
        let matrix = match &self.part {
            Part::Dense(matrix) => matrix,
            Part::Sparse(blocks) => {
                for (i, value) in y.iter_mut().enumerate() {
                    for (j, block) in blocks.in_row(i) {
                        for (k, value) in value.iter_mut().enumerate() {
                            let terms = parts.clone().map(|l| block[(k, l)] * dr[j][l]);
                            *value += terms.sum::<f64>();
                        }
                    }
                }
                return;
            }
        };
        let m = self.order();
        let columns = self.transpose.as_deref().unwrap_or(matrix);
        let of_rows = |(task, out): (usize, &mut [f64])| {
            let rows = task * ROWS..task * ROWS + out.len();
            for (contact, dr) in dr.iter().enumerate() {
                for k in parts.clone().filter(|&k| dr[k] != 0.0) {
                    let column = &self.row(columns, contact, k)[rows.clone()];
                    for (value, w) in out.iter_mut().zip(column) {
                        *value += w * dr[k];
                    }
                }
            }
        };
        let out = y.as_flattened_mut();
        if m < PARALLEL_ROWS {
            out.chunks_mut(ROWS).enumerate().for_each(of_rows);
        } else {
            tasks::for_each(out.chunks_mut(ROWS), |task, out| of_rows((task, out)));
        }
    }

    /// Whether an inverse may be tried; that of a sparse matrix would be dense.
    pub fn may_have_inverse(&self) -> bool {
        self.blocks().is_none() && self.is_symmetric()
    }

    /// Whether the inverse has been made, or is known not to exist.
    pub fn inverse_known(&self) -> Option<bool> {
        if !self.may_have_inverse() {
            return Some(false);
        }
        self.inverse.get().map(Option::is_some)
    }

    /// Makes the inverse, unless it is known whether there is one.
    pub fn make_inverse(&self, stop: &AtomicBool) -> Result<(), Error> {
        if let (None, Part::Dense(matrix)) = (self.inverse_known(), &self.part) {
            let made = inverse(matrix, self.order(), stop)?;
            let _ = self.inverse.get_or_init(|| made);
        }
        Ok(())
    }

    /// The inverse; empty if it was not made.
    fn inverse(&self) -> &[f64] {
        let made = self.inverse.get().and_then(Option::as_deref);
        made.unwrap_or(&[])
    }

    /// `y = W⁻¹ x`, with the inverse made before.
    pub fn inverse_product(&self, x: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each_row(self.inverse(), y, |row| dot_long(row, x.as_flattened()));
    }

    /// A block of the inverse made before.
    pub fn inverse_pair(&self, moved: usize, pushed: usize) -> Block<D> {
        self.block_of(self.inverse(), moved, pushed)
    }
}

/// `y_i = of(i)`, by several threads if there are many.
fn each<const D: usize>(y: &mut [[f64; D]], of: impl Fn(usize) -> [f64; D] + Sync) {
    /// One row of blocks takes at most a microsecond.
    const PARALLEL: usize = 4096;
    if y.len() < PARALLEL {
        y.iter_mut().enumerate().for_each(|(i, y)| *y = of(i));
    } else {
        tasks::for_each(y.chunks_mut(PARALLEL / 8), |task, y| {
            for (k, y) in y.iter_mut().enumerate() {
                *y = of(task * (PARALLEL / 8) + k);
            }
        });
    }
}

/// The transpose of a row-major matrix, or `None` if it equals the matrix.
fn asymmetric_transpose(matrix: &[f64], m: usize) -> Option<Vec<f64>> {
    /// Rows and columns in one tile: both sides of the diagonal stay in the cache.
    const TILE: usize = 32;
    #[expect(clippy::float_cmp, reason = "symmetric to the bit is what is asked")]
    let tile_is_symmetric = |i: usize, j: usize| {
        let row_is_symmetric =
            |a: usize| (j..(j + TILE).min(a)).all(|b| matrix[a * m + b] == matrix[b * m + a]);
        (i..(i + TILE).min(m)).all(row_is_symmetric)
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
            let row = &matrix[a * m..][j..(j + TILE).min(m)];
            let column = transpose[j * m + a..].iter_mut().step_by(m);
            column.zip(row).for_each(|(to, w)| *to = *w);
        }
    }
    Some(transpose)
}

/// With a larger condition number of the matrix with unit diagonal, the inverse is mostly
/// rounding.
const WORST_CONDITION: f64 = 1e10;

/// The inverse of a symmetric positive definite matrix; `None` for another matrix.
fn inverse(matrix: &[f64], m: usize, stop: &AtomicBool) -> Result<Option<Vec<f64>>, Error> {
    if memory::check("the inverse of W", 3 * 8 * (m as u128).pow(2)).is_err() {
        return Ok(None); // steps are taken without it
    }
    let diagonal: Vec<f64> = (0..m).map(|i| matrix[i * (m + 1)]).collect();
    // A power of two does not change the bits of any other unit.
    let unit = -exponent(diagonal.iter().fold(0.0_f64, |a, &b| a.max(b)));
    let mut inverse: Vec<f64> = matrix.iter().map(|&w| times_two_to(w, unit)).collect();
    if dense::cholesky(&mut inverse, m, stop)?.is_some() {
        return Ok(None);
    }
    dense::invert_from_cholesky(&mut inverse, m, stop)?;
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
