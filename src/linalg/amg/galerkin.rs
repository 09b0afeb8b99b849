//! The matrix of the next level, `Pᵀ A P`, in two products.

use std::sync::Arc;

use crate::linalg::amg::aggregates::by_group;
use crate::linalg::amg::block_matrix::{BlockMatrix, PADDING, ROWS, cut};
use crate::linalg::amg::prolongation::Prolongation;
use crate::linalg::amg::single_rows::LevelMatrix;
use crate::linalg::amg::slots::Slots;
use crate::linalg::amg::wide::{WideWork, widest};
use crate::linalg::pages::zeros;
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;
use crate::tasks;

/// Calls a kernel with the sizes of the blocks of `P` and the lanes of their rows.
macro_rules! with_sizes {
    ($p:expr, $kernel:ident, $fields:expr) => {
        match ($p.b, $p.m) {
            (2, 3) => widest($kernel::<2, 3, 4>($fields)),
            (3, 3) => widest($kernel::<3, 3, 4>($fields)),
            (3, 6) => widest($kernel::<3, 6, 8>($fields)),
            (6, 6) => widest($kernel::<6, 6, 8>($fields)),
            _ => unreachable!("3 rigid motions in the plane, 6 in space"),
        }
    };
}
pub(super) use with_sizes;

/// `Pᵀ A P`, exactly symmetric.
pub(super) fn galerkin(matrix: LevelMatrix<'_>, p: &Prolongation) -> BlockMatrix {
    let upper = upper_triangle(matrix, p, None, None);
    whole(&upper, p.m, matrix.exponent())
}

/// Computes the blocks of `coarse = Pᵀ A P` between `changed` coarse nodes anew, to the bits of
/// [`galerkin`].
pub(super) fn update(
    coarse: &mut BlockMatrix,
    matrix: LevelMatrix<'_>,
    p: &Prolongation,
    changed: &[bool],
) {
    let (m, size) = (p.m, p.m * p.m);
    let mut needed = vec![false; matrix.nodes()];
    for g in (0..changed.len()).filter(|&g| changed[g]) {
        for &[i, _] in p.coarse_row(g) {
            needed[i as usize] = true;
        }
    }
    let upper = upper_triangle(matrix, p, Some(changed), Some(&needed));
    let mut blocks = upper.column.iter().zip(upper.values.chunks_exact(size));
    for (g, &count) in upper.counts.iter().enumerate() {
        for (&h, block) in blocks.by_ref().take(count as usize) {
            let h = h as usize;
            let own = coarse.place(g, h) * size;
            let mirror = coarse.place(h, g) * size;
            if g == h {
                write_symmetric(&mut coarse.values[own..own + size], block, m);
                continue;
            }
            coarse.values[own..own + size].copy_from_slice(block);
            for c in 0..m {
                for l in 0..m {
                    coarse.values[mirror + c * m + l] = block[l * m + c];
                }
            }
        }
    }
}

/// Writes a diagonal block by its upper triangle.
fn write_symmetric(to: &mut [f32], from: &[f32], m: usize) {
    for c in 0..m {
        for l in 0..m {
            to[c * m + l] = from[if l < c { c * m + l } else { l * m + c }];
        }
    }
}

/// Some rows of `A P`, blocks `b × m` by rows.
#[derive(Default)]
struct Product {
    /// Start of each row in `column`.
    start: Vec<u32>,
    column: Vec<u32>,
    values: Vec<f32>,
}

struct ProductRows<'a> {
    matrix: LevelMatrix<'a>,
    p: &'a Prolongation,
    needed: Option<&'a [bool]>,
    task: usize,
    slots: &'a mut Slots,
    product: &'a mut Product,
}

struct SizedProductRows<'a, const B: usize, const M: usize, const L: usize>(ProductRows<'a>);

