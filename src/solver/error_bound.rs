//! How far a point is from the answer, proved: the error bound of chapter 9 of
//! `docs/paper`.
//!
//! Where `A` of [`monotony`](crate::solver::monotony) is positive definite there is exactly
//! one answer `r*`. For `r̂ ∈ K_μ` and `y ∈ K*_μ` orthogonal to it, `e = y − V(r̂)` and
//! `d = r̂ − r*` satisfy
//!
//! ```text
//! dᵀ A d + e·d ≤ 0,
//! ```
//!
//! an ellipsoid that holds `d`. Everything is in variables scaled by powers of two,
//! which is exact, and every rounding is counted: that of `W r̂ + q`, of `e`, of `A`, of
//! its factor and of solves with it. What is bounded is the distance to the answer of
//! `W`, `q`, `μ` as they stand in memory.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::bipotential::{self, law_step};
use crate::law::cone::project;
use crate::law::face::{Face, Place};
use crate::linalg::below::{Below, Ellipsoid, gamma};
use crate::linalg::binary::times_two_to;
use crate::linalg::small::{dot, norm, tangential_norm};
use crate::problem::reduced::Reduced;
use crate::solver::contraction::contraction;
use crate::solver::monotony::{
    Known, Monotony, Ties, Touching, Units, Weights, least_ratio, product, scaled_entry,
};
use crate::solver::weights::{self, Common};

/// Unknowns of an island above which nothing is proved: some ten dense matrices of
/// that order are made.
pub const LARGEST: usize = 3000;

/// Unknowns up to which a ball is tried: a factor for each radius.
const LARGEST_OF_BALLS: usize = 1000;

/// Why there is no bound. Contacts are in the caller's numbering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// Bodies held by contact alone: friction feels a motion that `A` does not.
    HeldByContact,
    /// A contact penetrates that nothing can move.
    NoAnswer {
        contact: usize,
    },
    /// Nothing moves a contact that just touches.
    Touching {
        contact: usize,
    },
    /// A tangent that nothing moves, with friction.
    Led {
        contact: usize,
    },
    TooLarge {
        unknowns: usize,
    },
    /// The symmetric part of `W` is not positive definite to rounding.
    NotDefinite {
        contact: usize,
    },
    /// Friction is too large for `A`, and no ball was found.
    Friction {
        contact: usize,
    },
    /// A reaction where the law leaves none: a tangent without friction, a contact
    /// that stays open.
    Impossible {
        contact: usize,
    },
    /// Friction that depends on direction: the rounding of the change of variables
    /// that makes it Coulomb's is not counted.
    Directional,
    /// Numbers beyond the range of doubles.
    Range,
}

impl Reason {
    /// A word for it, and the contact or number of unknowns that it names.
    #[must_use]
    pub fn told(self) -> (&'static str, usize) {
        match self {
            Self::HeldByContact => ("held by contact", 0),
            Self::NoAnswer { contact } => ("no answer", contact),
            Self::Touching { contact } => ("touching", contact),
            Self::Led { contact } => ("led", contact),
            Self::TooLarge { unknowns } => ("too large", unknowns),
            Self::NotDefinite { contact } => ("not definite", contact),
            Self::Friction { contact } => ("friction", contact),
            Self::Impossible { contact } => ("impossible", contact),
            Self::Directional => ("directional", 0),
            Self::Range => ("range", 0),
        }
    }
}

/// What a bound says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// There is one answer, and it is this near.
    Global,
    /// One answer is this near; it is the only one within a ball.
    Local,
    NotAvailable(Reason),
}

impl Kind {
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Global => "global",
            Self::Local => "local",
            Self::NotAvailable(_) => "not available",
        }
    }
}

/// A bound of the error of a point, in the caller's units and numbering; what is not
/// available is empty.
#[derive(Clone, Debug)]
pub struct Bound<const D: usize> {
    pub kind: Kind,
    /// `‖r − r*‖` in the norm of `W`.
    pub energy: f64,
    /// That over `‖r*‖`; infinite where `r* = 0` is not excluded.
    pub relative: f64,
    /// Of a local bound, how far from `r` in that norm there is no other answer;
    /// infinite for a global one.
    pub alone_within: f64,
    pub reaction: Vec<[f64; D]>,
    pub relative_displacement: Vec<[f64; D]>,
    /// `L`, where it is proved to be below 1 on every island.
    pub contraction: Option<f64>,
    /// `‖r − r*‖` by the energy that is missing, where `L < 1`.
    pub energy_by_gap: Option<f64>,
    /// Gap of the bipotential, contact by contact, at `r` itself.
    pub gap: Vec<f64>,
    /// `½ rᵀ W r`, what the reactions store.
    pub stored: f64,
}

