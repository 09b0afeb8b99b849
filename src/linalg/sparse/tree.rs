//! From an elimination order to the tree of fronts.
//!
//! Elimination tree and row counts (Liu), supernodes, and their relaxation: small fronts are
//! merged with their parents, which adds some zeros, because products of a few columns are far
//! slower than larger ones.

use crate::linalg::packed::Packed;
use crate::linalg::sparse::csc::narrow;
use crate::linalg::sparse::supervariables::SupervariableGraph;
use crate::linalg::sparse::tuning;

const NONE: u32 = u32::MAX;

/// A front of the final tree.
#[derive(Debug)]
pub(crate) struct TreeFront {
    /// Pivots, as places in the given elimination order.
    pub(crate) nodes: Vec<u32>,
    pub(crate) np: usize,
    pub(crate) nf: usize,
    pub(crate) parent: Option<usize>,
}

/// Fronts in postorder, and their work.
#[derive(Debug)]
pub(crate) struct Tree {
    pub(crate) fronts: Vec<TreeFront>,
    pub(crate) flops: f64,
}

/// Additions and multiplications to eliminate `np` of `nf` rows:
/// `Σ (nf − k)²`, `k < np`.
#[expect(clippy::cast_precision_loss, reason = "a count for decisions")]
pub(crate) fn flops_of(np: usize, nf: usize) -> f64 {
    let cube = |n: f64| n * (n + 1.0) * (2.0 * n + 1.0) / 6.0;
    cube(nf as f64) - cube((nf - np) as f64)
}

impl Tree {
    /// `order[place]` is the node eliminated there; it contains no kept nodes.
    pub(crate) fn new(nodes: &SupervariableGraph, order: &[u32]) -> Self {
        let parent = elimination_tree(nodes, order);
        let (parent, order_of) = postorder(&parent);
        let order: Vec<u32> = order_of.iter().map(|&v| order[v as usize]).collect();
        let counts = row_counts(nodes, &order, &parent);
        let mut supernodes = supernodes(nodes, &order, &parent, &counts);
        relax(&mut supernodes);
        let touched = first_touch(nodes, &order);
        let mut this = arrange(supernodes, &touched);
        // Back to the places in the given order.
        for front in &mut this.fronts {
            for v in &mut front.nodes {
                *v = order_of[*v as usize];
            }
        }
        this
    }
}

/// Place of each interior node; kept ones have none.
fn places(nodes: &SupervariableGraph, order: &[u32]) -> Vec<u32> {
    let mut place = vec![NONE; nodes.len()];
    for (at, &v) in (0_u32..).zip(order) {
        place[v as usize] = at;
    }
    place
}

fn elimination_tree(nodes: &SupervariableGraph, order: &[u32]) -> Vec<u32> {
    let place = places(nodes, order);
    let mut parent = vec![NONE; order.len()];
    let mut ancestor = vec![NONE; order.len()];
    for (at, &v) in (0_u32..).zip(order) {
        for &w in nodes.neighbours(v as usize) {
            let mut k = place[w as usize];
            // Kept nodes have no place, which counts as above every other.
            while k < at {
                let next = std::mem::replace(&mut ancestor[k as usize], at);
                if next == NONE {
                    parent[k as usize] = at;
                    break;
                }
                k = next;
            }
        }
    }
    parent
}

/// Renumbers such that every subtree is consecutive and ends with its root: the new parents,
/// and the old number of each new one.
fn postorder(parent: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let n = parent.len();
    let mut child = vec![NONE; n];
    let mut sibling = vec![NONE; n];
    for v in (0..n).rev() {
        if parent[v] != NONE {
            sibling[v] = std::mem::replace(&mut child[parent[v] as usize], narrow(v));
        }
    }
    let mut old = Vec::with_capacity(n);
    let mut path: Vec<u32> = Vec::new();
    for root in (0..n).filter(|&v| parent[v] == NONE) {
        path.push(narrow(root));
        while let Some(&top) = path.last() {
            let next = std::mem::replace(&mut child[top as usize], NONE);
            if next == NONE {
                old.push(top);
                let _ = path.pop();
                if sibling[top as usize] != NONE && !path.is_empty() {
                    path.push(sibling[top as usize]);
                }
            } else {
                path.push(next);
            }
        }
    }
    let mut new = vec![NONE; n];
    for (at, &v) in (0_u32..).zip(&old) {
        new[v as usize] = at;
    }
    let parent = old.iter().map(|&v| match parent[v as usize] {
        NONE => NONE,
        p => new[p as usize],
    });
    (parent.collect(), old)
}

/// Unknowns in each column of the factor, with itself and kept rows: row `i` is in the columns
/// from its neighbours up the tree to `i`.
fn row_counts(nodes: &SupervariableGraph, order: &[u32], parent: &[u32]) -> Vec<usize> {
    let place = places(nodes, order);
    let mut counts: Vec<usize> = order.iter().map(|&v| nodes.weight(v as usize)).collect();
    let mut seen = vec![NONE; order.len()];
    for i in order.iter().copied().chain(nodes.kept()) {
        let own = place[i as usize];
        let weight = nodes.weight(i as usize);
        if own != NONE {
            seen[own as usize] = i;
        }
        for &w in nodes.neighbours(i as usize) {
            let mut k = place[w as usize];
            // A kept row climbs to the root of the tree.
            if k == NONE || k > own {
                continue;
            }
            while k != NONE && seen[k as usize] != i {
                seen[k as usize] = i;
                counts[k as usize] += weight;
                k = parent[k as usize];
            }
        }
    }
    counts
}

