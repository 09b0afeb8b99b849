//! Semismooth Newton of Alart and Curnier in the displacements, (19) and (20).
//!
//! Each linear system is solved by flexible GMRES to the accuracy that the step is worth. The
//! preconditioner follows the statuses: one that was made for other statuses costs several
//! times as many iterations, more than making it costs.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use crate::error::Error;
use crate::law::cone::Status;
use crate::linalg::flexible_gmres::{self, Limits};
use crate::linalg::parallel::axpy;
use crate::primal::certificate::{Judged, Point, contacts_alone, judge};
use crate::primal::preconditioner::Preconditioner;
use crate::primal::problem::Primal;
use crate::primal::tangent::Tangent;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::merit;
use crate::solver::newton::linearisation::Linearisation;
use crate::solver::{Outcome, Settings};

/// Largest number of Newton steps.
const MOST_STEPS: usize = 60;

/// Largest number of halvings of a step.
const MOST_HALVINGS: usize = 6;

/// A step may be worse than the last point, but not worse than the worst of this many points.
const MEMORY: usize = 4;

/// Share of the statuses that change while a coarse solution of the step is enough.
const MANY: f64 = 0.002;
/// Relative residual of the linear system while many statuses change, while some do, and after.
const COARSE: f64 = 1e-3;
const MIDDLE: f64 = 1e-5;
const FINE: f64 = 1e-8;

/// Iterations of one linear system after which the method has stalled, and the size of the
/// Krylov space before a restart.
const MOST_KRYLOV: usize = 400;
const BASIS: usize = 80;

/// Steps without a better point after which the method has stalled.
const PATIENCE: usize = 12;

/// Why the method ended without a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The linear solver did not reach its tolerance.
    Multigrid,
    /// The statuses did not settle.
    Statuses,
}

impl Reason {
    /// As part of a sentence.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Multigrid => "multigrid does not converge for this stiffness",
            Self::Statuses => "the contact statuses do not settle",
        }
    }
}

/// The result of the Newton steps.
#[derive(Clone, Debug)]
pub struct Solved<const D: usize> {
    pub point: Point<D>,
    pub judged: Judged<D>,
    pub outcome: Outcome,
    pub reason: Option<Reason>,
    pub newton: usize,
    pub krylov: usize,
    /// `(products with K, η)` of each step.
    pub history: Vec<(f64, f64)>,
    /// Memory of the largest hierarchy.
    pub bytes: usize,
}

/// The start of a load step.
#[derive(Debug)]
pub struct Begin<'a, const D: usize> {
    pub y: Vec<f64>,
    /// Closed contacts of the step before; `None` for the unloaded bodies.
    pub closed: Option<Vec<bool>>,
    pub force: &'a [f64],
    /// `v − y` at each contact.
    pub offset: &'a [[f64; D]],
}

/// Newton steps of one load step.
#[derive(Debug)]
pub struct Newton<'p, const D: usize> {
    problem: &'p Primal<D>,
    settings: &'p Settings,
    stop: &'p AtomicBool,
    started: Instant,
    preconditioner: Preconditioner<'p, D>,
    newton: usize,
    krylov: usize,
    history: Vec<(f64, f64)>,
    work: Vec<f64>,
}

impl<'p, const D: usize> Newton<'p, D> {
    #[must_use]
    pub fn new(problem: &'p Primal<D>, settings: &'p Settings, stop: &'p AtomicBool) -> Self {
        Self {
            problem,
            settings,
            stop,
            started: Instant::now(),
            preconditioner: Preconditioner::new(problem),
            newton: 0,
            krylov: 0,
            history: Vec::new(),
            work: Vec::new(),
        }
    }