impl<const B: usize, const M: usize, const L: usize> WideWork for SizedProductRows<'_, B, M, L> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let ProductRows {
            matrix,
            p,
            needed,
            task,
            slots,
            product,
        } = self.0;
        let mut sums: Vec<[[f32; L]; B]> = Vec::new();
        let rows = task * ROWS..matrix.nodes().min((task + 1) * ROWS);
        let (loaded, first) = matrix.load(rows.clone());
        for i in rows {
            product.start.push(narrow(product.column.len()));
            if needed.is_some_and(|needed| !needed[i]) {
                continue;
            }
            sums.clear();
            let skipped = first + matrix.skipped(i);
            for (at, &j) in matrix.row(i).zip(matrix.columns(i)) {
                let a = &loaded[(at - skipped) * B * B..][..B * B];
                for q in p.row(j as usize) {
                    let (slot, new) = slots.slot(p.column[q]);
                    if new {
                        sums.push([[0.0; L]; B]);
                    }
                    let block = &p.values[q * B * M..][..B * M + L - M];
                    // A local copy stays in registers.
                    let mut sum = sums[slot];
                    for c in 0..B {
                        let mut row = [0.0; L];
                        row.copy_from_slice(&block[c * M..c * M + L]);
                        for l in 0..B {
                            for e in 0..L {
                                sum[l][e] = row[e].times_plus::<FMA>(a[c * B + l], sum[l][e]);
                            }
                        }
                    }
                    sums[slot] = sum;
                }
            }
            product.column.extend_from_slice(&slots.columns);
            for row in sums.iter().flatten() {
                product.values.extend_from_slice(&row[..M]);
            }
            slots.clear();
        }
        product.start.push(narrow(product.column.len()));
    }
}

/// The blocks of a symmetric matrix on and above its diagonal, columns ascending.
#[derive(Default)]
struct Upper {
    counts: Vec<u32>,
    column: Vec<u32>,
    /// Each block by columns.
    values: Vec<f32>,
}

/// Coarse rows in one task: each reads the blocks of a hundred fine rows.
const COARSE_ROWS: usize = 16;

/// Coarse rows whose products are held at a time. Rows of `A P` are made when the first of them
/// reads one, and dropped after the last.
const WINDOW: usize = 64 * COARSE_ROWS;

/// The rows and columns of `changed` coarse nodes, or all; `needed` are the fine nodes that these
/// read.
fn upper_triangle(
    matrix: LevelMatrix<'_>,
    p: &Prolongation,
    changed: Option<&[bool]>,
    needed: Option<&[bool]>,
) -> Upper {
    let nodes = p.coarse_nodes();
    let wanted = |g: usize| changed.is_none_or(|changed| changed[g]);
    let read = |g: usize| p.coarse_row(g).iter().map(|&[i, _]| i as usize / ROWS);
    let mut last = vec![0; matrix.nodes().div_ceil(ROWS)];
    for g in (0..nodes).filter(|&g| wanted(g)) {
        read(g).for_each(|task| last[task] = g);
    }
    let mut products: Vec<Option<Product>> = last.iter().map(|_| None).collect();
    let mut whole = Upper::default();
    for first in (0..nodes).step_by(WINDOW) {
        let end = nodes.min(first + WINDOW);
        for task in (first..end).filter(|&g| wanted(g)).flat_map(read) {
            let _ = products[task].get_or_insert_default();
        }
        let new = products
            .iter_mut()
            .enumerate()
            .filter_map(|(task, product)| {
                let product = product
                    .as_mut()
                    .filter(|product| product.start.is_empty())?;
                Some((task, product))
            });
        tasks::for_each_with(
            new,
            || Slots::new(nodes),
            |slots, _, (task, product)| {
                let rows = ProductRows {
                    matrix,
                    p,
                    needed,
                    task,
                    slots,
                    product,
                };
                with_sizes!(p, SizedProductRows, rows);
            },
        );
        let starts = (first..end).step_by(COARSE_ROWS);
        let mut parts: Vec<(usize, Upper)> = starts.map(|g| (g, Upper::default())).collect();
        tasks::for_each_with(
            &mut parts,
            || Slots::new(nodes),
            |slots, _, (first, upper)| {
                let rows = CoarseRows {
                    p,
                    products: &products,
                    changed,
                    rows: *first..end.min(*first + COARSE_ROWS),
                    slots,
                    upper,
                };
                with_sizes!(p, SizedCoarseRows, rows);
            },
        );
        for (_, part) in parts {
            whole.counts.extend(part.counts);
            whole.column.extend(part.column);
            whole.values.extend(part.values);
        }
        for (product, _) in products
            .iter_mut()
            .zip(&last)
            .filter(|(_, last)| **last < end)
        {
            *product = None;
        }
    }
    whole
}

struct CoarseRows<'a> {
    p: &'a Prolongation,
    /// Of the tasks of [`ROWS`] rows that are read.
    products: &'a [Option<Product>],
    changed: Option<&'a [bool]>,
    rows: std::ops::Range<usize>,
    slots: &'a mut Slots,
    upper: &'a mut Upper,
}

