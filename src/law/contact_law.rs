//! The numbers of the law of a contact, in one record: all layers hand it on unopened.

use crate::error::Error;

/// The largest friction coefficient. The products of two squares of such numbers, as in
/// `(1 + μ₁²)(1 + μ₂²)`, stay in the range of doubles with eight decades to spare.
pub const LARGEST_FRICTION: f64 = 1e75;

/// The numbers of the law (8) of one contact. They are checked once, by [`check`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactLaw {
    /// Friction coefficient.
    pub mu: f64,
}

impl ContactLaw {
    /// Coulomb's law of each contact.
    #[must_use]
    pub fn coulomb(mu: &[f64]) -> Vec<Self> {
        mu.iter().map(|&mu| Self { mu }).collect()
    }
}

/// Checks the laws of so many contacts.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Friction`].
pub fn check(laws: &[ContactLaw], contacts: usize) -> Result<(), Error> {
    if laws.len() != contacts {
        return Err(Error::Shape {
            what: "mu",
            expected: contacts,
            found: laws.len(),
        });
    }
    let mut numbered = laws.iter().enumerate();
    numbered.try_for_each(|(node, law)| check_friction(node, law.mu))
}

/// Checks a friction coefficient of a contact.
///
/// # Errors
/// [`Error::Friction`].
pub fn check_friction(node: usize, mu: f64) -> Result<(), Error> {
    if (0.0..=LARGEST_FRICTION).contains(&mu) {
        Ok(())
    } else {
        Err(Error::Friction {
            node,
            mu,
            largest: LARGEST_FRICTION,
        })
    }
}
