//! The error bound of one island.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::face::{Face, Place};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{amax, norm, tangential_norm};
use crate::linalg::verified_cholesky::{Ellipsoid, VerifiedCholesky, gamma};
use crate::proof::contraction::contraction;
use crate::proof::monotonicity::{
    KnownSlip, Monotonicity, Ties, Units, Weights, least_ratio, product, scaled_entry,
};
use crate::proof::tuning;
use crate::proof::weights::{self, Common};
use crate::reduced::reduced::Reduced;

/// A smaller energy, in scaled variables, may have lost terms to underflow.
const LEAST_ENERGY: f64 = 1e-280;

/// An island with its factors, which do not depend on a point.
#[derive(Debug)]
pub(super) struct BoundedIsland<const D: usize> {
    pub(super) monotonicity: Monotonicity<D>,
    /// A factor below the symmetric part of `W`, which is `half`.
    pub(super) of_w: VerifiedCholesky,
    /// `|d_j| ≤ width · ‖d‖`.
    pub(super) widths_of_w: Vec<f64>,
    pub(super) half: Vec<f64>,
    pub(super) common: Common,
    pub(super) refined: Option<Weights>,
    pub(super) contraction: Option<f64>,
    pub(super) global: Option<IslandFactor<D>>,
    /// Rows of `Ŵ` of all components of the island, each over its unknowns.
    pub(super) rows: Vec<f64>,
}

/// A factor below `A` and its consequences for any point.
#[derive(Debug)]
pub(super) struct IslandFactor<const D: usize> {
    pub(super) ties: Ties,
    pub(super) normal: Vec<f64>,
    pub(super) known: Vec<KnownSlip<D>>,
    pub(super) cholesky: VerifiedCholesky,
    /// `L Lᵀ ≽ α W`.
    pub(super) alpha: f64,
    /// The widths of the unit ellipsoid along the unknowns and along the rows of `Ŵ`.
    pub(super) widths: Widths,
}

#[derive(Debug, Default)]
pub(super) struct Widths {
    pub(super) reaction: Vec<f64>,
    pub(super) displacement: Vec<f64>,
}

/// A start point in the cones, scaled, with its rounding errors.
pub(super) struct Candidate<const D: usize> {
    pub(super) faces: Vec<Face<D>>,
    pub(super) v: Vec<[f64; D]>,
    pub(super) dv: Vec<[f64; D]>,
    /// `r − r̂`, scaled, and the error of `r`.
    pub(super) off: Vec<[f64; D]>,
    pub(super) blur: Vec<[f64; D]>,
}

/// A bound on one island, scaled, for `r`.
#[derive(Clone, Debug)]
pub(super) struct IslandBound<const D: usize> {
    pub(super) energy: f64,
    /// Radius of the ball around `r` in which the solution is unique.
    pub(super) alone_within: f64,
    pub(super) reaction: Vec<[f64; D]>,
    pub(super) displacement: Vec<[f64; D]>,
}

impl<const D: usize> BoundedIsland<D> {
    /// `None` if the symmetric part of `W` is not positive definite.
    pub(super) fn new(
        problem: &Reduced<D>,
        units: &Units,
        monotonicity: Monotonicity<D>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let all = monotonicity.all();
        let (half, error) = monotonicity.symmetric_part(&all);
        let Some(of_w) = VerifiedCholesky::new(half.clone(), all.len(), error, stop)? else {
            return Ok(None);
        };
        let common = weights::common(&monotonicity, of_w.lower());
        let refined = weights::refined(&monotonicity, &common, stop)?;
        let contraction = contraction(&monotonicity, &common, stop)?;
        let mut rows = Vec::with_capacity(D * monotonicity.nodes.len() * all.len());
        for position in monotonicity.nodes.clone() {
            for k in 0..D {
                let pushed = monotonicity.components.iter();
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
            monotonicity,
        };
        let known = island.monotonicity.nothing_known();
        let mut global = None;
        for weights in island.tried() {
            let ties = Ties::none(all.clone());
            global = island.factor(ties, weights, known.clone(), stop)?;
            if let Some(factor) = &mut global {
                factor.widths = widths(&island.rows, &island.monotonicity, factor);
                break;
            }
        }
        island.global = global;
        Ok(Some(island))
    }

    /// The weights to try, the best first.
    fn tried(&self) -> impl Iterator<Item = &Weights> + use<'_, D> {
        self.refined.iter().chain([&self.common.weights])
    }