impl<const D: usize> Bound<D> {
    /// What is said without a bound.
    fn none(self, reason: Reason) -> Self {
        Self {
            kind: Kind::NotAvailable(reason),
            energy: f64::INFINITY,
            relative: f64::INFINITY,
            alone_within: 0.0,
            reaction: Vec::new(),
            relative_displacement: Vec::new(),
            contraction: None,
            energy_by_gap: None,
            ..self
        }
    }

    fn start(problem: &Reduced<D>, r: &[[f64; D]], rigid: &[f64]) -> Self {
        let v = problem.exact_displacement(r, rigid);
        let contacts = r.iter().zip(&v).zip(&problem.mu);
        let gap: Vec<f64> = contacts
            .map(|((r, v), &mu)| bipotential::gap(r, v, mu))
            .collect();
        let mut moved = vec![[0.0; D]; r.len()];
        problem.compliance.product(r, &mut moved);
        let works = r.iter().zip(&moved).map(|(r, w)| dot(r, w));
        Self {
            kind: Kind::Global,
            energy: 0.0,
            relative: 0.0,
            alone_within: f64::INFINITY,
            reaction: vec![[0.0; D]; r.len()],
            relative_displacement: vec![[0.0; D]; r.len()],
            contraction: Some(0.0),
            energy_by_gap: None,
            gap: problem.compliance.scatter(&gap),
            stored: 0.5 * works.sum::<f64>(),
        }
    }
}

/// What bounds have in common for one `W` and `μ`.
#[derive(Debug)]
pub struct Prepared<const D: usize> {
    units: Units,
    islands: Result<Vec<Island<D>>, Reason>,
}

/// An island with what is proved of its `W`.
#[derive(Debug)]
struct Island<const D: usize> {
    monotony: Monotony<D>,
    /// Below the symmetric part of `W`, which is `half`.
    of_w: Below,
    /// `|d_j| ≤ width · ‖d‖`.
    widths_of_w: Vec<f64>,
    half: Vec<f64>,
    common: Common,
    refined: Option<Weights>,
    contraction: Option<f64>,
    global: Option<Certificate<D>>,
    /// Rows of `Ŵ` of all components of the island, each over its unknowns.
    rows: Vec<f64>,
}

/// A factor below `A` and what follows from it for any point.
#[derive(Debug)]
struct Certificate<const D: usize> {
    ties: Ties,
    normal: Vec<f64>,
    known: Vec<Known<D>>,
    below: Below,
    /// `L Lᵀ ≽ α W`.
    alpha: f64,
    /// Of the unit ellipsoid, along the unknowns and along the rows of `Ŵ`.
    widths: Widths,
}

#[derive(Debug, Default)]
struct Widths {
    reaction: Vec<f64>,
    displacement: Vec<f64>,
}

/// A point of the cones to start from, scaled, with what rounding leaves open.
struct Candidate<const D: usize> {
    faces: Vec<Face<D>>,
    v: Vec<[f64; D]>,
    dv: Vec<[f64; D]>,
    /// `r − r̂`, scaled.
    off: Vec<[f64; D]>,
}

/// A bound on one island, scaled, from `r` itself.
#[derive(Clone, Debug)]
struct Found<const D: usize> {
    energy: f64,
    /// Radius of the ball around `r` in which the answer is the only one.
    alone_within: f64,
    reaction: Vec<[f64; D]>,
    displacement: Vec<[f64; D]>,
}

/// The relative displacement that is reported beside a reaction, and how far that
/// may be from what it stands for.
pub type Given<'a, const D: usize> = (&'a [[f64; D]], &'a [[f64; D]]);

