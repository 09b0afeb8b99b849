//! A proved bound of the distance of a point from the solution, see chapter 9 of `docs/paper`.
//!
//! If `A` of [`monotonicity`](crate::proof::monotonicity) is positive definite, there is
//! exactly one solution `r*`. For `r̂ ∈ K_μ` and an orthogonal `y ∈ K*_μ`, `e = y − V(r̂)` and
//! `d = r̂ − r*` satisfy
//!
//! ```text
//! dᵀ A d + e·d ≤ 0,
//! ```
//!
//! an ellipsoid that contains `d`. All variables are scaled by powers of two, which is exact,
//! and every rounding is bounded: that of `W r̂ + q`, of `e`, of `A`, of its factor and of
//! solves with it. The bound is for the solution with `W`, `q`, `μ` as they are in memory. With
//! two coefficients of a contact it also contains the rounding of the change of variables.

mod island;

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::bipotential::{self, law_step};
use crate::law::cone::project;
use crate::law::contact_law::ContactLaw;
use crate::law::face::Face;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{amax, dot, rows_plus_scaled};
use crate::linalg::verified_cholesky::gamma;
use crate::proof::error_bound::island::{BoundedIsland, Candidate};
use crate::proof::monotonicity::{Monotonicity, Touching, Units};
use crate::proof::tuning;
use crate::reduced::elliptic_scaling::{self, EllipticScaling};
use crate::reduced::reduced::Reduced;

/// Why there is no bound. Contacts are in the numbering of the caller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// Only contact holds a body: `A` has no information on its rigid motions.
    HeldByContact,
    /// A contact penetrates that nothing can move.
    NoAnswer(usize),
    /// Nothing moves a contact that just touches.
    Touching(usize),
    /// A tangent with friction that nothing moves.
    Led(usize),
    /// An island with so many unknowns that no bound is tried.
    TooLarge(usize),
    /// The symmetric part of `W` is not positive definite beyond rounding.
    NotDefinite(usize),
    /// Friction is too large for `A`, and no ball was found.
    Friction(usize),
    /// A reaction that the law excludes: on a tangent without friction, or at a contact that
    /// stays open.
    Impossible(usize),
    /// A law with dilatancy.
    Dilatancy(usize),
    /// Numbers beyond the range of doubles.
    Range,
}

