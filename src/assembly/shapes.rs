//! Cells that are equal up to translation: they share one matrix.

use std::collections::HashMap;

use crate::tasks;

/// Cells in one task.
const CELLS: usize = 1024;

/// Classes of equal cells.
#[derive(Clone, Debug)]
pub(crate) struct Shapes {
    /// The first cell of each class.
    pub(crate) first: Vec<u32>,
    /// The class of each cell.
    pub(crate) which: Vec<u32>,
}

/// Classes of the cells `0..count`, of which `key(cell, out)` appends the numbers that must be
/// equal bit by bit. `None` for more than `most` classes.
pub(crate) fn shapes(
    count: usize,
    most: usize,
    key: impl Fn(usize, &mut Vec<u64>) + Sync,
) -> Option<Shapes> {
    let mut hashes = vec![0_u64; count];
    tasks::for_each_with(hashes.chunks_mut(CELLS), Vec::new, |own, task, hashes| {
        for (k, hash) in hashes.iter_mut().enumerate() {
            own.clear();
            key(task * CELLS + k, own);
            *hash = own.iter().fold(0, |hash, bits| mixed(hash ^ bits));
        }
    });
    let mut classes = HashMap::new();
    let (mut first, mut which) = (Vec::new(), vec![0; count]);
    for (cell, (hash, class)) in (0..).zip(hashes.iter().zip(&mut which)) {
        let next = u32::try_from(first.len()).ok()?;
        *class = *classes.entry(hash).or_insert(next);
        if *class == next {
            if first.len() == most {
                return None;
            }
            first.push(cell);
        }
    }
    // Different cells may have the same hash.
    let equal = tasks::map(which.chunks(CELLS), |task, classes| {
        let (mut own, mut other) = (Vec::new(), Vec::new());
        classes.iter().enumerate().all(|(k, &class)| {
            own.clear();
            other.clear();
            key(task * CELLS + k, &mut own);
            key(first[class as usize] as usize, &mut other);
            own == other
        })
    });
    equal
        .iter()
        .all(|&equal| equal)
        .then_some(Shapes { first, which })
}

/// A bijection in which each bit changes about half of all bits (Stafford's thirteenth).
fn mixed(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (bits ^ (bits >> 31)).wrapping_add(0x9E37_79B9_7F4A_7C15)
}
