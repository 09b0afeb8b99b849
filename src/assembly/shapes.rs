//! Cells that are equal up to translation: they share one matrix.

use std::collections::HashMap;

use rayon::prelude::*;

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
    hashes
        .par_iter_mut()
        .enumerate()
        .with_min_len(1024)
        .for_each_init(Vec::new, |own, (cell, hash)| {
            own.clear();
            key(cell, own);
            *hash = own.iter().fold(0, |hash, bits| mixed(hash ^ bits));
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
    let equal = which
        .par_iter()
        .enumerate()
        .with_min_len(1024)
        .map_init(
            || (Vec::new(), Vec::new()),
            |(own, other), (cell, &class)| {
                own.clear();
                other.clear();
                key(cell, own);
                key(first[class as usize] as usize, other);
                own == other
            },
        )
        .all(|equal| equal);
    equal.then_some(Shapes { first, which })
}

/// A bijection in which each bit changes about half of all bits (Stafford's thirteenth).
fn mixed(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (bits ^ (bits >> 31)).wrapping_add(0x9E37_79B9_7F4A_7C15)
}
