//! The rank of a few columns: which combinations of motions vanish in the rows that tell.
//!
//! One-sided Jacobi rotations give each singular value with the same relative accuracy, so that
//! a small one is compared with the accuracy of the rows and not with rounding of the large ones.

use crate::linalg::jacobi::{combine, orthogonalise};
use crate::linalg::small::norm;

/// Accuracy of rows in double precision that come from positions and directions in the numbers
/// of the caller: half of the digits are left to the arms of the rows. A smaller combination,
/// relative to the largest, is not held.
pub const ACCURACY: f64 = 1e-8;

/// Accuracy of rows that are exact up to their last digits: the motions of one body at degrees
/// of freedom of its own. Smaller combinations are rounding of the positions: motions that the
/// body does not have, such as the rotation of a straight line about itself, or that move no
/// contact.
pub const SAME_BODY: f64 = 1e-11;

/// Orthogonal combinations of columns.
#[derive(Clone, Debug)]
pub struct Combinations {
    pub columns: Vec<Vec<f64>>,
    /// What each is made of; orthogonal.
    pub amounts: Vec<Vec<f64>>,
    /// Their lengths, the singular values.
    pub sizes: Vec<f64>,
}

impl Combinations {
    pub fn new(mut columns: Vec<Vec<f64>>) -> Self {
        let amounts = orthogonalise(&mut columns);
        Self {
            sizes: columns.iter().map(|column| norm(column)).collect(),
            columns,
            amounts,
        }
    }

    /// Whether each combination exceeds this share of the largest one, or not.
    pub fn exceed(&self, share: f64) -> impl Iterator<Item = bool> + '_ {
        let least = share * self.sizes.iter().copied().fold(0.0, f64::max);
        self.sizes.iter().map(move |&size| size > least)
    }
}

/// The columns, or the independent ones among their combinations if they depend on each other.
pub fn keep_independent(columns: Vec<Vec<f64>>, share: f64) -> Vec<Vec<f64>> {
    let of = Combinations::new(columns.clone());
    if of.exceed(share).all(|exceeds| exceeds) {
        return columns;
    }
    let kept = of.amounts.iter().zip(of.exceed(share));
    kept.filter(|(_, exceeds)| *exceeds)
        .map(|(amounts, _)| combine(&columns, amounts))
        .collect()
}
