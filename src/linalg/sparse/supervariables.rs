//! Nodes: groups of unknowns with the same neighbours, and their graph.

use std::collections::HashMap;

use crate::linalg::sparse::csc::{mix, narrow};
use crate::linalg::sparse::tuning;

/// Consecutive unknowns count as one neighbour: if directions are weakly coupled, each
/// direction is joined to the same nodes by other unknowns.
const THREE: usize = 3;

/// The graph of nodes. Interior nodes come first, then the kept ones.
#[derive(Debug)]
pub struct SupervariableGraph {
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
        place: &[Option<usize>],
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
    pub fn new(
        col_ptr: &[usize],
        row_idx: &[usize],
        kept: &[usize],
        place: &[Option<usize>],
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

    fn collect_members(&mut self, nodes: usize, kept: &[usize], place: &[Option<usize>]) {
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

    pub fn unknowns(&self) -> usize {
        self.node_of.len()
    }

    pub fn kept(&self) -> std::ops::Range<u32> {
        narrow(self.interior)..narrow(self.len())
    }

    pub fn node_of(&self, dof: usize) -> usize {
        self.node_of[dof] as usize
    }

    pub fn members(&self, v: usize) -> &[u32] {
        &self.members[self.member_start[v]..self.member_start[v + 1]]
    }

    /// Number of unknowns of node `v`.
    pub fn weight(&self, v: usize) -> usize {
        self.member_start[v + 1] - self.member_start[v]
    }

    pub fn neighbours(&self, v: usize) -> &[u32] {
        &self.neighbours[self.start[v]..self.start[v + 1]]
    }

    /// Interior nodes, separated from those with very many neighbours.
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a threshold, exact or not"
    )]
    pub fn split_dense(&self) -> (Vec<u32>, Vec<u32>) {
        let limit = (tuning::dense_degree() * (self.interior as f64).sqrt()) as usize + 64;
        (0..narrow(self.interior)).partition(|&v| self.neighbours(v as usize).len() <= limit)
    }

    /// The graph of some nodes: starts, neighbours and weights in the numbering of `nodes`.
    pub fn subgraph(&self, nodes: &[u32]) -> (Vec<usize>, Vec<u32>, Vec<u32>) {
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
