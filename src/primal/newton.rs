//! Semismooth Newton of Alart and Curnier in the displacements, (19) and (20).
//!
//! Each linear system is solved to the accuracy that the step is worth, by the [`Engine`]. Its
//! preconditioner should follow the statuses: one that was made for other statuses costs
//! several times as many iterations, more than making it costs.

use std::time::Instant;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::parallel::norm;
use crate::linalg::small::{add_scaled, rows_plus_scaled};
use crate::primal::certificate::{Judged, Point, contacts_alone, judge};
use crate::primal::contacts::Contacts;
use crate::primal::engine::Engine;
use crate::primal::tangent::Tangent;
use crate::primal::tuning;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::merit;
use crate::solver::newton::linearisation::Linearisation;
use crate::solver::newton::search::search;
use crate::solver::{Outcome, Settings};

/// Relative residual of a linear system whose solution is the answer, as no status changes: little
/// above rounding.
const EXACT: f64 = 1e-12;

/// Largest change of the displacements by one more correction, relative to the largest of them,
/// or the tolerance if that is larger. The rows of a slender body may balance to the last digit
/// while its soft motions are far from the solution: η does not see this. A larger rounding floor
/// is not accepted either: the direct engine computes such bodies in twice the precision.
const SETTLED: f64 = 1e-9;

/// The stiffness of the softest motion, relative to the body, that the estimate of its error
/// holds: of springs that are softer, `K` has fewer than four digits.
const SOFTEST: f64 = 1e-12;

/// Why the method ended without a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The linear solver did not reach its tolerance.
    Multigrid,
    /// The statuses did not settle.
    Statuses,
    /// The displacements did not settle.
    Digits,
}

impl Reason {
    /// As part of a sentence.
    pub fn text(self) -> &'static str {
        match self {
            Self::Multigrid => "multigrid does not converge for this stiffness",
            Self::Statuses => "the contact statuses do not settle",
            Self::Digits => "the stiffness has too few digits for its softest motions",
        }
    }
}

/// The result of the Newton steps.
#[derive(Debug)]
pub struct SolvedStep<V, const D: usize> {
    pub point: Point<V, D>,
    pub judged: Judged<D>,
    pub outcome: Outcome,
    pub reason: Option<Reason>,
    /// Estimated errors of the solution; `None` without convergence, or if motions are free.
    pub errors: Option<Errors>,
    pub newton: usize,
    pub krylov: usize,
    /// `(products with K, η)` of each step.
    pub history: Vec<(f64, f64)>,
}

/// Estimated relative errors of a point: by one more correction.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// Of the displacements, by the largest.
    pub displacement: f64,
    /// `‖r − r*‖ / ‖r*‖`.
    pub reaction: f64,
    /// `‖v − v*‖ / ‖v*‖`, or that of the displacements if it is larger.
    pub relative_displacement: f64,
}

/// Whether a point is a solution.
#[derive(Clone, Copy, Debug)]
enum Verdict {
    /// The certificate does not hold.
    Unlawful,
    /// It holds, but the displacements may still change by more than [`SETTLED`].
    Unsettled,
    /// With its errors, unless motions are free: then it is one of many.
    Solution(Option<Errors>),
}

/// The start of a load step.
#[derive(Debug)]
pub struct Begin<'a, V, const D: usize> {
    pub y: V,
    /// Whether `y` has about the statuses of the solution.
    pub near: bool,
    /// Whether the certificate is enough: the errors of the solution are not estimated.
    pub draft: bool,
    /// Whether linear systems are solved well while many statuses change, too.
    pub careful: bool,
    /// Closed contacts of the step before; `None` for the unloaded bodies.
    pub closed: Option<Vec<bool>>,
    pub force: &'a V,
    /// `v − y` at each contact.
    pub offset: &'a [[f64; D]],
}

/// Newton steps of one load step.
#[derive(Debug)]
pub struct Newton<'p, E, const D: usize> {
    engine: &'p mut E,
    contacts: &'p Contacts<D>,
    settings: &'p Settings,
    started: Instant,
    steps: usize,
    krylov: usize,
    /// Upper estimate of `A⁻¹` relative to the preconditioner, from the last linear system.
    slowness: f64,
    history: Vec<(f64, f64)>,
}

