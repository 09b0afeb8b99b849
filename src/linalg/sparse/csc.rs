//! Checked view of a symmetric sparse matrix.

use crate::error::{Error, check_length};
use crate::linalg::union::Union;
use crate::tasks;

/// Largest asymmetry of a pair, relative to `√|K_ii K_jj|`.
///
/// Another order of assembly changes an entry by a few 1e-16 of its terms. A difference six
/// digits above this is a mistake, not rounding.
const ASYMMETRY: f64 = 1e-10;

/// The relation between the two triangles of a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// Each entry is stored twice, bitwise equal.
    Exact,
    /// They agree up to rounding.
    Rounded,
}

/// An index of the caller, who may have 32 bits for each: a copy as `usize` would take as much
/// memory as the values.
pub trait Index: Copy + Default + Ord + Send + Sync {
    /// A negative one becomes so large that it is out of every range.
    fn at(self) -> usize;

    /// The index, which the caller knows to fit.
    fn of(value: usize) -> Self;
}

macro_rules! index {
    ($($kind:ty)+) => {$(
        #[allow(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "out of every range, and compared with the type by the caller"
        )]
        impl Index for $kind {
            #[inline]
            fn at(self) -> usize {
                self as usize
            }

            #[inline]
            fn of(value: usize) -> Self {
                value as Self
            }
        }
    )+};
}

index!(i32 i64 usize);

/// A symmetric `n × n` matrix by columns, with both triangles and ascending row indices in each
/// column. Because it is symmetric, CSR arrays are valid too.
#[derive(Clone, Copy, Debug)]
pub struct Symmetric<'a, I = usize> {
    n: usize,
    col_ptr: &'a [usize],
    row_idx: &'a [I],
    values: &'a [f64],
}

impl<'a, I: Index> Symmetric<'a, I> {
    /// Checks structure and finiteness, once.
    pub fn new(
        n: usize,
        col_ptr: &'a [usize],
        row_idx: &'a [I],
        values: &'a [f64],
    ) -> Result<Self, Error> {
        check_length("column pointers of K", col_ptr.len(), n + 1)?;
        check_length("values of K", values.len(), row_idx.len())?;
        let broken = |row| Error::SparseStructure { what: "K", row };
        if col_ptr[0] != 0 {
            return Err(broken(0));
        }
        for j in 0..n {
            let (start, end) = (col_ptr[j], col_ptr[j + 1]);
            if end < start || end > row_idx.len() {
                return Err(broken(j));
            }
            let rows = &row_idx[start..end];
            // Without an early exit the compiler compares several at once.
            let later = rows.iter().skip(1);
            let rise = rows.iter().zip(later).filter(|(a, b)| a >= b).count() == 0;
            let finite = values[start..end].iter().filter(|v| !v.is_finite()).count() == 0;
            // Rising and signed: the first tells of a negative one.
            let ends = [rows.first(), rows.last()];
            if rise && finite && ends.iter().all(|end| end.is_none_or(|i| i.at() < n)) {
                continue;
            }
            if let Some(at) = rows.iter().position(|i| i.at() >= n) {
                return Err(Error::IndexRange {
                    what: "row indices of K",
                    position: start + at,
                    found: rows[at].at(),
                    limit: n,
                });
            }
            if !rise {
                return Err(broken(j));
            }
            if let Some(at) = values[start..end].iter().position(|v| !v.is_finite()) {
                return Err(Error::EntryNotFinite {
                    what: "K",
                    row: rows[at].at(),
                    column: j,
                    value: values[start + at],
                });
            }
        }
        check_length("row indices of K", row_idx.len(), col_ptr[n])?;
        Ok(Self {
            n,
            col_ptr,
            row_idx,
            values,
        })
    }

    /// A matrix made here from a checked one: a second check would take as long as a large part
    /// of the analysis.
    pub(crate) fn of_checked(col_ptr: &'a [usize], row_idx: &'a [I], values: &'a [f64]) -> Self {
        let n = col_ptr.len() - 1;
        debug_assert!(Self::new(n, col_ptr, row_idx, values).is_ok());
        Self {
            n,
            col_ptr,
            row_idx,
            values,
        }
    }

