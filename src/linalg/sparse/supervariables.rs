//! Nodes: groups of unknowns with the same neighbours, and their graph.

use std::collections::HashMap;

use crate::linalg::sparse::csc::{mix, narrow};
use crate::linalg::sparse::tuning;

/// Consecutive unknowns count as one neighbour: if directions are weakly coupled, each
/// direction is joined to the same nodes by other unknowns.
const THREE: usize = 3;

/// The graph of nodes. Interior nodes come first, then the kept ones.
#[derive(Debug)]
pub(crate) struct SupervariableGraph {
    node_of: Vec<u32>,
    /// Unknowns of node `v`: `members[member_start[v]..member_start[v + 1]]`.
    member_start: Vec<usize>,
    members: Vec<u32>,
    start: Vec<usize>,
    neighbours: Vec<u32>,
    interior: usize,
}

/// Whether an unknown belongs to the node of another one, this many places before it.
type SameNode<'a> = dyn Fn(usize, usize, usize) -> bool + 'a;

/// Unknowns grouped by nodes.
struct Groups {
    node_of: Vec<u32>,
    /// Number of nodes, and of nodes with unknowns that are not kept.
    nodes: usize,
    interior: usize,
}

impl Groups {
    /// Groups consecutive unknowns by
    /// `is_one(first of the node, unknown, unknowns after the first)`, and others by equal
    /// neighbourhoods.
    fn new<'a>(
        column: impl Fn(usize) -> &'a [usize] + Copy,
        kept: &[usize],
        place: &[Option<u32>],
        is_one: &SameNode,
    ) -> Self {
        let mut node_of = vec![0_u32; place.len()];
        let mut leaders: Vec<u32> = Vec::new();
        let mut by_hash: HashMap<u64, Vec<u32>> = HashMap::new();
        for j in (0..place.len()).filter(|&j| place[j].is_none()) {
            // The unknowns of a node are mostly consecutive.
            let near = leaders.last().map(|&lead| lead as usize);
            if let Some(lead) = near.filter(|&lead| is_one(lead, j, j - lead)) {
                node_of[j] = node_of[lead];
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
        // The start of the node in `kept`, and its number.
        let (mut first, mut nodes) = (0, interior);
        for (at, &j) in kept.iter().enumerate() {
            if at == 0 || !is_one(kept[first], j, at - first) {
                first = at;
                nodes += 1;
            }
            node_of[j] = narrow(nodes - 1);
        }
        Self {
            node_of,
            nodes,
            interior,
        }
    }
}

impl SupervariableGraph {
    /// Groups unknowns with equal closed neighbourhoods; if few are equal, consecutive unknowns
    /// with most neighbours in common. Kept unknowns are grouped only if they are consecutive
    /// in `kept`, so that S has the order of the caller; `place` is the position of each in
    /// `kept`.
    pub(crate) fn new(
        col_ptr: &[usize],
        row_idx: &[usize],
        kept: &[usize],
        place: &[Option<u32>],
    ) -> Self {
        let column = |j: usize| &row_idx[col_ptr[j]..col_ptr[j + 1]];
        let group = |is_one: &SameNode| Groups::new(column, kept, place, is_one);
        let equal = group(&|lead, j, _| same(column, lead, j));
        #[expect(clippy::cast_precision_loss, reason = "a threshold")]
        let most = tuning::fewer_nodes() * (place.len() - kept.len()) as f64;
        #[expect(clippy::cast_precision_loss, reason = "a threshold")]
        let is_fewer = |groups: &Groups| groups.interior as f64 <= most;
        let groups = if is_fewer(&equal) {
            equal
        } else {
            let alike = group(&|lead, j, after| {
                after < tuning::node_size() && is_alike(column(lead), column(j))
                    || same(column, lead, j)
            });
            if is_fewer(&alike) { alike } else { equal }
        };
        let mut this = Self {
            node_of: groups.node_of,
            member_start: Vec::new(),
            members: vec![0; place.len()],
            start: vec![0],
            neighbours: Vec::new(),
            interior: groups.interior,
        };
        this.collect_members(groups.nodes, kept, place);
        this.join(column);
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

    /// A node has the neighbours of all its unknowns.
    fn join<'a>(&mut self, column: impl Fn(usize) -> &'a [usize]) {
        let nodes = self.member_start.len() - 1;
        let mut seen = vec![u32::MAX; nodes];
        for v in 0..nodes {
            let own = narrow(v);
            seen[v] = own;
            let members = &self.members[self.member_start[v]..self.member_start[v + 1]];
            let mut before: &[usize] = &[];
            for &member in members {
                let column = column(member as usize);
                if column == before {
                    continue;
                }
                before = column;
                for &i in column {
                    let w = self.node_of[i];
                    if seen[w as usize] != own {
                        seen[w as usize] = own;
                        self.neighbours.push(w);
                    }
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

    /// Interior nodes, separated from those with very many neighbours.
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a threshold, exact or not"
    )]
    pub(crate) fn split_dense(&self) -> (Vec<u32>, Vec<u32>) {
        let limit = (tuning::dense_degree() * (self.interior as f64).sqrt()) as usize + 64;
        (0..narrow(self.interior)).partition(|&v| self.neighbours(v as usize).len() <= limit)
    }

    /// The graph of some nodes: starts, neighbours and weights in the numbering of `nodes`.
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

/// Whether the closed neighbourhoods of `a` and `b` are equal; each contains the diagonal,
/// stored or not.
fn same<'a>(column: impl Fn(usize) -> &'a [usize], a: usize, b: usize) -> bool {
    let (x, y) = (column(a), column(b));
    if x == y {
        return x.binary_search(&a).is_ok() && x.binary_search(&b).is_ok();
    }
    false
}

/// Whether unknowns with these neighbours belong to one node: most neighbours are in the same
/// nodes, and some are the same. Directions without any coupling are better eliminated
/// separately.
fn is_alike(a: &[usize], b: &[usize]) -> bool {
    common(a, b, THREE) >= tuning::common_share() && common(a, b, 1) >= tuning::acting_share()
}

/// The share of the neighbours in either sorted list that is in both; `width` consecutive ones
/// count as the same.
#[expect(clippy::cast_precision_loss, reason = "counts of neighbours")]
fn common(a: &[usize], b: &[usize], width: usize) -> f64 {
    let (mut p, mut q, mut both, mut all) = (0, 0, 0_usize, 0_usize);
    while p < a.len() || q < b.len() {
        let of = |list: &[usize], at: usize| list.get(at).map_or(usize::MAX, |&i| i / width);
        let (i, j) = (of(a, p), of(b, q));
        let least = i.min(j);
        all += 1;
        both += usize::from(i == j);
        while p < a.len() && a[p] / width == least {
            p += 1;
        }
        while q < b.len() && b[q] / width == least {
            q += 1;
        }
    }
    both as f64 / all.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes of three unknowns along a line, each joined to the neighbouring nodes, except for
    /// the pairs of unknowns in `missing`; no pair is joined twice.
    fn line(nodes: usize, missing: impl Fn(usize, usize) -> bool) -> (Vec<usize>, Vec<usize>) {
        let (mut col_ptr, mut row_idx) = (vec![0], Vec::new());
        for j in 0..3 * nodes {
            let near = (3 * (j / 3)).saturating_sub(3)..(3 * (j / 3) + 6).min(3 * nodes);
            row_idx.extend(near.filter(|&i| i == j || !missing(i.min(j), i.max(j))));
            col_ptr.push(row_idx.len());
        }
        (col_ptr, row_idx)
    }

    #[test]
    fn entries_that_vanish_leave_the_nodes() {
        let nodes = 40;
        let kept: Vec<usize> = (3 * nodes - 6..3 * nodes).collect();
        let place: Vec<Option<u32>> = (0..3 * nodes)
            .map(|j| kept.iter().position(|&k| k == j).map(narrow))
            .collect();
        let of = |missing: &dyn Fn(usize, usize) -> bool| {
            let (col_ptr, row_idx) = line(nodes, missing);
            SupervariableGraph::new(&col_ptr, &row_idx, &kept, &place)
        };
        let whole = of(&|_, _| false);
        // Within a node the directions are not coupled, nor the first to the last of every
        // other node.
        let some = of(&|i, j| i / 3 == j / 3 || i % 6 == 0 && j == i + 5);
        assert_eq!(whole.len(), nodes);
        assert_eq!(some.len(), nodes);
        for v in 0..nodes {
            assert_eq!(some.members(v), whole.members(v));
            let sorted = |nodes: &SupervariableGraph| {
                let mut list = nodes.neighbours(v).to_vec();
                list.sort_unstable();
                list
            };
            assert_eq!(sorted(&some), sorted(&whole));
        }
        assert_eq!(some.kept(), whole.kept());
    }

    /// Three parallel lines with consecutive unknowns: they are lines, not nodes.
    #[test]
    fn directions_that_do_not_act_stay_apart() {
        let (col_ptr, row_idx) = line(30, |i, j| i % 3 != j % 3);
        let nodes = SupervariableGraph::new(&col_ptr, &row_idx, &[], &[None; 90]);
        assert_eq!(nodes.len(), 90);
    }

    /// Unknowns of a line of nodes with one unknown each share half of their neighbours.
    #[test]
    fn neighbours_are_not_one_node() {
        let n = 30;
        let row_idx: Vec<usize> = (0_usize..n)
            .flat_map(|j| j.saturating_sub(1)..(j + 2).min(n))
            .collect();
        let mut col_ptr = vec![0];
        col_ptr.extend((0..n).map(|j| 3 * j + 2 - usize::from(j + 1 == n)));
        let nodes = SupervariableGraph::new(&col_ptr, &row_idx, &[], &vec![None; n]);
        assert_eq!(nodes.len(), n);
    }
}
