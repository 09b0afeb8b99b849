//! Connected bodies: the parts of the free rows and columns of `K` that no entry couples.

use std::collections::HashMap;

use crate::linalg::sparse::csc::{Index, Symmetric, Symmetry, mix};
use crate::linalg::sparse::rows::OwnedMatrix;

/// The free part of a symmetric matrix, both triangles from its lower one, and the global
/// numbers of its rows. Stored zeros are omitted except where [`in_use`] keeps them.
pub fn free_part(
    k: &Symmetric,
    symmetry: Symmetry,
    fixed: &[Option<usize>],
) -> (OwnedMatrix, Vec<usize>) {
    let global: Vec<usize> = (0..k.n()).filter(|&i| fixed[i].is_none()).collect();
    let mut number = vec![usize::MAX; k.n()];
    for (local, &i) in global.iter().enumerate() {
        number[i] = local;
    }
    let in_use = in_use(k);
    if symmetry == Symmetry::Exact {
        return (chosen(k, &global, &number, in_use.as_deref()), global);
    }
    let lower = |j: usize| {
        let (number, in_use) = (&number, in_use.as_deref());
        let first = k.col_ptr()[j];
        let used = move |at: usize| in_use.is_none_or(|used| used[at]);
        k.column(j).enumerate().filter_map(move |(at, (i, value))| {
            let keep = i >= j && number[i] != usize::MAX && used(first + at);
            keep.then(|| (number[i], value))
        })
    };
    let mut pointer = vec![0; global.len() + 1];
    for (local, &j) in global.iter().enumerate() {
        for (i, _) in lower(j) {
            pointer[local + 1] += 1;
            if i != local {
                pointer[i + 1] += 1;
            }
        }
    }
    for i in 0..global.len() {
        pointer[i + 1] += pointer[i];
    }
    // Columns are visited in order, so that each column is filled in order: its upper entries
    // come before its own turn, its lower ones in it.
    let mut cursor = pointer.clone();
    let entries = pointer[global.len()];
    let (mut index, mut values) = (vec![0; entries], vec![0.0; entries]);
    for (local, &j) in global.iter().enumerate() {
        for (i, value) in lower(j) {
            for (row, column) in [(i, local), (local, i)]
                .into_iter()
                .take(1 + usize::from(i != local))
            {
                index[cursor[column]] = row;
                values[cursor[column]] = value;
                cursor[column] += 1;
            }
        }
    }
    (
        OwnedMatrix {
            pointer,
            index,
            values,
        },
        global,
    )
}

/// The rows and columns `global` under their new numbers, for a matrix that is bitwise
/// symmetric: no triangle needs to be copied.
fn chosen(
    k: &Symmetric,
    global: &[usize],
    number: &[usize],
    in_use: Option<&[bool]>,
) -> OwnedMatrix {
    let entries = k.row_idx().len();
    let (mut index, mut values) = (vec![0; entries], vec![0.0; entries]);
    let mut pointer = Vec::with_capacity(global.len() + 1);
    pointer.push(0);
    let mut next = 0;
    for &j in global {
        for at in k.col_ptr()[j]..k.col_ptr()[j + 1] {
            let row = number[k.row_idx()[at]];
            // Always written, and counted if it stays: this needs no branch.
            (index[next], values[next]) = (row, k.values()[at]);
            next += usize::from(row != usize::MAX && in_use.is_none_or(|used| used[at]));
        }
        pointer.push(next);
    }
    index.truncate(next);
    values.truncate(next);
    index.shrink_to_fit();
    values.shrink_to_fit();
    OwnedMatrix {
        pointer,
        index,
        values,
    }
}

