//! The node of each contact whose displacement its relative displacement replaces.
//!
//! Such a node occurs in the rows of this contact only, or otherwise in those of contacts that
//! have chosen a node before. So contacts in the order of choice depend on later ones only, and
//! `T` is the product of simple changes of variables. All other nodes of the rows are masters.

use std::collections::BTreeMap;
use std::fmt;

use crate::error::Error;
use crate::linalg::small::Block;
use crate::linalg::sparse::csc::narrow;

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

/// What the choice needs to know of the nodes.
#[derive(Clone, Copy)]
pub struct AboutNodes<'a, const D: usize> {
    /// The places with a degree of freedom.
    pub free: &'a [bool],
    /// The diagonal block of `K` of a node, with positive numbers at the other places.
    pub block: &'a dyn Fn(usize) -> Block<D>,
    /// The body of each node.
    pub bodies: &'a dyn Fn() -> Vec<u32>,
}

impl<const D: usize> fmt::Debug for AboutNodes<'_, D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("AboutNodes");
        shown.field("free", &self.free).finish_non_exhaustive()
    }
}

/// Chooses the node of each contact, and gives the contacts with a node in the order of choice.
pub(super) fn choose<const D: usize>(
    contacts: &[Columns<D>],
    nodes: &AboutNodes<'_, D>,
) -> Result<(Vec<Frame<D>>, Vec<u32>), Error> {
    let mut uses = vec![0_u32; nodes.free.len() / D];
    for (node, _) in contacts.iter().flatten() {
        uses[*node] += 1;
    }
    let mut list: Vec<Frame<D>> = contacts.iter().map(|_| Frame::absent()).collect();
    let mut order = Vec::with_capacity(contacts.len());
    let mut left: Vec<usize> = (0..contacts.len()).collect();
    left.retain(|&i| !contacts[i].is_empty());
    let mut body = None;
    while !left.is_empty() {
        let mut oblique = None;
        let (mut chosen, mut candidates, mut later) = (Vec::new(), Vec::new(), Vec::new());
        for i in left {
            let own = contacts[i].iter().filter(|(node, _)| uses[*node] == 1);
            let mut frames = own
                .map(|(node, _)| frame(*node, &contacts[i], nodes.free))
                .peekable();
            let alone = frames.peek().is_some();
            let frames: Vec<Frame<D>> = frames.flatten().collect();
            if frames.is_empty() {
                later.push(i);
                if alone {
                    oblique = oblique.or(Some(i));
                }
            } else {
                chosen.push(i);
                candidates.push(frames);
            }
        }
        if chosen.is_empty() {
            return Err(Error::NoOwnNode {
                contact: oblique.unwrap_or(later[0]),
                oblique: oblique.is_some(),
                contacts: later,
            });
        }
        if candidates.iter().any(|frames| frames.len() > 1) {
            let body = body.get_or_insert_with(nodes.bodies);
            let columns: Vec<&Columns<D>> = chosen.iter().map(|&i| &contacts[i]).collect();
            keep_softest(&columns, &mut candidates, nodes.block, body);
        }
        for (&i, frames) in chosen.iter().zip(candidates) {
            list[i] = frames.into_iter().next().unwrap_or_else(Frame::absent);
            for (node, _) in &contacts[i] {
                uses[*node] -= 1;
            }
            order.push(narrow(i));
        }
        left = later;
    }
    Ok((list, order))
}

/// Chooses one side of each pair of bodies: that with a candidate for most contacts; of two
/// such, the softer one; of two equal ones, the first.
fn keep_softest<const D: usize>(
    contacts: &[&Columns<D>],
    candidates: &mut [Vec<Frame<D>>],
    block: &dyn Fn(usize) -> Block<D>,
    body: &[u32],
) {
    let bodies = |columns: &Columns<D>| {
        let mut list: Vec<u32> = columns.iter().map(|(node, _)| body[*node]).collect();
        list.sort_unstable();
        list.dedup();
        list
    };
    let mut sides: BTreeMap<Vec<u32>, BTreeMap<u32, (usize, f64)>> = BTreeMap::new();
    for (columns, frames) in contacts.iter().zip(&*candidates) {
        let pair = sides.entry(bodies(columns)).or_default();
        let mut seen: Vec<u32> = Vec::new();
        for frame in frames {
            let side = body[frame.node];
            if seen.contains(&side) {
                continue;
            }
            seen.push(side);
            let block = block(frame.node);
            let (count, stiffness) = pair.entry(side).or_default();
            *count += 1;
            *stiffness += (0..D).map(|k| block[(k, k)]).sum::<f64>();
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
    for (columns, frames) in contacts.iter().zip(candidates) {
        let side = chosen.get(&bodies(columns));
        let on_side = |frame: &Frame<D>| Some(&body[frame.node]) == side;
        let size = |frame: &Frame<D>| frame.to_local.norm_squared();
        let mut best = 0;
        for at in 1..frames.len() {
            let (old, new) = (&frames[best], &frames[at]);
            if (on_side(new), size(new)) > (on_side(old), size(old)) {
                best = at;
            }
        }
        frames.swap(0, best);
    }
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
