//! Storage of update matrices, and adding one into another.
//!
//! Only the upper triangle of an update exists. It is kept by blocks of
//! columns, each a rectangle from row 0 to the last row of its diagonal block:
//! half the memory of a square, and every block is a plain column-major matrix.

use crate::linalg::symbolic::Run;

/// Columns in a block.
pub(crate) const BLOCK: usize = 256;

/// Layout of an upper triangle of order `n`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Packed {
    pub(crate) n: usize,
}

impl Packed {
    pub(crate) fn new(n: usize) -> Self {
        Self { n }
    }

    /// Numbers stored.
    pub(crate) fn len(self) -> usize {
        let whole = self.n / BLOCK;
        BLOCK * BLOCK * whole * (whole + 1) / 2 + (self.n - whole * BLOCK) * self.n
    }

    /// Where column `j` starts; its rows `0..=j` follow.
    pub(crate) fn column(self, j: usize) -> usize {
        let block = j / BLOCK;
        let rows = self.n.min((block + 1) * BLOCK);
        BLOCK * BLOCK * block * (block + 1) / 2 + (j - block * BLOCK) * rows
    }
}

/// Rows `from..from + len` of a child are rows `to..to + len` of its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    from: usize,
    to: usize,
    len: usize,
}

/// How the rows of an update lie in the front that takes it; `first` and `np`
/// are that front's pivots, `parent` the rows after them.
pub(crate) fn segments(child: &[Run], first: usize, np: usize, parent: &[Run]) -> Vec<Segment> {
    let mut list = Vec::with_capacity(child.len() + 4);
    let mut from = 0;
    // The stretch of the parent that is looked at: start, end, place in front.
    let mut stretch = (first, first + np, 0);
    let mut next = parent.iter();
    for run in child {
        let (mut start, end) = (run.start as usize, (run.start + run.len) as usize);
        while start < end {
            while stretch.1 <= start {
                let Some(run) = next.next() else {
                    unreachable!("a parent has every row of its children")
                };
                let place = stretch.2 + stretch.1 - stretch.0;
                stretch = (run.start as usize, (run.start + run.len) as usize, place);
            }
            let len = end.min(stretch.1) - start;
            list.push(Segment {
                from,
                to: stretch.2 + start - stretch.0,
                len,
            });
            from += len;
            start += len;
        }
    }
    list
}

fn add(target: &mut [f64], source: &[f64]) {
    for (t, s) in target.iter_mut().zip(source) {
        *t += s;
    }
}

/// Adds to the panel (`np` rows, column-major) what a child updates there.
pub(crate) fn add_to_panel(panel: &mut [f64], np: usize, child: &[f64], map: &[Segment]) {
    let layout = Packed::new(map.last().map_or(0, |s| s.from + s.len));
    let in_panel = map.partition_point(|s| s.to < np);
    for column in map {
        for k in 0..column.len {
            let (j, to) = (column.from + k, column.to + k);
            let source = &child[layout.column(j)..][..=j];
            let target = &mut panel[to * np..][..np];
            for row in &map[..in_panel] {
                if row.from > j {
                    break;
                }
                let len = row.len.min(j + 1 - row.from);
                add(&mut target[row.to..][..len], &source[row.from..][..len]);
            }
        }
    }
}

/// Adds to an update what a child contributes beyond the pivots; `start(j)` is
/// where column `j` of the update begins.
pub(crate) fn add_to_update(
    update: &mut [f64],
    start: impl Fn(usize) -> usize,
    np: usize,
    child: &[f64],
    map: &[Segment],
) {
    let layout = Packed::new(map.last().map_or(0, |s| s.from + s.len));
    let in_panel = map.partition_point(|s| s.to < np);
    let rows = &map[in_panel..];
    for column in rows {
        for k in 0..column.len {
            let (j, to) = (column.from + k, column.to + k - np);
            let source = &child[layout.column(j)..][..=j];
            let target = &mut update[start(to)..][..=to];
            for row in rows {
                if row.from > j {
                    break;
                }
                let len = row.len.min(j + 1 - row.from);
                add(
                    &mut target[row.to - np..][..len],
                    &source[row.from..][..len],
                );
            }
        }
    }
}
