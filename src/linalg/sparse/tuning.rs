//! The fitted constants of ordering and factorisation.
//!
//! *Half, twice* is what half and twice the value change in the work of `benches/tuning.py`: the
//! operations of the factorisation of four shipped scenes with 6 to 10 cells a side. Where it is
//! missing, neither changes it, as a rule because these sets do not reach the constant.

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
    /// `common_share` for single unknowns, if directions are coupled: 0.46 on a grid of bricks
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
    /// Work of a subtree that one thread does alone [flop]: some milliseconds, far above the cost of
    /// a task. If the total work is not much larger, a share of it, but at least the first value.
    least_leaf: f64 = 1e7;
    largest_leaf: f64 = 2e8;

    // ordering.rs
    /// Sets this small become one front in any case (`symbolic` merges them).
    /// Half, twice: −1.3 %, +3.8 %.
    leaf_nodes: usize = 8;

    // multifrontal.rs
    /// Rounding error of a pivot, relative to its diagonal in K, for each unknown eliminated before
    /// it. The stiffness of a free motion sums to the rounding of K, which adds up for equal cells:
    /// free plates of 1e2 to 1e5 unknowns give 1.6 roundings for each unknown.
    pivot_roundings: f64 = 8.0;

    // tree.rs
    /// A front is merged with its parent if both have at most this many pivots together.
    few_pivots: usize = 4;
    /// A front with at most `some_pivots` is merged if less than the share `zeros_of_some` of the
    /// entries of the merged front is zero; one with `many_pivots` as `zeros_of_many` says.
    /// Half, twice: −2.3 %, +2.8 %.
    some_pivots: usize = 16;
    /// Half, twice: −0.3 %, same.
    zeros_of_some: f64 = 0.8;
    /// Half, twice: −1.4 %, +1.6 %.
    many_pivots: usize = 48;
    /// Half, twice: −1.8 %, +4.0 %.
    zeros_of_many: f64 = 0.1;
    /// A front of any number of pivots is merged below this share of zeros.
    /// Half, twice: −0.2 %, +7.1 %.
    zeros_of_all: f64 = 0.05;
}