impl<'p, const D: usize, E: Engine<D>> Newton<'p, E, D> {
    pub fn new(engine: &'p mut E, contacts: &'p Contacts<D>, settings: &'p Settings) -> Self {
        Self {
            engine,
            contacts,
            settings,
            started: Instant::now(),
            steps: 0,
            krylov: 0,
            slowness: 1.0,
            history: Vec::new(),
        }
    }

    /// Makes Newton steps until the certificate holds, or none of them helps.
    pub fn run(
        mut self,
        begin: Begin<'_, E::Vector, D>,
    ) -> Result<SolvedStep<E::Vector, D>, E::Error> {
        let contacts = self.contacts;
        let tol = self.settings.tol;
        let mut prescribed = vec![[0.0; D]; contacts.count()];
        let mut point = self.point(begin.y, &prescribed, begin.force, begin.offset)?;
        // Whether the imbalance is that of a fresh product, not of a sum of corrections.
        let mut fresh = true;
        let mut statuses: Option<Vec<Status>> = None;
        let mut recent: Vec<f64> = Vec::new();
        let mut best: Option<(f64, usize, Point<E::Vector, D>, Judged<D>)> = None;
        let mut reason = Reason::Statuses;
        let mut unsettled = 0;
        let mut outcome = Outcome::Stalled;
        let mut errors = None;
        loop {
            let reduced = contacts_alone(contacts, &point.r, &point.v)?;
            let first = statuses.is_none();
            let law = if first && !begin.near {
                let holds = self.first_closed(begin.closed.as_deref(), &point.v);
                Linearisation::held(&reduced, |i| holds[i], &point.r, &point.v)
            } else {
                Linearisation::new(&reduced, &point.r, &point.v)
            };
            let now: Vec<Status> = law.at.iter().map(|at| at.status).collect();
            let changed = count_changes(statuses.as_deref(), &now);
            let mut judged = self.judge_point(&reduced, &point, begin.force, false)?;
            let eta = judged.residual();
            if !first && (changed == 0 || judged.converged(tol)) {
                judged = self.judge_point(&reduced, &point, begin.force, true)?;
            }
            if !fresh && judged.converged(tol) {
                point = self.point(point.y, &prescribed, begin.force, begin.offset)?;
                fresh = true;
                continue;
            }
            if !first {
                #[expect(clippy::cast_precision_loss, reason = "a count of products")]
                self.history.push(((self.krylov + self.steps) as f64, eta));
            }
            let tangent = Tangent::new(&contacts.frames, self.engine.free(), &reduced, &law);
            let verdict = if first {
                Verdict::Unlawful
            } else if begin.draft && judged.converged(tol) {
                Verdict::Solution(None)
            } else {
                self.verdict(&judged, &tangent, &now, &point)?
            };
            let converged = matches!(verdict, Verdict::Solution(_));
            if best.as_ref().is_none_or(|(least, ..)| eta < *least) || converged {
                best = Some((eta, self.steps, point.clone(), judged));
            }
            let wanted = match verdict {
                Verdict::Solution(found) => {
                    outcome = Outcome::Converged;
                    errors = found;
                    break;
                }
                Verdict::Unsettled => {
                    unsettled += 1;
                    reason = Reason::Digits;
                    tuning::fine_residual()
                }
                Verdict::Unlawful => {
                    let error = if first { 1.0 } else { eta };
                    let exact = changed == 0 && !tangent.slides();
                    let of_all = (!exact).then(|| share(changed, now.len()));
                    linear_tolerance(of_all, tol, error, begin.careful)
                }
            };
            if unsettled > tuning::unsettled_points() {
                break;
            }
            if let Some(ended) = self.find_end(best.as_ref().map_or(0, |best| best.1))? {
                outcome = ended;
                break;
            }
            let Some(correction) = self.correction(&tangent, &now, &point, wanted)? else {
                reason = Reason::Multigrid;
                break;
            };
            let recent_merits = (!first && changed > 0).then_some(&recent[..]);
            let taken = self.choose_step(&tangent, &reduced, &point, &correction, recent_merits);
            prescribed = taken.prescribed;
            point = self.move_point(point, &correction, taken.share, &prescribed, begin.offset)?;
            fresh = false;
            self.steps += 1;
            recent.push(merit(&reduced, &point.r, &point.v));
            statuses = Some(now);
        }
        let (_, _, point, judged) = best.ok_or(Error::Interrupted)?;
        Ok(SolvedStep {
            point,
            judged,
            outcome,
            reason: (outcome == Outcome::Stalled).then_some(reason),
            errors,
            newton: self.steps,
            krylov: self.krylov,
            history: self.history,
        })
    }

