//! Nodes: groups of unknowns with the same neighbours, and their graph.

use std::collections::HashMap;

use crate::linalg::csc::{mix, narrow};

/// A vertex joined to more than this many times `√N` others is ordered last:
/// dissection cannot separate anything around it.
const DENSE: f64 = 10.0;

/// The graph of nodes. Interior ones come first, kept ones after them.
#[derive(Debug)]
pub(crate) struct Quotient {
    node_of: Vec<u32>,
    /// Unknowns of node `v`: `members[member_start[v]..member_start[v + 1]]`.
    member_start: Vec<usize>,
    members: Vec<u32>,
    start: Vec<usize>,
    neighbours: Vec<u32>,
    interior: usize,
}

impl Quotient {
    /// Groups unknowns whose closed neighbourhoods are equal. Kept ones are
    /// grouped only where they follow one another in `kept`, so that S keeps
    /// the caller's order; `place` is the position of each in `kept`.
    pub(crate) fn new(
        col_ptr: &[usize],
        row_idx: &[usize],
        kept: &[usize],
        place: &[Option<u32>],
    ) -> Self {
        let n = place.len();
        let column = |j: usize| &row_idx[col_ptr[j]..col_ptr[j + 1]];
        let mut node_of = vec![0_u32; n];
        let mut leaders: Vec<u32> = Vec::new();
        let mut by_hash: HashMap<u64, Vec<u32>> = HashMap::new();
        for j in (0..n).filter(|&j| place[j].is_none()) {
            // Unknowns of a node mostly follow one another.
            let near = leaders.last().copied();
            if let Some(node) = near.filter(|&lead| same(column, lead as usize, j)) {
                node_of[j] = node_of[node as usize];
                continue;
            }
            let candidates = by_hash.entry(hash(column(j), j)).or_default();
            let known = candidates
                .iter()
                .find(|&&lead| same(column, lead as usize, j));
            node_of[j] = if let Some(&lead) = known {
                node_of[lead as usize]
            } else {
                candidates.push(narrow(j));
                leaders.push(narrow(j));
                narrow(leaders.len() - 1)
            };
        }
        let interior = leaders.len();
        for (at, &j) in kept.iter().enumerate() {
            let previous = at.checked_sub(1).map(|before| kept[before]);
            node_of[j] = if let Some(previous) = previous.filter(|&p| same(column, p, j)) {
                node_of[previous]
            } else {
                leaders.push(narrow(j));
                narrow(leaders.len() - 1)
            };
        }
        let mut this = Self {
            node_of,
            member_start: Vec::new(),
            members: vec![0; n],
            start: vec![0],
            neighbours: Vec::new(),
            interior,
        };
        this.collect_members(leaders.len(), kept, place);
        this.join(&leaders, column);
        this
    }

    fn collect_members(&mut self, nodes: usize, kept: &[usize], place: &[Option<u32>]) {
        let mut start = vec![0; nodes + 1];
        for &v in &self.node_of {
            start[v as usize + 1] += 1;
        }
        for v in 0..nodes {
            start[v + 1] += start[v];
        }
        let mut next = start.clone();
        let inner = (0..place.len()).filter(|&j| place[j].is_none());
        for j in inner.chain(kept.iter().copied()) {
            let slot = &mut next[self.node_of[j] as usize];
            self.members[*slot] = narrow(j);
            *slot += 1;
        }
        self.member_start = start;
    }

    fn join<'a>(&mut self, leaders: &[u32], column: impl Fn(usize) -> &'a [usize]) {
        let mut seen = vec![u32::MAX; leaders.len()];
        for (v, &lead) in leaders.iter().enumerate() {
            let own = narrow(v);
            seen[v] = own;
            for &i in column(lead as usize) {
                let w = self.node_of[i];
                if seen[w as usize] != own {
                    seen[w as usize] = own;
                    self.neighbours.push(w);
                }
            }
            self.start.push(self.neighbours.len());
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.start.len() - 1
    }

    pub(crate) fn unknowns(&self) -> usize {
        self.node_of.len()
    }

    pub(crate) fn kept(&self) -> std::ops::Range<u32> {
        narrow(self.interior)..narrow(self.len())
    }

    pub(crate) fn node_of(&self, dof: usize) -> usize {
        self.node_of[dof] as usize
    }

    pub(crate) fn members(&self, v: usize) -> &[u32] {
        &self.members[self.member_start[v]..self.member_start[v + 1]]
    }

    /// Number of unknowns of node `v`.
    pub(crate) fn weight(&self, v: usize) -> usize {
        self.member_start[v + 1] - self.member_start[v]
    }

    pub(crate) fn neighbours(&self, v: usize) -> &[u32] {
        &self.neighbours[self.start[v]..self.start[v + 1]]
    }

    /// Interior nodes, those with uncommonly many neighbours apart.
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a threshold, exact or not"
    )]
    pub(crate) fn split_dense(&self) -> (Vec<u32>, Vec<u32>) {
        let limit = (DENSE * (self.interior as f64).sqrt()) as usize + 64;
        (0..narrow(self.interior)).partition(|&v| self.neighbours(v as usize).len() <= limit)
    }

    /// The graph of some nodes alone: starts, neighbours, weights, all in the
    /// numbering of `nodes`.
    pub(crate) fn subgraph(&self, nodes: &[u32]) -> (Vec<usize>, Vec<u32>, Vec<u32>) {
        let mut local = vec![u32::MAX; self.len()];
        for (at, &v) in (0_u32..).zip(nodes) {
            local[v as usize] = at;
        }
        let mut start = vec![0];
        let mut neighbours = Vec::new();
        for &v in nodes {
            let inside = self
                .neighbours(v as usize)
                .iter()
                .map(|&w| local[w as usize]);
            neighbours.extend(inside.filter(|&w| w != u32::MAX));
            start.push(neighbours.len());
        }
        let weight = nodes
            .iter()
            .map(|&v| narrow(self.weight(v as usize)))
            .collect();
        (start, neighbours, weight)
    }
}

fn hash(column: &[usize], own: usize) -> u64 {
    let others = column.iter().filter(|&&i| i != own);
    others.fold(mix(own), |sum, &i| sum.wrapping_add(mix(i)))
}

/// Whether the closed neighbourhoods of `a` and `b` are equal: a diagonal entry
/// that is not stored counts as stored.
fn same<'a>(column: impl Fn(usize) -> &'a [usize], a: usize, b: usize) -> bool {
    let (x, y) = (column(a), column(b));
    if x == y {
        return x.binary_search(&a).is_ok() && x.binary_search(&b).is_ok();
    }
    false
}
