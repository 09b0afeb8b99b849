//! The fitted constants of ordering and factorisation. `benches/tuning.py` prints what half and
//! twice each value does.

use crate::fitted::fitted;

fitted! {
    // supervariables.rs
    /// A vertex with more neighbours than this many times `√N` is ordered last: dissection cannot
    /// separate the vertices around it.
    dense_degree: f64 = 10.0;
    /// Equal neighbourhoods define the nodes if there are this many times fewer nodes than
    /// unknowns. If hardly any are equal, entries that happen to vanish are missing in K.
    fewer_nodes: f64 = 0.6;
    /// Consecutive unknowns belong to one node, up to [`node_size`] of them, if this share of all their
    /// neighbours are neighbours of both. Nodes of one element share half of their neighbours.
    common_share: f64 = 0.75;
    /// The same share for single unknowns, if directions are coupled: 0.46 on a grid of bricks
    /// whose directions are coupled only between nodes off the axes.
    acting_share: f64 = 0.25;
    /// Largest number of degrees of freedom of a node, that of a shell.
    node_size: usize = 6;

    // mod.rs
    /// Up to this work for each node, METIS is not used if coordinates have given an order [flop]:
    /// METIS takes about 10 µs for each node, and half of this work takes no longer.
    worth_metis: f64 = 1e6;

    // tasks.rs
    /// Approximate number of subtrees of a small tree.
    task_parts: f64 = 16.0;
}
