//! A symmetric sparse matrix in square blocks, in double precision. Only one half is stored: a
//! block left of the diagonal is the mirror image of one that another row has.
//!
//! A product reads each block once and adds to two rows. Rows are cut into parts at places that
//! depend on the pattern alone; what a part adds to rows of later parts stands apart and is added
//! in the order of the parts, so that the bits are the same for any number of threads.

use std::ops::Range;
use std::sync::Arc;

use crate::linalg::amg::block_matrix::{ABSENT, PADDING, ROWS, cut};
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::compensated::Sum;
use crate::linalg::pages::zeros;
use crate::linalg::parallel::largest;
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;
use crate::linalg::union::Union;
use crate::tasks;

/// Most parts of a product, and fewest rows of a part: more serve no processor that is common.
const PARTS: usize = 32;
const LEAST_ROWS: usize = 512;

/// Parts that stay even if the numbering of the nodes is so irregular that each adds to most of
/// the other rows. Their vectors are then small beside the matrix.
const FEW: usize = 4;

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
    held: Vec<bool>,
    parts: Vec<Part>,
    /// For each stored block, the row of its mirror image: counted from the first of its part,
    /// then the numbers of the rows outside.
    target: Vec<u32>,
}

/// Rows of a product that one task computes.
#[derive(Clone, Debug)]
struct Part {
    rows: Range<usize>,
    /// Rows of later parts to which it adds, ascending.
    outside: Vec<u32>,
}

/// A stored block, or the mirror image of one.
#[derive(Clone, Copy)]
pub(super) struct StoredBlock<'a> {
    values: &'a [f64],
    /// Steps in `values` from row to row, and from column to column.
    strides: [usize; 2],
}

impl<'a> StoredBlock<'a> {
    /// A `b × b` block by columns, or its mirror image.
    pub(super) fn new(values: &'a [f64], b: usize, mirrored: bool) -> Self {
        let strides = if mirrored { [b, 1] } else { [1, b] };
        Self { values, strides }
    }

    /// The entry of a row and a column.
    #[inline(always)]
    pub(super) fn entry(self, row: usize, column: usize) -> f64 {
        self.values[row * self.strides[0] + column * self.strides[1]]
    }

    /// Writes `factor` times the block in single precision, by columns.
    #[inline(always)]
    pub(super) fn write_single<const B: usize>(self, factor: f64, to: &mut [f32]) {
        let (from, to) = (&self.values[..B * B], &mut to[..B * B]);
        if self.strides[0] == 1 {
            for (to, from) in to.iter_mut().zip(from) {
                *to = f32::rounded(from * factor);
            }
        } else {
            for (at, to) in to.iter_mut().enumerate() {
                *to = f32::rounded(from[at % B * B + at / B] * factor);
            }
        }
    }

    /// Calls `visit` with the row, the column and the value of each entry, by columns.
    #[inline(always)]
    pub(super) fn for_each(self, b: usize, mut visit: impl FnMut(usize, usize, f64)) {
        for column in 0..b {
            for row in 0..b {
                visit(row, column, self.entry(row, column));
            }
        }
    }
}

impl SymmetricBlocks {
    /// The matrix of all rows of `upper`.
    ///
    /// A component that no degree of freedom has is held: its row is that of the diagonal, with
    /// a number of the size of the other diagonals, the mean of its node or else `mean`.
    pub fn new(upper: UpperBlocks, mean: f64) -> Self {
        let UpperBlocks {
            b,
            dof,
            start: upper,
            column: of_upper,
            mut values,
            ..
        } = upper;
        values.resize(of_upper.len() * b * b + PADDING, 0.0);
        values.shrink_to_fit();
        let (start, column) = both_halves(&upper, &of_upper);
        let (parts, target) = choose_parts(&upper, of_upper);
        let mut matrix = Self {
            b,
            start: Arc::new(start),
            column: Arc::new(column),
            upper,
            values,
            parts,
            target,
            held: dof.iter().map(|&dof| dof == ABSENT).collect(),
        };
        matrix.fill_absent(mean);
        matrix
    }

