//! What a solver is given beside the problem: a method, limits, and where to start.

use crate::error::Error;

/// Which algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The default: accelerated Gauss–Seidel, finished by Newton.
    #[default]
    Auto,
    /// Exact one-node solves with Anderson acceleration, (17).
    GaussSeidel,
    /// Semismooth Newton alone, (19) and (20).
    Newton,
    /// One projection with an adaptive step and Nesterov's momentum.
    Nesterov,
    /// One projection with an adaptive step, (16), [dSF91, 79–81].
    Uzawa,
    /// Two projections with the same step, [dSF91, 82–87].
    UzawaTwoProjection,
    /// Friction limits frozen at the last pressures, [dSF91, 68].
    DisplacementPrinciple,
    /// Contact, then friction, the other's reactions frozen, [dSF91, 69, 70].
    AlternatingPrinciples,
    /// Slip frozen at the last displacements, [dSF91, 72].
    StressPrinciple,
    /// Displacements and reactions in turn, the bifunctional falling, [dSF91, 31–34].
    MinimisingSequence,
    /// Complementary pivoting on the piecewise linear law, after [dSF91, 75].
    Pivoting,
}

impl Method {
    /// The names a user writes, in the order of documentation.
    pub const NAMES: [(&'static str, Method); 11] = [
        ("auto", Method::Auto),
        ("newton", Method::Newton),
        ("gauss_seidel", Method::GaussSeidel),
        ("nesterov", Method::Nesterov),
        ("uzawa", Method::Uzawa),
        ("uzawa_two_projection", Method::UzawaTwoProjection),
        ("displacement_principle", Method::DisplacementPrinciple),
        ("alternating_principles", Method::AlternatingPrinciples),
        ("stress_principle", Method::StressPrinciple),
        ("minimising_sequence", Method::MinimisingSequence),
        ("pivoting", Method::Pivoting),
    ];

    /// The name a user writes.
    #[must_use]
    pub fn name(self) -> &'static str {
        let mut names = Self::NAMES.iter();
        names
            .find(|(_, method)| *method == self)
            .map_or("", |(name, _)| name)
    }

    /// Whether it takes bodies that contact alone holds: frozen tangential reactions
    /// or none leave nothing to balance the loads on them with.
    #[must_use]
    pub fn balances(self) -> bool {
        !matches!(
            self,
            Self::AlternatingPrinciples | Self::MinimisingSequence | Self::Pivoting
        )
    }
}

/// What the user may set; validated once.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub method: Method,
    /// Wished residual η; what it is held to is the larger of this and rounding.
    pub tol: f64,
    pub max_iterations: usize,
    pub max_seconds: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Auto,
            tol: 1e-10,
            max_iterations: 100_000,
            max_seconds: f64::INFINITY,
        }
    }
}

impl Settings {
    /// # Errors
    /// [`Error::Setting`] naming the first setting out of range.
    pub fn validate(&self) -> Result<(), Error> {
        // Written so that a NaN fails each of them.
        if !(self.tol > 0.0 && self.tol < 1.0) {
            return Err(Error::Setting {
                what: "tol",
                found: self.tol,
                expected: "a positive number below 1",
            });
        }
        if self.max_iterations == 0 {
            return Err(Error::Setting {
                what: "max_iterations",
                found: 0.0,
                expected: "a positive whole number",
            });
        }
        if !(self.max_seconds > 0.0) {
            return Err(Error::Setting {
                what: "max_seconds",
                found: self.max_seconds,
                expected: "a positive number",
            });
        }
        Ok(())
    }
}

/// Where to start, in the order of positions.
#[derive(Clone, Debug, Default)]
pub struct Start<const D: usize> {
    /// Reactions; empty for a cold start.
    pub reaction: Vec<[f64; D]>,
    /// Rigid motions `a`; empty for zero.
    pub rigid: Vec<f64>,
    /// Contacts that were closed before, which try to stick first; empty for none.
    pub closed: Vec<bool>,
}
