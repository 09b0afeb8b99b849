//! A symmetric sparse matrix in square blocks, in double precision. Only one half is stored: a
//! block left of the diagonal is the mirror image of one that another row has.

use std::sync::Arc;

use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix, PADDING, ROWS, cut};
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::compensated::Sum;
use crate::linalg::pages::zeros;
use crate::linalg::parallel::largest;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::{Index, Symmetric, narrow};
use crate::linalg::union::Union;
use crate::tasks;

/// Symmetric sparse matrix in `b × b` blocks, `b` = 2 or 3. Each row has its diagonal block.
#[derive(Clone, Debug)]
pub struct SymmetricBlocks {
    b: usize,
    /// Start of each row in `column`.
    start: Arc<Vec<u32>>,
    /// Columns of all blocks of a row, ascending.
    column: Arc<Vec<u32>>,
    /// Start of the blocks of each row in `values`.
    upper: Vec<u32>,
    /// Each block by columns, those of a row from the diagonal on, then [`PADDING`].
    values: Vec<f64>,
    /// The place in `values` of the mirror image of each block left of the diagonal.
    mirror: Vec<u32>,
    held: Vec<bool>,
}

/// A stored block, by columns, and whether its mirror image is meant.
#[derive(Clone, Copy)]
pub(super) struct StoredBlock<'a> {
    pub(super) values: &'a [f64],
    pub(super) mirrored: bool,
}

impl StoredBlock<'_> {
    /// Entry `at` by columns, of a `b × b` block.
    pub(super) fn entry(self, at: usize, b: usize) -> f64 {
        self.values[if self.mirrored {
            at % b * b + at / b
        } else {
            at
        }]
    }
}

impl SymmetricBlocks {
    /// The matrix of a symmetric `k` whose degree of freedom `i` is component `place[i] % b` of
    /// node `place[i] / b`, or is left out if `place[i]` is [`ABSENT`]. Of two blocks that mirror
    /// each other, the one in the row of the lower node is read.
    ///
    /// A component that no degree of freedom has is held: its row is that of the diagonal, with
    /// a number of the size of the other diagonals.
    ///
    /// # Panics
    /// If `place` has not one entry for each row of `k`, or names a node that does not exist.
    #[must_use]
    pub fn new<I: Index>(k: &Symmetric<'_, I>, place: &[u32], nodes: usize, b: usize) -> Self {
        assert_eq!(place.len(), k.n());
        let mut dof = vec![ABSENT; nodes * b];
        for (i, &at) in place.iter().enumerate() {
            if at != ABSENT {
                dof[at as usize] = narrow(i);
            }
        }
        let (upper, of_upper) = pattern(k, place, &dof, b);
        let values = blocks(k, place, &dof, b, (&upper, &of_upper));
        let (start, column, mirror) = both_halves(&upper, &of_upper);
        let mut matrix = Self {
            b,
            start: Arc::new(start),
            column: Arc::new(column),
            upper,
            values,
            mirror,
            held: dof.iter().map(|&dof| dof == ABSENT).collect(),
        };
        matrix.fill_absent(k);
        matrix
    }

    /// Gives absent unknowns the mean diagonal of their node, else of the whole matrix.
    fn fill_absent<I: Index>(&mut self, k: &Symmetric<'_, I>) {
        let b = self.b;
        if !self.held.contains(&true) {
            return;
        }
        let diagonal = k.diagonal();
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let mean = diagonal.iter().sum::<f64>() / diagonal.len().max(1) as f64;
        let mean = if mean > 0.0 { mean } else { 1.0 };
        for i in 0..self.nodes() {
            let absent = &self.held[b * i..b * (i + 1)];
            if !absent.contains(&true) {
                continue;
            }
            let at = self.upper[i] as usize * b * b;
            let block = &mut self.values[at..at + b * b];
            let (mut sum, mut count) = (0.0, 0.0);
            for l in (0..b).filter(|&l| !absent[l]) {
                sum += block[l * b + l];
                count += 1.0;
            }
            for l in (0..b).filter(|&l| absent[l]) {
                block[l * b + l] = if sum > 0.0 { sum / count } else { mean };
            }
        }
    }

