//! The contacts of a question of statics: the motions that they resist, and their cones.

use crate::error::{Error, check_length};
use crate::linalg::compensated::Sum;
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::linalg::union::Union;

/// `R` by rows, and for each contact the set `C` of its reactions. A contact has any number of
/// tangents: for a point of a soil, the normal component is the mean stress.
#[derive(Clone, Debug)]
pub struct Statics {
    /// `R`; the rows of a contact are consecutive, normal first.
    pub(super) rows: OwnedMatrix,
    pub(super) motions: usize,
    /// First row of each contact, and the number of rows.
    pub(super) first: Vec<usize>,
    /// Friction coefficient of each tangent; the number at a normal is not used.
    pub(super) friction: Vec<f64>,
    /// Cohesion of each contact, a force.
    pub(super) cohesion: Vec<f64>,
}

impl Statics {
    /// Takes `R (rows, motions)`, the number of rows of each contact, the coefficient of each row
    /// and the cohesion of each contact.
    pub fn new(
        rows: Rows,
        motions: usize,
        sizes: &[usize],
        friction: Vec<f64>,
        cohesion: Vec<f64>,
    ) -> Result<Self, Error> {
        let mut first = vec![0_usize];
        for (contact, &size) in sizes.iter().enumerate() {
            let next = first[contact].checked_add(size).filter(|_| size > 0);
            first.push(next.ok_or(Error::Shape {
                what: "the rows of a contact",
                expected: 1,
                found: size,
            })?);
        }
        let count = first[sizes.len()];
        if friction.len() == count {
            rows.check("R", count, motions)?;
        }
        for (what, numbers) in [("mu", &friction), ("cohesion", &cohesion)] {
            check_finite(what, numbers)?;
        }
        check_length("mu", friction.len(), count)?;
        check_length("cohesion", cohesion.len(), sizes.len())?;
        Ok(Self {
            rows: rows.select(Some),
            motions,
            first,
            friction,
            cohesion,
        })
    }

    pub(super) fn contacts(&self) -> usize {
        self.cohesion.len()
    }

    /// The same contacts without cohesion.
    pub(super) fn without_cohesion(&self) -> Self {
        Self {
            cohesion: vec![0.0; self.cohesion.len()],
            ..self.clone()
        }
    }

    /// Whether a contact has friction.
    pub(super) fn rubs(&self, contact: usize) -> bool {
        self.largest_friction(contact) > 0.0 || self.cohesion[contact] > 0.0
    }

    /// The largest coefficient of a contact.
    pub(super) fn largest_friction(&self, contact: usize) -> f64 {
        let tangents = self.first[contact] + 1..self.first[contact + 1];
        self.friction[tangents].iter().fold(0.0, |m, &mu| m.max(mu))
    }

    /// Entries of a row that are not zero.
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.rows.entries(row).filter(|entry| entry.1 != 0.0)
    }

    /// `Rᵀ r + e`, rounded once.
    pub fn imbalance(&self, reaction: &[f64], load: &[f64]) -> Vec<f64> {
        let mut sums: Vec<Sum> = load.iter().map(|&e| Sum::new(e)).collect();
        for (row, &r) in reaction.iter().enumerate() {
            for (j, value) in self.row(row) {
                sums[j].add_product(value, r);
            }
        }
        sums.iter().map(Sum::value).collect()
    }

    /// Length of each column of `R`, 1 for a motion that moves no contact: the unit of a motion.
    pub(super) fn column_lengths(&self) -> Vec<f64> {
        let mut lengths = vec![0.0_f64; self.motions];
        for row in 0..self.friction.len() {
            for (j, value) in self.row(row) {
                lengths[j] = lengths[j].hypot(value);
            }
        }
        let unit = |length: f64| if length > 0.0 { length } else { 1.0 };
        lengths.into_iter().map(unit).collect()
    }

    /// Groups of motions that share no contact, each with its contacts. They balance apart, so
    /// that the loads of a heavy body do not hide those of a light one.
    pub(super) fn groups(&self) -> Vec<(Vec<usize>, Vec<usize>)> {
        let mut sets = Union::new(self.motions);
        let mut leader = vec![None; self.contacts()];
        for (contact, leader) in leader.iter_mut().enumerate() {
            for row in self.first[contact]..self.first[contact + 1] {
                for (j, _) in self.row(row) {
                    sets.join(*leader.get_or_insert(j), j);
                }
            }
        }
        let number = sets.numbers();
        let count = number.iter().max().map_or(0, |last| last + 1);
        let mut groups = vec![(Vec::new(), Vec::new()); count];
        for (motion, &group) in number.iter().enumerate() {
            groups[group].0.push(motion);
        }
        for (contact, leader) in leader.into_iter().enumerate() {
            if let Some(motion) = leader {
                groups[number[motion]].1.push(contact);
            }
        }
        groups
    }
}

fn check_finite(what: &'static str, numbers: &[f64]) -> Result<(), Error> {
    match numbers
        .iter()
        .position(|c| !(0.0..f64::INFINITY).contains(c))
    {
        Some(place) => Err(Error::NotFinite {
            what,
            index: place,
            value: numbers[place],
        }),
        None => Ok(()),
    }
}