    /// Makes Newton steps until the certificate holds, or none of them helps.
    ///
    /// # Errors
    /// [`Error::Interrupted`]; errors of [`Reduced::new`].
    pub fn run(mut self, begin: Begin<'_, D>) -> Result<Solved<D>, Error> {
        let problem = self.problem;
        let tol = self.settings.tol;
        let prescribed = vec![[0.0; D]; problem.contacts()];
        let mut point = self.point(begin.y, &prescribed, begin.force, begin.offset);
        let mut statuses: Option<Vec<Status>> = None;
        let mut recent: Vec<f64> = Vec::new();
        let mut best: Option<(f64, usize, Point<D>, Judged<D>)> = None;
        let mut reason = Reason::Statuses;
        let mut outcome = Outcome::Stalled;
        loop {
            let reduced = contacts_alone(problem, &point.r, &point.v)?;
            let first = statuses.is_none();
            let law = if first {
                let holds = self.first_closed(begin.closed.as_deref(), &point.v);
                Linearisation::held(&reduced, |i| holds[i], &point.r, &point.v)
            } else {
                Linearisation::new(&reduced, &point.r, &point.v)
            };
            let now: Vec<Status> = law.at.iter().map(|at| at.status).collect();
            let changed = statuses.as_ref().map_or(now.len(), |before| {
                before.iter().zip(&now).filter(|(a, b)| a != b).count()
            });
            let mut judged = judge(problem, &reduced, &point, begin.force, None);
            let eta = judged.residual();
            if !first && (changed == 0 || judged.converged(tol)) {
                let terms = problem.terms(&point.y);
                judged = judge(problem, &reduced, &point, begin.force, Some(&terms));
            }
            if !first {
                #[expect(clippy::cast_precision_loss, reason = "a count of products")]
                self.history.push(((self.krylov + self.newton) as f64, eta));
            }
            let converged = !first && judged.converged(tol);
            if best.as_ref().is_none_or(|(least, ..)| eta < *least) || converged {
                best = Some((eta, self.newton, point.clone(), judged.clone()));
            }
            if converged {
                outcome = Outcome::Converged;
                break;
            }
            let since = best.as_ref().map_or(0, |best| self.newton - best.1);
            if self.newton >= MOST_STEPS || since > PATIENCE {
                break;
            }
            if self.newton >= self.settings.max_iterations {
                outcome = Outcome::IterationLimit;
                break;
            }
            if self.started.elapsed().as_secs_f64() > self.settings.max_seconds {
                outcome = Outcome::TimeLimit;
                break;
            }
            let share = ratio(changed, now.len());
            let wanted = if share > MANY {
                COARSE
            } else if changed > 0 {
                MIDDLE
            } else {
                FINE
            };
            let error = if first {
                1.0
            } else {
                eta.max(f64::MIN_POSITIVE)
            };
            let wanted = wanted.max(0.1 * tol / error.max(tol));
            let tangent = Tangent::new(problem, &reduced, &law);
            let Some((dy, moved)) = self.correction(&tangent, &now, &point, wanted)? else {
                reason = Reason::Multigrid;
                break;
            };
            let dr_prescribed = tangent.prescribed_reactions(&point.r, &dy, &moved);
            let share = if first || changed == 0 {
                1.0
            } else {
                let change = Change {
                    r: self.reaction_change(&moved, &dr_prescribed),
                    v: problem.frames.at_contacts(&dy),
                };
                let bar = recent
                    .iter()
                    .rev()
                    .take(MEMORY)
                    .fold(0.0_f64, |m, &x| m.max(x));
                search(&reduced, &point, &change, bar)
            };
            let mut y = std::mem::take(&mut point.y);
            axpy(share, &dy, &mut y);
            let mut prescribed = prescribed_part(problem, &point.r);
            for (value, change) in prescribed
                .as_flattened_mut()
                .iter_mut()
                .zip(dr_prescribed.as_flattened())
            {
                *value += share * change;
            }
            point = self.point(y, &prescribed, begin.force, begin.offset);
            self.newton += 1;
            recent.push(merit(&reduced, &point.r, &point.v));
            statuses = Some(now);
        }
        let (_, _, point, judged) = best.ok_or(Error::Interrupted)?;
        Ok(Solved {
            point,
            judged,
            outcome,
            reason: (outcome == Outcome::Stalled).then_some(reason),
            newton: self.newton,
            krylov: self.krylov,
            history: self.history,
            bytes: self.preconditioner.bytes,
        })
    }

