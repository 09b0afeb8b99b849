//! Problems with many more candidates than contacts: `W` is formed only for those that may
//! close.
//!
//! The bodies are condensed onto a few contacts that touch from the start or hold a body.
//! Columns of `Bᵀ` of other contacts pass the factor on demand, `W = (L⁻¹Bᵀ)ᵀ(L⁻¹Bᵀ)`. The
//! memory is linear in the number of candidates.

use std::collections::HashMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use crate::condensation::analysed::AnalysedBody;
use crate::condensation::assemble::{Source, assemble};
use crate::condensation::bodies::{Bodies, Loaded, forecast, needed};
use crate::condensation::condense::{Condensed, SortedProblem, analyse, contact_set};
use crate::condensation::stats::Stats;
use crate::condensation::surface::{Far, Share, Surface};
use crate::condensation::tuning;
use crate::error::Error;
use crate::law::contact_law::ContactLaw;
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::reach::Reach;
use crate::reduced::compliance::Compliance;
use crate::reduced::elliptic_scaling::EllipticScaling;
use crate::reduced::memory::Budget;
use crate::reduced::rotation::Rotation;

/// With smaller pivots, relative to the diagonal of K, the eliminated part is held by contacts
/// near one line, and solves with the factor lose digits.
const SOFT: f64 = 1e-7;

/// A contact with a gap below this share of the largest gap touches.
const TOUCHING: f64 = 1e-9;

/// Contacts for which `W` is formed only when they are likely to close.
#[derive(Debug)]
pub struct Candidates<const D: usize> {
    pub(super) bodies: Arc<Bodies>,
    pub(super) surface: Surface<D>,
    budget: Budget,
    pub(super) stats: Stats,
    /// The reach of columns, for bodies with rows beyond the kept unknowns.
    reach: Vec<Option<Arc<Reach>>>,
    seeds: Vec<usize>,
    /// The gaps may be those of another step.
    pub(super) whole: Arc<OnceLock<Condensed<D>>>,
}

/// The problem of some of the candidates.
#[derive(Clone, Debug)]
pub struct View<const D: usize> {
    /// Their numbers among all candidates, ascending.
    pub members: Vec<usize>,
    pub problem: Condensed<D>,
}

impl<const D: usize> Candidates<D> {
    pub(super) fn new(
        sorted: SortedProblem<D>,
        seeds: Vec<usize>,
        before: Option<&Bodies>,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let SortedProblem {
            parts,
            geometry,
            supports,
            surface,
            budget,
            notice,
            ..
        } = sorted;
        let few = surface.of(&seeds);
        let all = surface.shares.iter().zip(few.shares.iter()).zip(&parts);
        let kept = all.map(|((share, few), (dofs, _))| {
            let whole = contact_set(share, dofs.len());
            if whole.len() <= tuning::all_kept() {
                whole
            } else {
                contact_set(few, dofs.len())
            }
        });
        let kept = kept.collect();
        let parts = analyse(parts, kept, geometry.as_ref(), before)?;
        if let Some(notice) = notice {
            notice.leave(forecast(&parts, false));
        }
        let needed = needed(&parts, false);
        let mut bodies = Bodies::new(parts, supports, needed, &budget, stop)?;
        let stats = bodies.stats();
        for body in &bodies.list {
            let weak = body.factor().and_then(Factor::weakest_pivot);
            if let Some((dof, ratio)) = weak
                && ratio < SOFT
            {
                let dof = body.dofs()[dof];
                return Err(Error::FloatingBody { dof });
            }
        }
        for body in &mut bodies.list {
            // Only closed contacts will have a part of W.
            drop(body.take_inverse());
        }
        let reach = bodies
            .list
            .iter()
            .zip(surface.shares.iter())
            .map(|(body, share)| {
                let unknowns = || {
                    let entries = share.rows.iter().flat_map(|row| &row.entries);
                    entries.map(|&(i, _)| i)
                };
                let factor = body.factor()?;
                let beyond = unknowns().any(|i| body.place(i).is_none());
                beyond.then(|| Arc::new(Reach::new(factor.symbolic(), unknowns())))
            });
        Ok(Self {
            reach: reach.collect(),
            bodies: Arc::new(bodies),
            surface,
            budget,
            stats,
            seeds,
            whole: Arc::default(),
        })
    }

