//! The certificate of a point of a problem in the displacements.
//!
//! It is the certificate of all solvers, with estimates of the blocks `W_ii`, which only scale
//! it. It is at least as strict: the free displacement `q` of the whole load is not known, and
//! `v − W_ii r`, which is smaller, replaces it in the reference size of η. In addition, the
//! imbalance of all rows without a contact force is compared with the reactions.

use crate::error::Error;
use crate::linalg::parallel::norm;
use crate::primal::problem::Primal;
use crate::reduced::reduced::{Reduced, Rigid};
use crate::reduced::residual::{Certificate, WORST_FLOOR};

/// Rounding error of each term of a sum, relative to the term.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A point: unknowns, imbalance, and what the contacts feel.
#[derive(Clone, Debug)]
pub struct Point<const D: usize> {
    pub y: Vec<f64>,
    /// `A y − f`, from a fresh product with `K`.
    pub e: Vec<f64>,
    /// `e` at the contacts, and the reactions along prescribed components, which no row has.
    pub r: Vec<[f64; D]>,
    /// Relative displacement of the step.
    pub v: Vec<[f64; D]>,
}

impl<const D: usize> Point<D> {
    /// The reactions of the point as a solution: an open contact has none, one without friction
    /// none along its tangents. The rest of these rows is imbalance.
    fn reactions(&self, problem: &Primal<D>) -> Vec<[f64; D]> {
        let mut reactions = self.r.clone();
        for (i, (r, v)) in reactions.iter_mut().zip(&self.v).enumerate() {
            #[expect(clippy::cast_precision_loss, reason = "D is 2 or 3")]
            let mean = problem.compliance.block(i).trace() / D as f64;
            if mean * r[0] <= v[0] {
                *r = [0.0; D];
            } else if problem.mu[i] == 0.0 {
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
    #[must_use]
    pub fn residual(&self) -> f64 {
        self.certificate.residual.max(self.imbalance)
    }

    /// The tolerance of the residual if the caller asks for `tol`.
    #[must_use]
    pub fn tolerance(&self, tol: f64) -> f64 {
        self.certificate.tolerance(tol).max(self.imbalance_floor)
    }

    /// Rounding floor of the residual.
    #[must_use]
    pub fn floor(&self) -> f64 {
        self.certificate.floor.max(self.imbalance_floor)
    }

    /// Whether the point is a solution.
    #[must_use]
    pub fn converged(&self, tol: f64) -> bool {
        self.certificate.converged(tol)
            && self.imbalance_floor <= WORST_FLOOR
            && self.imbalance <= tol.max(self.imbalance_floor)
    }
}

/// The contacts alone, as a problem in the reactions: with `W_ii` and `q = v − W_ii r`, so that
/// `v` is that of the point.
///
/// # Errors
/// As [`Reduced::new`].
pub fn contacts_alone<'a, const D: usize>(
    problem: &'a Primal<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Result<Reduced<'a, D>, Error> {
    let mut q = vec![[0.0; D]; r.len()];
    problem.compliance.product(r, &mut q);
    for (q, v) in q.iter_mut().zip(v) {
        for (q, v) in q.iter_mut().zip(v) {
            *q = v - *q;
        }
    }
    Reduced::new(&problem.compliance, &q, &problem.mu, &Rigid::default())
}

/// Computes the certificate of a point. `force` is `f` of its step, `terms` the sizes of the
/// terms of `A y`, for the rounding; without them the rounding is zero.
#[must_use]
pub fn judge<const D: usize>(
    problem: &Primal<D>,
    reduced: &Reduced<D>,
    point: &Point<D>,
    force: &[f64],
    terms: Option<&[f64]>,
) -> Judged<D> {
    let reaction = point.reactions(problem);
    let mut certificate = Certificate::of(reduced, &reaction, point.v.clone(), &[]);
    let scaling = &reduced.scaling;
    // The imbalance of a row is what no reaction explains: at open contacts all of `e`.
    let mut left = point.e.clone();
    let mut of_contacts = Vec::with_capacity(D * point.r.len());
    for (i, k, at) in problem.frames.unknowns() {
        left[at] -= reaction[i][k];
        if let Some(terms) = terms {
            of_contacts.push(ROUNDING * terms[at] * scaling.to_r[i]);
        }
    }
    let size = norm(reaction.as_flattened());
    // Without reactions, the loads are the measure.
    let size = if size > 0.0 { size } else { norm(force) };
    let relative = |part: f64| if part == 0.0 { 0.0 } else { part / size };
    let reactions = scaling.reaction_norm(&reaction);
    if reactions > 0.0 {
        let rounding = norm(&of_contacts) / reactions;
        certificate.floor = (certificate.floor + rounding).min(WORST_FLOOR);
        certificate.sound &= rounding <= WORST_FLOOR;
    }
    Judged {
        reaction,
        imbalance: relative(norm(&left)),
        imbalance_floor: terms.map_or(0.0, |terms| ROUNDING * relative(norm(terms))),
        certificate,
    }
}
