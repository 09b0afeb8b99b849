//! Random definite matrices on random graphs, any of their unknowns kept.

use std::collections::BTreeSet;

use proptest::prelude::*;
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::comparison::errors;
use super::matrices::{Entries, Sparse, shuffle};

#[derive(Clone, Copy, Debug)]
enum Graph {
    Tree,
    Sparse,
    Cliques,
    Grid,
    Arrow,
}

type Edges = BTreeSet<(usize, usize)>;

fn edges(graph: Graph, nodes: usize, random: &mut StdRng) -> Edges {
    let mut found = Edges::new();
    match graph {
        Graph::Tree => found.extend((1..nodes).map(|i| (random.random_range(0..i), i))),
        Graph::Sparse => {
            for i in 0..nodes {
                found.extend((0..i).map(|j| (j, i)).filter(|_| random.random_bool(0.08)));
            }
        }
        Graph::Cliques => {
            for _ in 0..nodes / 3 {
                let members: BTreeSet<usize> =
                    (0..5).map(|_| random.random_range(0..nodes)).collect();
                for &i in &members {
                    found.extend(members.range(..i).map(|&j| (j, i)));
                }
            }
        }
        Graph::Grid => {
            let side = 6;
            found.extend((1..nodes).filter(|i| i % side > 0).map(|i| (i - 1, i)));
            found.extend((side..nodes).map(|i| (i - side, i)));
        }
        Graph::Arrow => found.extend((0..nodes - 1).map(|i| (i, nodes - 1))),
    }
    found
}

/// Nodes of one to three unknowns that share a pattern; each edge a random
/// energy of all its unknowns, `a aᵀ`, stiff or soft by eight powers of ten; each
/// unknown held by a thousandth of its diagonal.
fn matrix(graph: Graph, nodes: usize, contrast: i32, random: &mut StdRng) -> Sparse {
    let mut first = vec![0];
    for node in 0..nodes {
        first.push(first[node] + random.random_range(1..=3));
    }
    let n = first[nodes];
    let mut number: Vec<usize> = (0..n).collect();
    shuffle(&mut number, random);
    let mut pairs = edges(graph, nodes, random);
    pairs.extend((0..nodes).map(|i| (i, i)));
    let mut entries = Entries::default();
    let mut diagonal = vec![0.0; n];
    for (i, j) in pairs {
        let mut unknowns: Vec<usize> = (first[i]..first[i + 1]).collect();
        unknowns.extend((first[j]..first[j + 1]).filter(|_| i != j));
        let stiffness = 10_f64.powi(random.random_range(-contrast..=contrast));
        for _ in 0..2 {
            let a: Vec<f64> = unknowns
                .iter()
                .map(|_| random.random_range(-1.0..1.0))
                .collect();
            for (p, &row) in unknowns.iter().enumerate() {
                for (q, &column) in unknowns.iter().enumerate().take(p + 1) {
                    entries.add(number[row], number[column], stiffness * (a[p] * a[q]));
                }
                diagonal[row] += stiffness * a[p] * a[p];
            }
        }
    }
    for (row, own) in diagonal.iter().enumerate() {
        entries.add(number[row], number[row], 1e-3 * own);
    }
    entries.matrix(n)
}

fn any_graph() -> impl Strategy<Value = Graph> {
    use Graph::{Arrow, Cliques, Grid, Sparse, Tree};
    proptest::sample::select(vec![Tree, Sparse, Cliques, Grid, Arrow])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..Default::default() })]

    #[test]
    fn any_graph_any_kept_unknowns(
        graph in any_graph(),
        nodes in 1_usize..40,
        contrast in 0_i32..=4,
        share in 0.0..=1.0,
        seed: u64,
    ) {
        let mut random = StdRng::seed_from_u64(seed);
        let k = matrix(graph, nodes, contrast, &mut random);
        let mut kept: Vec<usize> = (0..k.n).filter(|_| random.random_bool(share)).collect();
        shuffle(&mut kept, &mut random);
        // Asserts symmetry, the same bits on two threads and the bound entry by
        // entry: K is definite, so nothing is refused.
        errors(&k, &kept);
    }
}
