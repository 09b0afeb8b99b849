//! Fronts and their rows, and the position of each entry of K.

use std::ops::Range;

use crate::linalg::packed::{Panel, Run};
use crate::linalg::sparse::csc::{Symmetric, narrow};
use crate::linalg::sparse::supervariables::SupervariableGraph;
use crate::linalg::sparse::symbolic::Front;
use crate::linalg::sparse::symbolic::pattern::SymbolicPattern;
use crate::linalg::sparse::tree::Tree;
use crate::tasks;

/// Fronts, rows and numbering, while they are made.
pub(super) struct Layout<'a> {
    pub(super) nodes: &'a SupervariableGraph,
    /// Nodes in the elimination order, kept ones last.
    pub(super) order: Vec<u32>,
    /// Place of each node in this order.
    pub(super) place: Vec<u32>,
    /// First unknown of each place, and the end.
    pub(super) offset: Vec<u32>,
    pub(super) old: Vec<u32>,
    pub(super) new: Vec<u32>,
    pub(super) fronts: Vec<Front>,
    /// Places (in `order`) of the pivots of each front.
    pub(super) pivots: Vec<Range<usize>>,
    /// Fronts whose updates go to each front.
    pub(super) children: Vec<Vec<usize>>,
    /// Updated rows of each front as places, and the start of each in the front.
    pub(super) rows: Vec<Vec<u32>>,
    pub(super) runs: Vec<Run>,
    pub(super) panels: usize,
}

impl<'a> Layout<'a> {
    pub(super) fn new(nodes: &'a SupervariableGraph, tree: &Tree, node_order: &[u32]) -> Self {
        let mut order: Vec<u32> = Vec::with_capacity(nodes.len());
        let mut fronts: Vec<Front> = Vec::with_capacity(tree.fronts.len());
        let mut pivots = Vec::with_capacity(tree.fronts.len());
        let mut children = vec![Vec::new(); tree.fronts.len()];
        let (mut first, mut panels) = (0, 0);
        for (f, front) in tree.fronts.iter().enumerate() {
            let from = order.len();
            order.extend(front.nodes.iter().map(|&v| node_order[v as usize]));
            pivots.push(from..order.len());
            let base = children[f].iter().map(|&child: &usize| fronts[child].base);
            fronts.push(Front {
                first,
                base: base.fold(first, usize::min),
                np: front.np,
                nu: front.nf - front.np,
                parent: front.parent,
                panel: panels,
                runs: 0..0,
                entries: 0..0,
            });
            if let Some(parent) = front.parent {
                children[parent].push(f);
            }
            first += front.np;
            panels += Panel::new(front.np, front.nf).len();
        }
        order.extend(nodes.kept());
        let n = nodes.unknowns();
        let mut place = vec![0; order.len()];
        let mut offset = Vec::with_capacity(order.len() + 1);
        let mut old = Vec::with_capacity(n);
        let mut new = vec![0; n];
        for (at, &v) in (0_u32..).zip(&order) {
            place[v as usize] = at;
            offset.push(narrow(old.len()));
            for &dof in nodes.members(v as usize) {
                new[dof as usize] = narrow(old.len());
                old.push(dof);
            }
        }
        offset.push(narrow(old.len()));
        Self {
            nodes,
            order,
            place,
            offset,
            old,
            new,
            fronts,
            pivots,
            children,
            rows: Vec::new(),
            runs: Vec::new(),
            panels,
        }
    }