    /// Gives absent unknowns the mean diagonal of their node, else `mean`.
    fn fill_absent(&mut self, mean: f64) {
        let b = self.b;
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
    pub fn nodes(&self) -> usize {
        self.upper.len() - 1
    }

    /// Unknowns of a node.
    pub fn block_size(&self) -> usize {
        self.b
    }

    /// Memory of the matrix.
    pub fn bytes(&self) -> usize {
        let outside = self.parts.iter().map(|part| part.outside.len());
        let places = self.start.len() + self.column.len() + self.upper.len() + self.target.len();
        let places = places + outside.sum::<usize>();
        4 * places + 8 * self.values.len() + self.held.len()
    }

    /// Unknowns that have no degree of freedom.
    pub fn held(&self) -> &[bool] {
        &self.held
    }

    /// The diagonal block of a node, by columns.
    pub fn diagonal_block(&self, node: usize) -> &[f64] {
        self.stored(self.upper[node])
    }

    fn stored(&self, at: u32) -> &[f64] {
        let size = self.b * self.b;
        &self.values[at as usize * size..][..size]
    }

    /// Columns of the blocks left of the diagonal, and of the others.
    fn sides(&self, node: usize) -> (&[u32], &[u32]) {
        let row = self.start[node] as usize..self.start[node + 1] as usize;
        let stored = (self.upper[node + 1] - self.upper[node]) as usize;
        self.column[row.clone()].split_at(row.len() - stored)
    }

    /// The blocks of a row: the node of each column, ascending, and the block.
    pub(super) fn row(&self, node: usize) -> impl Iterator<Item = (u32, StoredBlock<'_>)> {
        let (left, right) = self.sides(node);
        let left = left.iter().map(move |&j| {
            let before = self
                .sides(j as usize)
                .1
                .partition_point(|&k| (k as usize) < node);
            (j, self.upper[j as usize] + narrow(before), true)
        });
        let places = self.upper[node]..self.upper[node + 1];
        let right = right.iter().zip(places).map(|(&j, at)| (j, at, false));
        left.chain(right)
            .map(|(j, at, mirrored)| (j, StoredBlock::new(self.stored(at), self.b, mirrored)))
    }

    /// Calls `visit` with the blocks of a row: the node of each column, ascending, and the block
    /// by columns.
    pub fn for_each_block(&self, node: usize, mut visit: impl FnMut(usize, &[f64])) {
        let mut block = [0.0; 9];
        for (j, stored) in self.row(node) {
            stored.for_each(self.b, |row, column, value| {
                block[column * self.b + row] = value;
            });
            visit(j as usize, &block[..self.b * self.b]);
        }
    }

    /// The body of each node, numbered in the order of first appearance: nodes that the matrix
    /// couples, directly or through others. A block of zeros does not couple.
    pub fn connected(&self) -> Vec<u32> {
        let mut sets = Union::new(self.nodes());
        for i in 0..self.nodes() {
            for (&j, at) in self.sides(i).1.iter().zip(self.upper[i]..) {
                if self.stored(at).iter().any(|&value| value != 0.0) {
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

    /// Starts of rows, and columns of all their blocks.
    pub(super) fn pattern(&self) -> (&Arc<Vec<u32>>, &Arc<Vec<u32>>) {
        (&self.start, &self.column)
    }

    /// `y = A x`, for vectors of `b` entries for each node.
    pub fn product(&self, x: &[f64], y: &mut [f64]) {
        self.sum_terms::<Double<false>>(x, y);
    }

    /// Sums the terms of `A x`.
    fn sum_terms<T: Terms>(&self, x: &[f64], y: &mut [T::Sum]) {
        let b = self.b;
        assert_eq!(x.len(), b * self.nodes());
        assert_eq!(y.len(), x.len());
        let mut outside: Vec<Vec<T::Sum>> = Vec::new();
        outside.extend(self.parts.iter().map(|part| zeros(b * part.outside.len())));
        tasks::for_each(self.cut(y).zip(&mut outside), |k, (y, outside)| {
            let part = ProductPart {
                matrix: self,
                rows: self.parts[k].rows.clone(),
                x,
                y,
                outside,
            };
            match b {
                2 => widest(PartOfBlocks::<T, 2>(part)),
                _ => widest(PartOfBlocks::<T, 3>(part)),
            }
        });
        tasks::for_each(self.cut(y), |k, y| {
            let rows = &self.parts[k].rows;
            for (part, values) in self.parts[..k].iter().zip(&outside) {
                let first = part.outside.partition_point(|&i| (i as usize) < rows.start);
                let own = part.outside[first..]
                    .iter()
                    .zip(values[b * first..].chunks_exact(b));
                for (&i, add) in own.take_while(|(i, _)| (**i as usize) < rows.end) {
                    let to = &mut y[b * (i as usize - rows.start)..][..b];
                    to.iter_mut()
                        .zip(add)
                        .for_each(|(to, add)| T::join(to, *add));
                }
            }
        });
    }

    /// The rows of the parts of a product.
    fn cut<'y, S>(&self, mut y: &'y mut [S]) -> impl Iterator<Item = &'y mut [S]> {
        self.parts.iter().map(move |part| {
            let (own, rest) = std::mem::take(&mut y).split_at_mut(self.b * part.rows.len());
            y = rest;
            own
        })
    }

    /// `A x` with sums in twice the precision: the values, and the digits below their rounding.
    pub fn product_in_two(&self, x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut sums: Vec<Sum> = zeros(x.len());
        self.sum_terms::<InTwo>(x, &mut sums);
        sums.iter().map(Sum::parts).unzip()
    }

    /// `y = |A| |x|`.
    pub fn absolute_product(&self, x: &[f64], y: &mut [f64]) {
        self.sum_terms::<Double<true>>(x, y);
    }
}

/// The terms of a product and their sum.
trait Terms {
    type Sum: Copy + Default + Send + Sync;

    /// Adds `value x`.
    fn add<const FMA: bool>(sum: &mut Self::Sum, value: f64, x: f64);

    fn join(sum: &mut Self::Sum, other: Self::Sum);
}

/// In double precision, the terms or their magnitudes.
struct Double<const MAGNITUDES: bool>;

impl<const MAGNITUDES: bool> Terms for Double<MAGNITUDES> {
    type Sum = f64;

    #[inline(always)]
    fn add<const FMA: bool>(sum: &mut f64, value: f64, x: f64) {
        let of = |y: f64| if MAGNITUDES { y.abs() } else { y };
        *sum = of(value).times_plus::<FMA>(of(x), *sum);
    }

    #[inline(always)]
    fn join(sum: &mut f64, other: f64) {
        *sum += other;
    }
}

/// In twice the precision.
struct InTwo;

impl Terms for InTwo {
    type Sum = Sum;

    #[inline(always)]
    fn add<const FMA: bool>(sum: &mut Sum, value: f64, x: f64) {
        sum.add_product(value, x);
    }

    #[inline(always)]
    fn join(sum: &mut Sum, other: Sum) {
        sum.add_sum(other);
    }
}

/// What one task of a product computes.
struct ProductPart<'a, S> {
    matrix: &'a SymmetricBlocks,
    rows: Range<usize>,
    x: &'a [f64],
    /// The rows of the part, and those outside.
    y: &'a mut [S],
    outside: &'a mut [S],
}

/// A part of a matrix of `B × B` blocks.
struct PartOfBlocks<'a, T: Terms, const B: usize>(ProductPart<'a, T::Sum>);

impl<T: Terms, const B: usize> WideWork for PartOfBlocks<'_, T, B> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let ProductPart {
            matrix,
            rows,
            x,
            y,
            outside,
        } = self.0;
        let (y, _) = y.as_chunks_mut::<B>();
        let (outside, _) = outside.as_chunks_mut::<B>();
        let (x, _) = x.as_chunks::<B>();
        y.fill([T::Sum::default(); B]);
        for (k, i) in rows.enumerate() {
            let stored = matrix.upper[i] as usize..matrix.upper[i + 1] as usize;
            let columns = matrix.sides(i).1;
            let blocks =
                matrix.values[stored.start * B * B..stored.end * B * B].chunks_exact(B * B);
            let of_column = columns.iter().zip(&matrix.target[stored]);
            // One sum for each column of a block, in registers.
            let mut sums = [[T::Sum::default(); B]; B];
            let own = x[i];
            for (n, ((&j, &target), block)) in of_column.zip(blocks).enumerate() {
                let x = x[j as usize];
                for c in 0..B {
                    for l in 0..B {
                        T::add::<FMA>(&mut sums[c][l], block[c * B + l], x[c]);
                    }
                }
                if n == 0 {
                    continue; // the diagonal block
                }
                let target = target as usize;
                let to = if target < y.len() {
                    &mut y[target]
                } else {
                    &mut outside[target - y.len()]
                };
                for c in 0..B {
                    for l in 0..B {
                        T::add::<FMA>(&mut to[c], block[c * B + l], own[l]);
                    }
                }
            }
            for sum in &sums {
                for l in 0..B {
                    T::join(&mut y[k][l], sum[l]);
                }
            }
        }
    }
}