impl<const D: usize> Prepared<D> {
    /// Weights, factors and widths for a problem.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn new(problem: &Reduced<D>, stop: &AtomicBool) -> Result<Self, Error> {
        let units = Units::of(problem);
        let islands = Self::islands(problem, &units, stop)?;
        Ok(Self { units, islands })
    }

    /// Of a problem of which nothing can be proved.
    #[must_use]
    pub fn refused(problem: &Reduced<D>, reason: Reason) -> Self {
        Self {
            units: Units::of(problem),
            islands: Err(reason),
        }
    }

    fn islands(
        problem: &Reduced<D>,
        units: &Units,
        stop: &AtomicBool,
    ) -> Result<Result<Vec<Island<D>>, Reason>, Error> {
        let caller = problem.compliance.order();
        if let Some((contact, _)) = problem.contradiction {
            return Ok(Err(Reason::NoAnswer { contact }));
        }
        if !problem.rigid.modes.is_empty() {
            return Ok(Err(Reason::HeldByContact));
        }
        let mut islands = Vec::new();
        for island in problem.compliance.islands() {
            let unknowns = D * island.nodes.len();
            if unknowns > LARGEST {
                return Ok(Err(Reason::TooLarge { unknowns }));
            }
            let first = caller[island.nodes.start];
            let monotony = match Monotony::new(problem, units, island.nodes.clone()) {
                Ok(monotony) => monotony,
                Err(Touching(position)) => {
                    let contact = caller[position];
                    return Ok(Err(Reason::Touching { contact }));
                }
            };
            if let Some(position) = monotony.led_tangent() {
                let contact = caller[position];
                return Ok(Err(Reason::Led { contact }));
            }
            match Island::new(problem, units, monotony, stop)? {
                Some(island) => islands.push(island),
                None => return Ok(Err(Reason::NotDefinite { contact: first })),
            }
        }
        Ok(Ok(islands))
    }

    /// The bound at a reaction, in the order of positions; `given` is what is reported
    /// as its relative displacement, `W r + q` itself without.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn bound(
        &self,
        problem: &Reduced<D>,
        (r, rigid): (&[[f64; D]], &[f64]),
        given: Option<Given<'_, D>>,
        stop: &AtomicBool,
    ) -> Result<Bound<D>, Error> {
        let mut bound = Bound::start(problem, r, rigid);
        let islands = match &self.islands {
            Ok(islands) => islands,
            Err(reason) => return Ok(bound.none(*reason)),
        };
        let caller = problem.compliance.order();
        let r = scaled(r, &self.units.to_r);
        for island in islands {
            if let Some(position) = island.impossible(&r) {
                let contact = caller[position];
                return Ok(bound.none(Reason::Impossible { contact }));
            }
        }
        let (here, here_error) = self.displacement(problem, &r, &[]);
        let given = match given {
            None => (here.clone(), here_error),
            Some((v, error)) => (scaled(v, &self.units.to_v), scaled(error, &self.units.to_v)),
        };
        let onto_cone: Vec<_> = r
            .iter()
            .zip(&problem.mu)
            .map(|(r, &mu)| project(r, mu).0)
            .collect();
        let by_law: Vec<_> = r
            .iter()
            .zip(&here)
            .zip(&problem.mu)
            .map(|((r, v), &mu)| law_step(r, v, 1.0, mu).0)
            .collect();
        let candidates =
            [by_law, onto_cone].map(|point| self.candidate(problem, islands, &r, point));
        let (mut squares, mut by_gap, mut size) = (0.0, Some(0.0), 0.0);
        for island in islands {
            let mut found = island.global_bound(&candidates, &given);
            if found.is_none() {
                bound.kind = Kind::Local;
                found = island.local_bound(&candidates, &given, stop)?;
            }
            let nodes = island.monotony.nodes.clone();
            let Some(found) = found else {
                let contact = caller[nodes.start];
                return Ok(bound.none(Reason::Friction { contact }));
            };
            squares += found.energy * found.energy;
            bound.alone_within = bound.alone_within.min(found.alone_within);
            bound.reaction[nodes.clone()].copy_from_slice(&found.reaction);
            bound.relative_displacement[nodes].copy_from_slice(&found.displacement);
            let both = bound.contraction.zip(island.contraction);
            bound.contraction = both.map(|(a, b)| a.max(b));
            let error = island.energy_by_gap(&candidates[1]);
            by_gap = by_gap.zip(error).map(|(sum, e)| sum + e * e);
            size += island.least_size(&r);
        }
        let room = 1.0 + gamma(islands.len());
        let energy = room * squares.sqrt();
        let rest = size.sqrt() / room - energy;
        bound.relative = match (energy > 0.0, rest > 0.0) {
            (false, _) => 0.0,
            (true, true) => room * energy / rest,
            (true, false) => f64::INFINITY,
        };
        bound.energy = self.energy(energy);
        bound.alone_within = self.energy(bound.alone_within) * (1.0 - gamma(0));
        bound.energy_by_gap = by_gap.map(|sum| self.energy(room * sum.sqrt()));
        unscale(&mut bound.reaction, &self.units.to_r);
        unscale(&mut bound.relative_displacement, &self.units.to_v);
        let rows = bound.reaction.iter().chain(&bound.relative_displacement);
        if !bound.energy.is_finite() || !rows.flatten().all(|x| x.is_finite()) {
            return Ok(bound.none(Reason::Range));
        }
        bound.reaction = problem.compliance.scatter(&bound.reaction);
        bound.relative_displacement = problem.compliance.scatter(&bound.relative_displacement);
        Ok(bound)
    }

    /// Whether there is one answer for every `q`.
    #[must_use]
    pub fn unique(&self) -> bool {
        let islands = self.islands.as_ref();
        islands.is_ok_and(|islands| islands.iter().all(|island| island.global.is_some()))
    }

    /// A square root of energy in the caller's units, from above.
    fn energy(&self, scaled: f64) -> f64 {
        let half = self.units.to_energy.div_euclid(2);
        let odd = self.units.to_energy.rem_euclid(2) == 1;
        let root = times_two_to(scaled, -half);
        if odd {
            root * std::f64::consts::FRAC_1_SQRT_2 * (1.0 + f64::EPSILON)
        } else {
            root
        }
    }

    /// `Ŵ r̂ + q̂` with sums as in twice the precision, and how far it may be from that of
    /// any reaction within `moved` in each component of each contact.
    fn displacement(
        &self,
        problem: &Reduced<D>,
        r: &[[f64; D]],
        moved: &[f64],
    ) -> (Vec<[f64; D]>, Vec<[f64; D]>) {
        let mut plain = r.to_vec();
        unscale(&mut plain, &self.units.to_r);
        let v = scaled(&problem.exact_displacement(&plain, &[]), &self.units.to_v);
        let sizes = |rows: &[[f64; D]]| {
            let mut sizes = vec![[0.0; D]; rows.len()];
            problem.compliance.absolute_product(rows, &mut sizes);
            scaled(&sizes, &self.units.to_v)
        };
        let terms = sizes(&plain);
        let free = scaled(&problem.q, &self.units.to_v);
        let gamma = gamma(D * r.len());
        // Of a sum as in twice the precision [ORO05, proposition 5.5].
        let mut error: Vec<[f64; D]> = v
            .iter()
            .zip(terms.iter().zip(&free))
            .map(|(v, (w, q))| {
                std::array::from_fn(|k| {
                    f64::EPSILON * v[k].abs() + 2.0 * gamma * gamma * (w[k] + q[k].abs())
                })
            })
            .collect();
        if moved.iter().any(|&m| m > 0.0) {
            let mut by: Vec<[f64; D]> = moved.iter().map(|&m| [m; D]).collect();
            unscale(&mut by, &self.units.to_r);
            for (error, more) in error.iter_mut().zip(sizes(&by)) {
                for (e, more) in error.iter_mut().zip(more) {
                    *e += (1.0 + gamma) * more;
                }
            }
        }
        (v, error)
    }

    fn candidate(
        &self,
        problem: &Reduced<D>,
        islands: &[Island<D>],
        r: &[[f64; D]],
        mut point: Vec<[f64; D]>,
    ) -> Candidate<D> {
        for island in islands {
            for position in island.monotony.nodes.clone() {
                // Nothing moves its normal: it stays open.
                if island.monotony.unknown(position, 0).is_none() {
                    point[position] = [0.0; D];
                }
            }
        }
        let points = point.iter().zip(&problem.mu);
        let faces: Vec<Face<D>> = points.map(|(r, &mu)| Face::of(r, mu)).collect();
        let reaction: Vec<_> = faces.iter().map(|face| face.reaction).collect();
        let moved: Vec<_> = faces.iter().map(|face| face.moved).collect();
        let (v, dv) = self.displacement(problem, &reaction, &moved);
        let off = r.iter().zip(&reaction);
        let off = off.map(|(r, x)| std::array::from_fn(|k| r[k] - x[k]));
        Candidate {
            off: off.collect(),
            faces,
            v,
            dv,
        }
    }
}