    /// The contacts that stick in the first Newton step: those closed before, else those
    /// without a gap. For a body without such a contact and without a support, the next one
    /// closes.
    fn first_closed(&self, closed: Option<&[bool]>, v: &[[f64; D]]) -> Vec<bool> {
        if let Some(closed) = closed {
            return closed.to_vec();
        }
        let mut near: Vec<bool> = v.iter().map(|v| v[0] <= 0.0).collect();
        for contacts in self.problem.floating() {
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

    /// The point with unknowns `y`. `prescribed` are reactions along prescribed components.
    fn point(
        &mut self,
        y: Vec<f64>,
        prescribed: &[[f64; D]],
        force: &[f64],
        offset: &[[f64; D]],
    ) -> Point<D> {
        let problem = self.problem;
        let mut e = vec![0.0; y.len()];
        problem.product(&y, &mut self.work, &mut e);
        axpy(-1.0, force, &mut e);
        let mut v = problem.frames.at_contacts(&y);
        for (v, offset) in v.as_flattened_mut().iter_mut().zip(offset.as_flattened()) {
            *v += offset;
        }
        let mut r = problem.frames.at_contacts(&e);
        for (r, more) in r
            .as_flattened_mut()
            .iter_mut()
            .zip(prescribed.as_flattened())
        {
            *r += more;
        }
        Point { y, e, r, v }
    }

    /// `dy` and `A dy` of a Newton step; `None` if the linear solver stalls.
    fn correction(
        &mut self,
        tangent: &Tangent<'_, D>,
        statuses: &[Status],
        point: &Point<D>,
        tol: f64,
    ) -> Result<Option<(Vec<f64>, Vec<f64>)>, Error> {
        match self.preconditioner.prepare(tangent, statuses, self.stop) {
            Ok(()) => {}
            Err(
                Error::Multigrid { .. } | Error::Indefinite { .. } | Error::FloatingBody { .. },
            ) => return Ok(None),
            Err(other) => return Err(other),
        }
        let right = tangent.right_side(&point.e);
        let mut work = std::mem::take(&mut self.work);
        let preconditioner = &mut self.preconditioner;
        let solved = flexible_gmres::solve(
            |x, out| {
                tangent.product(x, &mut work, out);
                tangent.clear(out);
            },
            |b, x| {
                preconditioner.apply(b, x);
                tangent.clear(x);
            },
            &right,
            Limits {
                tol,
                restart: BASIS,
                most: MOST_KRYLOV,
            },
            self.stop,
        )?;
        self.work = work;
        self.krylov += solved.products;
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        self.preconditioner.solved_in(solved.products);
        if !solved.reached {
            return Ok(None);
        }
        let mut dy = solved.x;
        axpy(1.0, &tangent.known, &mut dy);
        let mut moved = vec![0.0; dy.len()];
        self.problem.product(&dy, &mut self.work, &mut moved);
        Ok(Some((dy, moved)))
    }

    fn reaction_change(&self, moved: &[f64], prescribed: &[[f64; D]]) -> Vec<[f64; D]> {
        let mut change = self.problem.frames.at_contacts(moved);
        for (change, more) in change
            .as_flattened_mut()
            .iter_mut()
            .zip(prescribed.as_flattened())
        {
            *change += more;
        }
        change
    }
}

/// The reactions along components without an unknown.
fn prescribed_part<const D: usize>(problem: &Primal<D>, r: &[[f64; D]]) -> Vec<[f64; D]> {
    let mut part = r.to_vec();
    for (i, k, _) in problem.frames.unknowns() {
        part[i][k] = 0.0;
    }
    part
}

/// A full Newton step at the contacts.
struct Change<const D: usize> {
    r: Vec<[f64; D]>,
    v: Vec<[f64; D]>,
}

/// The share of a step that reduces the merit below `bar`, the worst of the last points; if
/// none does, the share with the smallest merit.
fn search<const D: usize>(
    reduced: &Reduced<D>,
    point: &Point<D>,
    change: &Change<D>,
    bar: f64,
) -> f64 {
    let moved = |from: &[[f64; D]], by: &[[f64; D]], share: f64| -> Vec<[f64; D]> {
        let sum = |(x, d): (&[f64; D], &[f64; D])| std::array::from_fn(|k| x[k] + share * d[k]);
        from.iter().zip(by).map(sum).collect()
    };
    let (mut share, mut best) = (1.0, (f64::INFINITY, 1.0));
    for _ in 0..=MOST_HALVINGS {
        let there = merit(
            reduced,
            &moved(&point.r, &change.r, share),
            &moved(&point.v, &change.v, share),
        );
        if there <= (1.0 - 1e-4 * share) * bar {
            return share;
        }
        if there < best.0 {
            best = (there, share);
        }
        share *= 0.5;
    }
    best.1
}

fn ratio(part: usize, whole: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    let ratio = part as f64 / whole.max(1) as f64;
    ratio
}
