//! The contacts of a question of statics: the motions that they resist, and their cones.

use std::ops::Range;

use crate::error::{Error, check_length};
use crate::linalg::compensated::Sum;
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::linalg::union::Union;

/// `R` by rows, and for each contact the set `C` of its reactions. A contact has any number of
/// tangents: for a point of a soil, the normal component is the mean stress.
#[derive(Clone, Debug)]
pub struct Statics {
    /// `R`; the rows of a contact are consecutive, normal first.
    rows: OwnedMatrix,
    /// Length of each column of `R`, 1 for a motion that moves no contact: the unit of a motion.
    pub(super) lengths: Vec<f64>,
    /// First row of each contact, and the number of rows.
    first: Vec<usize>,
    /// Friction coefficient of each tangent; the number at a normal is not used.
    pub(super) friction: Vec<f64>,
    /// Cohesion of each contact, a force.
    pub(super) cohesion: Vec<f64>,
    pub(super) groups: Vec<Group>,
    /// Number of each motion in its group.
    pub(super) place: Vec<usize>,
}

/// Motions that share no contact with others, and their contacts. Groups balance apart, so that
/// the loads of a heavy body do not hide those of a light one.
#[derive(Clone, Debug, Default)]
pub(super) struct Group {
    pub(super) motions: Vec<usize>,
    pub(super) contacts: Vec<usize>,
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
        check_not_negative("mu", &friction)?;
        check_not_negative("cohesion", &cohesion)?;
        check_length("mu", friction.len(), count)?;
        check_length("cohesion", cohesion.len(), sizes.len())?;
        let mut lengths = Vec::new();
        if lengths.try_reserve_exact(motions).is_err() {
            return Err(Error::Shape {
                what: "the motions of R",
                expected: rows.columns.len(),
                found: motions,
            });
        }
        lengths.resize(motions, 0.0);
        let mut statics = Self {
            rows: rows.select(Some),
            lengths,
            first,
            friction,
            cohesion,
            groups: Vec::new(),
            place: Vec::with_capacity(motions),
        };
        for row in 0..count {
            for (j, value) in statics.rows.entries(row) {
                statics.lengths[j] = statics.lengths[j].hypot(value);
            }
        }
        let unmoved = statics.lengths.iter_mut().filter(|length| **length == 0.0);
        unmoved.for_each(|length| *length = 1.0);
        statics.make_groups();
        Ok(statics)
    }

    pub(super) fn rows_of(&self, contact: usize) -> Range<usize> {
        self.first[contact]..self.first[contact + 1]
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
        let tangents = &self.friction[self.rows_of(contact)][1..];
        tangents.iter().fold(0.0, |m, &mu| m.max(mu))
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

    fn make_groups(&mut self) {
        let mut sets = Union::new(self.lengths.len());
        let mut leader = vec![None; self.cohesion.len()];
        for (contact, leader) in leader.iter_mut().enumerate() {
            for (j, _) in self.rows_of(contact).flat_map(|row| self.row(row)) {
                sets.join(*leader.get_or_insert(j), j);
            }
        }
        let number = sets.numbers();
        let count = number.iter().max().map_or(0, |last| last + 1);
        self.groups = vec![Group::default(); count];
        for (motion, &group) in number.iter().enumerate() {
            self.place.push(self.groups[group].motions.len());
            self.groups[group].motions.push(motion);
        }
        for (contact, leader) in leader.into_iter().enumerate() {
            if let Some(motion) = leader {
                self.groups[number[motion]].contacts.push(contact);
            }
        }
    }
}

fn check_not_negative(what: &'static str, numbers: &[f64]) -> Result<(), Error> {
    let wrong = |c: &f64| !(0.0..f64::INFINITY).contains(c);
    match numbers.iter().position(wrong) {
        Some(index) => Err(Error::NotFinite {
            what,
            index,
            value: numbers[index],
        }),
        None => Ok(()),
    }
}
