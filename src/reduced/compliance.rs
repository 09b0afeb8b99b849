//! The compliance `W` of (3), one matrix for each island of coupled contacts.
//!
//! Contacts are stored such that each island is a range of positions; `order` gives the numbers
//! of the caller. `W` is not copied or changed.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::compensated::Sum;
use crate::linalg::small::Block;
use crate::linalg::sparse::blocks::Blocks;
use crate::linalg::sparse::sparse_lu::Analysis;
use crate::reduced::elliptic_scaling::EllipticScaling;
use crate::reduced::island::PARALLEL_ROWS;
pub use crate::reduced::island::{Island, Part};
use crate::reduced::memory;
use crate::reduced::rotation::Rotation;
use crate::reduced::tuning;
use crate::tasks;

/// First block of each row, columns and entries.
pub type BlockRows = (Vec<usize>, Vec<usize>, Vec<f64>);

/// Whether a matrix with this many blocks is stored and factored as a sparse matrix. Sparse
/// work takes longer for each number than dense work.
pub fn is_sparse(blocks: usize, contacts: usize) -> bool {
    contacts >= tuning::sparse_contacts()
        && blocks.saturating_mul(tuning::sparse_share()) <= contacts.saturating_mul(contacts)
}

/// `W` of all contacts, by islands.
#[derive(Debug)]
pub struct Compliance<'a, const D: usize> {
    islands: Vec<Island<'a, D>>,
    /// Caller's number of the contact at each position.
    order: Vec<usize>,
    /// Island of each position.
    island_of: Vec<usize>,
    /// `W` in blocks if it is sparse, made on first use.
    whole: OnceLock<Whole<D>>,
}

/// A whole `W` in blocks, and the elimination order of matrices with its pattern.
#[derive(Debug)]
pub struct Whole<const D: usize> {
    pub blocks: Blocks<D>,
    pub analysis: Analysis,
}

impl<const D: usize> Whole<D> {
    /// Whether there is memory for the factors of an LU: both triangles; the count has one.
    pub fn has_memory(&self) -> bool {
        let bytes = 2 * self.analysis.counts().bytes_peak as u128;
        memory::check("the factors of W", bytes).is_ok()
    }
}

impl<'a, const D: usize> Compliance<'a, D> {
    /// Makes `W` from islands: the contact numbers of each, and its part of `W` with blocks in
    /// the order of these numbers.
    ///
    /// # Errors
    /// As [`Island::new`]. The islands must partition `0..n_c`.
    pub fn new(parts: Vec<(Vec<usize>, Part<'a, D>)>) -> Result<Self, Error> {
        let mut islands = Vec::with_capacity(parts.len());
        let mut order = Vec::new();
        let mut island_of = Vec::new();
        for (nodes, part) in parts {
            let positions = order.len()..order.len() + nodes.len();
            island_of.resize(positions.end, islands.len());
            islands.push(Island::new(positions, &nodes, part)?);
            order.extend(nodes);
        }
        Ok(Self {
            islands,
            order,
            island_of,
            whole: OnceLock::new(),
        })
    }

    /// Makes `W` from a dense row-major matrix of order `D n_c`.
    pub fn from_dense(contacts: usize, matrix: Cow<'a, [f64]>) -> Result<Self, Error> {
        Self::new(vec![((0..contacts).collect(), Part::Dense(matrix))])
    }

    /// `T W T`.
    pub fn scaled(&self, elliptic: &EllipticScaling) -> Result<Compliance<'static, D>, Error> {
        self.map(|w, moved, pushed| elliptic.block(w, moved, pushed))
    }

