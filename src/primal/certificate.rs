//! The certificate of a point of a problem in the displacements.
//!
//! It is the certificate of all solvers, with estimates of the blocks `W_ii`, which only scale
//! it. It is at least as strict: the free displacement `q` of the whole load is not known, and
//! `v − W_ii r`, which is smaller, replaces it in the reference size of η. In addition, the
//! imbalance of all rows without a contact force is compared with the reactions.

use crate::error::Error;
use crate::linalg::parallel::norm;
use crate::linalg::small::{rows_plus_scaled, tangential_norm};
use crate::primal::contacts::Contacts;
use crate::primal::engine::{Engine, Terms};
use crate::reduced::reduced::{Reduced, Rigid};
use crate::reduced::residual::{Certificate, WORST_FLOOR};

/// Rounding error of each term of a sum, relative to the term.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A point: unknowns, imbalance, and what the contacts feel.
#[derive(Clone, Debug)]
pub struct Point<V, const D: usize> {
    pub y: V,
    /// `A y − f`, from a fresh product with `K`.
    pub e: V,
    /// `e` at the contacts, and the reactions along prescribed components, which no row has.
    pub r: Vec<[f64; D]>,
    /// Relative displacement of the step.
    pub v: Vec<[f64; D]>,
}

impl<V, const D: usize> Point<V, D> {
    /// The reactions of the point as a solution: without cohesion an open contact has none, and
    /// one without friction none along its tangents. The rest of these rows is imbalance.
    fn reactions(&self, contacts: &Contacts<D>) -> Vec<[f64; D]> {
        let mut reactions = self.r.clone();
        for (i, (r, v)) in reactions.iter_mut().zip(&self.v).enumerate() {
            #[expect(clippy::cast_precision_loss, reason = "D is 2 or 3")]
            let mean = contacts.compliance.block(i).trace() / D as f64;
            let law = &contacts.law[i];
            let open = mean * r[0] <= v[0] - law.dilatancy * tangential_norm(v);
            if open {
                r[0] = 0.0;
            }
            if law.cohesion == 0.0 && (open || law.mu == 0.0) {
                r[1..].fill(0.0);
            }
        }
        reactions
    }
}

/// The certificate of a point.
#[derive(Clone, Debug)]
pub struct Judged<const D: usize> {
    /// The reactions of the solution.
    pub reaction: Vec<[f64; D]>,
    pub certificate: Certificate<D>,
    /// `‖A y − f‖` of all rows without a reaction, relative to the forces.
    pub imbalance: f64,
    /// Rounding of the imbalance.
    imbalance_floor: f64,
}

impl<const D: usize> Judged<D> {
    /// The larger of the two errors.
    pub fn residual(&self) -> f64 {
        self.certificate.residual.max(self.imbalance)
    }

    /// The tolerance of the residual if the caller asks for `tol`.
    pub fn tolerance(&self, tol: f64) -> f64 {
        self.certificate.tolerance(tol).max(self.imbalance_floor)
    }

    /// Rounding floor of the residual.
    pub fn floor(&self) -> f64 {
        self.certificate.floor.max(self.imbalance_floor)
    }

    /// Whether the point is a solution.
    pub fn converged(&self, tol: f64) -> bool {
        self.certificate.converged(tol)
            && self.imbalance_floor <= WORST_FLOOR
            && self.imbalance <= tol.max(self.imbalance_floor)
    }
}

/// The contacts alone, as a problem in the reactions: with `W_ii` and `q = v − W_ii r`, so that
/// `v` is that of the point.
pub fn contacts_alone<'a, const D: usize>(
    contacts: &'a Contacts<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Result<Reduced<'a, D>, Error> {
    let mut moved = vec![[0.0; D]; r.len()];
    contacts.compliance.product(r, &mut moved);
    let q = rows_plus_scaled(v, -1.0, &moved);
    Reduced::new(&contacts.compliance, &q, &contacts.law, &Rigid::default())
}

/// Computes the certificate of a point. `force` is `f` of its step, `terms` the sizes of the
/// terms of `A y`, for the rounding; without them the rounding is zero.
pub fn judge<const D: usize, E: Engine<D>>(
    engine: &mut E,
    contacts: &Contacts<D>,
    reduced: &Reduced<D>,
    point: &Point<E::Vector, D>,
    force: &E::Vector,
    terms: Option<&Terms<D>>,
) -> Result<Judged<D>, E::Error> {
    let reaction = point.reactions(contacts);
    let mut certificate = Certificate::of(reduced, &reaction, point.v.clone(), &[]);
    let scaling = &reduced.scaling;
    // The imbalance of a row is what no reaction explains: at open contacts all of `e`.
    let left = engine.imbalance(&point.e, &reaction)?;
    let mut of_contacts = Vec::with_capacity(D * point.r.len());
    if let Some(terms) = terms {
        for (i, k, _) in contacts.frames.unknowns() {
            of_contacts.push(ROUNDING * terms.at_contacts[i][k] * scaling.to_r[i]);
        }
    }
    let size = norm(reaction.as_flattened());
    // Without reactions, the loads are the measure.
    let size = if size > 0.0 {
        size
    } else {
        engine.norm(force)?
    };
    let relative = |part: f64| if part == 0.0 { 0.0 } else { part / size };
    let reactions = scaling.reaction_norm(&reaction);
    if reactions > 0.0 {
        let rounding = norm(&of_contacts) / reactions;
        certificate.floor = (certificate.floor + rounding).min(WORST_FLOOR);
        certificate.sound &= rounding <= WORST_FLOOR;
    }
    Ok(Judged {
        reaction,
        imbalance: relative(left),
        imbalance_floor: terms.map_or(0.0, |terms| ROUNDING * relative(terms.norm)),
        certificate,
    })
}
