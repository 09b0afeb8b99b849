//! Rows, columns and parts of the sparse matrices of the caller.

use std::collections::HashMap;

use crate::error::Error;
use crate::linalg::compensated::Sum;
use crate::linalg::sparse::csc::{Index, Symmetric, Symmetry, mix};
use crate::reduced::rotation::Rotation;

/// A borrowed matrix by rows; indices need not be sorted.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    pub row_ptr: &'a [usize],
    pub columns: &'a [usize],
    pub values: &'a [f64],
}

impl<'a> Rows<'a> {
    /// # Errors
    /// Structure, range or finiteness, with the place.
    pub fn check(&self, what: &'static str, rows: usize, columns: usize) -> Result<(), Error> {
        if self.row_ptr.len() != rows + 1 {
            return Err(Error::Shape {
                what,
                expected: rows + 1,
                found: self.row_ptr.len(),
            });
        }
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
    #[must_use]
    pub fn select(&self, number: impl Fn(usize) -> Option<usize>) -> OwnedMatrix {
        let mut out = OwnedMatrix::default();
        for row in 0..self.row_ptr.len() - 1 {
            for (column, value) in self.row(row) {
                if let Some(column) = number(column) {
                    out.index.push(column);
                    out.values.push(value);
                }
            }
            out.pointer.push(out.index.len());
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
    #[must_use]
    pub fn view(&self) -> Symmetric<'_> {
        Symmetric::of_checked(&self.pointer, &self.index, &self.values)
    }

    /// Some of the rows.
    #[must_use]
    pub fn rows(&self, rows: &[usize]) -> Self {
        let mut out = Self::default();
        for &row in rows {
            for (j, value) in self.entries(row) {
                out.index.push(j);
                out.values.push(value);
            }
            out.pointer.push(out.index.len());
        }
        out
    }

    /// `Q A` of a matrix by rows, with `D` rows for each contact.
    #[must_use]
    pub fn rotated<const D: usize>(&self, rotation: &Rotation<D>) -> Self {
        let mut out = Self::default();
        for contact in 0..rotation.contacts() {
            let of_row = |k| {
                self.entries(D * contact + k)
                    .map(move |(j, value)| (k, j, value))
            };
            for row in rotation.rows(contact, (0..D).flat_map(of_row)) {
                for (j, value) in row {
                    out.index.push(j);
                    out.values.push(value);
                }
                out.pointer.push(out.index.len());
            }
        }
        out
    }

    /// Whether all entries of a row are zero.
    #[must_use]
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

    /// `y += Aᵀ x`, rows compressed (`A x` for compressed columns).
    pub fn add_transposed_product(&self, x: &[f64], y: &mut [f64]) {
        for (k, &x) in x.iter().enumerate() {
            for (j, a) in self.entries(k) {
                y[j] += a * x;
            }
        }
    }
}

/// The free part of a symmetric matrix, both triangles from its lower one, and the global
/// numbers of its rows. Stored zeros are omitted except where [`in_use`] keeps them.
#[must_use]
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
#[must_use]
pub fn columns<I: Index>(
    k: &Symmetric<I>,
    fixed: &[usize],
    position: &[Option<usize>],
) -> OwnedMatrix {
    let mut out = OwnedMatrix::default();
    for &j in fixed {
        for (i, value) in k.column(j).filter(|&(i, _)| position[i].is_none()) {
            out.index.push(i);
            out.values.push(value);
        }
        out.pointer.push(out.index.len());
    }
    out
}

/// Number of each row within its component.
#[must_use]
pub fn local_numbers(component: &[usize], count: usize) -> Vec<usize> {
    let mut next = vec![0; count];
    let number = |&c: &usize| {
        next[c] += 1;
        next[c] - 1
    };
    component.iter().map(number).collect()
}

/// Splits a block-diagonal matrix into its components, with their rows.
#[must_use]
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
        for (i, value) in k.entries(j).filter(|&(i, _)| component[i] == c) {
            part.index.push(local[i]);
            part.values.push(value);
        }
        part.pointer.push(part.index.len());
    }
    parts
}

/// Position in `list` of each index below `n`.
///
/// # Errors
/// [`Error::IndexRange`], [`Error::Repeated`].
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