impl Reason {
    /// A word for it, and its contact or number of unknowns.
    pub fn told(self) -> (&'static str, usize) {
        match self {
            Self::HeldByContact => ("held by contact", 0),
            Self::NoAnswer(contact) => ("no answer", contact),
            Self::Touching(contact) => ("touching", contact),
            Self::Led(contact) => ("led", contact),
            Self::TooLarge(unknowns) => ("too large", unknowns),
            Self::NotDefinite(contact) => ("not definite", contact),
            Self::Friction(contact) => ("friction", contact),
            Self::Impossible(contact) => ("impossible", contact),
            Self::Dilatancy(contact) => ("dilatancy", contact),
            Self::Range => ("range", 0),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BoundKind {
    /// There is one solution, within this distance.
    Global,
    /// A solution is within this distance; it is the only one within a ball.
    Local,
    NotAvailable(Reason),
}

impl BoundKind {
    pub fn name(self) -> &'static str {
        match self {
            Self::Global => "global",
            Self::Local => "local",
            Self::NotAvailable(_) => "not available",
        }
    }
}

/// A bound of the error of a point, in the units and numbering of the caller; unavailable parts
/// are empty.
#[derive(Clone, Debug)]
pub struct Bound<const D: usize> {
    pub kind: BoundKind,
    /// `‖r − r*‖` in the norm of `W`.
    pub energy: f64,
    /// `energy` over `‖r*‖`; infinite if `r* = 0` is not excluded.
    pub relative: f64,
    /// For a local bound, the radius of the ball around `r` without another solution, in this
    /// norm; infinite for a global bound.
    pub alone_within: f64,
    pub reaction: Vec<[f64; D]>,
    pub relative_displacement: Vec<[f64; D]>,
    /// `L`, if it is proved to be below 1 on each island.
    pub contraction: Option<f64>,
    /// A bound of `‖r − r*‖` by the missing energy, if `L < 1`.
    pub energy_by_gap: Option<f64>,
    /// Gap of the bipotential of each contact, at `r`.
    pub gap: Vec<f64>,
    /// The sum of the gaps over `½ rᵀ W r`, the energy of the reactions; `None` outside the
    /// range of doubles.
    pub share: Option<f64>,
}

impl<const D: usize> Bound<D> {
    fn none(self, reason: Reason) -> Self {
        Self {
            kind: BoundKind::NotAvailable(reason),
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

    /// The bound of `r = T r̃` and `v = T⁻¹ ṽ`, rounded up.
    pub fn change_variables(mut self, elliptic: Option<&EllipticScaling>) -> Self {
        if let Some(elliptic) = elliptic {
            self.reaction = elliptic.times(&self.reaction);
            self.relative_displacement = elliptic.over(&self.relative_displacement);
            let fields = [&mut self.reaction, &mut self.relative_displacement];
            for value in fields.into_iter().flat_map(|rows| rows.as_flattened_mut()) {
                *value *= 1.0 + elliptic_scaling::ROUNDING;
            }
        }
        self
    }

    fn start(problem: &Reduced<D>, r: &[[f64; D]], rigid: &[f64]) -> Self {
        let v = problem.exact_displacement(r, rigid);
        let contacts = r.iter().zip(&v).zip(&problem.law);
        let gap: Vec<f64> = contacts
            .map(|((r, v), law)| bipotential::gap(r, v, *law))
            .collect();
        Self {
            kind: BoundKind::Global,
            energy: 0.0,
            relative: 0.0,
            alone_within: f64::INFINITY,
            reaction: vec![[0.0; D]; r.len()],
            relative_displacement: vec![[0.0; D]; r.len()],
            contraction: Some(0.0),
            energy_by_gap: None,
            gap: problem.compliance.scatter(&gap),
            share: share(problem, r, &v),
        }
    }
}

/// Data shared by the bounds of one `W` and `μ`.
#[derive(Debug)]
pub struct Prepared<const D: usize> {
    units: Units,
    islands: Result<Vec<BoundedIsland<D>>, Reason>,
}

/// The relative displacement that is reported for a reaction, and its error.
pub type Reported<'a, const D: usize> = (&'a [[f64; D]], &'a [[f64; D]]);

impl<const D: usize> Prepared<D> {
    /// Weights, factors and widths for a problem.
    pub fn new(problem: &Reduced<D>, stop: &AtomicBool) -> Result<Self, Error> {
        let units = Units::of(problem);
        let islands = Self::islands(problem, &units, stop)?;
        Ok(Self { units, islands })
    }

    fn islands(
        problem: &Reduced<D>,
        units: &Units,
        stop: &AtomicBool,
    ) -> Result<Result<Vec<BoundedIsland<D>>, Reason>, Error> {
        let caller = problem.compliance.order();
        let laws = problem.law.iter().zip(caller);
        if let Some((_, &contact)) = laws.into_iter().find(|(law, _)| law.dilatancy > 0.0) {
            return Ok(Err(Reason::Dilatancy(contact)));
        }
        if let Some((contact, _)) = problem.contradiction {
            return Ok(Err(Reason::NoAnswer(contact)));
        }
        if !problem.rigid.modes.is_empty() {
            return Ok(Err(Reason::HeldByContact));
        }
        let mut islands = Vec::new();
        for island in problem.compliance.islands() {
            let unknowns = D * island.nodes.len();
            if unknowns > tuning::bounded_unknowns() {
                return Ok(Err(Reason::TooLarge(unknowns)));
            }
            let first = caller[island.nodes.start];
            let monotonicity = match Monotonicity::new(problem, units, island.nodes.clone()) {
                Ok(monotonicity) => monotonicity,
                Err(Touching(position)) => return Ok(Err(Reason::Touching(caller[position]))),
            };
            if let Some(position) = monotonicity.led_tangent() {
                return Ok(Err(Reason::Led(caller[position])));
            }
            match BoundedIsland::new(problem, units, monotonicity, stop)? {
                Some(island) => islands.push(island),
                None => return Ok(Err(Reason::NotDefinite(first))),
            }
        }
        Ok(Ok(islands))
    }

    /// The bound at a reaction in the order of positions. `given` is its reported relative
    /// displacement; without it, `W r + q` is used.
    pub fn bound(
        &self,
        problem: &Reduced<D>,
        (r, rigid): (&[[f64; D]], &[f64]),
        given: Option<Reported<'_, D>>,
        stop: &AtomicBool,
    ) -> Result<Bound<D>, Error> {
        let mut bound = Bound::start(problem, r, rigid);
        let islands = match &self.islands {
            Ok(islands) => islands,
            Err(reason) => return Ok(bound.none(*reason)),
        };
        let caller = problem.compliance.order();
        let plain = r;
        let r = scaled(plain, &self.units.to_r);
        for island in islands {
            let nodes = island.monotonicity.nodes.clone();
            if !(within_range(&plain[nodes.clone()]) && within_range(&r[nodes])) {
                return Ok(bound.none(Reason::Range));
            }
        }
        for island in islands {
            if let Some(position) = island.impossible(&r) {
                return Ok(bound.none(Reason::Impossible(caller[position])));
            }
        }
        let (here, here_error) = self.displacement(problem, &r, &[]);
        let given = match given {
            None => (here.clone(), here_error),
            Some((v, error)) => (scaled(v, &self.units.to_v), scaled(error, &self.units.to_v)),
        };
        let laws = self.laws(problem);
        let onto_cone = |i: usize| project(&r[i], laws[i]).0;
        let by_law = |i: usize| law_step(&r[i], &here[i], 1.0, laws[i]).0;
        let all = 0..r.len();
        let points: [Vec<_>; 2] = [
            all.clone().map(by_law).collect(),
            all.map(onto_cone).collect(),
        ];
        let candidates = points.map(|point| self.candidate(problem, islands, &r, point));
        let room = 1.0 + gamma(islands.len());
        let mut energy = 0.0_f64;
        // Other solutions differ from r on at least one island, this one on all. If a ball is
        // smaller than the sum over all islands, a wider one is tried.
        for least in [false, true] {
            let least = if least { energy } else { 0.0 };
            (energy, bound.alone_within) = (0.0, f64::INFINITY);
            for island in islands {
                let mut found = island.global_bound(&candidates, &given);
                let nodes = island.monotonicity.nodes.clone();
                let mut laws = problem.law[nodes.clone()].iter();
                // The cells of a local bound are those of cones.
                if found.is_none() && laws.all(|law| law.cohesion == 0.0) {
                    bound.kind = BoundKind::Local;
                    found = island.local_bound(&candidates, &given, least, stop)?;
                }
                let Some(found) = found else {
                    return Ok(bound.none(Reason::Friction(caller[nodes.start])));
                };
                energy = energy.hypot(found.energy);
                bound.alone_within = bound.alone_within.min(found.alone_within);
                bound.reaction[nodes.clone()].copy_from_slice(&found.reaction);
                bound.relative_displacement[nodes].copy_from_slice(&found.displacement);
            }
            energy *= room;
            if energy <= bound.alone_within {
                break;
            }
        }
        if !(energy <= bound.alone_within) {
            let contact = islands.iter().find(|island| island.global.is_none());
            let contact = contact.map_or(0, |island| caller[island.monotonicity.nodes.start]);
            return Ok(bound.none(Reason::Friction(contact)));
        }
        let (mut by_gap, mut size) = (Some(0.0_f64), 0.0_f64);
        for island in islands {
            let both = bound.contraction.zip(island.contraction);
            bound.contraction = both.map(|(a, b)| a.max(b));
            let mut laws = problem.law[island.monotonicity.nodes.clone()].iter();
            // The gap of a cone is measured.
            let conical = laws.all(|law| law.cohesion == 0.0);
            let error = conical.then(|| island.energy_by_gap(&candidates[1]));
            let error = error.flatten();
            by_gap = by_gap.zip(error).map(|(sum, e)| sum.hypot(e));
            size = size.hypot(island.least_size(&r));
        }
        let rest = size / room - energy;
        bound.relative = match (energy > 0.0, rest > 0.0) {
            (false, _) => 0.0,
            (true, true) => room * energy / rest,
            (true, false) => f64::INFINITY,
        };
        if !self.to_units(&mut bound, energy, by_gap.map(|gap| room * gap)) {
            return Ok(bound.none(Reason::Range));
        }
        bound.reaction = problem.compliance.scatter(&bound.reaction);
        bound.relative_displacement = problem.compliance.scatter(&bound.relative_displacement);
        Ok(bound)
    }

    /// Converts a scaled bound to the units of the caller; returns whether it is still valid.
    fn to_units(&self, bound: &mut Bound<D>, energy: f64, by_gap: Option<f64>) -> bool {
        // A bound that leaves the range of doubles is not valid.
        let kept = |&(scaled, plain): &(f64, f64)| {
            plain.is_finite() && (scaled == 0.0 || plain >= f64::MIN_POSITIVE)
        };
        bound.energy = self.energy(energy);
        bound.alone_within = self.energy(bound.alone_within) * (1.0 - gamma(0));
        let by_gap = by_gap.map(|gap| (gap, self.energy(gap)));
        bound.energy_by_gap = by_gap.filter(kept).map(|(_, plain)| plain);
        let mut told = vec![(energy, bound.energy)];
        let of_scaled = [bound.reaction.clone(), bound.relative_displacement.clone()];
        unscale(&mut bound.reaction, &self.units.to_r);
        unscale(&mut bound.relative_displacement, &self.units.to_v);
        let of_caller = [&bound.reaction, &bound.relative_displacement];
        for (before, after) in of_scaled.iter().zip(of_caller) {
            let pairs = before.as_flattened().iter().zip(after.as_flattened());
            told.extend(pairs.map(|(a, b)| (*a, *b)));
        }
        told.iter().all(kept) && bound.energy <= bound.alone_within
    }

    /// Whether there is one solution for each `q`.
    pub fn unique(&self) -> bool {
        let islands = self.islands.as_ref();
        islands.is_ok_and(|islands| islands.iter().all(|island| island.global.is_some()))
    }

    /// A square root of energy in the units of the caller, rounded up.
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

    /// `Ŵ r̂ + q̂` with sums in twice the precision, and its largest difference for reactions
    /// within `moved` in each component.
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
        // Error of a sum in twice the precision [ORO05, proposition 5.5].
        let of_term = 2.0 * gamma * gamma + (1.0 + gamma) * problem.entry_rounding;
        let error_at = |(i, v): (usize, &[f64; D])| {
            let terms = |k: usize| terms[i][k] + free[i][k].abs();
            std::array::from_fn(|k| f64::EPSILON * v[k].abs() + of_term * terms(k))
        };
        let mut error: Vec<[f64; D]> = v.iter().enumerate().map(error_at).collect();
        if moved.iter().any(|&m| m > 0.0) {
            let mut by: Vec<[f64; D]> = moved.iter().map(|&m| [m; D]).collect();
            unscale(&mut by, &self.units.to_r);
            error = rows_plus_scaled(&error, 1.0 + gamma + problem.entry_rounding, &sizes(&by));
        }
        (v, error)
    }

    fn laws(&self, problem: &Reduced<D>) -> Vec<ContactLaw> {
        let laws = problem.law.iter().zip(&self.units.to_r);
        laws.map(|(law, &to_r)| law.scaled(times_two_to(1.0, to_r)))
            .collect()
    }

    fn candidate(
        &self,
        problem: &Reduced<D>,
        islands: &[BoundedIsland<D>],
        r: &[[f64; D]],
        mut point: Vec<[f64; D]>,
    ) -> Candidate<D> {
        for island in islands {
            for position in island.monotonicity.nodes.clone() {
                // Nothing moves its normal: it stays open.
                if island.monotonicity.unknown(position, 0).is_none() {
                    let cohesive = problem.law[position].cohesion > 0.0;
                    point[position][..if cohesive { 1 } else { D }].fill(0.0);
                }
            }
        }
        let points = point.iter().zip(self.laws(problem));
        let faces: Vec<Face<D>> = points.map(|(r, law)| Face::of(r, law)).collect();
        let reaction: Vec<_> = faces.iter().map(|face| face.reaction).collect();
        let moved: Vec<_> = faces.iter().map(|face| face.moved).collect();
        let (v, dv) = self.displacement(problem, &reaction, &moved);
        let blur = |r: &[f64; D]| r.map(|c| problem.entry_rounding * c.abs());
        Candidate {
            off: rows_plus_scaled(r, -1.0, &reaction),
            blur: r.iter().map(blur).collect(),
            faces,
            v,
            dv,
        }
    }
}

/// The sum of the gaps over `½ rᵀ W r`. It is computed with `r` over a power of two, because
/// the energy of small reactions underflows.
fn share<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]], v: &[[f64; D]]) -> Option<f64> {
    let e = exponent(amax(r.as_flattened()));
    let unit: Vec<_> = r.iter().map(|r| r.map(|c| times_two_to(c, -e))).collect();
    let mut moved = vec![[0.0; D]; r.len()];
    problem.compliance.product(&unit, &mut moved);
    let contacts = unit.iter().zip(v).zip(&problem.law);
    let gaps: f64 = contacts
        .map(|((r, v), law)| bipotential::gap(r, v, law.scaled(times_two_to(1.0, -e))))
        .sum();
    let works = unit.iter().zip(&moved).map(|(r, w)| dot(r, w));
    let stored = 0.5 * works.sum::<f64>();
    if gaps == 0.0 {
        return Some(0.0);
    }
    if !(gaps.is_finite() && stored.is_finite()) {
        return None;
    }
    let ratio = times_two_to(gaps / stored, -e);
    Some(if stored == 0.0 {
        gaps.signum() * f64::INFINITY
    } else {
        ratio
    })
}

/// Whether products of these numbers with others of order one, and with their rounding, keep
/// their digits.
fn within_range<const D: usize>(rows: &[[f64; D]]) -> bool {
    /// The smallest normal number over ε², with a margin for sums.
    const LEAST: f64 = 1e-270;
    const MOST: f64 = 1e270;
    let largest = amax(rows.as_flattened());
    largest == 0.0 || (LEAST..=MOST).contains(&largest)
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
