//! Storage of fronts, and the addition of one update to another.
//!
//! Only the upper triangle of a front is stored. The rows of its pivots, the *panel*, are
//! stored by blocks of rows and become the factor; the rest, the *update*, is stored by blocks
//! of columns. Each block is a column-major matrix. Below the diagonal only the diagonal blocks
//! have entries.

use std::ops::Range;

/// Consecutive rows of a front, in elimination numbering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub(crate) start: u32,
    pub(crate) len: u32,
}

/// Rows in a block of a panel: this many pivots are factored together.
pub(crate) const PIVOTS: usize = 128;

/// Columns in a block of an update.
pub(crate) const BLOCK: usize = 256;

/// Layout of the first `np` rows of an upper triangle of order `nf`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Panel {
    pub(crate) np: usize,
    pub(crate) nf: usize,
}

impl Panel {
    pub(crate) fn new(np: usize, nf: usize) -> Self {
        Self { np, nf }
    }

    /// Numbers stored.
    pub(crate) fn len(self) -> usize {
        self.blocks().last().map_or(0, |(_, range)| range.end)
    }

    /// Rows of each block, and its position; its columns begin with the first of its rows.
    pub(crate) fn blocks(self) -> impl DoubleEndedIterator<Item = (Range<usize>, Range<usize>)> {
        (0..self.np.div_ceil(PIVOTS)).map(move |block| {
            let first = block * PIVOTS;
            let rows = first..self.np.min(first + PIVOTS);
            let start = self.start(block);
            (rows.clone(), start..start + rows.len() * (self.nf - first))
        })
    }

    fn start(self, block: usize) -> usize {
        PIVOTS * block * self.nf - PIVOTS * PIVOTS * (block * block.saturating_sub(1) / 2)
    }

    /// Position of entry `(row, column)`; the rows below it, to the end of the block, follow.
    pub(crate) fn at(self, row: usize, column: usize) -> usize {
        let block = row / PIVOTS;
        let first = block * PIVOTS;
        let height = PIVOTS.min(self.np - first);
        self.start(block) + (column - first) * height + row - first
    }
}

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

    /// Position of column `j`; its rows `0..=j` follow.
    pub(crate) fn column(self, j: usize) -> usize {
        let block = j / BLOCK;
        let rows = self.n.min((block + 1) * BLOCK);
        BLOCK * BLOCK * block * (block + 1) / 2 + (j - block * BLOCK) * rows
    }
}

/// Rows `from..from + len` of a child are rows `to..to + len` of its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) len: usize,
}

/// Positions of the rows of an update in the front that takes it; `first` and `np` are the
/// pivots of that front, `parent` the rows after them.
pub(crate) fn segments(child: &[Run], first: usize, np: usize, parent: &[Run]) -> Vec<Segment> {
    let mut list = Vec::with_capacity(child.len() + 4);
    let mut from = 0;
    // The current range of the parent: start, end, position in the front.
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

/// Adds the update of a child to a panel.
pub(crate) fn add_to_panel(panel: &mut [f64], layout: Panel, child: &[f64], map: &[Segment]) {
    let source_layout = Packed::new(map.last().map_or(0, |s| s.from + s.len));
    let in_panel = map.partition_point(|s| s.to < layout.np);
    for column in map {
        for k in 0..column.len {
            let (j, to) = (column.from + k, column.to + k);
            let source = &child[source_layout.column(j)..][..=j];
            for row in &map[..in_panel] {
                if row.from > j {
                    break;
                }
                let (mut from, mut at) = (row.from, row.to);
                let end = from + row.len.min(j + 1 - from);
                while from < end {
                    let len = (end - from).min(PIVOTS - at % PIVOTS);
                    add(
                        &mut panel[layout.at(at, to)..][..len],
                        &source[from..][..len],
                    );
                    from += len;
                    at += len;
                }
            }
        }
    }
}

/// Adds the update of a child beyond the pivots to an update; column `j` of the latter begins
/// at `start(j)`.
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
