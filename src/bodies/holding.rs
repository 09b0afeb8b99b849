//! What holds bodies: supports, springs and contacts, as rows in the amounts of rigid motions.
//!
//! A motion is free if it moves no row. Only the triangle of the QR factorisation of the rows of
//! a body is kept: it has the same singular values, and the triangles of several ranks are rows
//! again.

use crate::bodies::rank::{ACCURACY, Combinations};

/// More bodies that contact alone holds are left to the direct engine: the work for each contact
/// grows with the square of their number.
pub const MOST_LOOSE: usize = 32;

/// The rows that hold each of some bodies with equal numbers of motions.
#[derive(Clone, Debug)]
pub struct Holding {
    motions: usize,
    /// Upper triangles, `m × m` by rows.
    triangles: Vec<Vec<f64>>,
}

impl Holding {
    /// Bodies that nothing holds.
    #[must_use]
    pub fn new(bodies: usize, motions: usize) -> Self {
        Self {
            motions,
            triangles: vec![vec![0.0; motions * motions]; bodies],
        }
    }

    #[must_use]
    pub fn bodies(&self) -> usize {
        self.triangles.len()
    }

    #[must_use]
    pub fn motions(&self) -> usize {
        self.motions
    }

    /// The rows of a body, an upper triangle.
    #[must_use]
    pub fn triangle(&self, body: usize) -> &[f64] {
        &self.triangles[body]
    }

    /// Adds a row: the displacement or the force that the motions of a body have there.
    pub fn hold(&mut self, body: usize, row: &[f64]) {
        let m = self.motions;
        let mut row = row.to_vec();
        let triangle = self.triangles[body].chunks_exact_mut(m.max(1));
        for (k, above) in triangle.enumerate() {
            if row[k] == 0.0 {
                continue;
            }
            let length = above[k].hypot(row[k]);
            let (cosine, sine) = (above[k] / length, row[k] / length);
            for (above, below) in above[k..].iter_mut().zip(&mut row[k..]) {
                (*above, *below) = (
                    cosine * *above + sine * *below,
                    cosine * *below - sine * *above,
                );
            }
        }
    }

    /// A body of one node without rotations cannot turn: the motions after the first
    /// `translations` move nothing.
    pub fn hold_rotations(&mut self, body: usize, translations: usize) {
        for rotation in translations..self.motions {
            let mut row = vec![0.0; self.motions];
            row[rotation] = 1.0;
            self.hold(body, &row);
        }
    }

    /// Whether no motion of a body is free.
    #[must_use]
    pub fn is_held(&self, body: usize) -> bool {
        self.combine(body).exceed(ACCURACY).all(|exceeds| exceeds)
    }

    /// The amounts of the free motions of a body, orthonormal; `accuracy` is that of the rows.
    #[must_use]
    pub fn find_free_motions(&self, body: usize, accuracy: f64) -> Vec<Vec<f64>> {
        let combinations = self.combine(body);
        let held: Vec<bool> = combinations.exceed(accuracy).collect();
        let amounts = combinations.amounts.into_iter().zip(held);
        amounts
            .filter_map(|(amounts, held)| (!held).then_some(amounts))
            .collect()
    }

    /// Some bodies as one, with the motions of each after those of the one before.
    #[must_use]
    pub fn join(&self, bodies: &[usize]) -> Self {
        let mut joined = Self::new(1, self.motions * bodies.len());
        let width = joined.motions;
        for (b, &body) in bodies.iter().enumerate() {
            for (k, row) in self.triangles[body].chunks_exact(self.motions).enumerate() {
                let at = (self.motions * b + k) * width + self.motions * b;
                joined.triangles[0][at..at + self.motions].copy_from_slice(row);
            }
        }
        joined
    }

    fn combine(&self, body: usize) -> Combinations {
        let column = |k: usize| {
            let entries = self.triangles[body].iter().skip(k).step_by(self.motions);
            entries.copied().collect()
        };
        Combinations::new((0..self.motions).map(column).collect())
    }
}
