//! The nodes that share a cell with each node: the sparsity pattern of K in blocks.

use crate::assembly::cells::Cells;
use crate::linalg::pages::zeros;
use crate::linalg::sparse::csc::Index;
use crate::tasks;

/// Rows shorter than this are not worth a task of their own.
const LEAST_ROWS: usize = 1024;

/// Some rows of K: their nodes, ascending, and the numbers of all nodes among the columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    pub rows: Vec<usize>,
    pub numbers: Vec<usize>,
}

/// For each node the nodes that share a cell with it, ascending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    start: Vec<usize>,
    column: Vec<u32>,
    part: Option<Part>,
}

impl Pattern {
    /// The pattern of a mesh; other rows than those of a `part` are empty.
    pub fn new(cells: &Cells, part: Option<Part>) -> Self {
        let around = Around::new(cells);
        let nodes = cells.nodes();
        let mut wanted = vec![part.is_none(); nodes];
        for &row in part.iter().flat_map(|part| &part.rows) {
            wanted[row] = true;
        }
        let rows = chunk_of_rows(nodes);
        let mut start = vec![0; nodes + 1];
        tasks::for_each(start[1..].chunks_mut(rows), |chunk, lengths| {
            let mut seen = Seen::new(nodes);
            let rows = (chunk * rows..).zip(lengths);
            for (row, length) in rows.filter(|(row, _)| wanted[*row]) {
                seen.visit(cells, &around, row, |_| *length += 1);
            }
        });
        for row in 0..nodes {
            start[row + 1] += start[row];
        }
        let mut column = zeros(start[nodes]);
        let bounds: Vec<usize> = start.iter().copied().step_by(rows).collect();
        tasks::for_each(parts(&mut column, &bounds), |chunk, mut rest| {
            let mut seen = Seen::new(nodes);
            let rows = chunk * rows..nodes.min((chunk + 1) * rows);
            for row in rows.filter(|row| wanted[*row]) {
                let (own, later) =
                    std::mem::take(&mut rest).split_at_mut(start[row + 1] - start[row]);
                let mut next = 0;
                seen.visit(cells, &around, row, |node| {
                    own[next] = node;
                    next += 1;
                });
                own.sort_unstable();
                rest = later;
            }
        });
        Self {
            start,
            column,
            part,
        }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.start.len() - 1
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.column.len()
    }

    /// Number of blocks in the rows before that of `node`.
    pub fn start(&self, node: usize) -> usize {
        self.start[node]
    }

    /// The nodes that share a cell with `node`, ascending.
    pub fn row(&self, node: usize) -> &[u32] {
        &self.column[self.start[node]..self.start[node + 1]]
    }

    /// Number of nodes among the columns.
    pub fn columns(&self) -> usize {
        let last = self
            .part
            .as_ref()
            .and_then(|part| part.numbers.iter().max());
        last.map_or(self.nodes(), |last| last + 1)
    }

    /// Row pointers and columns of the degrees of freedom, `D` for each node.
    pub fn csr<const D: usize, I: Index>(&self) -> (Vec<I>, Vec<I>) {
        let part = self.part.as_ref();
        let nodes = part.map_or(self.nodes(), |part| part.rows.len());
        let node_of = |row: usize| part.map_or(row, |part| part.rows[row]);
        let number = |node: u32| part.map_or(node as usize, |part| part.numbers[node as usize]);
        let rows = chunk_of_rows(nodes);
        let mut pointer = vec![I::default(); D * nodes + 1];
        tasks::for_each_together(pointer[1..].chunks_mut(D), LEAST_ROWS, |row, ends| {
            let node = node_of(row);
            let length = D * (self.start[node + 1] - self.start[node]);
            for (k, end) in ends.iter_mut().enumerate() {
                *end = I::of(D * D * self.start[node] + (k + 1) * length);
            }
        });
        let mut index: Vec<I> = zeros(D * D * self.blocks());
        let bounds: Vec<usize> = (0..nodes)
            .step_by(rows)
            .map(|row| D * D * self.start[node_of(row)])
            .collect();
        tasks::for_each(parts(&mut index, &bounds), |chunk, part| {
            let mut entries = part.iter_mut();
            for row in chunk * rows..nodes.min((chunk + 1) * rows) {
                for _ in 0..D {
                    for column in self.row(node_of(row)).iter().map(|&node| number(node)) {
                        for (m, entry) in entries.by_ref().take(D).enumerate() {
                            *entry = I::of(D * column + m);
                        }
                    }
                }
            }
        });
        (pointer, index)
    }
}

fn chunk_of_rows(nodes: usize) -> usize {
    nodes
        .div_ceil(4 * rayon::current_num_threads())
        .max(LEAST_ROWS)
}

/// Cuts at the ascending `bounds`, the first of which is the start of `whole`; the last part
/// ends where `whole` does.
pub(crate) fn parts<'a, T>(mut whole: &'a mut [T], bounds: &[usize]) -> Vec<&'a mut [T]> {
    let mut found = Vec::with_capacity(bounds.len());
    for pair in bounds.windows(2) {
        let (own, later) = whole.split_at_mut(pair[1] - pair[0]);
        found.push(own);
        whole = later;
    }
    if !bounds.is_empty() {
        found.push(whole);
    }
    found
}

/// The cells around each node, ascending, by a counting sort.
struct Around {
    start: Vec<usize>,
    cell: Vec<u32>,
}

impl Around {
    fn new(cells: &Cells) -> Self {
        let mut start = vec![0; cells.nodes() + 1];
        for &node in cells.flat() {
            start[node as usize + 1] += 1;
        }
        for node in 0..cells.nodes() {
            start[node + 1] += start[node];
        }
        let mut next = start.clone();
        let mut cell = vec![0; cells.flat().len()];
        for (number, own) in (0..).zip(cells.flat().chunks_exact(cells.corners().max(1))) {
            for &node in own {
                let place = &mut next[node as usize];
                cell[*place] = number;
                *place += 1;
            }
        }
        Self { start, cell }
    }

    fn of(&self, node: usize) -> &[u32] {
        &self.cell[self.start[node]..self.start[node + 1]]
    }
}

/// Marks the nodes that a row has. Zeros of a fresh vector take no memory before they are
/// changed, so that each task may have its own.
struct Seen {
    row: Vec<u32>,
}

impl Seen {
    fn new(nodes: usize) -> Self {
        Self {
            row: vec![0; nodes],
        }
    }

    /// Calls `found` once for each node that shares a cell with `node`.
    fn visit(&mut self, cells: &Cells, around: &Around, node: usize, mut found: impl FnMut(u32)) {
        let mark = u32::try_from(node + 1).unwrap_or(u32::MAX);
        for &cell in around.of(node) {
            for &other in cells.of(cell as usize) {
                if std::mem::replace(&mut self.row[other as usize], mark) != mark {
                    found(other);
                }
            }
        }
    }
}