/// The first column of the factor with an entry in each row: the first neighbour of the row, or
/// the row itself.
fn first_touch(nodes: &SupervariableGraph, order: &[u32]) -> Vec<u32> {
    let place = places(nodes, order);
    let first = |v: &u32| {
        let near = nodes.neighbours(*v as usize).iter();
        near.map(|&w| place[w as usize])
            .fold(place[*v as usize], u32::min)
    };
    order.iter().map(first).collect()
}

struct Supernode {
    nodes: Vec<u32>,
    np: usize,
    nf: usize,
    zeros: usize,
    parent: Option<usize>,
    /// Set after it is merged with its parent.
    merged: bool,
}

/// Chains of the tree whose columns have one pattern.
fn supernodes(
    nodes: &SupervariableGraph,
    order: &[u32],
    parent: &[u32],
    counts: &[usize],
) -> Vec<Supernode> {
    let mut found: Vec<Supernode> = Vec::new();
    let mut of = vec![0; order.len()];
    for v in 0..order.len() {
        let weight = nodes.weight(order[v] as usize);
        let chained = v > 0
            && parent[v - 1] == narrow(v)
            && counts[v - 1] == counts[v] + nodes.weight(order[v - 1] as usize);
        match found.last_mut() {
            Some(last) if chained => {
                last.nodes.push(narrow(v));
                last.np += weight;
            }
            _ => found.push(Supernode {
                nodes: vec![narrow(v)],
                np: weight,
                nf: counts[v],
                zeros: 0,
                parent: None,
                merged: false,
            }),
        }
        of[v] = found.len() - 1;
    }
    for supernode in &mut found {
        let last = supernode.nodes.last().map_or(0, |&v| v as usize);
        supernode.parent = (parent[last] != NONE).then(|| of[parent[last] as usize]);
    }
    found
}

/// Merges children with parents if they have few pivots or add few zeros. A parent has all rows of its child except
/// the pivots of the child, so the merged front has the rows of the parent and the pivots of
/// both.
#[expect(clippy::cast_precision_loss, reason = "a share for a decision")]
fn relax(list: &mut [Supernode]) {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); list.len()];
    for s in 0..list.len() {
        let mut own = std::mem::take(&mut children[s]);
        // The child with the best fitting rows first.
        own.sort_by_key(|&c| (list[s].nf + list[c].np - list[c].nf, c));
        let mut later = Vec::new();
        for &c in &own {
            let (np, nf) = (list[s].np + list[c].np, list[s].nf + list[c].np);
            let zeros = list[s].zeros + list[c].zeros + list[c].np * (nf - list[c].nf);
            let entries = np * nf - np * (np - 1) / 2;
            let share = zeros as f64 / entries as f64;
            let limits = [
                (tuning::few_pivots(), 1.0),
                (tuning::some_pivots(), tuning::zeros_of_some()),
                (tuning::many_pivots(), tuning::zeros_of_many()),
                (usize::MAX, tuning::zeros_of_all()),
            ];
            if zeros == 0
                || limits
                    .iter()
                    .any(|&(limit, part)| np <= limit && share < part)
            {
                let mut nodes = std::mem::take(&mut list[c].nodes);
                nodes.append(&mut list[s].nodes);
                list[s].nodes = nodes;
                (list[s].np, list[s].nf, list[s].zeros) = (np, nf, zeros);
                list[c].merged = true;
                later.append(&mut children[c]);
            } else {
                later.push(c);
            }
        }
        for &c in &later {
            list[c].parent = Some(s);
        }
        children[s] = later;
        if let Some(parent) = list[s].parent {
            children[parent].push(s);
        }
    }
}

/// Postorder of the merged tree. Among siblings, the one whose peak exceeds its rest by most
/// comes first: this needs the least memory on a stack (Liu 1986).
///
/// A front is dense, so its pivots may have any order. Pivots reached by the same descendants
/// are consecutive, so that updates are added in long runs.
fn arrange(mut list: Vec<Supernode>, touched: &[u32]) -> Tree {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); list.len()];
    let mut peak = vec![0_usize; list.len()];
    let mut roots = Vec::new();
    let left = |s: &Supernode| Packed::new(s.nf - s.np).len();
    for s in 0..list.len() {
        if list[s].merged {
            continue;
        }
        children[s].sort_by_key(|&c| (std::cmp::Reverse(peak[c] - left(&list[c])), c));
        let mut height = 0;
        for &c in &children[s] {
            peak[s] = peak[s].max(height + peak[c]);
            height += left(&list[c]);
        }
        peak[s] = peak[s].max(height + left(&list[s]));
        match list[s].parent {
            Some(parent) => children[parent].push(s),
            None => roots.push(s),
        }
    }
    let mut fronts = Vec::new();
    let mut flops = 0.0;
    let mut number = vec![0; list.len()];
    let mut path: Vec<(usize, bool)> = roots.into_iter().rev().map(|s| (s, false)).collect();
    while let Some((s, done)) = path.pop() {
        if !done {
            path.push((s, true));
            path.extend(children[s].iter().rev().map(|&c| (c, false)));
            continue;
        }
        number[s] = fronts.len();
        flops += flops_of(list[s].np, list[s].nf);
        let mut nodes = std::mem::take(&mut list[s].nodes);
        nodes.sort_unstable_by_key(|&v| (touched[v as usize], v));
        fronts.push(TreeFront {
            nodes,
            np: list[s].np,
            nf: list[s].nf,
            parent: list[s].parent,
        });
    }
    for front in &mut fronts {
        front.parent = front.parent.map(|s| number[s]);
    }
    Tree { fronts, flops }
}
