//! The rigid motions of bodies that only contact holds, by contacts: a contact is moved by those
//! of two bodies, however many there are.

use crate::error::Error;
use crate::linalg::small::Block;
use crate::linalg::sparse::rows::Rows;

/// The columns of `R`; of each contact, the motions that move it, in their order.
#[derive(Clone, Debug, Default)]
pub struct RigidMotions<const D: usize> {
    count: usize,
    start: Vec<usize>,
    motion: Vec<usize>,
    values: Vec<[f64; D]>,
}

/// The block of a contact and of the `D` motions around one, by which the contact moves as given: beside
/// a matrix of contacts, motions are in blocks of `D`.
pub fn border_block<const D: usize>(motion: usize, moved: &[f64; D]) -> Block<D> {
    Block::from_fn(|k, l| if l == motion % D { moved[k] } else { 0.0 })
}

impl<const D: usize> From<Vec<Vec<[f64; D]>>> for RigidMotions<D> {
    /// From columns, each with all contacts.
    fn from(columns: Vec<Vec<[f64; D]>>) -> Self {
        let contacts = columns.iter().map(Vec::len).max().unwrap_or(0);
        let at = |i: usize| {
            let all = columns.iter().enumerate();
            all.filter_map(move |(c, column)| column.get(i).map(|&value| (c, value)))
        };
        Self::collect(columns.len(), (0..contacts).map(at))
    }
}

impl<const D: usize> RigidMotions<D> {
    /// From `R` by rows, `D` for each contact.
    pub fn from_rows(rows: Rows, contacts: usize, count: usize) -> Result<Self, Error> {
        rows.check("R", D * contacts, count)?;
        let mut at = vec![[0.0; D]; count];
        let mut all = Self {
            count,
            start: vec![0],
            ..Self::default()
        };
        for contact in 0..contacts {
            let mut moved = Vec::new();
            for row in D * contact..D * (contact + 1) {
                for (c, value) in rows.row(row) {
                    at[c][row % D] += value;
                    moved.push(c);
                }
            }
            moved.sort_unstable();
            moved.dedup();
            all.add(
                moved
                    .iter()
                    .map(|&c| (c, std::mem::replace(&mut at[c], [0.0; D]))),
            );
        }
        Ok(all)
    }

    fn collect<T: Iterator<Item = (usize, [f64; D])>>(
        count: usize,
        rows: impl Iterator<Item = T>,
    ) -> Self {
        let mut all = Self {
            count,
            start: vec![0],
            ..Self::default()
        };
        rows.for_each(|row| all.add(row));
        all
    }

    fn add(&mut self, row: impl Iterator<Item = (usize, [f64; D])>) {
        for (c, value) in row.filter(|(_, value)| value.iter().any(|&x| x != 0.0)) {
            self.motion.push(c);
            self.values.push(value);
        }
        self.start.push(self.motion.len());
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Number of contacts; zero without motions.
    pub fn contacts(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    pub fn values(&self) -> &[[f64; D]] {
        &self.values
    }

    /// The motions that move a contact, and how.
    #[inline]
    pub fn at(&self, contact: usize) -> impl Iterator<Item = (usize, &[f64; D])> {
        let range = if self.count == 0 {
            0..0
        } else {
            self.start[contact]..self.start[contact + 1]
        };
        let motions = self.motion[range.clone()].iter().copied();
        motions.zip(&self.values[range])
    }

    pub fn gather(&self, order: &[usize]) -> Self {
        if self.count == 0 {
            return Self::default();
        }
        let row = |&i: &usize| self.at(i).map(|(c, value)| (c, *value));
        Self::collect(self.count, order.iter().map(row))
    }

    /// Each value replaced by `of(contact, motion, value)`.
    pub fn map(&self, of: impl Fn(usize, usize, &[f64; D]) -> [f64; D]) -> Self {
        let mut other = self.clone();
        for contact in 0..self.contacts() {
            for at in self.start[contact]..self.start[contact + 1] {
                other.values[at] = of(contact, self.motion[at], &self.values[at]);
            }
        }
        other
    }

    /// The columns, each with all contacts: only for few motions.
    pub fn columns(&self) -> Vec<Vec<[f64; D]>> {
        let of_motion = |motion| {
            let at = |contact| self.at(contact).find(|(c, _)| *c == motion);
            let values =
                (0..self.contacts()).map(|contact| at(contact).map_or([0.0; D], |(_, v)| *v));
            values.collect()
        };
        (0..self.count).map(of_motion).collect()
    }

    /// `v += R a`.
    pub fn add_product(&self, a: &[f64], v: &mut [[f64; D]]) {
        for (contact, value) in v.iter_mut().enumerate() {
            for (c, motion) in self.at(contact).filter(|(c, _)| *c < a.len()) {
                for (value, m) in value.iter_mut().zip(motion) {
                    *value += a[c] * m;
                }
            }
        }
    }

    /// `Rᵀ S r` with a scale for each contact.
    pub fn work(&self, r: &[[f64; D]], scale: &[f64]) -> Vec<f64> {
        let mut work = vec![0.0; self.count];
        for (contact, (r, s)) in r.iter().zip(scale).enumerate() {
            for (c, motion) in self.at(contact) {
                work[c] += (0..D).map(|k| motion[k] * r[k]).sum::<f64>() * s;
            }
        }
        work
    }

    pub fn lengths(&self) -> Vec<f64> {
        let mut lengths = vec![0.0_f64; self.count];
        for (&c, value) in self.motion.iter().zip(&self.values) {
            lengths[c] = value.iter().fold(lengths[c], |sum, x| sum.hypot(*x));
        }
        lengths
    }
}