struct SizedCoarseRows<'a, const B: usize, const M: usize, const L: usize>(CoarseRows<'a>);

impl<const B: usize, const M: usize, const L: usize> WideWork for SizedCoarseRows<'_, B, M, L> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let CoarseRows {
            p,
            products,
            changed,
            rows,
            slots,
            upper,
        } = self.0;
        let skipped = |g: usize| changed.is_some_and(|changed| !changed[g]);
        let mut sums: Vec<[[f32; L]; M]> = Vec::new();
        let mut order = Vec::new();
        for g in rows {
            if skipped(g) {
                upper.counts.push(0);
                continue;
            }
            sums.clear();
            for &[i, q] in p.coarse_row(g) {
                let left = &p.values[q as usize * B * M..][..B * M + L - M];
                let (task, k) = (i as usize / ROWS, i as usize % ROWS);
                let Some(product) = &products[task] else {
                    continue;
                };
                for at in product.start[k] as usize..product.start[k + 1] as usize {
                    let h = product.column[at];
                    if (h as usize) < g || skipped(h as usize) {
                        continue;
                    }
                    let (slot, new) = slots.slot(h);
                    if new {
                        sums.push([[0.0; L]; M]);
                    }
                    let right = &product.values[at * B * M..][..B * M];
                    let sum = &mut sums[slot];
                    for c in 0..M {
                        let mut column = sum[c];
                        for k in 0..B {
                            for l in 0..L {
                                column[l] =
                                    left[k * M + l].times_plus::<FMA>(right[k * M + c], column[l]);
                            }
                        }
                        sum[c] = column;
                    }
                }
            }
            order.clear();
            order.extend(slots.columns.iter().copied().zip(0..));
            order.sort_unstable();
            upper.counts.push(narrow(order.len()));
            for &(h, slot) in &order {
                let slot: usize = slot;
                upper.column.push(h);
                for column in &sums[slot] {
                    upper.values.extend_from_slice(&column[..M]);
                }
            }
            slots.clear();
        }
    }
}

/// The whole matrix, with the lower blocks as mirror images of the upper ones.
fn whole(upper: &Upper, m: usize, exponent: i32) -> BlockMatrix {
    let (nodes, size) = (upper.counts.len(), m * m);
    let mut upper_start = vec![0_u32; nodes + 1];
    for (g, count) in upper.counts.iter().enumerate() {
        upper_start[g + 1] = upper_start[g] + count;
    }
    // Blocks of each column, in the order of their rows; the last one is that of the diagonal.
    let (lower_start, lower) = by_group(&upper.column, nodes);
    let row_of: Vec<u32> = (0..nodes)
        .flat_map(|g| std::iter::repeat_n(narrow(g), upper.counts[g] as usize))
        .collect();
    let start: Vec<u32> = (0..=nodes)
        .map(|g| upper_start[g] + lower_start[g] - narrow(g))
        .collect();
    let blocks = start[nodes] as usize;
    let mut column = zeros(blocks);
    let mut values = zeros(blocks * size + PADDING);
    let columns = cut(&mut column, nodes, |g| start[g] as usize);
    let parts = cut(&mut values, nodes, |g| start[g] as usize * size);
    tasks::for_each(columns.into_iter().zip(parts), |task, (columns, values)| {
        let mut columns = columns.iter_mut();
        let mut blocks = values.chunks_exact_mut(size);
        let mut next = || Some((columns.next()?, blocks.next()?));
        for g in task * ROWS..nodes.min((task + 1) * ROWS) {
            // The mirror image of the diagonal block is the block itself.
            for &at in &lower[lower_start[g] as usize..lower_start[g + 1] as usize] {
                let Some((column, block)) = next() else {
                    return;
                };
                let from = &upper.values[at as usize * size..][..size];
                *column = row_of[at as usize];
                if *column as usize == g {
                    write_symmetric(block, from, m);
                    continue;
                }
                for c in 0..m {
                    for l in 0..m {
                        block[c * m + l] = from[l * m + c];
                    }
                }
            }
            for at in upper_start[g] as usize + 1..upper_start[g + 1] as usize {
                let Some((column, block)) = next() else {
                    return;
                };
                *column = upper.column[at];
                block.copy_from_slice(&upper.values[at * size..][..size]);
            }
        }
    });
    BlockMatrix {
        b: m,
        start: Arc::new(start),
        column: Arc::new(column),
        values,
        missing: Vec::new(),
        held: vec![false; nodes * m],
        exponent,
    }
}