    /// Order of the matrix.
    pub fn n(&self) -> usize {
        self.n
    }

    /// The start of each column, `n + 1` numbers.
    pub fn col_ptr(&self) -> &'a [usize] {
        self.col_ptr
    }

    /// The row of each stored entry.
    pub fn row_idx(&self) -> &'a [I] {
        self.row_idx
    }

    /// Number of stored entries.
    pub fn values(&self) -> &'a [f64] {
        self.values
    }

    /// Rows and values of column `j`.
    pub fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> + use<'a, I> {
        let range = self.col_ptr[j]..self.col_ptr[j + 1];
        self.row_idx[range.clone()]
            .iter()
            .map(|i| i.at())
            .zip(self.values[range].iter().copied())
    }

    /// The diagonal; an entry that is not stored is zero.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.n)
            .map(|j| self.position(j, j).map_or(0.0, |at| self.values[at]))
            .collect()
    }

    /// The position of entry `(i, j)`, if it is stored.
    pub(crate) fn position(&self, i: usize, j: usize) -> Option<usize> {
        let start = self.col_ptr[j];
        self.row_idx[start..self.col_ptr[j + 1]]
            .binary_search_by_key(&i, |row| row.at())
            .ok()
            .map(|at| start + at)
    }

    /// Calls `visit(i, j, lower, upper)`, `i > j`, for each pair with at least one stored
    /// entry, with the positions of its entries.
    pub(crate) fn pairs(&self, mut visit: impl FnMut(usize, usize, Option<usize>, Option<usize>)) {
        // Columns are visited in order, so the partners (j, i) of column i occur with ascending
        // j: one cursor for each column finds all of them in one pass.
        let mut cursor = self.col_ptr[..self.n].to_vec();
        for j in 0..self.n {
            for at in self.col_ptr[j]..self.col_ptr[j + 1] {
                let i = self.row_idx[at].at();
                if i <= j {
                    continue;
                }
                while cursor[i] < self.col_ptr[i + 1] && self.row_idx[cursor[i]].at() < j {
                    visit(i, self.row_idx[cursor[i]].at(), None, Some(cursor[i]));
                    cursor[i] += 1;
                }
                let partner = (cursor[i] < self.col_ptr[i + 1]
                    && self.row_idx[cursor[i]].at() == j)
                    .then_some(cursor[i]);
                visit(i, j, Some(at), partner);
                cursor[i] += usize::from(partner.is_some());
            }
        }
        for (i, &from) in cursor.iter().enumerate() {
            for at in from..self.col_ptr[i + 1] {
                if self.row_idx[at].at() >= i {
                    break;
                }
                visit(i, self.row_idx[at].at(), None, Some(at));
            }
        }
    }

    /// Whether K is symmetric up to rounding; a missing partner is zero.
    ///
    /// # Errors
    /// [`Error::Asymmetric`] with the pair of largest asymmetry relative to `√|K_ii K_jj|`, or
    /// to the larger entry if a diagonal is zero. A change of units, of the whole or of one
    /// unknown, does not change the result.
    pub fn check_symmetry(&self) -> Result<Symmetry, Error> {
        if self.is_exact() {
            return Ok(Symmetry::Exact);
        }
        let diagonal = self.diagonal();
        let mut worst: Option<(f64, Error)> = None;
        self.pairs(|i, j, lower, upper| {
            let value = |at: Option<usize>| at.map_or(0.0, |at| self.values[at]);
            let (lower, upper) = (value(lower), value(upper));
            if lower.to_bits() == upper.to_bits() {
                return;
            }
            // Two roots: the product of two diagonals may overflow.
            let mut scale = diagonal[i].abs().sqrt() * diagonal[j].abs().sqrt();
            if scale == 0.0 {
                scale = lower.abs().max(upper.abs());
            }
            let difference = (lower - upper).abs();
            if difference > ASYMMETRY * scale {
                let ratio = difference / scale;
                if worst.as_ref().is_none_or(|(known, _)| ratio > *known) {
                    let error = Error::Asymmetric {
                        row: j,
                        column: i,
                        upper,
                        lower,
                    };
                    worst = Some((ratio, error));
                }
            }
        });
        worst.map_or(Ok(Symmetry::Rounded), |(_, error)| Err(error))
    }

    /// Whether each pair is stored and bitwise equal, as after assembly: one pass over half of
    /// the entries.
    fn is_exact(&self) -> bool {
        /// Columns in one task, at least: each has a cursor for every column.
        const LEAST: usize = 1 << 14;
        let columns = self.n.div_ceil(2 * rayon::current_num_threads()).max(LEAST);
        // Entries with their partners, of the columns of each task.
        let paired = tasks::map(0..self.n.div_ceil(columns), |_, task| {
            let first = task * columns;
            // As in `pairs`; the cursor of a column has passed its upper entries when its turn
            // comes.
            let mut cursor = vec![usize::MAX; self.n];
            let mut paired = 0;
            for j in first..self.n.min(first + columns) {
                for at in self.from(&mut cursor, j, first)..self.col_ptr[j + 1] {
                    let i = self.row_idx[at].at();
                    if i == j {
                        paired += 1;
                        continue;
                    }
                    let partner = self.from(&mut cursor, i, first);
                    cursor[i] = partner + 1;
                    if i < j
                        || partner >= self.col_ptr[i + 1]
                        || self.row_idx[partner].at() != j
                        || self.values[partner].to_bits() != self.values[at].to_bits()
                    {
                        return None;
                    }
                    paired += 2;
                }
            }
            Some(paired)
        });
        // An upper entry of a later task may lack its partner.
        let whole = paired.into_iter().sum::<Option<usize>>();
        whole == Some(self.values.len())
    }

    /// The cursor of column `j`, at first at its first entry from row `first` on.
    #[inline]
    fn from(&self, cursor: &mut [usize], j: usize, first: usize) -> usize {
        if cursor[j] == usize::MAX {
            let column = self.col_ptr[j]..self.col_ptr[j + 1];
            let before = self.row_idx[column.clone()].partition_point(|i| i.at() < first);
            cursor[j] = column.start + before;
        }
        cursor[j]
    }

    /// Number of the connected component of each row, from 0 in the order of first appearance.
    /// A stored zero does not connect.
    pub fn components(&self) -> Vec<usize> {
        let mut sets = Union::new(self.n);
        for j in 0..self.n {
            let (start, end) = (self.col_ptr[j], self.col_ptr[j + 1]);
            let above = self.row_idx[start..end].partition_point(|i| i.at() <= j);
            for at in start + above..end {
                if self.values[at] != 0.0 {
                    sets.join(j, self.row_idx[at].at());
                }
            }
        }
        sets.numbers()
    }

    /// `y = K x` by rows (a row is read from its column), so that each sum has one order for
    /// any number of threads.
    pub fn product(&self, x: &[f64], y: &mut [f64]) {
        /// Rows in one task: some ten microseconds.
        const ROWS: usize = 1024;
        assert_eq!(x.len(), self.n);
        assert_eq!(y.len(), self.n);
        tasks::for_each(y.chunks_mut(ROWS), |chunk, y| {
            for (k, y) in y.iter_mut().enumerate() {
                *y = self.column(chunk * ROWS + k).map(|(i, v)| v * x[i]).sum();
            }
        });
    }
}

/// Position in `list` of each index below `n`.
pub fn positions(
    what: &'static str,
    list: &[usize],
    n: usize,
) -> Result<Vec<Option<usize>>, Error> {
    let mut position = vec![None; n];
    for (k, &index) in list.iter().enumerate() {
        let Some(slot) = position.get_mut(index) else {
            return Err(Error::IndexRange {
                what,
                position: k,
                found: index,
                limit: n,
            });
        };
        if let Some(first) = slot.replace(k) {
            return Err(Error::Repeated {
                what,
                index,
                first,
                second: k,
            });
        }
    }
    Ok(position)
}

/// An index in 32 bits; the analysis has checked that this suffices.
pub(crate) fn narrow(i: usize) -> u32 {
    u32::try_from(i).expect("sizes are checked at the border")
}

/// A hash; the sum over a pattern distinguishes it from others.
pub(crate) fn mix(i: usize) -> u64 {
    let x = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (x ^ (x >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9)
}
