//! The two displacement principles alternately [dSF91, 69, 70]: frictionless contact with the
//! last tangential reactions, then friction with the last normal ones.
//!
//! Both are convex; together they are a block Gauss–Seidel iteration between the
//! normal and the tangential components of all contacts.

use crate::law::contact_law::ContactLaw;
use crate::law::frozen::Frozen;
use crate::reduced::reduced::Reduced;
use crate::solver::monitor::Monitor;
use crate::solver::outcome::Ended;
use crate::solver::paper::principles::convex::{enough, iterate, minimise};
use crate::solver::settings::Start;

/// The laws of contact with the tangential reactions of `r` fixed.
pub fn frozen_friction<const D: usize>(r: &[[f64; D]]) -> Vec<Frozen<D>> {
    r.iter()
        .map(|&tangential| Frozen::Contact { tangential })
        .collect()
}

/// The laws of friction with the normal reactions of `r` fixed.
pub fn frozen_contact<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<Frozen<D>> {
    let given = |(r, law): (&[f64; D], &ContactLaw)| {
        let normal = r[0].max(0.0);
        Frozen::Friction {
            normal,
            limit: law.limit(normal),
        }
    };
    r.iter().zip(&problem.law).map(given).collect()
}

/// Runs until the monitor stops it or passes give no improvement.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    iterate(problem, start, monitor, |point, monitor| {
        let enough = enough(problem, point, monitor);
        let contact = frozen_friction(&point.r);
        let pressed = minimise(problem, contact, point, enough, monitor)?;
        let friction = frozen_contact(problem, &pressed.r);
        minimise(problem, friction, &pressed, enough, monitor)
    })
}
