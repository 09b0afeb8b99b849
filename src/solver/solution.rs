//! The result of a solver: a point in the numbering of the caller, with its certificate.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::bipotential;
use crate::law::cone::Status;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::Certificate;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::monitor::Monitor;
use crate::solver::newton::refine;
use crate::solver::outcome::Outcome;
use crate::solver::paper::principles::minimising_sequence::Sequence;
use crate::solver::settings::Settings;

/// The solution, or the best point, in the numbering of the caller.
#[derive(Clone, Debug, Default)]
pub struct Solution<const D: usize> {
    pub reaction: Vec<[f64; D]>,
    pub relative_displacement: Vec<[f64; D]>,
    pub status: Vec<Status>,
    /// Contacts that are open by more than the tolerance.
    pub opened: Vec<bool>,
    /// Gap of the bipotential of each contact, in units of work.
    pub bipotential_gap: Vec<f64>,
    pub rigid_motion: Vec<f64>,
    /// Rigid motion that the loads cause: with `NoEquilibrium` the proof, with another outcome
    /// the motion that grew during the iteration; empty without one.
    pub free_motion: Vec<f64>,
    /// Number of statuses tried if this proves `NoEquilibrium`, else 0.
    pub statuses_tried: u64,
    pub outcome: Outcome,
    pub residual: f64,
    pub tolerance: f64,
    /// Rounding floor of the residual.
    pub floor: f64,
    pub iterations: usize,
    /// In products with `W`.
    pub work: f64,
    /// `(work, η)` of each iteration.
    pub history: Vec<(f64, f64)>,
    /// The fields of [`Method::MinimisingSequence`](crate::solver::Method), else none.
    pub sequence: Option<Sequence<D>>,
    /// Bytes of the transpose and inverse of `W` that the solver keeps.
    pub bytes_beside: usize,
    pub seconds: f64,
}

/// Computes the certificate of the best point, in the numbering of the caller.
pub(super) fn finish<const D: usize>(
    problem: &Reduced<D>,
    settings: &Settings,
    monitor: Monitor<D>,
    outcome: Outcome,
) -> Solution<D> {
    let log = monitor.into_log();
    let (r, rigid, mut solution) = (log.best_reaction, log.best_rigid, log.result);
    let known = log.certificate;
    let certificate = known.unwrap_or_else(|| Certificate::new(problem, &r, &rigid));
    solution.outcome = match (certificate.converged(settings.tol), outcome) {
        (_, Outcome::NoEquilibrium) => outcome, // it was proved
        (true, _) => Outcome::Converged,
        (false, Outcome::Converged) => Outcome::Stalled,
        (false, _) => outcome,
    };
    solution.put(problem, settings, &r, rigid, &certificate);
    solution
}

/// With a larger relative error of the reactions, a refined point is not a solution.
const WORST_REACTION: f64 = 1e-6;

impl<const D: usize> Solution<D> {
    /// Stores a point and its certificate, in the numbering of the caller.
    pub(super) fn put(
        &mut self,
        problem: &Reduced<D>,
        settings: &Settings,
        r: &[[f64; D]],
        rigid: Vec<f64>,
        certificate: &Certificate<D>,
    ) {
        let nodes = r.iter().zip(&certificate.v).zip(&problem.law);
        let gap: Vec<f64> = nodes
            .map(|((r, v), law)| within_range(bipotential::gap(r, v, *law)))
            .collect();
        // r = 0 is open, for any rounding of r̂ − ṽ̂ at a grazing contact; with cohesion r_n = 0.
        let mut status = certificate.status.clone();
        for (i, status) in status.iter_mut().enumerate() {
            let least = if problem.law[i].cohesion > 0.0 { 1 } else { D };
            if r[i][..least].iter().all(|&c| c == 0.0) {
                *status = Status::Open;
            }
        }
        let whole = problem.compliance;
        self.reaction = whole.scatter(r);
        self.relative_displacement = whole.scatter(&certificate.v);
        self.status = whole.scatter(&status);
        self.opened = whole.scatter(&certificate.opened(problem, settings.tol));
        self.bipotential_gap = whole.scatter(&gap);
        self.rigid_motion = rigid;
        self.residual = certificate.residual;
        self.tolerance = certificate.tolerance(settings.tol);
        self.floor = certificate.floor;
        self.bytes_beside = whole.bytes_beside();
    }

    /// Refines a converged solution with a more accurate evaluation of `v` than `W` gives; the
    /// certificate then uses it. The result is the better of the point and the refined one. If
    /// neither is a solution, the outcome is stalled.
    pub fn refine(
        &mut self,
        problem: &Reduced<D>,
        settings: &Settings,
        evaluate: impl Fn(Vec<[f64; D]>, Vec<f64>) -> Result<refine::RefinedPoint<D>, Error>,
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        let start = problem.compliance.gather(&self.reaction);
        let point = evaluate(start, self.rigid_motion.clone())?;
        let refined = refine::refine(problem, point.clone(), evaluate, stop)?;
        let forward = refine::forward_error(problem, &refined, &[], stop)?;
        let judged = [refined, point].map(|point| {
            let EvaluatedPoint { r, v, rigid } = point.at;
            (Certificate::of(problem, &r, v, &rigid), r, rigid)
        });
        let [refined, as_it_was] = judged;
        let answers = |judged: &(Certificate<D>, _, _)| judged.0.converged(settings.tol);
        // η is relative to the displacement of soft supports. If another correction still
        // changes the reactions, a small η does not imply accurate reactions.
        let settled = forward.is_none_or(|(of_r, _)| of_r <= WORST_REACTION);
        let better = match (answers(&refined), answers(&as_it_was)) {
            (true, _) if settled => refined,
            (false, true) if settled => as_it_was,
            _ => {
                self.outcome = Outcome::Stalled;
                refined
            }
        };
        let (certificate, r, rigid) = better;
        self.put(problem, settings, &r, rigid, &certificate);
        Ok(())
    }
}

/// The nearest number in the range of doubles: with forces of 1e160 and displacements of 1e150,
/// a solution is finite but its work is not.
fn within_range(value: f64) -> f64 {
    if value.is_nan() {
        return 0.0; // infinities of both signs: nothing is known of their sum
    }
    value.clamp(f64::MIN, f64::MAX)
}
