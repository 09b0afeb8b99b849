//! The pattern of K with both triangles.

use std::borrow::Cow;

use crate::linalg::sparse::csc::{Symmetric, narrow};

/// The pattern with both triangles: that of K, unless rounding has cancelled an entry on one
/// side only.
pub(super) struct SymbolicPattern<'a> {
    pub(super) col_ptr: Cow<'a, [usize]>,
    pub(super) row_idx: Cow<'a, [usize]>,
    /// If both triangles of K are stored, the position of the lower partner of each upper
    /// entry: a search in each column would take longer than the rest of the analysis.
    pub(super) partner: Option<Vec<u32>>,
}

impl<'a> SymbolicPattern<'a> {
    pub(super) fn of(k: &Symmetric<'a>) -> Self {
        let mut whole = true;
        let mut partner = vec![0; k.values().len()];
        k.pairs(|_, _, lower, upper| match (lower, upper) {
            (Some(lower), Some(upper)) => partner[upper] = narrow(lower),
            _ => whole = false,
        });
        if whole {
            return Self {
                col_ptr: Cow::Borrowed(k.col_ptr()),
                row_idx: Cow::Borrowed(k.row_idx()),
                partner: Some(partner),
            };
        }
        let mut columns: Vec<Vec<usize>> = (0..k.n()).map(|j| vec![j]).collect();
        k.pairs(|i, j, _, _| {
            columns[j].push(i);
            columns[i].push(j);
        });
        let mut col_ptr = vec![0];
        let mut row_idx = Vec::new();
        for mut column in columns {
            column.sort_unstable();
            row_idx.extend(column);
            col_ptr.push(row_idx.len());
        }
        Self {
            col_ptr: Cow::Owned(col_ptr),
            row_idx: Cow::Owned(row_idx),
            partner: None,
        }
    }
}