fn scaled<const D: usize>(rows: &[[f64; D]], exponents: &[i32]) -> Vec<[f64; D]> {
    let rows = rows.iter().zip(exponents);
    rows.map(|(row, &e)| row.map(|c| times_two_to(c, e)))
        .collect()
}

fn unscale<const D: usize>(rows: &mut [[f64; D]], exponents: &[i32]) {
    for (row, &e) in rows.iter_mut().zip(exponents) {
        *row = row.map(|c| times_two_to(c, -e));
    }
}

impl<const D: usize> Island<D> {
    /// Nothing where the symmetric part of `W` is not positive definite.
    fn new(
        problem: &Reduced<D>,
        units: &Units,
        monotony: Monotony<D>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let all = monotony.all();
        let (half, error) = monotony.symmetric_part(&all);
        let Some(of_w) = Below::new(half.clone(), all.len(), error, stop)? else {
            return Ok(None);
        };
        let common = weights::common(&monotony, of_w.lower());
        let refined = weights::refined(&monotony, &common, stop)?;
        let contraction = contraction(&monotony, &common, stop)?;
        let mut rows = Vec::with_capacity(D * monotony.nodes.len() * all.len());
        for position in monotony.nodes.clone() {
            for k in 0..D {
                let pushed = monotony.components.iter();
                rows.extend(pushed.map(|&c| scaled_entry(problem, units, (position, k), c)));
            }
        }
        let mut island = Self {
            half,
            widths_of_w: of_w.widths(),
            of_w,
            common,
            refined,
            contraction,
            global: None,
            rows,
            monotony,
        };
        let known = vec![Known::Nothing; island.monotony.mu.len()];
        let tried: Vec<Weights> = island.tried().cloned().collect();
        for weights in tried {
            island.global =
                island.certificate(Ties::none(all.clone()), &weights, known.clone(), stop)?;
            if let Some(certificate) = &mut island.global {
                certificate.widths = widths(&island.rows, &island.monotony, certificate);
                break;
            }
        }
        Ok(Some(island))
    }