    /// Number of nodes, each with a row of blocks.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.upper.len() - 1
    }

    /// Unknowns of a node.
    #[must_use]
    pub fn block_size(&self) -> usize {
        self.b
    }

    /// Memory of the matrix.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let places = self.start.len() + self.column.len() + self.upper.len() + self.mirror.len();
        4 * places + 8 * self.values.len() + self.held.len()
    }

    /// Unknowns that have no degree of freedom.
    #[must_use]
    pub fn held(&self) -> &[bool] {
        &self.held
    }

    /// The diagonal block of a node, by columns.
    #[must_use]
    pub fn diagonal_block(&self, node: usize) -> &[f64] {
        self.stored(self.upper[node])
    }

    fn stored(&self, at: u32) -> &[f64] {
        let size = self.b * self.b;
        &self.values[at as usize * size..][..size]
    }

    /// Columns of the blocks left of the diagonal with the places of their mirror images, and
    /// columns of the others.
    fn sides(&self, node: usize) -> (&[u32], &[u32], &[u32]) {
        let row = self.start[node] as usize..self.start[node + 1] as usize;
        let stored = (self.upper[node + 1] - self.upper[node]) as usize;
        let (left, right) = self.column[row.clone()].split_at(row.len() - stored);
        let first = row.start - self.upper[node] as usize;
        (left, &self.mirror[first..first + left.len()], right)
    }

    /// The blocks of a row: the node of each column, ascending, and the block.
    pub(super) fn row(&self, node: usize) -> impl Iterator<Item = (u32, StoredBlock<'_>)> {
        let (left, mirror, right) = self.sides(node);
        let left = left.iter().zip(mirror).map(|(&j, &at)| (j, at, true));
        let places = self.upper[node]..self.upper[node + 1];
        let right = right.iter().zip(places).map(|(&j, at)| (j, at, false));
        left.chain(right).map(|(j, at, mirrored)| {
            let values = self.stored(at);
            (j, StoredBlock { values, mirrored })
        })
    }

    /// Calls `visit` with the blocks of a row: the node of each column, ascending, and the block
    /// by columns.
    pub fn for_each_block(&self, node: usize, mut visit: impl FnMut(usize, &[f64])) {
        let mut block = [0.0; 9];
        for (j, stored) in self.row(node) {
            let block = &mut block[..self.b * self.b];
            for (at, value) in block.iter_mut().enumerate() {
                *value = stored.entry(at, self.b);
            }
            visit(j as usize, block);
        }
    }

    /// The body of each node, numbered in the order of first appearance: nodes that the matrix
    /// couples, directly or through others. A block of zeros does not couple.
    #[must_use]
    pub fn connected(&self) -> Vec<u32> {
        let mut sets = Union::new(self.nodes());
        for i in 0..self.nodes() {
            for (j, block) in self.row(i).filter(|(_, block)| !block.mirrored) {
                if block.values.iter().any(|&value| value != 0.0) {
                    sets.join(i, j as usize);
                }
            }
        }
        sets.numbers().into_iter().map(narrow).collect()
    }

    /// Largest magnitude of the entries.
    pub(super) fn largest(&self) -> f64 {
        largest(&self.values)
    }

    /// The matrix in single precision, divided by a power of two near its largest diagonal.
    #[must_use]
    pub fn to_single(&self) -> BlockMatrix {
        let (size, largest) = (self.b * self.b, self.largest());
        let exponent = if largest.is_finite() {
            exponent(largest)
        } else {
            0
        };
        let factor = times_two_to(1.0, -exponent);
        let mut values = zeros(self.column.len() * size + PADDING);
        let parts = cut(&mut values, self.nodes(), |i| self.start[i] as usize * size);
        tasks::for_each(parts, |task, part| {
            let rows = task * ROWS..self.nodes().min((task + 1) * ROWS);
            let blocks = rows.flat_map(|i| self.row(i));
            for (to, (_, block)) in part.chunks_exact_mut(size).zip(blocks) {
                for (at, to) in to.iter_mut().enumerate() {
                    *to = f32::rounded(block.entry(at, self.b) * factor);
                }
            }
        });
        BlockMatrix {
            b: self.b,
            start: Arc::clone(&self.start),
            column: Arc::clone(&self.column),
            values,
            held: self.held.clone(),
            exponent,
        }
    }

    /// `y = A x`, for vectors of `b` entries for each node.
    ///
    /// # Panics
    /// If `x` or `y` has not this length.
    pub fn product(&self, x: &[f64], y: &mut [f64]) {
        assert_eq!(x.len(), self.b * self.nodes());
        assert_eq!(y.len(), x.len());
        tasks::for_each(y.chunks_mut(ROWS * self.b), |task, y| {
            let rows = ProductRows {
                matrix: self,
                x,
                first: task * ROWS,
                y,
            };
            match self.b {
                2 => widest(Sized::<2, 4>(rows)),
                _ => widest(Sized::<3, 4>(rows)),
            }
        });
    }

    /// `A x` with sums in twice the precision: the values, and the digits below their rounding.
    ///
    /// # Panics
    /// If `x` has not an entry for each unknown.
    #[must_use]
    pub fn product_in_two(&self, x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (b, n) = (self.b, self.b * self.nodes());
        assert_eq!(x.len(), n);
        let (mut high, mut low) = (zeros(n), zeros(n));
        let parts = high.chunks_mut(ROWS * b).zip(low.chunks_mut(ROWS * b));
        tasks::for_each(parts, |task, (high, low)| {
            let rows = high.chunks_exact_mut(b).zip(low.chunks_exact_mut(b));
            for (k, (high, low)) in rows.enumerate() {
                let mut sums = [Sum::default(); 3];
                for (j, block) in self.row(task * ROWS + k) {
                    let x = &x[b * j as usize..][..b];
                    for at in 0..b * b {
                        sums[at % b].add_product(block.entry(at, b), x[at / b]);
                    }
                }
                for (sum, (high, low)) in sums.iter().zip(high.iter_mut().zip(low)) {
                    (*high, *low) = sum.parts();
                }
            }
        });
        (high, low)
    }

    /// `y = |A| |x|`.
    ///
    /// # Panics
    /// If `x` or `y` has not `b` entries for each node.
    pub fn absolute_product(&self, x: &[f64], y: &mut [f64]) {
        let b = self.b;
        assert_eq!(x.len(), b * self.nodes());
        assert_eq!(y.len(), x.len());
        tasks::for_each(y.chunks_mut(b * ROWS), |task, y| {
            for (k, y) in y.chunks_exact_mut(b).enumerate() {
                y.fill(0.0);
                for (j, block) in self.row(task * ROWS + k) {
                    let x = &x[b * j as usize..][..b];
                    for at in 0..b * b {
                        y[at % b] += (block.entry(at, b) * x[at / b]).abs();
                    }
                }
            }
        });
    }
}

