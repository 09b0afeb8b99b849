//! The numbers of the law of a contact, in one record: all layers hand it on unopened.

use crate::error::{Error, check_length};
use crate::linalg::small::tangential_norm;

/// The largest friction coefficient. The products of two squares of such numbers, as in
/// `(1 + μ₁²)(1 + μ₂²)`, stay in the range of doubles with eight decades to spare.
pub const LARGEST_FRICTION: f64 = 1e75;

/// The largest cohesion, in the units of the caller: that of `q` and `W` leaves as much room.
pub const LARGEST_COHESION: f64 = 1e150;

/// The numbers of the law of one contact, `‖r_t‖ ≤ c + μ r_n` and `v_n ≥ β‖v_t‖`: Coulomb's (8)
/// for c = β = 0. They are checked once, by [`check`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactLaw {
    /// Friction coefficient μ.
    pub mu: f64,
    /// Cohesion c, a force: the friction without pressure.
    pub cohesion: f64,
    /// Dilatancy β, from 0 to μ: the opening by a unit of slip.
    pub dilatancy: f64,
}

impl ContactLaw {
    pub fn coulomb(mu: &[f64]) -> Vec<Self> {
        mu.iter().map(|&mu| Self::from(mu)).collect()
    }

    pub fn is_coulomb(&self) -> bool {
        // Without `..`, here and below: another number must say whether it is Coulomb's.
        let Self {
            mu: _,
            cohesion,
            dilatancy,
        } = *self;
        cohesion == 0.0 && dilatancy == 0.0
    }

    /// Whether a tangential reaction is possible.
    pub fn has_friction(&self) -> bool {
        self.mu > 0.0 || self.cohesion > 0.0
    }

    pub fn limit(&self, r_n: f64) -> f64 {
        self.cohesion + self.mu * r_n
    }

    /// `μ − β`, the coefficient of the correction (9): zero for an associated law.
    pub fn correction(&self) -> f64 {
        self.mu - self.dilatancy
    }

    /// `v_n − β‖v_t‖`, which is complementary to `r_n`.
    pub fn opening<const D: usize>(&self, v: &[f64; D]) -> f64 {
        if self.dilatancy == 0.0 {
            return v[0];
        }
        v[0] - self.dilatancy * tangential_norm(v)
    }

    /// The distance of a reaction from the border of the set of all; negative outside.
    pub fn depth<const D: usize>(&self, r: &[f64; D]) -> f64 {
        if !self.has_friction() {
            return r[0];
        }
        let of_friction = (self.limit(r[0]) - tangential_norm(r)) / self.mu.hypot(1.0);
        r[0].min(of_friction)
    }

    /// The law of `to_r r`. In these variables a larger cohesion is never reached.
    pub fn scaled(self, to_r: f64) -> Self {
        Self {
            cohesion: (self.cohesion * to_r).min(LARGEST_COHESION),
            ..self
        }
    }
}

/// Coulomb's law with a friction coefficient.
impl From<f64> for ContactLaw {
    fn from(mu: f64) -> Self {
        Self {
            mu,
            ..Self::default()
        }
    }
}

/// Checks the laws of so many contacts.
pub fn check(laws: &[ContactLaw], contacts: usize) -> Result<(), Error> {
    check_length("mu", laws.len(), contacts)?;
    laws.iter().enumerate().try_for_each(|(node, law)| {
        check_friction(node, law.mu)?;
        let ContactLaw {
            mu,
            cohesion,
            dilatancy,
        } = *law;
        if !(0.0..=LARGEST_COHESION).contains(&cohesion) {
            let largest = LARGEST_COHESION;
            return Err(Error::Cohesion {
                node,
                cohesion,
                largest,
            });
        }
        if !(0.0..=mu).contains(&dilatancy) {
            return Err(Error::Dilatancy {
                node,
                dilatancy,
                mu,
            });
        }
        Ok(())
    })
}

/// Refuses laws other than Coulomb's, for what solves no others.
pub fn require_coulomb(laws: &[ContactLaw], what: &'static str) -> Result<(), Error> {
    laws.iter().enumerate().try_for_each(|(node, law)| {
        let ContactLaw {
            mu: _,
            cohesion,
            dilatancy,
        } = *law;
        let (argument, value) = if cohesion != 0.0 {
            ("cohesion", cohesion)
        } else if dilatancy != 0.0 {
            ("dilatancy", dilatancy)
        } else {
            return Ok(());
        };
        Err(Error::NotCoulomb {
            what,
            argument,
            node,
            value,
        })
    })
}

/// Checks a friction coefficient of a contact.
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
