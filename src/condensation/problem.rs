//! A contact problem with all contacts, or with those that may close.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::condensation::bodies::{Bodies, Loaded};
use crate::condensation::body::DIGITS;
use crate::condensation::candidates::{Candidates, seeds};
use crate::condensation::condense::{Condensed, SortedProblem};
use crate::condensation::stats::Stats;
use crate::condensation::surface::Surface;
use crate::error::{Error, check_finite, check_length};
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::small::amax;
use crate::reduced::elliptic_scaling::EllipticScaling;
use crate::reduced::rotation::Rotation;

/// Largest difference between relative displacements from `W` and from `u`, as a share of the
/// largest motion of a contact. `W` may lose [`DIGITS`] before it is corrected, 2e-11 of it,
/// and a path adds up these errors.
const CONFIRMED: f64 = 1e-8;

/// The factor to which this loss is estimated.
const ALLOWED: f64 = 8.0;

/// A contact problem, with `W` of all contacts formed or not.
#[derive(Debug)]
pub enum Problem<const D: usize> {
    Whole(Condensed<D>),
    Growing {
        candidates: Arc<Candidates<D>>,
        law: Vec<ContactLaw>,
    },
}

impl<const D: usize> Problem<D> {
    /// Condenses onto all contacts, or onto few if there are many more candidates than touching
    /// contacts. `grow` decides this, `None` lets the gaps decide. Analyses of the problem
    /// `before` may be used again.
    pub fn new(
        sorted: SortedProblem<D>,
        grow: Option<bool>,
        before: Option<&Self>,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let before = before.map(|problem| &**problem.bodies());
        let all_known = sorted.supports.known.is_some();
        if grow != Some(false)
            && !all_known
            && let Some(seeds) = seeds(&sorted.surface, grow == Some(true))
        {
            match Candidates::new(sorted.clone(), seeds, before, stop) {
                // The few contacts do not hold the body; all of them may.
                Err(Error::FloatingBody { .. }) => {}
                made => {
                    return Ok(Self::Growing {
                        candidates: Arc::new(made?),
                        law: sorted.law,
                    });
                }
            }
        }
        Condensed::new(sorted, before, stop).map(Self::Whole)
    }

    pub fn bodies(&self) -> &Arc<Bodies> {
        match self {
            Self::Whole(problem) => problem.bodies(),
            Self::Growing { candidates, .. } => &candidates.bodies,
        }
    }

    pub fn surface(&self) -> &Surface<D> {
        match self {
            Self::Whole(problem) => problem.surface(),
            Self::Growing { candidates, .. } => &candidates.surface,
        }
    }

    pub fn contacts(&self) -> usize {
        self.surface().contacts()
    }

    pub fn law(&self) -> &[ContactLaw] {
        match self {
            Self::Whole(problem) => problem.law(),
            Self::Growing { law, .. } => law,
        }
    }

    pub fn stats(&self) -> &Stats {
        match self {
            Self::Whole(problem) => problem.stats(),
            Self::Growing { candidates, .. } => &candidates.stats,
        }
    }

    /// Bytes of the compliance formed so far.
    pub fn bytes_compliance(&self) -> usize {
        match self {
            Self::Whole(problem) => problem.compliance().bytes(),
            Self::Growing { candidates, .. } => candidates
                .whole
                .get()
                .map_or(0, |problem| problem.compliance().bytes()),
        }
    }

    /// The problem with `W` of all contacts, formed now if needed.
    pub fn whole(&self, stop: &AtomicBool) -> Result<Condensed<D>, Error> {
        match self {
            Self::Whole(problem) => Ok(problem.clone()),
            Self::Growing { candidates, law } => candidates
                .whole(stop)?
                .with_gap(candidates.surface.gap.clone())
                .with_law(law.clone()),
        }
    }