/// The rows of one task of a product.
struct ProductRows<'a> {
    matrix: &'a SymmetricBlocks,
    x: &'a [f64],
    first: usize,
    y: &'a mut [f64],
}

/// Rows of `B × B` blocks, with `L` lanes for each column.
struct Sized<'a, const B: usize, const L: usize>(ProductRows<'a>);

impl<const B: usize, const L: usize> WideWork for Sized<'_, B, L> {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "must take the caller's instructions")]
    fn run<const FMA: bool>(self) {
        let ProductRows {
            matrix,
            x,
            first,
            y,
        } = self.0;
        for (k, y) in y.chunks_exact_mut(B).enumerate() {
            let (left, mirror, right) = matrix.sides(first + k);
            // One sum for each column of a block, in registers; lanes after B are not used.
            let mut sums = [[0.0_f64; L]; B];
            for (&j, &at) in left.iter().zip(mirror) {
                let block = &matrix.values[at as usize * B * B..][..B * B];
                let x = &x[j as usize * B..][..B];
                for c in 0..B {
                    for l in 0..B {
                        sums[c][l] = block[l * B + c].times_plus::<FMA>(x[c], sums[c][l]);
                    }
                }
            }
            let mut values = &matrix.values[matrix.upper[first + k] as usize * B * B..];
            for &j in right {
                let block = &values[..B * B + L - B];
                let x = &x[j as usize * B..][..B];
                for c in 0..B {
                    for l in 0..L {
                        sums[c][l] = block[c * B + l].times_plus::<FMA>(x[c], sums[c][l]);
                    }
                }
                values = &values[B * B..];
            }
            let mut sum = sums[0];
            for other in &sums[1..] {
                for l in 0..L {
                    sum[l] += other[l];
                }
            }
            y.copy_from_slice(&sum[..B]);
        }
    }
}

