//! The node of each contact whose displacement its relative displacement replaces.
//!
//! Such a node occurs in the rows of this contact only, so that no other contact feels the
//! change of variables there. All other nodes of the rows are masters.

use std::collections::BTreeMap;

use crate::error::Error;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::small::Block;

/// Largest product of the lengths of a row of `B_s` and of the column of its inverse: normal and
/// tangents of a contact must be independent.
const MOST_OBLIQUE: f64 = 1e6;

/// Smallest `B_s` relative to the largest block of its contact: `B_s⁻¹` multiplies the rounding
/// of all others.
const LEAST: f64 = 1e-3;

/// Stiffnesses that differ by less than this are equal: they differ by rounding.
const EQUAL: f64 = 1e-6;

/// The variables of one contact.
#[derive(Clone, Debug)]
pub struct Frame<const D: usize> {
    pub node: usize,
    /// `u_s = from_local y`; rows of prescribed degrees of freedom are zero.
    pub from_local: Block<D>,
    /// `y = to_local u_s`.
    pub to_local: Block<D>,
    /// Whether component `k` of `v` has an unknown.
    pub free: [bool; D],
}

impl<const D: usize> Frame<D> {
    /// A contact without a free degree of freedom has no unknown, and no node.
    fn absent() -> Self {
        Self {
            node: usize::MAX,
            from_local: Block::zeros(),
            to_local: Block::zeros(),
            free: [false; D],
        }
    }
}

/// The columns of the rows of one contact at free degrees of freedom, by nodes.
pub(super) type Columns<const D: usize> = Vec<(usize, Block<D>)>;

const OBLIQUE: Error = Error::NotIterative {
    reason: "a support at a contact is oblique to the normal and the tangents",
};

/// Chooses the node of each contact. `free` are the places with a degree of freedom.
///
/// # Errors
/// [`Error::NotIterative`] if a contact has no node of its own, or if its supports are oblique.
pub(super) fn choose<const D: usize>(
    contacts: &[Columns<D>],
    free: &[bool],
    matrix: &BlockMatrix<f64>,
) -> Result<Vec<Frame<D>>, Error> {
    let mut uses = vec![0_u32; matrix.nodes()];
    for (node, _) in contacts.iter().flatten() {
        uses[*node] += 1;
    }
    let mut candidates = Vec::with_capacity(contacts.len());
    for columns in contacts {
        let own: Vec<&(usize, Block<D>)> = columns
            .iter()
            .filter(|(node, _)| uses[*node] == 1)
            .collect();
        if own.is_empty() && !columns.is_empty() {
            return Err(Error::NotIterative {
                reason: "each node of a contact has another contact too",
            });
        }
        let frames = own
            .iter()
            .filter_map(|(node, _)| frame(*node, columns, free));
        let frames: Vec<Frame<D>> = frames.collect();
        if frames.is_empty() && !columns.is_empty() {
            return Err(OBLIQUE);
        }
        candidates.push(frames);
    }
    if candidates.iter().all(|frames| frames.len() < 2) {
        let only = candidates.into_iter();
        return Ok(only
            .map(|mut frames| frames.pop().unwrap_or_else(Frame::absent))
            .collect());
    }
    Ok(softest(contacts, candidates, matrix))
}