    /// The weights to try, best first.
    fn tried(&self) -> impl Iterator<Item = &Weights> + use<'_, D> {
        let refined = self.refined.iter();
        refined.chain(std::iter::once(&self.common.weights))
    }

    /// A contact with a reaction where the law leaves none.
    fn impossible(&self, r: &[[f64; D]]) -> Option<usize> {
        let carried = |&position: &usize| {
            (0..D).any(|k| self.monotony.unknown(position, k).is_none() && r[position][k] != 0.0)
        };
        self.monotony.nodes.clone().find(carried)
    }

    fn certificate(
        &self,
        ties: Ties,
        weights: &Weights,
        known: Vec<Known<D>>,
        stop: &AtomicBool,
    ) -> Result<Option<Certificate<D>>, Error> {
        let all = ties.unknowns();
        let (form, error) = ties.compress(self.monotony.form(&all, weights, &known));
        let Some(below) = Below::new(form.clone(), ties.len(), error, stop)? else {
            return Ok(None);
        };
        let (half, of_half) = ties.compress(self.monotony.symmetric_part(&all));
        let ratio = least_ratio((&form, error), below.lower(), (&half, of_half), stop)?;
        Ok(ratio.map(|alpha| Certificate {
            normal: weights.normal.clone(),
            widths: Widths::default(),
            ties,
            known,
            below,
            alpha,
        }))
    }

    /// The least over the candidates, number by number: there is one answer only.
    fn global_bound(
        &self,
        candidates: &[Candidate<D>; 2],
        given: &(Vec<[f64; D]>, Vec<[f64; D]>),
    ) -> Option<Found<D>> {
        let certificate = self.global.as_ref()?;
        let [mut first, second] = candidates.each_ref().map(|candidate| {
            let ellipsoid = self.ellipsoid(certificate, candidate);
            self.found(certificate, candidate, given, &ellipsoid, f64::INFINITY)
        });
        let least = |a: &mut [[f64; D]], b: &[[f64; D]]| {
            for (a, b) in a.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
                *a = a.min(*b);
            }
        };
        least(&mut first.reaction, &second.reaction);
        least(&mut first.displacement, &second.displacement);
        first.energy = first.energy.min(second.energy);
        Some(first)
    }

    /// The ellipsoid that holds `d`, over the unknowns kept.
    fn ellipsoid(&self, certificate: &Certificate<D>, candidate: &Candidate<D>) -> Ellipsoid {
        let Certificate { ties, known, .. } = certificate;
        let (e, error) = self.misfit(ties, &certificate.normal, known, candidate);
        certificate.below.ellipsoid(&e, &error)
    }

    fn misfit(
        &self,
        ties: &Ties,
        normal: &[f64],
        known: &[Known<D>],
        candidate: &Candidate<D>,
    ) -> (Vec<f64>, Vec<f64>) {
        let first = self.monotony.nodes.start;
        let of = |(&unknown, tied): (&usize, &Option<(usize, f64)>)| {
            let (contact, k) = self.monotony.contact(unknown);
            let at = first + contact;
            let (v, dv) = (&candidate.v[at], &candidate.dv[at]);
            let (face, p) = (&candidate.faces[at], normal[contact]);
            if tied.is_some() {
                return face.misfit_along(v[0], dv[0], p);
            }
            let (e, error) = match known[contact] {
                Known::Sticks => Face::misfit_held(v, dv, p),
                _ => face.misfit(v, dv, p, self.monotony.mu[contact]),
            };
            (e[k], error[k])
        };
        ties.kept.iter().zip(&ties.tied).map(of).unzip()
    }

    /// `‖d‖` in the norm of `W`, from above.
    fn length(&self, certificate: &Certificate<D>, ellipsoid: &Ellipsoid) -> f64 {
        let whole = self.spread(&certificate.ties, &ellipsoid.centre);
        let room = 1.0 + gamma(whole.len());
        room * (self.norm(&whole) + ellipsoid.radius / certificate.alpha.sqrt())
    }

    /// Values of the unknowns kept, and what they carry along, among zeros.
    fn spread(&self, ties: &Ties, values: &[f64]) -> Vec<f64> {
        let mut whole = vec![0.0; self.monotony.order()];
        for ((&unknown, tied), &value) in ties.kept.iter().zip(&ties.tied).zip(values) {
            whole[unknown] = value;
            if let Some((other, factor)) = *tied {
                whole[other] = factor * value;
            }
        }
        whole
    }

    /// `√(xᵀ W x)`, from above.
    fn norm(&self, x: &[f64]) -> f64 {
        let energy: f64 = product(&self.half, x)
            .iter()
            .zip(x)
            .map(|(a, b)| a * b)
            .sum();
        let lost = 2.0 * gamma(2 * x.len()) * norm(&self.half) * norm(x).powi(2);
        (energy.max(0.0) + lost).sqrt() * (1.0 + gamma(0))
    }

    /// `rᵀ W r`, from below.
    fn least_size(&self, r: &[[f64; D]]) -> f64 {
        let x: Vec<f64> = self
            .monotony
            .components
            .iter()
            .map(|&(i, k)| r[i][k])
            .collect();
        let energy: f64 = product(&self.half, &x)
            .iter()
            .zip(&x)
            .map(|(a, b)| a * b)
            .sum();
        let lost = 2.0 * gamma(2 * x.len()) * norm(&self.half) * norm(&x).powi(2);
        (energy - lost).max(0.0)
    }

    /// `‖r − r̂‖` in the norm of `W`, from above.
    fn off(&self, candidate: &Candidate<D>) -> f64 {
        let components = &self.monotony.components;
        let off: Vec<f64> = components
            .iter()
            .map(|&(i, k)| candidate.off[i][k])
            .collect();
        let moved: Vec<f64> = components
            .iter()
            .map(|&(i, _)| candidate.faces[i].moved)
            .collect();
        // The difference is rounded, and the point of the cone is not the numbers.
        let blur = (norm(&self.half) * (1.0 + gamma(off.len()))).sqrt();
        let blurred = norm(&moved) + f64::EPSILON * norm(&off);
        self.norm(&off) + (1.0 + gamma(off.len())) * blur * blurred
    }

    /// What an ellipsoid around a candidate says of `r` and of the `v` reported with it.
    fn found(
        &self,
        certificate: &Certificate<D>,
        candidate: &Candidate<D>,
        given: &(Vec<[f64; D]>, Vec<[f64; D]>),
        ellipsoid: &Ellipsoid,
        ball: f64,
    ) -> Found<D> {
        let nodes = self.monotony.nodes.clone();
        let centre = self.spread(&certificate.ties, &ellipsoid.centre);
        let radius = ellipsoid.radius;
        let width = self.spread(&certificate.ties, &certificate.widths.reaction);
        let n = self.monotony.order();
        let room = 1.0 + gamma(n);
        let mut reaction = vec![[0.0; D]; nodes.len()];
        let mut displacement = reaction.clone();
        for (contact, position) in nodes.enumerate() {
            for k in 0..D {
                let row = &self.rows[(D * contact + k) * n..][..n];
                let moved: f64 = row.iter().zip(&centre).map(|(w, c)| w * c).sum();
                let along = certificate.widths.displacement[D * contact + k];
                let apart = (given.0[position][k] - candidate.v[position][k]).abs();
                displacement[contact][k] = room
                    * (apart
                        + given.1[position][k]
                        + candidate.dv[position][k]
                        + moved.abs()
                        + gamma(n) * norm(row) * norm(&centre)
                        + radius * along);
                let Some(unknown) = self.monotony.unknown(position, k) else {
                    continue; // zero, as in every answer
                };
                let off = candidate.off[position][k].abs() + candidate.faces[position].moved;
                reaction[contact][k] =
                    room * (off + centre[unknown].abs() + radius * width[unknown].abs());
            }
        }
        let off = self.off(candidate);
        Found {
            energy: room * (off + self.length(certificate, ellipsoid)),
            alone_within: ball - off,
            reaction,
            displacement,
        }
    }

    /// Around a candidate, a ball with exactly one answer, where one is found.
    ///
    /// In the ball `‖d‖ ≤ R`, with the norm of `W`, `w_n` is at most `√W_nn R` and `‖w_t‖` at
    /// most `ω = √‖W_tt‖ R`. Contacts that stay open by this have no reaction at any point of
    /// it that can be an answer, those that slide by more than ω keep their direction to
    /// [`Known::Slides`], in the plane with a reaction on one ray, and those whose reaction
    /// stays inside its cone stick. If `A` made with this is positive definite and bounds `d` by less
    /// than `R`, the variational inequality on the ball and on cones that know this (zero,
    /// the ray, or all of space where `v = 0`), which has a solution since that is compact,
    /// has it inside the ball, and so is an answer; two of them in the ball would
    /// contradict the monotony.
    fn local_bound(
        &self,
        candidates: &[Candidate<D>; 2],
        given: &(Vec<[f64; D]>, Vec<[f64; D]>),
        stop: &AtomicBool,
    ) -> Result<Option<Found<D>>, Error> {
        /// Radii to try, in lengths of `e`; larger ones know less.
        const RADII: [f64; 5] = [3.0, 12.0, 50.0, 200.0, 1000.0];
        let n = self.monotony.order();
        if !self.monotony.symmetric || n > LARGEST_OF_BALLS {
            return Ok(None);
        }
        for candidate in candidates {
            for weights in self.tried() {
                let nothing = vec![Known::Nothing; self.monotony.mu.len()];
                let all = Ties::none(self.monotony.all());
                let (e, error) = self.misfit(&all, &weights.normal, &nothing, candidate);
                let unit = 2.0 * self.of_w.ellipsoid(&e, &error).radius + f64::EPSILON;
                let mut found = None;
                for radii in RADII {
                    let radius = radii * unit;
                    let Some(tried) = self.within(radius, weights, candidate, stop)? else {
                        break;
                    };
                    if tried.1 < radius {
                        found = Some((tried, radius));
                        break;
                    }
                }
                let Some((mut best, ball)) = found else {
                    continue;
                };
                // The answer lies nearer than the ball is wide: more is known there.
                for _ in 0..2 {
                    let nearer = 1.2 * best.1;
                    match self.within(nearer, weights, candidate, stop)? {
                        Some(tried) if tried.1 < best.1 => best = tried,
                        _ => break,
                    }
                }
                let mut certificate = best.0;
                certificate.widths = widths(&self.rows, &self.monotony, &certificate);
                let ellipsoid = self.ellipsoid(&certificate, candidate);
                let found = self.found(&certificate, candidate, given, &ellipsoid, ball);
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// What holds for the answers within a ball: a certificate and the bound of `‖d‖`.
    fn within(
        &self,
        radius: f64,
        weights: &Weights,
        candidate: &Candidate<D>,
        stop: &AtomicBool,
    ) -> Result<Option<(Certificate<D>, f64)>, Error> {
        let n = self.monotony.order();
        let room = 1.0 + gamma(D);
        let entry = |i: usize, j: usize| self.half[j * n + i];
        let mut known = vec![Known::Nothing; self.monotony.mu.len()];
        let mut ties = Ties::default();
        for (contact, position) in self.monotony.nodes.clone().enumerate() {
            let at = |k: usize| self.monotony.unknown(position, k);
            let (v, dv) = (&candidate.v[position], &candidate.dv[position]);
            let lift = at(0).map_or(0.0, |i| entry(i, i).sqrt()) * radius * room;
            let open = candidate.faces[position].place == Place::Apex && v[0] - dv[0] > lift;
            if open {
                continue;
            }
            let face = &candidate.faces[position];
            let mu = self.monotony.mu[contact];
            let tangents: Vec<usize> = (1..D).filter_map(at).collect();
            if face.place == Place::Inside && mu > 0.0 {
                let mut lengths = [0.0; D];
                for (k, length) in lengths.iter_mut().enumerate() {
                    *length = at(k).map_or(0.0, |i| self.widths_of_w[i] * radius * room);
                }
                let least = mu * (face.reaction[0] - lengths[0]) / room;
                let most = room * (tangential_norm(&face.reaction) + tangential_norm(&lengths));
                if least > most {
                    known[contact] = Known::Sticks;
                }
            }
            let sticks = matches!(known[contact], Known::Sticks);
            let largest = match tangents[..] {
                [i] => entry(i, i),
                [i, j] => {
                    let (a, b, c) = (entry(i, i), entry(i, j), entry(j, j));
                    0.5 * (a + c) + (0.5 * (a - c)).hypot(b)
                }
                _ => 0.0,
            };
            let slip = tangential_norm(v) / room;
            let turned = room * (room * largest.sqrt() * radius + room * tangential_norm(dv));
            if slip > turned && !sticks && !tangents.is_empty() {
                let mut direction = v.map(|c| c / tangential_norm(v));
                direction[0] = 0.0;
                // ‖x/‖x‖ − y/‖y‖‖ ≤ 2 ‖x − y‖/‖x‖; in the plane, no turn at all.
                let turn = if D == 2 {
                    0.0
                } else {
                    2.0 * room * turned / slip + 8.0 * f64::EPSILON
                };
                // Beyond 1 the triangle inequality says more.
                if turn < 1.0 {
                    known[contact] = Known::Slides { direction, turn };
                }
                // In the plane the reaction is known to its size, where r̂ agrees.
                let agrees = match face.place {
                    Place::Apex => true,
                    Place::Ray(ray) => ray[1] * direction[1] < 0.0,
                    Place::Inside => false,
                };
                if let (2, true, [tangent], Some(normal)) = (D, agrees, &tangents[..], at(0)) {
                    ties.push(normal, Some((*tangent, -mu * direction[1].signum())));
                    continue;
                }
            }
            for unknown in (0..D).filter_map(at) {
                ties.push(unknown, None);
            }
        }
        let certificate = self.certificate(ties, weights, known, stop)?;
        Ok(certificate.map(|certificate| {
            let ellipsoid = self.ellipsoid(&certificate, candidate);
            let length = self.length(&certificate, &ellipsoid);
            (certificate, length)
        }))
    }

    /// `‖r − r*‖` by what is missing: with `L < 1`, and `u` such that no contact
    /// penetrates, `½ (1 − L) (‖u − u*‖² + ‖r̂ − r*‖²) ≤ B(u, r̂)`.
    ///
    /// `B = ½ ‖u − w‖² + Σ γ` where `w` is in equilibrium with `r̂`; `u` lifts the contacts
    /// that penetrate, by `λ`, at the least energy, `½ λᵀ W⁻¹ λ`.
    fn energy_by_gap(&self, candidate: &Candidate<D>) -> Option<f64> {
        let contraction = self.contraction?;
        let mut lift = vec![0.0; self.monotony.order()];
        let mut gaps = 0.0;
        for (contact, position) in self.monotony.nodes.clone().enumerate() {
            let (v, dv) = (&candidate.v[position], &candidate.dv[position]);
            let face = &candidate.faces[position];
            let mu = self.monotony.mu[contact];
            let raised = (dv[0] - v[0]).max(0.0);
            if let Some(unknown) = self.monotony.unknown(position, 0) {
                lift[unknown] = raised;
            }
            let r = &face.reaction;
            if r[0] == 0.0 {
                continue;
            }
            let slip = if mu > 0.0 { tangential_norm(v) } else { 0.0 };
            let opening = v[0] + raised;
            let along: f64 = (1..D).map(|k| r[k] * v[k]).sum();
            let friction = along + mu * r[0] * slip;
            let sizes: f64 = (1..D).map(|k| (r[k] * v[k]).abs()).sum::<f64>() + mu * r[0] * slip;
            let lost = r[0] * (dv[0] + f64::EPSILON * (v[0].abs() + raised))
                + (1..D)
                    .map(|k| r[k].abs() * dv[k] + face.moved * (v[k].abs() + dv[k]))
                    .sum::<f64>()
                + mu * r[0] * tangential_norm(dv)
                + gamma(D) * (sizes + r[0] * opening.abs());
            gaps += (r[0] * opening).max(0.0) + friction.max(0.0) + lost;
        }
        let half = 0.5 * self.of_w.length(&lift).powi(2);
        let missing = (half + gaps) * (1.0 + gamma(lift.len()));
        Some((2.0 * missing / (1.0 - contraction)).sqrt() * (1.0 + gamma(0)) + self.off(candidate))
    }
}

/// Widths of the unit ellipsoid of a certificate, along its unknowns and along rows.
fn widths<const D: usize>(
    rows: &[f64],
    monotony: &Monotony<D>,
    certificate: &Certificate<D>,
) -> Widths {
    let count = D * monotony.nodes.len();
    let mut displacement = vec![0.0; count];
    let Ties { kept, tied } = &certificate.ties;
    if !kept.is_empty() {
        let mut along = Vec::with_capacity(count * kept.len());
        let mut errors = Vec::with_capacity(count);
        for row in rows.chunks_exact(monotony.order()) {
            let mut rounding = 0.0;
            for (&unknown, tied) in kept.iter().zip(tied) {
                let other = tied.map_or(0.0, |(other, factor)| factor * row[other]);
                if other != 0.0 {
                    rounding += 4.0 * f64::EPSILON * (row[unknown].abs() + other.abs());
                }
                along.push(row[unknown] + other);
            }
            errors.push(rounding);
        }
        displacement = certificate.below.widths_along(&along, &errors);
    }
    Widths {
        reaction: certificate.below.widths(),
        displacement,
    }
}