/// Whether each stored entry belongs to the pattern; `None` if all do.
///
/// On a grid some entries of the block of two nodes cancel and others do not, depending on the
/// material. Without these zeros the unknowns of a node would have different patterns. The
/// analysis works on nodes, and would have three times as many nodes and nine times the edges.
/// Blocks of zeros only are not part of the pattern, nor are other zeros.
fn in_use(k: &Symmetric) -> Option<Vec<bool>> {
    let values = k.values();
    if values.iter().all(|&value| value != 0.0) {
        return None;
    }
    let (node_of, members) = nodes(k);
    let entries = |j: usize| k.col_ptr()[j]..k.col_ptr()[j + 1];
    let mut used = vec![false; values.len()];
    // The last node with a nonzero block for each node.
    let mut met = vec![usize::MAX; members.len()];
    for (node, own) in members.iter().enumerate() {
        for at in own.iter().flat_map(|&j| entries(j)) {
            if values[at] != 0.0 {
                met[node_of[k.row_idx()[at]]] = node;
            }
        }
        for &j in own {
            for at in entries(j) {
                let i = k.row_idx()[at];
                used[at] = i == j || met[node_of[i]] == node;
            }
        }
    }
    Some(used)
}

/// Groups of a few unknowns whose stored columns have one pattern, and the group of each
/// unknown.
fn nodes(k: &Symmetric) -> (Vec<usize>, Vec<Vec<usize>>) {
    /// Largest number of unknowns of a node, with rotations.
    const MOST: usize = 6;
    let column = |j: usize| &k.row_idx()[k.col_ptr()[j]..k.col_ptr()[j + 1]];
    let mut first: HashMap<u64, Vec<usize>> = HashMap::new();
    let mut node_of = vec![0; k.n()];
    let mut members: Vec<Vec<usize>> = Vec::new();
    for j in 0..k.n() {
        // The unknowns of a node are mostly consecutive.
        let near = j.checked_sub(1).filter(|&i| column(i) == column(j));
        let known = near.map(|i| node_of[i]);
        let node = known.unwrap_or_else(|| {
            let sum = |sum: u64, &i: &usize| sum.wrapping_add(mix(i));
            let alike = first.entry(column(j).iter().fold(0, sum)).or_default();
            let same = |&&node: &&usize| column(members[node][0]) == column(j);
            alike.iter().find(same).copied().unwrap_or_else(|| {
                alike.push(members.len());
                members.len()
            })
        });
        if node == members.len() {
            members.push(Vec::new());
        }
        members[node].push(j);
        node_of[j] = node;
    }
    for node in 0..members.len() {
        if members[node].len() > MOST {
            for j in members[node].split_off(1) {
                node_of[j] = members.len();
                members.push(vec![j]);
            }
        }
    }
    (node_of, members)
}

/// Columns of a symmetric matrix at `fixed`, with the rows that are not fixed.
pub fn columns<I: Index>(
    k: &Symmetric<I>,
    fixed: &[usize],
    position: &[Option<usize>],
) -> OwnedMatrix {
    let mut out = OwnedMatrix::default();
    for &j in fixed {
        out.push(k.column(j).filter(|&(i, _)| position[i].is_none()));
    }
    out
}

/// Number of each row within its component.
pub fn local_numbers(component: &[usize], count: usize) -> Vec<usize> {
    let mut next = vec![0; count];
    let number = |&c: &usize| {
        next[c] += 1;
        next[c] - 1
    };
    component.iter().map(number).collect()
}

/// Splits a block-diagonal matrix into its components, with their rows.
pub fn split(k: OwnedMatrix, component: &[usize]) -> Vec<(Vec<usize>, OwnedMatrix)> {
    let count = component.iter().max().map_or(0, |c| c + 1);
    if count == 1 {
        return vec![((0..component.len()).collect(), k)];
    }
    let local = local_numbers(component, count);
    let mut parts: Vec<(Vec<usize>, OwnedMatrix)> = (0..count)
        .map(|_| (Vec::new(), OwnedMatrix::default()))
        .collect();
    for (j, &c) in component.iter().enumerate() {
        let (rows, part) = &mut parts[c];
        rows.push(j);
        let own = k.entries(j).filter(|&(i, _)| component[i] == c);
        part.push(own.map(|(i, value)| (local[i], value)));
    }
    parts
}
