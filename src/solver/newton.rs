//! Semismooth Newton of Alart and Curnier on the closed contacts, (19) and (20).
//!
//! The line search is monotone in the residual of the judge, which is cheap
//! because `v` is affine in `r`.

use crate::error::Error;
use crate::problem::reduced::Reduced;
use crate::problem::residual::residual;
use crate::solver::monitor::{Monitor, Verdict};
use crate::solver::system::{Factored, Solved, System};
use crate::solver::{Outcome, Start};

/// Newton steps at the most.
const MOST_STEPS: usize = 40;

/// Halvings of a step at the most.
const MOST_HALVINGS: usize = 12;

/// An iterative solution of a step is asked to leave so much of what the step
/// is to gain, between these bounds.
const FORCING: f64 = 0.1;
const LEAST_FORCING: f64 = 1e-10;
const MOST_FORCING: f64 = 1e-4;

/// How a run of Newton steps ended.
#[derive(Debug)]
pub enum End<const D: usize> {
    /// The monitor stopped it.
    Stop(Outcome),
    /// It came to a stand at a better point `(r, a)`.
    Better(Vec<[f64; D]>, Vec<f64>),
    /// It did not move.
    Stalled,
}

/// Newton alone: from the start until converged or at a stand.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn alone<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<Outcome, Error> {
    let mut r = vec![[0.0; D]; problem.contacts()];
    let mut rigid = vec![0.0; problem.rigid.modes.len()];
    if !start.reaction.is_empty() {
        r.copy_from_slice(&start.reaction);
    }
    if !start.rigid.is_empty() {
        rigid.copy_from_slice(&start.rigid);
    }
    let v = problem.relative_displacement(&r, &rigid);
    if let Verdict::Stop(outcome) = monitor.look(&r, &v, &rigid, false)? {
        return Ok(outcome);
    }
    loop {
        match run(problem, &r, &rigid, monitor)? {
            End::Stop(outcome) => return Ok(outcome),
            End::Better(better, motion) => (r, rigid) = (better, motion),
            End::Stalled => return Ok(Outcome::Stalled),
        }
    }
}

/// Newton steps from `(r, a)` until converged or at a stand.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    rigid: &[f64],
    monitor: &mut Monitor<D>,
) -> Result<End<D>, Error> {
    let mut r = r.to_vec();
    let mut rigid = rigid.to_vec();
    let mut v = problem.relative_displacement(&r, &rigid);
    monitor.count(1.0);
    let mut here = residual(problem, &r, &v, &rigid);
    let mut moved = false;
    let mut factored: Option<Factored> = None;
    for _ in 0..MOST_STEPS {
        let system = System::linearised(problem, &r, &v);
        let forcing = (FORCING * monitor.wish() / here).clamp(LEAST_FORCING, MOST_FORCING);
        let stop = monitor.stop();
        let mut count = |products| monitor.count(products);
        let solved = system.solve((&r, &rigid), forcing, &mut factored, &mut count, stop)?;
        let Some(to) = solved else {
            break;
        };
        let to_v = problem.relative_displacement(&to.r, &to.rigid);
        monitor.count(1.0);
        let mut share = 1.0;
        let accepted = (0..MOST_HALVINGS).find_map(|_| {
            let next_r = between(&r, &to.r, share);
            let next_v = between(&v, &to_v, share);
            let next_rigid: Vec<f64> = rigid
                .iter()
                .zip(&to.rigid)
                .map(|(x, y)| x + share * (y - x))
                .collect();
            let there = residual(problem, &next_r, &next_v, &next_rigid);
            if there <= (1.0 - 1e-4 * share) * here {
                return Some((next_r, next_v, next_rigid, there));
            }
            share *= 0.5;
            None
        });
        let Some((next_r, next_v, next_rigid, there)) = accepted else {
            break;
        };
        (r, v, rigid, here) = (next_r, next_v, next_rigid, there);
        moved = true;
        match monitor.look(&r, &v, &rigid, true)? {
            Verdict::Stop(outcome) => return Ok(End::Stop(outcome)),
            Verdict::Refresh => {
                v = problem.relative_displacement(&r, &rigid);
                here = residual(problem, &r, &v, &rigid);
            }
            Verdict::Continue => {}
        }
        if share < 1e-2 {
            break; // creeping: sweeps do better
        }
    }
    Ok(if moved {
        End::Better(r, rigid)
    } else {
        End::Stalled
    })
}

/// `x + share (y − x)`, exactly `y` for a whole step.
fn between<const D: usize>(x: &[[f64; D]], y: &[[f64; D]], share: f64) -> Vec<[f64; D]> {
    if share >= 1.0 {
        return y.to_vec();
    }
    let blend =
        |(x, y): (&[f64; D], &[f64; D])| std::array::from_fn(|k| x[k] + share * (y[k] - x[k]));
    x.iter().zip(y).map(blend).collect()
}

/// The solution with some contacts held in every direction and the others open:
/// `(r, a)`. `None` where it is not unique.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn held_at<const D: usize>(
    problem: &Reduced<D>,
    holds: impl Fn(usize) -> bool,
    monitor: &mut Monitor<D>,
) -> Result<Option<Solved<D>>, Error> {
    let system = System::held(problem, holds);
    let stop = monitor.stop();
    let mut count = |products| monitor.count(products);
    if problem.rigid.modes.is_empty()
        && problem.compliance.is_symmetric()
        && let Some(solved) = system.solve_definite(&mut count, stop)?
    {
        return Ok(Some(solved));
    }
    let cold = vec![[0.0; D]; problem.contacts()];
    let none = vec![0.0; problem.rigid.modes.len()];
    system.solve((&cold, &none), MOST_FORCING, &mut None, &mut count, stop)
}