/// The blocks of rows from the diagonal on, of a matrix that comes in parts of its rows: the
/// whole of its entries is never in memory.
#[derive(Clone, Debug)]
pub struct UpperBlocks {
    b: usize,
    /// The place of each degree of freedom, and the degree of freedom at each place.
    place: Vec<u32>,
    dof: Vec<u32>,
    /// Start of each row that is known in `column`.
    start: Vec<u32>,
    column: Vec<u32>,
    /// Each block by columns, then zeros.
    values: Vec<f64>,
}

impl UpperBlocks {
    /// Without a row. Degree of freedom `i` is component `place[i] % b` of node `place[i] / b`, or
    /// is left out if `place[i]` is [`ABSENT`].
    pub fn new(place: Vec<u32>, nodes: usize, b: usize) -> Self {
        let mut dof = vec![ABSENT; nodes * b];
        for (i, &at) in place.iter().enumerate() {
            if at != ABSENT {
                dof[at as usize] = narrow(i);
            }
        }
        Self {
            b,
            place,
            dof,
            start: vec![0],
            column: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Sum of the diagonal entries.
    pub fn trace(&self) -> f64 {
        let size = self.b * self.b;
        let of_row = self.start[..self.known()].iter();
        let blocks = of_row.map(|&at| &self.values[at as usize * size..][..size]);
        blocks
            .flat_map(|block| block.iter().step_by(self.b + 1))
            .sum()
    }

    /// Number of nodes whose rows are known.
    pub fn known(&self) -> usize {
        self.start.len() - 1
    }

    /// Adds the rows of the next nodes, up to `end`; `row` gives the columns and the values of a
    /// degree of freedom. Of two blocks that mirror each other, the one in the row of the lower
    /// node is read.
    pub fn append<R: Iterator<Item = (usize, f64)>>(
        &mut self,
        end: usize,
        row: impl Fn(usize) -> R + Sync,
    ) {
        let (first, before) = (self.known(), self.column.len());
        let nodes = |task: usize| first + task * ROWS..end.min(first + (task + 1) * ROWS);
        let (b, place, dof) = (self.b, &self.place, &self.dof);
        let patterns = tasks::map(0..(end - first).div_ceil(ROWS), |_, task| {
            let (mut counts, mut columns, mut found) = (Vec::new(), Vec::new(), Vec::new());
            for i in nodes(task) {
                found.clear();
                found.push(narrow(i));
                for &dof in dof[b * i..b * (i + 1)].iter().filter(|&&dof| dof != ABSENT) {
                    for (j, _) in row(dof as usize) {
                        let node = place[j] / narrow(b);
                        // The components of a node usually follow one another.
                        if place[j] != ABSENT && node as usize > i && found.last() != Some(&node) {
                            found.push(node);
                        }
                    }
                }
                found.sort_unstable();
                found.dedup();
                counts.push(narrow(found.len()));
                columns.extend_from_slice(&found);
            }
            (counts, columns)
        });
        let mut sum = narrow(before);
        for (counts, columns) in patterns {
            for count in counts {
                sum += count;
                self.start.push(sum);
            }
            self.column.extend(columns);
        }
        let (start, column, size) = (&self.start, &self.column, b * b);
        let known = column.len() * size + PADDING;
        if before == 0 {
            // Of all rows, if the others are as long: memory that is not touched costs nothing.
            self.values = zeros(known * (dof.len() / b) / end.max(1));
        }
        if self.values.len() < known {
            self.values.resize(known, 0.0);
        }
        let own = |i: usize| (start[first + i] as usize - before) * size;
        let parts = cut(&mut self.values[before * size..], end - first, own);
        tasks::for_each(parts, |task, part| {
            for i in nodes(task) {
                let stored = start[i] as usize..start[i + 1] as usize;
                let from = (stored.start - start[nodes(task).start] as usize) * size;
                let columns = &column[stored];
                for (r, &dof) in dof[b * i..b * (i + 1)].iter().enumerate() {
                    if dof == ABSENT {
                        continue;
                    }
                    // Columns come in the order of the nodes in most matrices.
                    let mut at = 0;
                    for (j, value) in row(dof as usize) {
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
    }
}

/// Starts and columns of whole rows.
fn both_halves(upper: &[u32], of_upper: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let nodes = upper.len() - 1;
    let row = |i: usize| upper[i] as usize..upper[i + 1] as usize;
    let mut start = vec![0; nodes + 1];
    for i in 0..nodes {
        start[i + 1] += upper[i + 1] - upper[i];
        for &j in &of_upper[row(i)][1..] {
            start[j as usize + 1] += 1;
        }
    }
    for i in 0..nodes {
        start[i + 1] += start[i];
    }
    let mut column = zeros(start[nodes] as usize);
    // The next place of each row: rows come in the order of the columns.
    let mut next = start[..nodes].to_vec();
    for i in 0..nodes {
        let own = &of_upper[row(i)];
        column[next[i] as usize..][..own.len()].copy_from_slice(own);
        for &j in &own[1..] {
            let place = &mut next[j as usize];
            column[*place as usize] = narrow(i);
            *place += 1;
        }
    }
    (start, column)
}

/// Rows of each part of a product, in at most [`PARTS`] parts.
pub(super) fn part_rows(nodes: usize) -> impl Iterator<Item = Range<usize>> {
    let count = PARTS.min(nodes / LEAST_ROWS).max(1);
    (0..count).map(move |k| nodes * k / count..nodes * (k + 1) / count)
}

/// Cuts the rows into at most [`PARTS`] parts, fewer if they would add to many rows outside.
fn choose_parts(upper: &[u32], of_upper: Vec<u32>) -> (Vec<Part>, Vec<u32>) {
    let nodes = upper.len() - 1;
    let mut count = PARTS.min(nodes / LEAST_ROWS).max(1);
    loop {
        // The last part that each row was met in.
        let mut met = vec![ABSENT; nodes];
        let parts: Vec<Part> = (0..count)
            .map(|k| {
                let rows = nodes * k / count..nodes * (k + 1) / count;
                let stored = upper[rows.start] as usize..upper[rows.end] as usize;
                let mut outside = Vec::new();
                for &j in &of_upper[stored] {
                    let new = std::mem::replace(&mut met[j as usize], narrow(k)) != narrow(k);
                    if new && j as usize >= rows.end {
                        outside.push(j);
                    }
                }
                outside.sort_unstable();
                Part { rows, outside }
            })
            .collect();
        let outside: usize = parts.iter().map(|part| part.outside.len()).sum();
        if outside > nodes / 2 && count > FEW {
            count /= 2;
            continue;
        }
        let mut target = of_upper;
        target.shrink_to_fit();
        for part in &parts {
            let stored = upper[part.rows.start] as usize..upper[part.rows.end] as usize;
            for j in &mut target[stored] {
                *j = if (*j as usize) < part.rows.end {
                    *j - narrow(part.rows.start)
                } else {
                    let number = part.outside.partition_point(|i| i < j);
                    narrow(part.rows.len() + number)
                };
            }
        }
        return (parts, target);
    }
}