    /// The same bodies and initial contacts with another surface, and what has been formed for
    /// all contacts of it.
    fn with_surface(&self, surface: Surface<D>, whole: Arc<OnceLock<Condensed<D>>>) -> Self {
        Self {
            bodies: Arc::clone(&self.bodies),
            surface,
            budget: self.budget,
            stats: self.stats.clone(),
            reach: self.reach.clone(),
            seeds: self.seeds.clone(),
            whole,
        }
    }

    pub(super) fn with_gap(&self, gap: Vec<[f64; D]>) -> Self {
        let surface = Surface {
            gap,
            ..self.surface.clone()
        };
        self.with_surface(surface, Arc::clone(&self.whole))
    }

    /// Gaps along normals, and so the seeds, do not change.
    pub(super) fn scaled(&self, elliptic: &EllipticScaling) -> Self {
        let mut surface = self.surface.clone();
        surface.scale(elliptic);
        self.with_surface(surface, Arc::default())
    }

    pub(super) fn rotated(&self, rotation: &Rotation<D>) -> Self {
        self.with_surface(self.surface.rotated(rotation), Arc::default())
    }

    /// The initial contacts, ascending.
    pub fn seeds(&self) -> &[usize] {
        &self.seeds
    }

    /// `B d` of a rigid motion at all candidates.
    ///
    /// # Errors
    /// None for a motion of its own.
    pub fn motion(&self, amounts: &[f64]) -> Result<Vec<[f64; D]>, Error> {
        let bodies = &self.bodies;
        let nothing = (vec![0.0; bodies.order()], vec![0.0; bodies.fixed().len()]);
        let moved = Loaded {
            load: &nothing.0,
            prescribed: &nothing.1,
            reaction: &vec![[0.0; D]; self.surface.contacts()],
            rigid: amounts,
        };
        let d = bodies.displacement(&self.surface, moved)?;
        Ok(self.surface.product(&bodies.list, bodies.fixed(), &d))
    }

    /// The problem of some contacts, ascending. It copies half solves from an earlier view.
    pub fn view(
        &self,
        members: Vec<usize>,
        law: &[ContactLaw],
        before: Option<&View<D>>,
    ) -> Result<View<D>, Error> {
        let mut surface = self.surface.of(&members);
        for (b, reach) in self.reach.iter().enumerate() {
            if let Some(reach) = reach {
                let old = before.map(|view| (&view.members[..], &view.problem.surface().shares[b]));
                let far = self.far(b, reach, &surface.shares[b], &members, old)?;
                Arc::make_mut(&mut surface.shares)[b].far = Some(far);
            }
        }
        let source = &mut Source::Shared(&self.bodies.list);
        let compliance = assemble(source, &surface, &self.budget)?;
        let law = members.iter().map(|&i| law[i]).collect();
        let bodies = Arc::clone(&self.bodies);
        let mut stats = self.stats.clone();
        stats.amplification = stats
            .amplification
            .max(self.amplification(&surface, &compliance));
        Ok(View {
            problem: Condensed::of(bodies, Arc::new(surface), law, compliance, stats)?,
            members,
        })
    }

    /// Bound of the error of this `W`, in ε: stiffness times compliance, as
    /// that of S in [`ContactStiffness`](crate::condensation::contact_stiffness::ContactStiffness).
    fn amplification(&self, surface: &Surface<D>, compliance: &Compliance<'_, D>) -> f64 {
        let ones = vec![[1.0; D]; compliance.contacts()];
        let mut sums = vec![[0.0; D]; compliance.contacts()];
        compliance.absolute_product(&ones, &mut sums);
        let flexible = sums.as_flattened().iter().fold(0.0, |m: f64, &s| m.max(s));
        let bodies = self.bodies.list.iter().zip(surface.shares.iter());
        let stiffest = bodies.map(|(body, share)| {
            let entries = share.rows.iter().flat_map(|row| &row.entries);
            body.stiffest(entries.map(|&(i, _)| i))
        });
        flexible * stiffest.fold(0.0, f64::max)
    }

