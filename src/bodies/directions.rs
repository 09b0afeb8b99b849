//! What each degree of freedom is, from the positions alone.

/// The kind of a degree of freedom: a displacement along an axis, or a rotation about one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DofDirection {
    Along(usize),
    About(usize),
}

/// Directions of degrees of freedom from their positions. Those at one position are, in
/// ascending order, displacements along the axes, then rotations if their number is that of a
/// node of a beam or a shell. Bodies that touch share positions: then runs of consecutive
/// numbers are nodes.
pub fn find_directions(places: &[[f64; 3]], dimension: usize) -> Vec<Option<DofDirection>> {
    let key = |i: usize| places[i].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&i| (key(i), i));
    let mut directions = vec![None; places.len()];
    for at_place in order.chunk_by(|&i, &j| key(i) == key(j)) {
        for node in group_into_nodes(at_place, dimension) {
            for (k, &dof) in node.iter().enumerate() {
                directions[dof] = Some(if k < dimension {
                    DofDirection::Along(k)
                } else if dimension == 2 {
                    DofDirection::About(2)
                } else {
                    DofDirection::About(k - 3)
                });
            }
        }
    }
    directions
}

/// The nodes at one position, each with its degrees of freedom in the order of directions.
fn group_into_nodes(dofs: &[usize], dimension: usize) -> Vec<Vec<usize>> {
    let with_rotations = if dimension == 2 { 3 } else { 6 };
    let of_node = |count: usize| count == dimension || count == with_rotations;
    let runs: Vec<&[usize]> = dofs.chunk_by(|i, j| j - i == 1).collect();
    if runs.iter().all(|run| of_node(run.len())) {
        return runs.into_iter().map(<[usize]>::to_vec).collect();
    }
    if of_node(dofs.len()) {
        return vec![dofs.to_vec()];
    }
    if runs.iter().all(|run| run.len().is_multiple_of(dimension)) {
        return runs
            .iter()
            .flat_map(|run| run.chunks(dimension))
            .map(<[usize]>::to_vec)
            .collect();
    }
    if dofs.len().is_multiple_of(dimension) {
        // First all x, then all y: for each axis one from each node.
        let count = dofs.len() / dimension;
        let node = |k: usize| (0..dimension).map(|axis| dofs[axis * count + k]).collect();
        return (0..count).map(node).collect();
    }
    Vec::new()
}
