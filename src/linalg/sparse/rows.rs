//! Sparse matrices by rows, borrowed or owned.

use crate::error::{Error, check_length};
use crate::linalg::compensated::Sum;
use crate::linalg::sparse::csc::Symmetric;

/// A borrowed matrix by rows; indices need not be sorted.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    pub row_ptr: &'a [usize],
    pub columns: &'a [usize],
    pub values: &'a [f64],
}

impl<'a> Rows<'a> {
    pub fn check(&self, what: &'static str, rows: usize, columns: usize) -> Result<(), Error> {
        check_length(what, self.row_ptr.len(), rows + 1)?;
        let entries = self.columns.len();
        let broken = |row: &usize| self.row_ptr[*row] > self.row_ptr[row + 1];
        let ends = self.row_ptr[0] == 0 && self.row_ptr[rows] == entries;
        if let Some(row) = (0..rows).find(broken) {
            return Err(Error::SparseStructure { what, row });
        }
        if !ends || self.values.len() != entries {
            return Err(Error::SparseStructure { what, row: rows });
        }
        for row in 0..rows {
            for (column, value) in self.row(row) {
                if column >= columns {
                    return Err(Error::IndexRange {
                        what,
                        position: row,
                        found: column,
                        limit: columns,
                    });
                }
                if !value.is_finite() {
                    return Err(Error::EntryNotFinite {
                        what,
                        row,
                        column,
                        value,
                    });
                }
            }
        }
        Ok(())
    }

    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + 'a {
        let range = self.row_ptr[row]..self.row_ptr[row + 1];
        self.columns[range.clone()]
            .iter()
            .copied()
            .zip(self.values[range].iter().copied())
    }

    /// The columns that `number` gives a new number, under this number.
    pub fn select(&self, number: impl Fn(usize) -> Option<usize>) -> OwnedMatrix {
        let mut out = OwnedMatrix::default();
        for row in 0..self.row_ptr.len() - 1 {
            let entries = self.row(row);
            out.push(entries.filter_map(|(j, value)| Some((number(j)?, value))));
        }
        out
    }

    /// The nonzero entries of a row at free degrees of freedom, for each body, under local
    /// numbers.
    pub(crate) fn by_body(
        &self,
        row: usize,
        place: &[Option<(usize, usize)>],
    ) -> Vec<(usize, Vec<(usize, f64)>)> {
        let mut found: Vec<(usize, Vec<(usize, f64)>)> = Vec::new();
        for (column, value) in self.row(row).filter(|&(_, value)| value != 0.0) {
            let Some((body, local)) = place[column] else {
                continue;
            };
            match found.iter_mut().find(|(b, _)| *b == body) {
                Some((_, entries)) => entries.push((local, value)),
                None => found.push((body, vec![(local, value)])),
            }
        }
        found
    }
}

/// An owned matrix, compressed by rows or by columns as its owner decides.
#[derive(Clone, Debug)]
pub struct OwnedMatrix {
    pub pointer: Vec<usize>,
    pub index: Vec<usize>,
    pub values: Vec<f64>,
}

impl Default for OwnedMatrix {
    fn default() -> Self {
        Self {
            pointer: vec![0],
            index: Vec::new(),
            values: Vec::new(),
        }
    }
}

