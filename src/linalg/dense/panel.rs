//! Fronts: partial Cholesky factorisation of a panel, and its update.

use crate::linalg::dense::kernels::{
    faer_matmul, leave_wide, solve_lower_triangular_in_place, triangular_matmul,
};
use crate::linalg::dense::layout::part;
use crate::linalg::dense::product::TILE;
use crate::linalg::packed::{BLOCK, PIVOTS, Panel};
use crate::tasks;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::matmul::triangular::BlockStructure;
use faer::{Accum, MatMut, MatRef, Par, Spec};

/// Partial Cholesky of a front: its first rows, an upper triangle, become `U = Lᵀ`, by blocks
/// of rows.
///
/// Fronts are stored as upper triangles, so that products are `Uᵀ U` with both factors along
/// contiguous columns. With `L Lᵀ` one factor is packed across pages, at up to half the rate.
/// `check(k, pivot)` is called with each pivot in order, before its root is taken.
///
/// # Errors
/// The error of `check`, which must refuse pivots that are not positive.
pub(crate) fn factor_panel<E: Send>(
    panel: &mut [f64],
    layout: Panel,
    shared: bool,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    let Panel { np, nf } = layout;
    let mut square = vec![0.0; np.min(PIVOTS).pow(2)];
    let mut memory = MemBuffer::new(cholesky_in_place_scratch::<f64>(
        np.min(PIVOTS),
        Par::Seq,
        Spec::default(),
    ));
    for (rows, range) in layout.blocks() {
        let (above, rest) = panel.split_at_mut(range.start);
        let above = blocks_from(above, layout, rows.start);
        let b = rows.len();
        let (own, tail) = rest[..range.len()].split_at_mut(b * b);
        for u in &above {
            let u = u.subcols(0, b);
            triangular_matmul(
                MatMut::from_column_major_slice_mut(own, b, b),
                BlockStructure::TriangularUpper,
                Accum::Add,
                u.transpose(),
                BlockStructure::Rectangular,
                u,
                BlockStructure::Rectangular,
                -1.0,
                Par::Seq,
            );
        }
        let lower = &mut square[..b * b];
        factor_square(own, lower, b, &mut memory, &mut |k, pivot| {
            check(rows.start + k, pivot)
        })?;
        let lower = MatRef::from_column_major_slice(lower, b, b);
        let tile_width = if shared { part(nf) } else { TILE };
        let work = |tile: usize, columns: &mut [f64]| {
            let first = b + tile * tile_width;
            let width = columns.len() / b;
            let mut columns = MatMut::from_column_major_slice_mut(columns, b, width);
            for u in &above {
                let (left, right) = (u.subcols(0, b).transpose(), u.subcols(first, width));
                faer_matmul(columns.as_mut(), Accum::Add, left, right, -1.0, Par::Seq);
            }
            solve_lower_triangular_in_place(lower, columns, Par::Seq);
        };
        debug_assert_eq!(tail.len(), b * (nf - rows.end));
        if shared {
            tasks::for_each(tail.chunks_mut(b * tile_width), work);
        } else {
            for (tile, columns) in tail.chunks_mut(b * tile_width).enumerate() {
                work(tile, columns);
            }
        }
    }
    Ok(())
}

/// The blocks of a panel in `values`, each from column `from` on.
pub(super) fn blocks_from(values: &[f64], layout: Panel, from: usize) -> Vec<MatRef<'_, f64>> {
    let whole = layout
        .blocks()
        .take_while(|(_, range)| range.end <= values.len());
    whole
        .map(|(rows, range)| {
            let width = layout.nf - rows.start;
            MatRef::from_column_major_slice(&values[range], rows.len(), width)
                .subcols(from - rows.start, layout.nf - from)
        })
        .collect()
}