    /// A contact with a reaction that the law excludes.
    pub(super) fn impossible(&self, r: &[[f64; D]]) -> Option<usize> {
        let carried = |&position: &usize| {
            (0..D)
                .any(|k| self.monotonicity.unknown(position, k).is_none() && r[position][k] != 0.0)
        };
        self.monotonicity.nodes.clone().find(carried)
    }

    pub(super) fn factor(
        &self,
        ties: Ties,
        weights: &Weights,
        known: Vec<KnownSlip<D>>,
        stop: &AtomicBool,
    ) -> Result<Option<IslandFactor<D>>, Error> {
        let all = ties.unknowns();
        let (form, error) = ties.compress(self.monotonicity.form(&all, weights, &known));
        let Some(cholesky) = VerifiedCholesky::new(form.clone(), ties.kept.len(), error, stop)?
        else {
            return Ok(None);
        };
        let (half, of_half) = ties.compress(self.monotonicity.symmetric_part(&all));
        let ratio = least_ratio((&form, error), cholesky.lower(), (&half, of_half), stop)?;
        Ok(ratio.map(|alpha| IslandFactor {
            normal: weights.normal.clone(),
            widths: Widths::default(),
            ties,
            known,
            cholesky,
            alpha,
        }))
    }

    /// The smallest bound over the candidates, number by number: there is only one solution.
    pub(super) fn global_bound(
        &self,
        candidates: &[Candidate<D>; 2],
        given: &(Vec<[f64; D]>, Vec<[f64; D]>),
    ) -> Option<IslandBound<D>> {
        let factor = self.global.as_ref()?;
        let [mut first, second] = candidates.each_ref().map(|candidate| {
            let ellipsoid = self.ellipsoid(factor, candidate);
            self.found(factor, candidate, given, &ellipsoid, f64::INFINITY)
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

    /// The ellipsoid that contains `d`, over the kept unknowns.
    pub(super) fn ellipsoid(
        &self,
        factor: &IslandFactor<D>,
        candidate: &Candidate<D>,
    ) -> Ellipsoid {
        let IslandFactor { ties, known, .. } = factor;
        let (e, error) = self.misfit(ties, &factor.normal, known, candidate);
        factor.cholesky.ellipsoid(&e, &error)
    }

    pub(super) fn misfit(
        &self,
        ties: &Ties,
        normal: &[f64],
        known: &[KnownSlip<D>],
        candidate: &Candidate<D>,
    ) -> (Vec<f64>, Vec<f64>) {
        let first = self.monotonicity.nodes.start;
        let of = |(&unknown, tied): (&usize, &Option<(usize, f64)>)| {
            let (contact, k) = self.monotonicity.contact(unknown);
            let at = first + contact;
            let (v, dv) = (&candidate.v[at], &candidate.dv[at]);
            let (face, p) = (&candidate.faces[at], normal[contact]);
            if tied.is_some() {
                return face.misfit_along(v[0], dv[0], p);
            }
            let (e, error) = match known[contact] {
                KnownSlip::Sticks => Face::misfit_held(v, dv, p),
                _ => face.misfit(v, dv, p, self.monotonicity.mu[contact]),
            };
            (e[k], error[k])
        };
        ties.kept.iter().zip(&ties.tied).map(of).unzip()
    }

    /// `‖d‖` in the norm of `W`, rounded up.
    pub(super) fn length(&self, factor: &IslandFactor<D>, ellipsoid: &Ellipsoid) -> f64 {
        let whole = self.spread(&factor.ties, &ellipsoid.centre);
        let room = 1.0 + gamma(whole.len());
        room * (self.norm(&whole) + ellipsoid.radius / factor.alpha.sqrt())
    }

    /// Values of the kept unknowns and of those that depend on them; zero elsewhere.
    pub(super) fn spread(&self, ties: &Ties, values: &[f64]) -> Vec<f64> {
        let mut whole = vec![0.0; self.monotonicity.order()];
        for ((&unknown, tied), &value) in ties.kept.iter().zip(&ties.tied).zip(values) {
            whole[unknown] = value;
            if let Some((other, factor)) = *tied {
                whole[other] = factor * value;
            }
        }
        whole
    }

    /// `√(xᵀ W x)`, rounded up.
    pub(super) fn norm(&self, x: &[f64]) -> f64 {
        let (energy, lost, e) = self.energy(x);
        times_two_to((energy.max(0.0) + lost).sqrt() * (1.0 + gamma(0)), e)
    }

    /// `√(rᵀ W r)`, rounded down.
    pub(super) fn least_size(&self, r: &[[f64; D]]) -> f64 {
        let (energy, lost, e) = self.energy(&self.gather(|i, k| r[i][k]));
        times_two_to((energy - lost).max(0.0).sqrt() * (1.0 - gamma(0)), e)
    }

    /// `xᵀ W x` for `x` over a power of two that makes its largest entry about one: the value,
    /// its error and the exponent.
    fn energy(&self, x: &[f64]) -> (f64, f64, i32) {
        let e = exponent(amax(x));
        let x: Vec<f64> = x.iter().map(|x| times_two_to(*x, -e)).collect();
        let moved = product(&self.half, &x);
        let energy: f64 = moved.iter().zip(&x).map(|(a, b)| a * b).sum();
        // The errors of W, and those of x, which are no larger.
        let size = norm(&self.half);
        let entries = 2.0 * self.entry_errors() + self.monotonicity.entry_rounding * size;
        let lost = (2.0 * gamma(2 * x.len()) * size + entries) * norm(&x).powi(2);
        (energy, lost, e)
    }

    /// The norm of the errors of the entries of `Ŵ`.
    fn entry_errors(&self) -> f64 {
        self.monotonicity.entry_rounding * norm(&self.rows)
    }

    /// A value of each unknown, from its position and component.
    fn gather(&self, of: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let components = self.monotonicity.components.iter();
        components.map(|&(i, k)| of(i, k)).collect()
    }

    /// `‖r − r̂‖` in the norm of `W`, rounded up.
    fn off(&self, candidate: &Candidate<D>) -> f64 {
        let off = self.gather(|i, k| candidate.off[i][k]);
        let moved = self.gather(|i, _| candidate.faces[i].moved);
        // The difference is rounded, and the point of the cone differs from its numbers.
        let blur = (norm(&self.half) * (1.0 + gamma(off.len())) + self.entry_errors()).sqrt();
        let of_r = self.gather(|i, k| candidate.blur[i][k]);
        let blurred = norm(&moved) + f64::EPSILON * norm(&off) + norm(&of_r);
        self.norm(&off) + (1.0 + gamma(off.len())) * blur * blurred
    }

    /// The bound for `r` and its reported `v` from an ellipsoid around a candidate.
    pub(super) fn found(
        &self,
        factor: &IslandFactor<D>,
        candidate: &Candidate<D>,
        given: &(Vec<[f64; D]>, Vec<[f64; D]>),
        ellipsoid: &Ellipsoid,
        ball: f64,
    ) -> IslandBound<D> {
        let nodes = self.monotonicity.nodes.clone();
        let centre = self.spread(&factor.ties, &ellipsoid.centre);
        let radius = ellipsoid.radius;
        let width = self.spread(&factor.ties, &factor.widths.reaction);
        let n = self.monotonicity.order();
        let room = 1.0 + gamma(n);
        let mut reaction = vec![[0.0; D]; nodes.len()];
        let mut displacement = reaction.clone();
        for (contact, position) in nodes.enumerate() {
            for k in 0..D {
                let row = &self.rows[(D * contact + k) * n..][..n];
                let moved: f64 = row.iter().zip(&centre).map(|(w, c)| w * c).sum();
                let along = factor.widths.displacement[D * contact + k];
                let apart = (given.0[position][k] - candidate.v[position][k]).abs();
                displacement[contact][k] = room
                    * (apart
                        + given.1[position][k]
                        + candidate.dv[position][k]
                        + moved.abs()
                        + (gamma(n) + self.monotonicity.entry_rounding)
                            * norm(row)
                            * norm(&centre)
                        + radius * along);
                let Some(unknown) = self.monotonicity.unknown(position, k) else {
                    continue; // zero, as in every answer
                };
                let off = candidate.off[position][k].abs()
                    + candidate.blur[position][k]
                    + candidate.faces[position].moved;
                reaction[contact][k] =
                    room * (off + centre[unknown].abs() + radius * width[unknown].abs());
            }
        }
        let off = self.off(candidate);
        IslandBound {
            energy: room * (off + self.length(factor, ellipsoid)),
            alone_within: ball - off,
            reaction,
            displacement,
        }
    }

    /// A ball around a candidate with exactly one solution, if one is found.
    ///
    /// In the ball `‖d‖ ≤ R`, in the norm of `W`, `w_n` is at most `√W_nn R` and `‖w_t‖` at
    /// most `ω = √‖W_tt‖ R`. Contacts open by more than this have no reaction in any solution
    /// in the ball. Contacts that slide by more than ω keep their direction up to
    /// [`KnownSlip::Slides`]; in the plane their reaction lies on one ray. Contacts whose
    /// reaction stays inside its cone stick. Now let `A` made with this be positive definite
    /// and bound `d` by less than `R`. The variational inequality on the ball and on these
    /// smaller cones (zero, the ray, or the whole space where `v = 0`) has a solution, because
    /// the set is compact. This solution lies inside the ball, and so solves the problem. Two
    /// solutions in the ball would contradict the monotonicity.
    ///
    /// The ball is around the candidate. It contains a ball around `r` that contains the
    /// solution and has at least the radius `least`.
    pub(super) fn local_bound(
        &self,
        candidates: &[Candidate<D>; 2],
        given: &(Vec<[f64; D]>, Vec<[f64; D]>),
        least: f64,
        stop: &AtomicBool,
    ) -> Result<Option<IslandBound<D>>, Error> {
        let n = self.monotonicity.order();
        if !self.monotonicity.symmetric || n > tuning::ball_unknowns() {
            return Ok(None);
        }
        for candidate in candidates {
            for weights in self.tried() {
                let nothing = self.monotonicity.nothing_known();
                let all = Ties::none(self.monotonicity.all());
                let (e, error) = self.misfit(&all, &weights.normal, &nothing, candidate);
                let length = 2.0 * self.of_w.ellipsoid(&e, &error).radius;
                let off = self.off(candidate);
                let unit = length.max(off).max(least);
                let unit = if unit > 0.0 { unit } else { f64::EPSILON };
                let mut found = None;
                for radii in tuning::RADII {
                    let radius = radii * unit;
                    let Some(tried) = self.within(radius, weights, candidate, stop)? else {
                        break;
                    };
                    // A margin for later upward rounding.
                    let room = 1.0 + 4.0 * gamma(n);
                    let whole = least.max(room * (off + tried.1));
                    if room * (off + whole) < radius {
                        found = Some((tried, radius));
                        break;
                    }
                }
                let Some((mut best, ball)) = found else {
                    continue;
                };
                // The solution is nearer than the radius: more is known in a smaller ball.
                for _ in 0..2 {
                    let nearer = tuning::nearer_ball() * best.1;
                    match self.within(nearer, weights, candidate, stop)? {
                        Some(tried) if tried.1 < best.1 => best = tried,
                        _ => break,
                    }
                }
                let mut factor = best.0;
                factor.widths = widths(&self.rows, &self.monotonicity, &factor);
                let ellipsoid = self.ellipsoid(&factor, candidate);
                let found = self.found(&factor, candidate, given, &ellipsoid, ball);
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// A factor and the bound of `‖d‖` that hold for the solutions in a ball.
    pub(super) fn within(
        &self,
        radius: f64,
        weights: &Weights,
        candidate: &Candidate<D>,
        stop: &AtomicBool,
    ) -> Result<Option<(IslandFactor<D>, f64)>, Error> {
        let n = self.monotonicity.order();
        let room = 1.0 + gamma(D) + 2.0 * self.monotonicity.entry_rounding;
        let entry = |i: usize, j: usize| self.half[j * n + i];
        // What a part of W by errors that is not symmetric adds to w, for each unit of radius.
        let skew = self.entry_errors() * norm(&self.widths_of_w) * room;
        let mut known = self.monotonicity.nothing_known();
        let mut ties = Ties::default();
        for (contact, position) in self.monotonicity.nodes.clone().enumerate() {
            let at = |k: usize| self.monotonicity.unknown(position, k);
            let (v, dv) = (&candidate.v[position], &candidate.dv[position]);
            let lift = (at(0).map_or(0.0, |i| entry(i, i).sqrt()) + skew) * radius * room;
            let open = candidate.faces[position].place == Place::Apex && v[0] - dv[0] > lift;
            if open {
                continue;
            }
            let face = &candidate.faces[position];
            let mu = self.monotonicity.mu[contact];
            let tangents: Vec<usize> = (1..D).filter_map(at).collect();
            if face.place == Place::Inside && mu > 0.0 {
                let length = |i: usize| self.widths_of_w[i] * radius * room;
                let lengths: [f64; D] = std::array::from_fn(|k| at(k).map_or(0.0, length));
                let least = mu * (face.reaction[0] - lengths[0]) / room;
                let most = room * (tangential_norm(&face.reaction) + tangential_norm(&lengths));
                if least > most {
                    known[contact] = KnownSlip::Sticks;
                }
            }
            let sticks = matches!(known[contact], KnownSlip::Sticks);
            let largest = match tangents[..] {
                [i] => entry(i, i),
                [i, j] => {
                    let (a, b, c) = (entry(i, i), entry(i, j), entry(j, j));
                    0.5 * (a + c) + (0.5 * (a - c)).hypot(b)
                }
                _ => 0.0,
            };
            let slip = tangential_norm(v) / room;
            let turn_of_w = room * (largest.sqrt() + skew) * radius;
            let turned = room * (turn_of_w + room * tangential_norm(dv));
            if slip > turned && !sticks && !tangents.is_empty() {
                let mut direction = v.map(|c| c / tangential_norm(v));
                direction[0] = 0.0;
                // ‖x/‖x‖ − y/‖y‖‖ ≤ 2 ‖x − y‖/‖x‖; in the plane the direction does not turn.
                let turn = if D == 2 {
                    0.0
                } else {
                    2.0 * room * turned / slip + 8.0 * f64::EPSILON
                };
                // Above 1 the triangle inequality is better.
                if turn < 1.0 {
                    known[contact] = KnownSlip::Slides { direction, turn };
                }
                // In the plane the direction of the reaction is known, if r̂ agrees.
                let agrees = match face.place {
                    Place::Apex => true,
                    Place::Ray(ray) => ray[1] * direction[1] < 0.0,
                    Place::Inside | Place::Edge(_) => false,
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
        let factor = self.factor(ties, weights, known, stop)?;
        Ok(factor.map(|factor| {
            let ellipsoid = self.ellipsoid(&factor, candidate);
            let length = self.length(&factor, &ellipsoid);
            (factor, length)
        }))
    }

    /// A bound of `‖r − r*‖` by the missing energy: with `L < 1` and a `u` for which no contact
    /// penetrates, `½ (1 − L) (‖u − u*‖² + ‖r̂ − r*‖²) ≤ B(u, r̂)`.
    ///
    /// `B = ½ ‖u − w‖² + Σ γ`, with `w` in equilibrium with `r̂`; `u` lifts penetrating
    /// contacts by `λ` with the least energy, `½ λᵀ W⁻¹ λ`.
    pub(super) fn energy_by_gap(&self, candidate: &Candidate<D>) -> Option<f64> {
        let contraction = self.contraction?;
        let mut lift = vec![0.0; self.monotonicity.order()];
        let mut gaps = 0.0;
        for (contact, position) in self.monotonicity.nodes.clone().enumerate() {
            let (v, dv) = (&candidate.v[position], &candidate.dv[position]);
            let face = &candidate.faces[position];
            let mu = self.monotonicity.mu[contact];
            let raised = (dv[0] - v[0]).max(0.0);
            if let Some(unknown) = self.monotonicity.unknown(position, 0) {
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
        let nodes = self.monotonicity.nodes.clone();
        let pressed = candidate.faces[nodes].iter().any(|f| f.reaction[0] != 0.0);
        // Products of two small numbers: their sum is not an upper bound.
        if missing < LEAST_ENERGY && (pressed || lift.iter().any(|&l| l != 0.0)) {
            return None;
        }
        Some((2.0 * missing / (1.0 - contraction)).sqrt() * (1.0 + gamma(0)) + self.off(candidate))
    }
}

/// Widths of the unit ellipsoid of a factor, along its unknowns and along rows.
fn widths<const D: usize>(
    rows: &[f64],
    monotonicity: &Monotonicity<D>,
    factor: &IslandFactor<D>,
) -> Widths {
    let count = D * monotonicity.nodes.len();
    let mut displacement = vec![0.0; count];
    let Ties { kept, tied } = &factor.ties;
    if !kept.is_empty() {
        let mut along = Vec::with_capacity(count * kept.len());
        let mut errors = Vec::with_capacity(count);
        for row in rows.chunks_exact(monotonicity.order()) {
            let mut rounding = 0.0;
            for (&unknown, tied) in kept.iter().zip(tied) {
                let other = tied.map_or(0.0, |(other, factor)| factor * row[other]);
                let sizes = row[unknown].abs() + other.abs();
                if other != 0.0 {
                    rounding += 4.0 * f64::EPSILON * sizes;
                }
                rounding += monotonicity.entry_rounding * sizes;
                along.push(row[unknown] + other);
            }
            errors.push(rounding);
        }
        displacement = factor.cholesky.widths_along(&along, &errors);
    }
    Widths {
        reaction: factor.cholesky.widths(),
        displacement,
    }
}