impl OwnedMatrix {
    /// As a symmetric matrix: it is the free part of one, or a component of it.
    pub fn view(&self) -> Symmetric<'_> {
        Symmetric::of_checked(&self.pointer, &self.index, &self.values)
    }

    /// Adds a row.
    pub fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>) {
        for (j, value) in entries {
            self.index.push(j);
            self.values.push(value);
        }
        self.pointer.push(self.index.len());
    }

    /// Some of the rows.
    pub fn rows(&self, rows: &[usize]) -> Self {
        let mut out = Self::default();
        for &row in rows {
            out.push(self.entries(row));
        }
        out
    }

    /// Whether all entries of a row are zero.
    pub fn is_empty_row(&self, row: usize) -> bool {
        self.entries(row).all(|(_, value)| value == 0.0)
    }

    /// `b − A x` for the matrix by rows, with sums in twice the precision.
    pub(crate) fn residual(&self, x: &[f64], b: &[f64]) -> Vec<f64> {
        let of_row = |(k, b): (usize, &f64)| {
            let mut sum = Sum::new(*b);
            for (j, value) in self.entries(k) {
                sum.add_product(-value, x[j]);
            }
            sum.value()
        };
        b.iter().enumerate().map(of_row).collect()
    }

    /// `b − A x` as [`OwnedMatrix::residual`], and `|A| |x| + |b|`; `low` are the digits of `x`
    /// below its rounding.
    pub(crate) fn residual_and_size(
        &self,
        x: &[f64],
        low: Option<&[f64]>,
        b: &[f64],
    ) -> (Vec<f64>, Vec<f64>) {
        let of_row = |(k, b): (usize, &f64)| {
            let (mut sum, mut size) = (Sum::new(*b), b.abs());
            for (j, value) in self.entries(k) {
                sum.add_product(-value, x[j]);
                if let Some(low) = low {
                    sum.add_product(-value, low[j]);
                }
                size += (value * x[j]).abs();
            }
            (sum.value(), size)
        };
        b.iter().enumerate().map(of_row).unzip()
    }

    /// `y += A x` for the matrix by rows.
    pub(crate) fn add_to_sums(&self, x: &[f64], y: &mut [Sum]) {
        for (k, sum) in y.iter_mut().enumerate() {
            for (j, value) in self.entries(k) {
                sum.add_product(value, x[j]);
            }
        }
    }

    /// Entry `i` of the diagonal; columns are ascending.
    pub(crate) fn diagonal(&self, i: usize) -> f64 {
        let column = self.pointer[i]..self.pointer[i + 1];
        let at = self.index[column.clone()].binary_search(&i);
        at.map_or(0.0, |at| self.values[column.start + at])
    }

    /// `xᵀ |A| x` for `x ≥ 0`.
    pub(crate) fn absolute_form(&self, x: &[f64]) -> f64 {
        let of_row = |(k, xk): (usize, &f64)| {
            let row = self.entries(k).map(|(j, value)| value.abs() * x[j]);
            xk * row.sum::<f64>()
        };
        x.iter().enumerate().map(of_row).sum()
    }

    pub(crate) fn entries(&self, k: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.pointer[k]..self.pointer[k + 1];
        self.index[range.clone()]
            .iter()
            .copied()
            .zip(self.values[range].iter().copied())
    }

    /// `y += A x`, rows compressed.
    pub fn add_product(&self, x: &[f64], y: &mut [f64]) {
        for (row, value) in y.iter_mut().enumerate() {
            *value += self.entries(row).map(|(j, a)| a * x[j]).sum::<f64>();
        }
    }

    /// `y += |A| |x|`, rows compressed.
    pub fn add_absolute_product(&self, x: &[f64], y: &mut [f64]) {
        for (row, value) in y.iter_mut().enumerate() {
            *value += self
                .entries(row)
                .map(|(j, a)| (a * x[j]).abs())
                .sum::<f64>();
        }
    }

    /// Whether `sum`, which is `start + (A x)_k`, is the rounding of its terms.
    pub(crate) fn cancels(&self, k: usize, x: &[f64], start: f64, sum: f64) -> bool {
        let terms = self.entries(k).map(|(j, a)| (a * x[j]).abs());
        sum.abs() <= 4.0 * f64::EPSILON * (start.abs() + terms.sum::<f64>())
    }

    /// `y += Aᵀ x`, rows compressed (`A x` for compressed columns).
    pub fn add_transposed_product(&self, x: &[f64], y: &mut [f64]) {
        for (k, &x) in x.iter().enumerate() {
            for (j, a) in self.entries(k) {
                y[j] += a * x;
            }
        }
    }
}
