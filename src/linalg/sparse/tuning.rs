//! The fitted constants of ordering and factorisation.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`: the
//! operations of the factorisation of four shipped scenes with 6 to 10 cells a side.

use crate::fitted::fitted;

fitted! {
    // supervariables.rs
    /// A vertex with more neighbours than this many times `√N` is ordered last: dissection cannot
    /// separate the vertices around it.
    /// Half, twice: same, same.
    dense_degree: f64 = 10.0;
    /// Equal neighbourhoods define the nodes if there are this many times fewer nodes than
    /// unknowns. If hardly any are equal, entries that happen to vanish are missing in K.
    /// Half, twice: same, same.
    fewer_nodes: f64 = 0.6;
    /// Consecutive unknowns belong to one node, up to [`node_size`] of them, if this share of all their
    /// neighbours are neighbours of both. Nodes of one element share half of their neighbours.
    /// Half, twice: same, same.
    common_share: f64 = 0.75;
    /// The same share for single unknowns, if directions are coupled: 0.46 on a grid of bricks
    /// whose directions are coupled only between nodes off the axes.
    /// Half, twice: same, same.
    acting_share: f64 = 0.25;
    /// Largest number of degrees of freedom of a node, that of a shell.
    /// Half, twice: same, same.
    node_size: usize = 6;

    // mod.rs
    /// Up to this work for each node, METIS is not used if coordinates have given an order [flop]:
    /// METIS takes about 10 µs for each node, and half of this work takes no longer.
    /// Half, twice: same, same.
    worth_metis: f64 = 1e6;

    // tasks.rs
    /// Approximate number of subtrees of a small tree.
    /// Half, twice: same, same.
    task_parts: f64 = 16.0;
}
