//! The settings of a solver: a method, limits and a start value.

use crate::error::Error;
use crate::law::contact_law::{ContactLaw, require_coulomb};

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
    /// Trial reactions of a penalty that return to the cone, with multipliers [G89].
    ReturnMapping,
    /// Newton on the perturbed Lagrangian, with multipliers [SWT85].
    PerturbedLagrangian,
    /// Friction limits fixed at the last pressures, [dSF91, 68].
    DisplacementPrinciple,
    /// Contact with fixed friction, then friction with fixed contact, [dSF91, 69, 70].
    AlternatingPrinciples,
    /// Slip fixed at the last displacements, [dSF91, 72].
    StressPrinciple,
    /// Displacements and reactions alternately, decreasing the bifunctional, [dSF91, 31–34].
    MinimisingSequence,
    /// Complementary pivoting on the piecewise linear law, after [dSF91, 75].
    Pivoting,
}

impl Method {
    /// The names of the methods in the order of the documentation.
    pub const NAMES: [(&'static str, Method); 13] = [
        ("auto", Method::Auto),
        ("newton", Method::Newton),
        ("gauss_seidel", Method::GaussSeidel),
        ("nesterov", Method::Nesterov),
        ("uzawa", Method::Uzawa),
        ("uzawa_two_projection", Method::UzawaTwoProjection),
        ("return_mapping", Method::ReturnMapping),
        ("perturbed_lagrangian", Method::PerturbedLagrangian),
        ("displacement_principle", Method::DisplacementPrinciple),
        ("alternating_principles", Method::AlternatingPrinciples),
        ("stress_principle", Method::StressPrinciple),
        ("minimising_sequence", Method::MinimisingSequence),
        ("pivoting", Method::Pivoting),
    ];

    pub fn name(self) -> &'static str {
        let mut names = Self::NAMES.iter();
        names
            .find(|(_, method)| *method == self)
            .map_or("", |(name, _)| name)
    }

    /// Refuses laws that the method does not solve. Pivoting has the cells of Coulomb's law;
    /// friction with a fixed pressure has no dilatancy.
    pub fn require_law(self, laws: &[ContactLaw]) -> Result<(), Error> {
        match self {
            Self::Pivoting => require_coulomb(laws, "method 'pivoting'"),
            Self::AlternatingPrinciples => {
                let plain: Vec<ContactLaw> = laws
                    .iter()
                    .map(|law| ContactLaw {
                        cohesion: 0.0,
                        ..*law
                    })
                    .collect();
                require_coulomb(&plain, "method 'alternating_principles'")
            }
            _ => Ok(()),
        }
    }

    /// Whether it solves problems with bodies that only contact holds: methods that fix the
    /// tangential reactions, or start without any, cannot balance the loads.
    pub fn balances(self) -> bool {
        !matches!(
            self,
            Self::AlternatingPrinciples | Self::MinimisingSequence | Self::Pivoting
        )
    }
}

/// The settings of the user, validated once.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub method: Method,
    /// Tolerance of η. The rounding floor replaces it if that is larger.
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
    pub fn validate(&self) -> Result<(), Error> {
        let wrong = |what, found, expected| {
            Err(Error::Setting {
                what,
                found,
                expected,
            })
        };
        // Written such that a NaN fails.
        if !(self.tol > 0.0 && self.tol < 1.0) {
            return wrong("tol", self.tol, "a positive number below 1");
        }
        if self.max_iterations == 0 {
            return wrong("max_iterations", 0.0, "a positive whole number");
        }
        if !(self.max_seconds > 0.0) {
            return wrong("max_seconds", self.max_seconds, "a positive number");
        }
        Ok(())
    }
}

/// A start value, in the order of positions.
#[derive(Clone, Debug, Default)]
pub struct Start<const D: usize> {
    /// Reactions; empty for a cold start.
    pub reaction: Vec<[f64; D]>,
    /// Rigid motions `a`; empty for zero.
    pub rigid: Vec<f64>,
    /// Contacts that were closed before and start as sticking; empty for none.
    pub closed: Vec<bool>,
}