    /// Half solves of the rows of a share; those of an earlier one are copied.
    fn far(
        &self,
        body: usize,
        reach: &Arc<Reach>,
        share: &Share,
        members: &[usize],
        before: Option<(&[usize], &Share)>,
    ) -> Result<Far, Error> {
        let body = &self.bodies.list[body];
        let factor = body.factor().ok_or(Error::FactorDropped)?;
        let (reached, kept) = (reach.pivots().len(), body.kept());
        let rows = share.rows.len();
        let bytes = 8 * ((reached + kept) as u128) * rows as u128;
        self.budget
            .check("the half solves of the contacts", bytes, 0)?;
        let global = |members: &[usize], row: usize| D * members[row / D] + row % D;
        let mut known = HashMap::new();
        if let Some((members, share)) = before {
            for (k, row) in share.rows.iter().enumerate() {
                let _ = known.insert(global(members, row.row), k);
            }
        }
        let old = before.and_then(|(_, share)| share.far.as_ref());
        let found: Vec<Option<usize>> = share
            .rows
            .iter()
            .map(|row| known.get(&global(members, row.row)).copied())
            .collect();
        let fresh: Vec<&[(usize, f64)]> = share
            .rows
            .iter()
            .zip(&found)
            .filter(|(_, old)| old.is_none())
            .map(|(row, _)| &row.entries[..])
            .collect();
        let (inside_new, kept_new) = factor.half_solve(reach, &fresh);
        let mut far = Far {
            reach: Arc::clone(reach),
            inside: Vec::with_capacity(reached * rows),
            kept: Vec::with_capacity(kept * rows),
        };
        let mut next = 0;
        for found in found {
            let (inside, column) = if let (Some(k), Some(old)) = (found, old) {
                old.column(k, kept)
            } else {
                let k = next;
                next += 1;
                (
                    &inside_new[k * reached..(k + 1) * reached],
                    &kept_new[k * kept..(k + 1) * kept],
                )
            };
            far.inside.extend_from_slice(inside);
            far.kept.extend_from_slice(column);
        }
        Ok(far)
    }

    /// The problem with `W` of all contacts: condensed again, onto all of them.
    pub(super) fn whole(&self, stop: &AtomicBool) -> Result<&Condensed<D>, Error> {
        // Two simultaneous callers both make it, with the same bits. A lock would be held
        // during work of the pool, whose threads may need the lock.
        if let Some(made) = self.whole.get() {
            return Ok(made);
        }
        let bodies = self.bodies.list.iter().zip(self.surface.shares.iter());
        let parts = bodies.map(|(body, share)| {
            AnalysedBody::again(body.ordered(), contact_set(share, body.dofs().len()))
        });
        let parts = parts.collect::<Result<Vec<_>, _>>()?;
        let made = Condensed::from_parts(
            parts,
            self.bodies.supports().clone(),
            self.surface.clone(),
            vec![ContactLaw::default(); self.surface.contacts()],
            &self.budget,
            stop,
        )?;
        Ok(self.whole.get_or_init(|| made))
    }
}

/// The initial contacts if most of many candidates are apart; with `always`, if there are many
/// candidates.
pub(super) fn seeds<const D: usize>(surface: &Surface<D>, always: bool) -> Option<Vec<usize>> {
    let largest = surface.gap.iter().fold(0.0_f64, |m, g| m.max(g[0].abs()));
    let touches = |i: usize| surface.gap[i][0] <= TOUCHING * largest;
    let mut chosen = vec![false; surface.contacts()];
    let mut grows = false;
    for share in surface.shares.iter() {
        let mut contacts: Vec<usize> = share.rows.iter().map(|row| row.row / D).collect();
        contacts.dedup();
        let touching = contacts.iter().filter(|&&i| touches(i)).count();
        let many = D * contacts.len() > tuning::all_kept();
        grows |= many && (always || tuning::one_touches_in() * touching <= contacts.len());
        for k in 0..tuning::pins() {
            if let Some(&contact) = contacts.get(scattered(k, contacts.len())) {
                chosen[contact] = true;
            }
        }
    }
    let members = |i: &usize| chosen[*i] || !always && touches(*i);
    grows.then(|| (0..surface.contacts()).filter(members).collect())
}

/// The `k`-th number of a sequence that fills `0..count` evenly and follows no line of a
/// row-by-row numbering: multiples of the golden ratio.
#[expect(clippy::cast_possible_truncation, reason = "below `count`")]
fn scattered(k: usize, count: usize) -> usize {
    const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
    let turn = (k as u64).wrapping_mul(GOLDEN);
    ((u128::from(turn) * count as u128) >> 64) as usize
}