    /// The certificate of a point, with its rounding if that is wanted.
    fn judge_point(
        &mut self,
        reduced: &Reduced<D>,
        point: &Point<E::Vector, D>,
        force: &E::Vector,
        rounding: bool,
    ) -> Result<Judged<D>, E::Error> {
        let terms = if rounding {
            Some(self.engine.terms(&point.y)?)
        } else {
            None
        };
        let engine = &mut *self.engine;
        judge(engine, self.contacts, reduced, point, force, terms.as_ref())
    }

    /// What the certificate and one more correction say of a point.
    fn verdict(
        &mut self,
        judged: &Judged<D>,
        tangent: &Tangent<D>,
        statuses: &[Status],
        point: &Point<E::Vector, D>,
    ) -> Result<Verdict, E::Error> {
        let tol = self.settings.tol;
        if !judged.converged(tol) {
            return Ok(Verdict::Unlawful);
        }
        let most = SETTLED.max(tol);
        if !self.engine.is_held(tangent, statuses) {
            // The displacements are one of many.
            return Ok(if judged.floor() <= most {
                Verdict::Solution(None)
            } else {
                Verdict::Unsettled
            });
        }
        let errors = self.estimate(judged, tangent, statuses, point)?;
        let settled = errors.filter(|by| by.displacement <= most);
        let settled = settled.filter(|_| judged.floor() <= most);
        Ok(settled.map_or(Verdict::Unsettled, |errors| Verdict::Solution(Some(errors))))
    }

    /// Whether a limit, or the lack of a better point since the step `best`, ends the steps.
    fn find_end(&mut self, best: usize) -> Result<Option<Outcome>, E::Error> {
        let limit = self.settings.max_seconds;
        Ok(
            if self.steps >= tuning::newton_steps() || self.steps - best > tuning::patience() {
                Some(Outcome::Stalled)
            } else if self.steps >= self.settings.max_iterations {
                Some(Outcome::IterationLimit)
            } else if self.engine.is_late(self.started, limit)? {
                Some(Outcome::TimeLimit)
            } else {
                None
            },
        )
    }

    /// The contacts that stick in the first Newton step: those closed before, else those
    /// without a gap. For a body without such a contact and without a support, the next one
    /// closes.
    fn first_closed(&self, closed: Option<&[bool]>, v: &[[f64; D]]) -> Vec<bool> {
        if let Some(closed) = closed {
            return closed.to_vec();
        }
        let mut near: Vec<bool> = v.iter().map(|v| v[0] <= 0.0).collect();
        for contacts in self.engine.floating() {
            if contacts.iter().any(|&i| near[i]) {
                continue;
            }
            let nearest = contacts
                .iter()
                .fold(f64::INFINITY, |least, &i| least.min(v[i][0]));
            for i in contacts {
                near[i] = v[i][0] <= nearest;
            }
        }
        near
    }

    /// How much of a correction is taken: all of it without `recent` merits.
    fn choose_step(
        &self,
        tangent: &Tangent<D>,
        reduced: &Reduced<D>,
        point: &Point<E::Vector, D>,
        correction: &Change<E::Vector, D>,
        recent: Option<&[f64]>,
    ) -> AcceptedShare<D> {
        let frames = &self.contacts.frames;
        let (v, moved) = (&correction.v, &correction.moved_at);
        let of_prescribed = tangent.prescribed_reactions(frames, &point.r, v, moved);
        let share = recent.map_or(1.0, |recent| {
            let r = rows_plus_scaled(moved, 1.0, &of_prescribed);
            choose_share(reduced, point, (&r[..], &v[..]), recent)
        });
        let prescribed = prescribed_part(self.contacts, &point.r, &of_prescribed, share);
        AcceptedShare { share, prescribed }
    }

