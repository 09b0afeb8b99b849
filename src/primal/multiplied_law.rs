//! The linearised law of a contact, multiplied by a block `M` so that each of its rows holds a
//! component, `dv_k = …`, or reads `(I + C) dr + V dv = M s`: the rows of a Newton step.

use crate::linalg::small::Block;

/// The law of one contact, multiplied by `M`.
#[derive(Clone, Debug)]
pub struct MultipliedLaw<const D: usize> {
    pub held: [bool; D],
    pub multiplier: Block<D>,
    /// `M by_r` and `M by_v` in the rows that are not held.
    pub by_r: Block<D>,
    pub by_v: Block<D>,
}

impl<const D: usize> MultipliedLaw<D> {
    /// The law `by_r dr + by_v dv = s`; `None` if it determines nothing. `free` are the components
    /// with an unknown; `least` is a compliance far below that of the contact.
    ///
    /// The row of the normal of a contact that dilates, `dv_n − β t·dv_t = s`, becomes a stiff
    /// spring and is not mixed with the others.
    pub fn new(by_r: Block<D>, mut by_v: Block<D>, free: [bool; D], least: f64) -> Option<Self> {
        for k in (0..D).filter(|&k| !free[k]) {
            by_v.fill_column(k, 0.0);
        }
        let moves = |k: usize| by_v[(k, k)] != 0.0 && by_r.row(k).amax() == 0.0;
        let held: [bool; D] = std::array::from_fn(|k| {
            let others = (0..D).filter(|&l| l != k);
            let alone = others.map(|l| by_v[(k, l)].abs()).sum::<f64>() == 0.0;
            free[k] && alone && moves(k)
        });
        let mut multiplied = by_r + by_v * least;
        for k in (0..D).filter(|&k| held[k] || (k == 0 && moves(k))) {
            multiplied.fill_row(k, 0.0);
            multiplied.fill_column(k, 0.0);
            multiplied[(k, k)] = if held[k] { 1.0 } else { least } * by_v[(k, k)];
        }
        let multiplier = multiplied.try_inverse()?;
        let (mut by_r, mut by_v) = (multiplier * by_r, multiplier * by_v);
        for k in (0..D).filter(|&k| held[k]) {
            by_r.fill_row(k, 0.0);
            by_v.fill_row(k, 0.0);
        }
        Some(Self {
            held,
            multiplier,
            by_r,
            by_v,
        })
    }
}