/// Chooses one side of each pair of bodies: that with a candidate for most contacts; of two
/// such, the softer one; of two equal ones, the first.
fn softest<const D: usize>(
    contacts: &[Columns<D>],
    candidates: Vec<Vec<Frame<D>>>,
    matrix: &BlockMatrix<f64>,
) -> Vec<Frame<D>> {
    let body = matrix.connected();
    let bodies = |columns: &Columns<D>| {
        let mut list: Vec<u32> = columns.iter().map(|(node, _)| body[*node]).collect();
        list.sort_unstable();
        list.dedup();
        list
    };
    let mut sides: BTreeMap<Vec<u32>, BTreeMap<u32, (usize, f64)>> = BTreeMap::new();
    for (columns, frames) in contacts.iter().zip(&candidates) {
        let pair = sides.entry(bodies(columns)).or_default();
        let mut seen: Vec<u32> = Vec::new();
        for frame in frames {
            let side = body[frame.node];
            if seen.contains(&side) {
                continue;
            }
            seen.push(side);
            let block = matrix.diagonal_block(frame.node);
            let (count, stiffness) = pair.entry(side).or_default();
            *count += 1;
            *stiffness += (0..D).map(|k| block[k * D + k]).sum::<f64>();
        }
    }
    let chosen: BTreeMap<Vec<u32>, u32> = sides
        .into_iter()
        .filter_map(|(pair, sides)| {
            let mut sides = sides.into_iter();
            let mut best = sides.next()?;
            for (side, (count, stiffness)) in sides {
                let softer = stiffness < (1.0 - EQUAL) * best.1.1;
                if count > best.1.0 || (count == best.1.0 && softer) {
                    best = (side, (count, stiffness));
                }
            }
            Some((pair, best.0))
        })
        .collect();
    let pick = |(columns, frames): (&Columns<D>, Vec<Frame<D>>)| {
        let side = chosen.get(&bodies(columns));
        let size = |frame: &Frame<D>| frame.to_local.norm_squared();
        let better = |a: &Frame<D>, b: &Frame<D>| {
            let on_side = |frame: &Frame<D>| Some(&body[frame.node]) == side;
            (on_side(a), size(a)) > (on_side(b), size(b))
        };
        let mut frames = frames.into_iter();
        let first = frames.next().unwrap_or_else(Frame::absent);
        frames.fold(
            first,
            |best, next| if better(&next, &best) { next } else { best },
        )
    };
    contacts.iter().zip(candidates).map(pick).collect()
}

/// The variables of a contact with `node` as its own; `None` if the relative displacement does
/// not determine that of the node.
fn frame<const D: usize>(node: usize, columns: &Columns<D>, free: &[bool]) -> Option<Frame<D>> {
    let block = columns.iter().find(|(other, _)| *other == node)?.1;
    let row: [bool; D] = std::array::from_fn(|k| block.row(k).iter().any(|&b| b != 0.0));
    let column: [bool; D] = std::array::from_fn(|k| block.column(k).iter().any(|&b| b != 0.0));
    let own: [bool; D] = std::array::from_fn(|k| free[D * node + k]);
    let count = |used: [bool; D]| used.into_iter().filter(|&used| used).count();
    if count(row) != count(column) || column != own {
        return None;
    }
    // Masters must not move a component that the node cannot.
    let moved = |k: usize| {
        columns
            .iter()
            .any(|(_, other)| other.row(k).iter().any(|&b| b != 0.0))
    };
    if (0..D).any(|k| !row[k] && moved(k)) {
        return None;
    }
    let largest = columns
        .iter()
        .map(|(_, other)| other.amax())
        .fold(0.0, f64::max);
    if block.amax() < LEAST * largest {
        return None;
    }
    // Ones at the prescribed components make a regular block of full size.
    let mut whole = block;
    let held = |used: [bool; D]| (0..D).filter(move |&k| !used[k]);
    for (row, column) in held(row).zip(held(column)) {
        whole[(row, column)] = 1.0;
    }
    let inverse = whole.try_inverse()?;
    // The condition of normal and tangents, each row of length one.
    let sizes = (0..D).map(|k| whole.row(k).norm() * inverse.column(k).norm());
    if !(sizes.fold(0.0, f64::max) <= MOST_OBLIQUE) {
        return None;
    }
    let inside = |i: usize, j: usize| column[i] && row[j];
    Some(Frame {
        node,
        from_local: Block::from_fn(|i, j| if inside(i, j) { inverse[(i, j)] } else { 0.0 }),
        to_local: block,
        free: row,
    })
}