    /// The point with unknowns `y`. `prescribed` are reactions along prescribed components.
    fn point(
        &mut self,
        y: E::Vector,
        prescribed: &[[f64; D]],
        force: &E::Vector,
        offset: &[[f64; D]],
    ) -> Result<Point<E::Vector, D>, E::Error> {
        let e = self.engine.unbalanced(&y, force)?;
        self.at_contacts(y, e, prescribed, offset)
    }

    /// The point after a share of a correction.
    fn move_point(
        &mut self,
        point: Point<E::Vector, D>,
        correction: &Change<E::Vector, D>,
        share: f64,
        prescribed: &[[f64; D]],
        offset: &[[f64; D]],
    ) -> Result<Point<E::Vector, D>, E::Error> {
        let y = self.engine.add(point.y, share, &correction.dy)?;
        let e = self.engine.add(point.e, share, &correction.moved)?;
        self.at_contacts(y, e, prescribed, offset)
    }

    /// The point with these unknowns and this imbalance.
    fn at_contacts(
        &mut self,
        y: E::Vector,
        e: E::Vector,
        prescribed: &[[f64; D]],
        offset: &[[f64; D]],
    ) -> Result<Point<E::Vector, D>, E::Error> {
        let v = rows_plus_scaled(&self.engine.at_contacts(&y)?, 1.0, offset);
        let r = rows_plus_scaled(&self.engine.at_contacts(&e)?, 1.0, prescribed);
        Ok(Point { y, e, r, v })
    }

    /// The correction of a Newton step; `None` if the linear solver stalls.
    fn correction(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        point: &Point<E::Vector, D>,
        tol: f64,
    ) -> Result<Option<Change<E::Vector, D>>, E::Error> {
        let solved = self.engine.correction(tangent, statuses, &point.e, tol)?;
        let Some(solved) = solved else {
            return Ok(None);
        };
        self.krylov += solved.products;
        self.slowness = slowness(solved.products, tol);
        if !solved.reached {
            return Ok(None);
        }
        Ok(Some(self.change(solved.dy)?))
    }

    /// What a correction changes.
    fn change(&mut self, dy: E::Vector) -> Result<Change<E::Vector, D>, E::Error> {
        let moved = self.engine.product(&dy)?;
        Ok(Change {
            v: self.engine.at_contacts(&dy)?,
            moved_at: self.engine.at_contacts(&moved)?,
            dy,
            moved,
        })
    }

    /// The change by one more correction; `None` if there is none.
    ///
    /// Of a body that its supports hold firmly, one application of the preconditioner estimates
    /// the correction. It may miss motions by the factor that slows the linear solver, so that the
    /// estimate is multiplied by it. A motion that is softer than single precision is no part of
    /// the preconditioner: then the correction itself is computed. What its linear system leaves of
    /// a residual of rounding may move [`SOFTEST`] motions.
    fn estimate(
        &mut self,
        judged: &Judged<D>,
        tangent: &Tangent<D>,
        statuses: &[Status],
        point: &Point<E::Vector, D>,
    ) -> Result<Option<Errors>, E::Error> {
        let mut least = f64::EPSILON;
        let change = if self.engine.may_be_soft()? {
            let wanted = tuning::fine_residual();
            least *= wanted / SOFTEST;
            self.correction(tangent, statuses, point, wanted)?
                .map(|change| (change, 1.0))
        } else {
            let dy = self.engine.estimate(tangent, statuses, &point.e)?;
            let slowness = self.slowness;
            dy.map(|dy| self.change(dy))
                .transpose()?
                .map(|change| (change, slowness))
        };
        let Some((change, factor)) = change else {
            return Ok(None);
        };
        let frames = &self.contacts.frames;
        let moved = &change.moved_at;
        let prescribed = tangent.prescribed_reactions(frames, &point.r, &change.v, moved);
        let moved = rows_plus_scaled(&point.r, 1.0, moved);
        let mut r = rows_plus_scaled(&moved, 1.0, &prescribed);
        for (i, (r, reaction)) in r.iter_mut().zip(&judged.reaction).enumerate() {
            if statuses[i] == Status::Open {
                let cohesive = self.contacts.law[i].cohesion > 0.0;
                r[..if cohesive { 1 } else { D }].fill(0.0);
            }
            add_scaled(r, -1.0, reaction);
        }
        let of = |changed: f64, whole: f64| {
            if changed == 0.0 {
                0.0
            } else {
                factor * changed / whole
            }
        };
        let sizes = self.engine.largest(&change.dy)?;
        let displacement = of(sizes, self.engine.largest(&point.y)?);
        let v = of(norm(change.v.as_flattened()), norm(point.v.as_flattened()));
        let reaction = of(norm(r.as_flattened()), norm(judged.reaction.as_flattened()));
        let pressed = judged.reaction.as_flattened().iter().any(|&r| r != 0.0);
        Ok(Some(Errors {
            displacement,
            // A number of the solution is rounded, unless it is zero.
            reaction: if pressed {
                reaction.max(f64::EPSILON)
            } else {
                reaction
            },
            relative_displacement: v.max(displacement).max(least),
        }))
    }
}

