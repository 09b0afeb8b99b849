//! The numbers of the law of a contact, in one record: all layers hand it on unopened.

use crate::error::Error;

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
    let valid = |law: &ContactLaw| law.mu.is_finite() && law.mu >= 0.0;
    match laws.iter().position(|law| !valid(law)) {
        Some(node) => Err(Error::Friction {
            node,
            mu: laws[node].mu,
        }),
        None => Ok(()),
    }
}