    /// Updated rows of each front: the later neighbours of its pivots, and the updated rows of
    /// its children without its own pivots.
    pub(super) fn place_rows(&mut self) {
        let mut seen = vec![u32::MAX; self.order.len()];
        for f in 0..self.fronts.len() {
            let stamp = narrow(f);
            let pivots = self.pivots[f].clone();
            let mut rows: Vec<u32> = Vec::new();
            let mut add = |q: u32| {
                if q as usize >= pivots.end && seen[q as usize] != stamp {
                    seen[q as usize] = stamp;
                    rows.push(q);
                }
            };
            for &v in &self.order[pivots.clone()] {
                for &w in self.nodes.neighbours(v as usize) {
                    add(self.place[w as usize]);
                }
            }
            for &child in &self.children[f] {
                self.rows[child].iter().for_each(|&q| add(q));
            }
            rows.sort_unstable();
            let from = self.runs.len();
            let mut nu = 0;
            for &q in &rows {
                let (start, end) = (self.offset[q as usize], self.offset[q as usize + 1]);
                nu += (end - start) as usize;
                match self.runs[from..].last_mut() {
                    Some(run) if run.start + run.len == start => run.len += end - start,
                    _ => self.runs.push(Run {
                        start,
                        len: end - start,
                    }),
                }
            }
            debug_assert_eq!(nu, self.fronts[f].nu, "the counts foretold another front");
            self.fronts[f].runs = from..self.runs.len();
            self.rows.push(rows);
        }
    }

    /// Position of each entry of K, by fronts. Each pair uses the entry of the lower triangle
    /// of K, for either order of its unknowns.
    pub(super) fn place_entries(
        &mut self,
        k: &Symmetric,
        pattern: &SymbolicPattern,
    ) -> Vec<(u32, u32)> {
        let count = |p: usize| {
            if pattern.partner.is_some() {
                let j = self.old[p] as usize;
                let rows = &pattern.row_idx[pattern.col_ptr[j]..pattern.col_ptr[j + 1]];
                rows.iter().filter(|&&i| self.new[i] as usize >= p).count()
            } else {
                self.later(k, pattern, p).count()
            }
        };
        let pivots = |front: &Front| front.first..front.first + front.np;
        let counts = tasks::collect(self.fronts.len(), |f| {
            pivots(&self.fronts[f]).map(count).sum::<usize>()
        });
        let mut entries = vec![(0, 0); counts.iter().sum()];
        let mut rest = entries.as_mut_slice();
        let mut parts = Vec::with_capacity(counts.len());
        let mut from = 0;
        for (front, count) in self.fronts.iter_mut().zip(counts) {
            let (part, next) = std::mem::take(&mut rest).split_at_mut(count);
            parts.push(part);
            rest = next;
            front.entries = from..from + count;
            from += count;
        }
        let scratch = || vec![0_u32; self.order.len()];
        tasks::for_each_with(parts, scratch, |shift, f, part| {
            self.place_entries_of(f, k, pattern, shift, part);
        });
        entries
    }

    /// Entries of K in the row of pivot `p` of its front: places of unknowns, and positions in
    /// the values of K.
    fn later<'p>(
        &'p self,
        k: &'p Symmetric,
        pattern: &'p SymbolicPattern,
        p: usize,
    ) -> impl Iterator<Item = (usize, usize)> + 'p {
        let j = self.old[p] as usize;
        (pattern.col_ptr[j]..pattern.col_ptr[j + 1]).filter_map(move |at| {
            let i = pattern.row_idx[at];
            if (self.new[i] as usize) < p {
                return None;
            }
            let value = match &pattern.partner {
                Some(_) if i >= j => Some(at),
                Some(partner) => Some(partner[at] as usize),
                None => k.position(i.max(j), i.min(j)),
            };
            value.map(|value| (i, value))
        })
    }

    /// `shift` becomes the column of this front at which a place starts, minus `offset`.
    fn place_entries_of(
        &self,
        f: usize,
        k: &Symmetric,
        pattern: &SymbolicPattern,
        shift: &mut [u32],
        entries: &mut [(u32, u32)],
    ) {
        let pivots = self.pivots[f].clone();
        let front = &self.fronts[f];
        let layout = front.layout();
        let mut column = 0;
        for q in pivots.chain(self.rows[f].iter().map(|&q| q as usize)) {
            shift[q] = column;
            column += self.offset[q + 1] - self.offset[q];
        }
        let rows = front.first..front.first + front.np;
        let found = rows.flat_map(|p| self.later(k, pattern, p).map(move |found| (p, found)));
        for (entry, (p, (i, value))) in entries.iter_mut().zip(found) {
            let node = self.place[self.nodes.node_of(i)] as usize;
            let column = (shift[node] + self.new[i] - self.offset[node]) as usize;
            *entry = (narrow(value), narrow(layout.at(p - front.first, column)));
        }
    }
}