/// The reactions along components without an unknown, after a share of their `change`.
fn prescribed_part<const D: usize>(
    contacts: &Contacts<D>,
    r: &[[f64; D]],
    change: &[[f64; D]],
    share: f64,
) -> Vec<[f64; D]> {
    let mut part = r.to_vec();
    for (i, k, _) in contacts.frames.unknowns() {
        part[i][k] = 0.0;
    }
    rows_plus_scaled(&part, share, change)
}

/// What a full Newton step changes.
struct Change<V, const D: usize> {
    dy: V,
    /// `A dy`.
    moved: V,
    /// `dy` and `A dy` at the contacts.
    v: Vec<[f64; D]>,
    moved_at: Vec<[f64; D]>,
}

/// The share of a correction that is taken, and the reactions along prescribed components after
/// it.
struct AcceptedShare<const D: usize> {
    share: f64,
    prescribed: Vec<[f64; D]>,
}

/// The share of a step that [`search`] accepts; if none, the share with the smallest merit. The
/// full step changes reactions and relative displacements by `dr` and `dv`.
fn choose_share<V, const D: usize>(
    reduced: &Reduced<D>,
    point: &Point<V, D>,
    (dr, dv): (&[[f64; D]], &[[f64; D]]),
    recent: &[f64],
) -> f64 {
    let of_share = |share: f64| {
        let r = rows_plus_scaled(&point.r, share, dr);
        let v = rows_plus_scaled(&point.v, share, dv);
        (merit(reduced, &r, &v), ())
    };
    let accepted = search(recent, tuning::halvings() + 1, of_share);
    accepted.map_or_else(|least| least, |accepted| accepted.share)
}

/// The condition of a preconditioned system that takes `products` to reduce its residual by
/// `tol`: each product of conjugate gradients reduces the error by `1 − 2/√κ`.
fn slowness(products: usize, tol: f64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let steps = products as f64;
    (2.0 * steps / (2.0 / tol).ln()).powi(2).max(1.0)
}

/// Number of contacts whose status changed; of all of them without statuses before.
fn count_changes(before: Option<&[Status]>, now: &[Status]) -> usize {
    before.map_or(now.len(), |before| {
        before.iter().zip(now).filter(|(a, b)| a != b).count()
    })
}

/// The share of the statuses that changed.
fn share(changed: usize, all: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    let share = changed as f64 / all.max(1) as f64;
    share
}

/// The relative residual of a linear system that its Newton step is worth: a share of the
/// statuses changed, and the point has the error `error`. Without a share the problem is linear.
fn linear_tolerance(changed: Option<f64>, tol: f64, error: f64, careful: bool) -> f64 {
    let wanted = match changed {
        None => EXACT,
        Some(share) if share > tuning::many_changes() && !careful => tuning::coarse_residual(),
        Some(share) if share > 0.0 => tuning::middle_residual(),
        Some(_) => tuning::fine_residual(),
    };
    wanted.max(0.1 * tol / error.max(tol))
}