    /// The same bodies and contacts with other laws.
    pub fn with_law(&self, law: Vec<ContactLaw>) -> Result<Self, Error> {
        contact_law::check(&law, self.contacts())?;
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.with_law(law)?),
            Self::Growing { candidates, .. } => Self::Growing {
                candidates: Arc::clone(candidates),
                law,
            },
        })
    }

    /// The same bodies and contacts with other gaps; the initial contacts stay.
    pub fn with_gap(&self, gap: Vec<[f64; D]>) -> Result<Self, Error> {
        check_length("gap", gap.len(), self.contacts())?;
        check_finite("gap", gap.as_flattened())?;
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.with_gap(gap)),
            Self::Growing { candidates, law } => Self::Growing {
                candidates: Arc::new(candidates.with_gap(gap)),
                law: law.clone(),
            },
        })
    }

    /// The same contacts in scaled variables, on the same bodies.
    pub fn scaled(&self, elliptic: &EllipticScaling) -> Result<Self, Error> {
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.scaled(elliptic)?),
            Self::Growing { candidates, law } => Self::Growing {
                candidates: Arc::new(candidates.scaled(elliptic)),
                law: law.clone(),
            },
        })
    }

    /// The same contacts in rotated frames, on the same bodies.
    pub fn rotated(&self, rotation: &Rotation<D>) -> Result<Self, Error> {
        check_length("rotation", rotation.contacts(), self.contacts())?;
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.rotated(rotation)?),
            Self::Growing { candidates, law } => Self::Growing {
                candidates: Arc::new(candidates.rotated(rotation)),
                law: law.clone(),
            },
        })
    }

    /// The rigid motions at all contacts, `B R`.
    ///
    /// # Errors
    /// None for a motion of its own.
    pub fn modes(&self) -> Result<Vec<Vec<[f64; D]>>, Error> {
        let candidates = match self {
            Self::Whole(problem) => return Ok(problem.modes()),
            Self::Growing { candidates, .. } => candidates,
        };
        let count = candidates.bodies.motions().len();
        let of_motion = |k| {
            let mut amounts = vec![0.0; count];
            amounts[k] = 1.0;
            candidates.motion(&amounts)
        };
        (0..count).map(of_motion).collect()
    }

    /// As [`Bodies::displacements`].
    pub fn displacements(&self, states: &[Loaded<'_, D>]) -> Result<Vec<Vec<f64>>, Error> {
        self.bodies().displacements(self.surface(), states)
    }

    /// Checks that `B u + gap` is `v` at the displacements `u` of a state.
    pub fn confirm(
        &self,
        state: &Loaded<'_, D>,
        u: &[f64],
        held_to: &Confirmed<D>,
    ) -> Result<(), Error> {
        let Confirmed { v, gap, slip } = held_to;
        let bodies = self.bodies();
        let moved = self.surface().product(&bodies.list, bodies.fixed(), u);
        let all = moved.iter().chain(v).chain(gap).chain(slip);
        let size = all.map(|a| amax(a)).fold(0.0, f64::max);
        let off = (0..v.len()).map(|i| {
            let off: [f64; D] = std::array::from_fn(|k| moved[i][k] + gap[i][k] - v[i][k]);
            (i, amax(&off))
        });
        let Some((contact, off)) = off.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return Ok(());
        };
        // If all contacts stick, `v` is the rounding of the displacements under the loads.
        let explained =
            |u: &[f64]| off <= CONFIRMED * size + ALLOWED * DIGITS * f64::EPSILON * amax(u);
        if explained(u) {
            return Ok(());
        }
        // And if the bodies hardly move, of the displacements under the loads alone.
        let nothing = vec![[0.0; D]; v.len()];
        let alone = Loaded {
            reaction: &nothing,
            ..*state
        };
        if explained(&self.bodies().displacement(self.surface(), alone)?) {
            return Ok(());
        }
        Err(Error::NotConfirmed { contact, off, size })
    }
}

/// The values for comparison with `B u + gap`.
#[derive(Clone, Debug)]
pub struct Confirmed<const D: usize> {
    pub v: Vec<[f64; D]>,
    pub gap: Vec<[f64; D]>,
    /// The change of the tangential parts of `v` in the step, and zero along the normal: the
    /// rounding of earlier steps stays.
    pub slip: Vec<[f64; D]>,
}