/// Factors a diagonal block, an upper triangle, in place. `lower` becomes its transpose, on
/// which faer's Cholesky uses wide registers.
fn factor_square<E>(
    own: &mut [f64],
    lower: &mut [f64],
    n: usize,
    memory: &mut MemBuffer,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    let copy = |own: &[f64], lower: &mut [f64]| {
        for i in 0..n {
            for j in 0..=i {
                lower[j * n + i] = own[i * n + j];
            }
        }
    };
    copy(own, lower);
    let factored = cholesky_in_place(
        MatMut::from_column_major_slice_mut(lower, n, n),
        LltRegularization::default(),
        Par::Seq,
        MemStack::new(memory),
        Spec::default(),
    );
    leave_wide();
    if factored.is_err() {
        // Factor again with a slow method, to find the pivot.
        copy(own, lower);
        pivots_one_by_one(lower, n, check)?;
        // The slow method had other rounding and found none: report the last pivot.
        return check(n - 1, 0.0);
    }
    for i in 0..n {
        check(i, lower[i * n + i] * lower[i * n + i])?;
        for j in 0..=i {
            own[i * n + j] = lower[j * n + i];
        }
    }
    Ok(())
}

/// Plain Cholesky of a lower triangle that stops at an error of `check`.
fn pivots_one_by_one<E>(
    a: &mut [f64],
    n: usize,
    check: &mut impl FnMut(usize, f64) -> Result<(), E>,
) -> Result<(), E> {
    for k in 0..n {
        check(k, a[k * n + k])?;
        let root = a[k * n + k].sqrt();
        for i in k..n {
            a[k * n + i] /= root;
        }
        for j in k + 1..n {
            for i in j..n {
                a[j * n + i] -= a[k * n + i] * a[k * n + j];
            }
        }
    }
    Ok(())
}

/// The update `−U₁₂ᵀ U₁₂` of a factored panel; the contents of `update` are not read.
pub(crate) fn rank_update(panel: &[f64], layout: Panel, update: &mut [f64], shared: bool) {
    let Panel { np, nf } = layout;
    let nu = nf - np;
    let panel = blocks_from(panel, layout, np);
    let narrow = if shared { part(nf) } else { BLOCK };
    let mut strips = Vec::with_capacity(nu.div_ceil(narrow));
    let mut rest = update;
    for first in (0..nu).step_by(BLOCK) {
        let end = nu.min(first + BLOCK);
        let (block, next) = rest.split_at_mut((end - first) * end);
        rest = next;
        // Columns of a block are as long as its last one.
        for (k, strip) in block.chunks_mut(narrow * end).enumerate() {
            strips.push((first + k * narrow, end, strip));
        }
    }
    let work = |_: usize, (j, rows, strip): (usize, usize, &mut [f64])| {
        let width = strip.len() / rows;
        let strip = MatMut::from_column_major_slice_mut(strip, rows, width);
        let mut block = strip.split_at_row_mut(j + width).0;
        // A tile stays in the cache for all blocks of the panel.
        for i in (0..j).step_by(TILE) {
            let height = TILE.min(j - i);
            let mut add = Accum::Replace;
            for u in &panel {
                let tile = block.as_mut().subrows_mut(i, height);
                let (left, right) = (u.subcols(i, height).transpose(), u.subcols(j, width));
                faer_matmul(tile, add, left, right, -1.0, Par::Seq);
                add = Accum::Add;
            }
        }
        let mut add = Accum::Replace;
        for u in &panel {
            let u = u.subcols(j, width);
            triangular_matmul(
                block.as_mut().subrows_mut(j, width),
                BlockStructure::TriangularUpper,
                add,
                u.transpose(),
                BlockStructure::Rectangular,
                u,
                BlockStructure::Rectangular,
                -1.0,
                Par::Seq,
            );
            add = Accum::Add;
        }
    };
    if shared {
        tasks::for_each(strips.into_iter().rev(), work);
    } else {
        for strip in strips {
            work(0, strip);
        }
    }
}
