//! Checks the arrays of the caller, once.

use crate::error::Error;

/// # Errors
/// [`Error::Shape`].
pub fn check_length(what: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected {
        Ok(())
    } else {
        Err(Error::Shape {
            what,
            expected,
            found,
        })
    }
}

/// # Errors
/// [`Error::NotFinite`] with the place.
pub fn check_finite(what: &'static str, values: &[f64]) -> Result<(), Error> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NotFinite {
            what,
            index,
            value: values[index],
        }),
    }
}

/// # Errors
/// [`Error::Shape`] and [`Error::Friction`].
pub fn check_friction(mu: &[f64], contacts: usize) -> Result<(), Error> {
    check_length("mu", mu.len(), contacts)?;
    match mu.iter().position(|m| !(m.is_finite() && *m >= 0.0)) {
        Some(node) => Err(Error::Friction { node, mu: mu[node] }),
        None => Ok(()),
    }
}
