//! Sparse symmetric matrices made entry by entry.

use std::collections::BTreeMap;

use bipot_rs::linalg::sparse::csc::Symmetric;
use rand::{RngExt, rngs::StdRng};

/// A symmetric matrix by columns, both triangles stored.
#[derive(Clone, Debug)]
pub(crate) struct Sparse {
    pub(crate) n: usize,
    pub(crate) col_ptr: Vec<usize>,
    pub(crate) row_idx: Vec<usize>,
    pub(crate) values: Vec<f64>,
}

/// Entries of a matrix that is being summed up, by column and row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Entries(BTreeMap<(usize, usize), f64>);

impl Entries {
    /// Adds to the entries `(i, j)` and `(j, i)`, once where they are one.
    pub(crate) fn add(&mut self, i: usize, j: usize, value: f64) {
        *self.0.entry((i, j)).or_default() += value;
        if i != j {
            *self.0.entry((j, i)).or_default() += value;
        }
    }

    /// A spring of stiffness `k` between two unknowns.
    pub(crate) fn spring(&mut self, i: usize, j: usize, k: f64) {
        self.add(i, i, k);
        self.add(j, j, k);
        self.add(i, j, -k);
    }

    pub(crate) fn matrix(self, n: usize) -> Sparse {
        let mut col_ptr = vec![0; n + 1];
        for &(j, _) in self.0.keys() {
            col_ptr[j + 1] += 1;
        }
        for j in 0..n {
            col_ptr[j + 1] += col_ptr[j];
        }
        Sparse {
            n,
            col_ptr,
            row_idx: self.0.keys().map(|&(_, i)| i).collect(),
            values: self.0.into_values().collect(),
        }
    }
}

impl Sparse {
    /// From a dense symmetric matrix; zeros are not stored.
    pub(crate) fn from_dense(n: usize, dense: &[f64]) -> Self {
        let mut entries = Entries::default();
        for j in 0..n {
            for i in (0..=j).filter(|&i| dense[j * n + i] != 0.0) {
                entries.add(i, j, dense[j * n + i]);
            }
        }
        entries.matrix(n)
    }

    pub(crate) fn view(&self) -> Symmetric<'_> {
        Symmetric::new(self.n, &self.col_ptr, &self.row_idx, &self.values).unwrap()
    }

    fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let view = self.view(); // checked once
        (0..self.n).flat_map(move |j| view.column(j).map(move |(i, v)| (i, j, v)))
    }

    pub(crate) fn dense(&self) -> Vec<f64> {
        let mut dense = vec![0.0; self.n * self.n];
        for (i, j, value) in self.entries() {
            dense[j * self.n + i] = value;
        }
        dense
    }

    /// The rows and columns whose new number is given; the others are left out.
    pub(crate) fn renumbered(&self, number: &[Option<usize>]) -> Self {
        let mut moved = Entries::default();
        for (i, j, value) in self.entries().filter(|&(i, j, _)| i <= j) {
            if let (Some(i), Some(j)) = (number[i], number[j]) {
                moved.add(i, j, value);
            }
        }
        moved.matrix(number.iter().flatten().count())
    }

    /// Every entry times `unit(i) unit(j)`.
    pub(crate) fn scaled(&self, unit: impl Fn(usize) -> f64) -> Self {
        let mut scaled = self.clone();
        let entries = self.entries().zip(&mut scaled.values);
        entries.for_each(|((i, j, value), to)| *to = value * unit(i) * unit(j));
        scaled
    }
}

pub(crate) fn shuffle<T>(list: &mut [T], random: &mut StdRng) {
    for i in (1..list.len()).rev() {
        list.swap(i, random.random_range(0..=i));
    }
}