/// Starts and columns of the blocks of each row from the diagonal on.
fn pattern<I: Index>(
    k: &Symmetric<'_, I>,
    place: &[u32],
    dof: &[u32],
    b: usize,
) -> (Vec<u32>, Vec<u32>) {
    let nodes = dof.len() / b;
    let parts = tasks::map(0..nodes.div_ceil(ROWS), |_, task| {
        let (mut counts, mut columns, mut row) = (Vec::new(), Vec::new(), Vec::new());
        for i in task * ROWS..nodes.min((task + 1) * ROWS) {
            row.clear();
            row.push(narrow(i));
            for &dof in dof[b * i..b * (i + 1)].iter().filter(|&&dof| dof != ABSENT) {
                for (j, _) in k.column(dof as usize) {
                    let node = place[j] / narrow(b);
                    // The components of a node usually follow one another.
                    if place[j] != ABSENT && node as usize > i && row.last() != Some(&node) {
                        row.push(node);
                    }
                }
            }
            row.sort_unstable();
            row.dedup();
            counts.push(narrow(row.len()));
            columns.extend_from_slice(&row);
        }
        (counts, columns)
    });
    let mut start = vec![0];
    let mut column = Vec::with_capacity(parts.iter().map(|(_, columns)| columns.len()).sum());
    let mut sum = 0;
    for (counts, columns) in parts {
        for count in counts {
            sum += count;
            start.push(sum);
        }
        column.extend(columns);
    }
    (start, column)
}

/// Values of the blocks of each row from the diagonal on.
fn blocks<I: Index>(
    k: &Symmetric<'_, I>,
    place: &[u32],
    dof: &[u32],
    b: usize,
    (start, column): (&[u32], &[u32]),
) -> Vec<f64> {
    let (nodes, size) = (dof.len() / b, b * b);
    let mut values = zeros(column.len() * size + PADDING);
    let parts = cut(&mut values, nodes, |i| start[i] as usize * size);
    tasks::for_each(parts, |task, part| {
        for i in task * ROWS..nodes.min((task + 1) * ROWS) {
            let row = start[i] as usize..start[i + 1] as usize;
            let from = (row.start - start[task * ROWS] as usize) * size;
            let columns = &column[row];
            for (r, &dof) in dof[b * i..b * (i + 1)].iter().enumerate() {
                if dof == ABSENT {
                    continue;
                }
                // Columns come in the order of the nodes in most matrices.
                let mut at = 0;
                for (j, value) in k.column(dof as usize) {
                    let node = place[j] / narrow(b);
                    if place[j] == ABSENT || (node as usize) < i {
                        continue;
                    }
                    if columns.get(at) != Some(&node) {
                        at += 1;
                    }
                    if columns.get(at) != Some(&node) {
                        at = columns.partition_point(|&j| j < node);
                    }
                    part[from + at * size + place[j] as usize % b * b + r] = value;
                }
            }
        }
    });
    values
}

/// Starts and columns of whole rows, and the places of the mirror images of what is left of the
/// diagonal.
fn both_halves(upper: &[u32], of_upper: &[u32]) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let nodes = upper.len() - 1;
    let row = |i: usize| upper[i] as usize..upper[i + 1] as usize;
    let mut left = vec![0; nodes + 1];
    for i in 0..nodes {
        for &j in &of_upper[row(i)][1..] {
            left[j as usize + 1] += 1;
        }
    }
    for i in 0..nodes {
        left[i + 1] += left[i];
    }
    let start: Vec<u32> = left.iter().zip(upper).map(|(left, up)| left + up).collect();
    let mut column = zeros(start[nodes] as usize);
    let mut mirror = zeros(left[nodes] as usize);
    // Number of blocks that a row has so far: rows come in the order of the columns.
    let mut filled = vec![0; nodes];
    for i in 0..nodes {
        let own = start[i] as usize + filled[i] as usize;
        column[own..own + row(i).len()].copy_from_slice(&of_upper[row(i)]);
        for at in row(i).skip(1) {
            let j = of_upper[at] as usize;
            column[(start[j] + filled[j]) as usize] = narrow(i);
            mirror[(left[j] + filled[j]) as usize] = narrow(at);
            filled[j] += 1;
        }
    }
    (start, column, mirror)
}
