//! Adds the matrices of cells to the rows of their nodes.

use std::ops::Range;

use crate::assembly::cells::Cells;
use crate::assembly::pattern::{Pattern, parts};
use crate::tasks;

/// One of so many nodes of the cells decides where the rows are cut for the threads.
const SAMPLE: usize = 16;

/// Adds the matrices of the cells in `range` to the values of K.
///
/// Each thread owns a range of nodes, and goes through the cells in their order: every row sums
/// in this order. `matrix` gives the blocks of a cell in the order (i, j, k, l).
pub(crate) fn add<'a, const D: usize>(
    pattern: &Pattern,
    cells: &Cells,
    range: Range<usize>,
    matrix: impl Fn(usize) -> &'a [f64] + Sync,
    values: &mut [f64],
) {
    let cuts = cuts(cells, range.clone(), rayon::current_num_threads());
    let bounds: Vec<usize> = cuts
        .iter()
        .map(|&node| D * D * pattern.start(node))
        .collect();
    tasks::for_each(parts(values, &bounds), |part, values| {
        let end = cuts.get(part + 1).copied().unwrap_or(pattern.nodes());
        let rows = cuts[part]..end;
        let mut order: Vec<usize> = Vec::with_capacity(cells.corners());
        for cell in range.clone() {
            let nodes = cells.of(cell);
            if !nodes.iter().any(|&node| rows.contains(&(node as usize))) {
                continue;
            }
            // Ascending nodes: one walk along the row finds them all.
            order.clear();
            order.extend(0..nodes.len());
            order.sort_by_key(|&j| nodes[j]);
            let own = matrix(cell);
            for (i, &node) in nodes.iter().enumerate() {
                let node = node as usize;
                let columns = pattern.row(node);
                if rows.contains(&node) && !columns.is_empty() {
                    let from = D * D * pattern.start(node) - bounds[part];
                    let row = &mut values[from..][..D * D * columns.len()];
                    let blocks = &own[i * nodes.len() * D * D..][..nodes.len() * D * D];
                    add_row::<D>(columns, nodes, &order, blocks, row);
                }
            }
        }
    });
}

fn add_row<const D: usize>(
    columns: &[u32],
    nodes: &[u32],
    order: &[usize],
    blocks: &[f64],
    row: &mut [f64],
) {
    let mut place = 0;
    for &j in order {
        while columns[place] < nodes[j] {
            place += 1;
        }
        let block = &blocks[j * D * D..][..D * D];
        for k in 0..D {
            let to = &mut row[(k * columns.len() + place) * D..][..D];
            for (sum, value) in to.iter_mut().zip(&block[k * D..][..D]) {
                *sum += value;
            }
        }
    }
}

/// First nodes of `count` parts to which the cells add about equally often; the first is 0.
fn cuts(cells: &Cells, range: Range<usize>, count: usize) -> Vec<usize> {
    let own = &cells.flat()[range.start * cells.corners()..range.end * cells.corners()];
    let mut sample: Vec<u32> = if count > 1 {
        own.iter().copied().step_by(SAMPLE).collect()
    } else {
        Vec::new()
    };
    sample.sort_unstable();
    let mut cuts = vec![0];
    cuts.extend((1..count).filter_map(|part| {
        let node = sample.get(part * sample.len() / count)?;
        Some(*node as usize)
    }));
    cuts
}