    /// `Q W Qᵀ`.
    pub fn rotated(&self, rotation: &Rotation<D>) -> Result<Compliance<'static, D>, Error> {
        self.map(|w, moved, pushed| rotation.block(w, moved, pushed))
    }

    /// Each block replaced, with the numbers of its contacts.
    fn map(
        &self,
        of: impl Fn(&Block<D>, usize, usize) -> Block<D> + Sync,
    ) -> Result<Compliance<'static, D>, Error> {
        let part = |island: &Island<'a, D>| {
            let caller = &self.order[island.nodes.clone()];
            let of = |i: usize, j: usize, w: &Block<D>| of(w, caller[i], caller[j]);
            (caller.to_vec(), island.part().map(caller.len(), of))
        };
        Compliance::new(self.islands.iter().map(part).collect())
    }

    pub fn contacts(&self) -> usize {
        self.order.len()
    }

    pub fn islands(&self) -> &[Island<'a, D>] {
        &self.islands
    }

    /// Whether `W` has so many zeros that matrices of its pattern are factored as sparse ones.
    pub fn is_sparse(&self) -> bool {
        let mut islands = self.islands.iter();
        islands.any(|island| island.blocks().is_some())
            || is_sparse(self.entries() / (D * D), self.contacts())
    }

    pub fn row_blocks(&self, position: usize, add: &mut dyn FnMut(usize, Block<D>)) {
        let (island, contact) = self.find(position);
        island.row_blocks(contact, &mut |j, w| add(island.nodes.start + j, w));
    }

    pub fn whole(&self) -> Result<Option<&Whole<D>>, Error> {
        if !self.is_sparse() {
            return Ok(None);
        }
        if self.whole.get().is_none() {
            let blocks = Blocks::from_rows(self.contacts(), |i, add| self.row_blocks(i, add));
            let analysis = Analysis::new(&blocks)?;
            let _ = self.whole.get_or_init(|| Whole { blocks, analysis });
        }
        Ok(self.whole.get())
    }

    pub fn entries(&self) -> usize {
        self.islands.iter().map(Island::entries).sum()
    }

    /// Contact number of the caller at each position.
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// Node values of the caller in the order of positions.
    pub fn gather<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.order.iter().map(|&i| values[i]).collect()
    }

    /// The inverse of [`Compliance::gather`].
    pub fn scatter<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let mut out = values.to_vec();
        for (&i, &value) in self.order.iter().zip(values) {
            out[i] = value;
        }
        out
    }

    pub fn bytes(&self) -> usize {
        8 * self.entries()
    }

    /// Bytes of transposes and inverses.
    pub fn bytes_beside(&self) -> usize {
        self.islands.iter().map(Island::bytes_beside).sum()
    }

    /// Largest `|W_ij − W_ji|` over the largest entry; zero for an elastic `W`.
    pub fn asymmetry(&self) -> f64 {
        let (mut apart, mut largest) = (0.0_f64, 0.0_f64);
        for (a, b) in self.islands.iter().map(Island::asymmetry) {
            (apart, largest) = (apart.max(a), largest.max(b));
        }
        if largest == 0.0 { 0.0 } else { apart / largest }
    }

    /// The island of a position, and the position within it.
    fn find(&self, position: usize) -> (&Island<'a, D>, usize) {
        let island = &self.islands[self.island_of[position]];
        (island, position - island.nodes.start)
    }

    /// The diagonal block of the contact at `position`.
    pub fn block(&self, position: usize) -> Block<D> {
        self.pair(position, position)
    }

    /// Whether a reaction moves the contact at `position` along its normal.
    pub fn moves(&self, position: usize) -> bool {
        let (island, contact) = self.find(position);
        island.moves(contact)
    }

    /// The block `W_ij` with `i` the contact moved and `j` the contact pushed.
    pub fn pair(&self, moved: usize, pushed: usize) -> Block<D> {
        self.block_of(Island::pair, moved, pushed)
    }

    fn block_of(
        &self,
        of: impl Fn(&Island<'a, D>, usize, usize) -> Block<D>,
        moved: usize,
        pushed: usize,
    ) -> Block<D> {
        let (island, contact) = self.find(moved);
        if !island.nodes.contains(&pushed) {
            return Block::zeros();
        }
        of(island, contact, pushed - island.nodes.start)
    }

    fn each(
        &self,
        x: &[[f64; D]],
        y: &mut [[f64; D]],
        of: impl Fn(&Island<'a, D>, &[[f64; D]], &mut [[f64; D]]),
    ) {
        for island in &self.islands {
            of(
                island,
                &x[island.nodes.clone()],
                &mut y[island.nodes.clone()],
            );
        }
    }

    /// `y = W r`.
    pub fn product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each(r, y, Island::product);
    }

    /// `y = Wᵀ r`, faster with fewer reactions.
    pub fn transposed_product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        y.fill([0.0; D]);
        for island in &self.islands {
            let y = &mut y[island.nodes.clone()];
            for (contact, r) in r[island.nodes.clone()].iter().enumerate() {
                if r.iter().any(|&c| c != 0.0) {
                    island.row_blocks(contact, &mut |other, w| {
                        for (k, value) in y[other].iter_mut().enumerate() {
                            *value += (0..D).map(|l| w[(l, k)] * r[l]).sum::<f64>();
                        }
                    });
                }
            }
        }
    }

    /// Component `k` of `W r` at a position, with sums in twice the precision.
    pub fn exact_row(&self, position: usize, k: usize, r: &[[f64; D]]) -> Sum {
        let (island, contact) = self.find(position);
        island.exact_row(contact, k, &r[island.nodes.clone()])
    }

    /// `W r` at some positions, in their order.
    pub fn product_at(&self, positions: &[usize], r: &[[f64; D]]) -> Vec<[f64; D]> {
        let at = |&position: &usize| {
            let (island, contact) = self.find(position);
            island.product_at(contact, &r[island.nodes.clone()])
        };
        if D * positions.len() < PARALLEL_ROWS {
            positions.iter().map(at).collect()
        } else {
            let rows = tasks::map(positions.chunks(32), |_, part| {
                part.iter().map(at).collect::<Vec<_>>()
            });
            rows.concat()
        }
    }

    pub fn is_symmetric(&self) -> bool {
        self.islands.iter().all(Island::is_symmetric)
    }

    /// `y = |W| |r|`, for bounds on the rounding of [`Compliance::product`].
    pub fn absolute_product(&self, r: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each(r, y, Island::absolute_product);
    }

    /// `y += W_{·i} dr` for the contact at `position`.
    pub fn add_column(&self, position: usize, dr: &[f64; D], y: &mut [[f64; D]]) {
        let (island, contact) = self.find(position);
        island.add_column(contact, dr, &mut y[island.nodes.clone()]);
    }

    /// `y += W dr` for some components of the reactions; reads only their columns.
    pub fn add_columns(&self, parts: Range<usize>, dr: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each(dr, y, |island, dr, y| {
            island.add_columns(parts.clone(), dr, y);
        });
    }

    /// Whether an inverse may be tried: only if `W` is symmetric and dense. It does not depend
    /// on earlier solves.
    pub fn may_have_inverse(&self) -> bool {
        self.islands.iter().all(Island::may_have_inverse)
    }

    /// Whether the inverse of `W` has been made, or is known not to exist.
    pub fn inverse_known(&self) -> Option<bool> {
        let mut known = self.islands.iter().map(Island::inverse_known);
        if known.clone().any(|known| known == Some(false)) {
            return Some(false);
        }
        known.try_fold(true, |all, known| Some(all && known?))
    }

    /// Makes the inverse of each island that has none. Returns whether `W` has an inverse of
    /// sufficient accuracy.
    pub fn make_inverse(&self, stop: &AtomicBool) -> Result<bool, Error> {
        for island in &self.islands {
            if self.inverse_known() == Some(false) {
                break;
            }
            island.make_inverse(stop)?;
        }
        Ok(self.inverse_known() == Some(true))
    }

    /// `y = W⁻¹ x`, with the inverse made before.
    pub fn inverse_product(&self, x: &[[f64; D]], y: &mut [[f64; D]]) {
        self.each(x, y, Island::inverse_product);
    }

    pub fn inverse_pair(&self, moved: usize, pushed: usize) -> Block<D> {
        self.block_of(Island::inverse_pair, moved, pushed)
    }

    /// The blocks of a sparse `W` in the numbering of the caller: the first of each row,
    /// columns, and row-major entries.
    pub fn rows_of_blocks(&self) -> Result<Option<BlockRows>, Error> {
        let Some(whole) = self.whole()? else {
            return Ok(None);
        };
        let mut place = vec![0; self.order.len()];
        for (position, &node) in self.order.iter().enumerate() {
            place[node] = position;
        }
        let (mut start, mut column, mut values) = (vec![0], Vec::new(), Vec::new());
        for &position in &place {
            for (other, block) in whole.blocks.in_row(position) {
                column.push(self.order[other]);
                values.extend(block.transpose().iter());
            }
            start.push(column.len());
        }
        Ok(Some((start, column, values)))
    }

    /// `W` as a dense row-major matrix in the numbering of the caller.
    pub fn to_dense(&self) -> Vec<f64> {
        let n = D * self.order.len();
        let mut dense = vec![0.0; n * n];
        for island in &self.islands {
            let nodes = &self.order[island.nodes.clone()];
            for (i, &moved) in nodes.iter().enumerate() {
                for (j, &pushed) in nodes.iter().enumerate() {
                    let block = island.pair(i, j);
                    for k in 0..D {
                        for l in 0..D {
                            dense[(D * moved + k) * n + D * pushed + l] = block[(k, l)];
                        }
                    }
                }
            }
        }
        dense
    }
}
