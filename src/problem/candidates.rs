//! Far more candidates than contacts: `W` is formed of those that may close only.
//!
//! The bodies are condensed onto a few contacts that touch or pin them; the columns
//! of `Bᵀ` of any others are carried through the factor when they are asked for,
//! `W = (L⁻¹Bᵀ)ᵀ(L⁻¹Bᵀ)`. Memory is linear in the candidates.

use std::collections::HashMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use crate::error::Error;
use crate::linalg::multifrontal::Factor;
use crate::linalg::reach::Reach;
use crate::problem::analysed::Analysed;
use crate::problem::assemble::{Source, assemble};
use crate::problem::bodies::{Bodies, Loaded, forecast, needed};
use crate::problem::body::DIGITS;
use crate::problem::border::{check_finite, check_friction, check_length};
use crate::problem::compliance::Compliance;
use crate::problem::condense::{Condensed, Sorted, analyse, contact_set};
use crate::problem::memory::Budget;
use crate::problem::stats::Stats;
use crate::problem::stretch::Stretch;
use crate::problem::surface::{Far, Share, Surface};

/// Degrees of freedom in the contact set of a body up to which all are kept: `W` of
/// so many is formed in a fraction of the time of the factor.
const MANY: usize = 600;

/// One candidate in so many may touch from the start; where more do, all are kept.
const FEW: usize = 4;

/// Contacts kept of each body to pin it, should its supports not.
const PINS: usize = 12;

/// Pivots below this share of their diagonal in K: what is eliminated then hangs on
/// contacts too close to one line, and digits are lost on all that passes the factor.
const SOFT: f64 = 1e-7;

/// Relative displacements by `W` and by `u` may differ by this share of the largest
/// motion of a contact: `W` may have lost [`DIGITS`] before
/// it is mended, 2e-11 of it, and a path adds these up.
const CONFIRMED: f64 = 1e-8;

/// What is lost is estimated to this factor.
const ALLOWED: f64 = 8.0;

/// Gaps below this share of the largest touch.
const TOUCHING: f64 = 1e-9;

/// Contacts of which `W` is not formed before they are likely to close.
#[derive(Debug)]
pub struct Candidates<const D: usize> {
    bodies: Arc<Bodies>,
    surface: Surface<D>,
    budget: Budget,
    stats: Stats,
    /// What columns can reach, of bodies with rows beyond the kept unknowns.
    reach: Vec<Option<Arc<Reach>>>,
    seeds: Vec<usize>,
    /// With gaps that may be those of another step.
    whole: Arc<OnceLock<Condensed<D>>>,
}

/// The problem of some of the candidates.
#[derive(Clone, Debug)]
pub struct View<const D: usize> {
    /// Their numbers among all candidates, ascending.
    pub members: Vec<usize>,
    pub problem: Condensed<D>,
}

/// A contact problem, `W` of all contacts formed or not.
#[derive(Debug)]
pub enum Problem<const D: usize> {
    Whole(Condensed<D>),
    Growing {
        candidates: Arc<Candidates<D>>,
        mu: Vec<f64>,
    },
}

impl<const D: usize> Problem<D> {
    /// Condenses onto all contacts, or onto few where far more are candidates than
    /// touch. `grow` says which, `None` leaves it to the gaps; `before` is a problem
    /// of which analyses may be used again.
    ///
    /// # Errors
    /// As [`Condensed::new`].
    pub fn new(
        sorted: Sorted<D>,
        grow: Option<bool>,
        before: Option<&Self>,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let before = before.map(|problem| &**problem.bodies());
        let all_known = sorted.supports.known.is_some();
        if grow != Some(false)
            && !all_known
            && let Some(seeds) = seeds(&sorted.surface, grow == Some(true))
        {
            match Candidates::new(sorted.clone(), seeds, before, stop) {
                // The few do not hold the body; all of them may.
                Err(Error::FloatingBody { .. }) => {}
                made => {
                    return Ok(Self::Growing {
                        candidates: Arc::new(made?),
                        mu: sorted.mu,
                    });
                }
            }
        }
        Condensed::new(sorted, before, stop).map(Self::Whole)
    }

    #[must_use]
    pub fn bodies(&self) -> &Arc<Bodies> {
        match self {
            Self::Whole(problem) => problem.bodies(),
            Self::Growing { candidates, .. } => &candidates.bodies,
        }
    }

    #[must_use]
    pub fn surface(&self) -> &Surface<D> {
        match self {
            Self::Whole(problem) => problem.surface(),
            Self::Growing { candidates, .. } => &candidates.surface,
        }
    }

    #[must_use]
    pub fn contacts(&self) -> usize {
        self.surface().contacts()
    }

    #[must_use]
    pub fn mu(&self) -> &[f64] {
        match self {
            Self::Whole(problem) => problem.mu(),
            Self::Growing { mu, .. } => mu,
        }
    }

    #[must_use]
    pub fn stats(&self) -> &Stats {
        match self {
            Self::Whole(problem) => problem.stats(),
            Self::Growing { candidates, .. } => &candidates.stats,
        }
    }

    /// Bytes that the compliance formed so far holds.
    #[must_use]
    pub fn bytes_compliance(&self) -> usize {
        match self {
            Self::Whole(problem) => problem.compliance().bytes(),
            Self::Growing { candidates, .. } => candidates
                .whole
                .get()
                .map_or(0, |problem| problem.compliance().bytes()),
        }
    }

    /// With `W` of all contacts, formed now where it was not.
    ///
    /// # Errors
    /// As [`Condensed::new`].
    pub fn whole(&self, stop: &AtomicBool) -> Result<Condensed<D>, Error> {
        match self {
            Self::Whole(problem) => Ok(problem.clone()),
            Self::Growing { candidates, mu } => candidates
                .whole(stop)?
                .with_gap(candidates.surface.gap.clone())
                .with_mu(mu.clone()),
        }
    }

    /// The same bodies and contacts with other friction coefficients.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::Friction`].
    pub fn with_mu(&self, mu: Vec<f64>) -> Result<Self, Error> {
        check_friction(&mu, self.contacts())?;
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.with_mu(mu)?),
            Self::Growing { candidates, .. } => Self::Growing {
                candidates: Arc::clone(candidates),
                mu,
            },
        })
    }

    /// The same bodies and contacts with other gaps, of which those to begin with stay.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn with_gap(&self, gap: Vec<[f64; D]>) -> Result<Self, Error> {
        check_length("gap", gap.len(), self.contacts())?;
        check_finite("gap", gap.as_flattened())?;
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.with_gap(gap)),
            Self::Growing { candidates, mu } => Self::Growing {
                candidates: Arc::new(candidates.with_gap(gap)),
                mu: mu.clone(),
            },
        })
    }

    /// The same contacts in stretched variables, on the same bodies.
    ///
    /// # Errors
    /// As [`Condensed::stretched`].
    pub fn stretched(&self, stretch: &Stretch) -> Result<Self, Error> {
        Ok(match self {
            Self::Whole(problem) => Self::Whole(problem.stretched(stretch)?),
            Self::Growing { candidates, mu } => Self::Growing {
                candidates: Arc::new(candidates.stretched(stretch)),
                mu: mu.clone(),
            },
        })
    }

    /// What the rigid motions are at all contacts, `B R`.
    ///
    /// # Errors
    /// None that a motion of its own can cause.
    pub fn modes(&self) -> Result<Vec<Vec<[f64; D]>>, Error> {
        let candidates = match self {
            Self::Whole(problem) => return Ok(problem.modes()),
            Self::Growing { candidates, .. } => candidates,
        };
        let count = candidates.bodies.motions().len();
        let of_motion = |k| {
            let mut amounts = vec![0.0; count];
            amounts[k] = 1.0;
            candidates.motion(&amounts)
        };
        (0..count).map(of_motion).collect()
    }

    /// As [`Bodies::displacements`].
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`], [`Error::FactorDropped`].
    pub fn displacements(&self, states: &[Loaded<'_, D>]) -> Result<Vec<Vec<f64>>, Error> {
        self.bodies().displacements(self.surface(), states)
    }

    /// Whether `B u + gap` is `v` at the displacements `u` of a state.
    ///
    /// # Errors
    /// [`Error::NotConfirmed`] at the contact where it is furthest from it; as
    /// [`Problem::displacements`].
    pub fn confirm(
        &self,
        state: &Loaded<'_, D>,
        u: &[f64],
        held_to: &Confirmed<D>,
    ) -> Result<(), Error> {
        let Confirmed { v, gap, slip } = held_to;
        let bodies = self.bodies();
        let moved = self.surface().product(&bodies.list, bodies.fixed(), u);
        let length = |a: &[f64; D]| a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let all = moved.iter().chain(v).chain(gap).chain(slip);
        let size = all.map(length).fold(0.0, f64::max);
        let off = (0..v.len()).map(|i| {
            let off: [f64; D] = std::array::from_fn(|k| moved[i][k] + gap[i][k] - v[i][k]);
            (i, length(&off))
        });
        let Some((contact, off)) = off.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return Ok(());
        };
        // Where all contacts stick, `v` is the rounding of what loads make of the bodies.
        let explained = |u: &[f64]| {
            let farthest = u.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            off <= CONFIRMED * size + ALLOWED * DIGITS * f64::EPSILON * farthest
        };
        if explained(u) {
            return Ok(());
        }
        // And where the bodies hardly move at all, of what loads alone would make of them.
        let nothing = vec![[0.0; D]; v.len()];
        let alone = Loaded {
            reaction: &nothing,
            ..*state
        };
        if explained(&self.bodies().displacement(self.surface(), alone)?) {
            return Ok(());
        }
        Err(Error::NotConfirmed { contact, off, size })
    }

    /// As [`Bodies::relative_displacement`].
    ///
    /// # Errors
    /// The same.
    pub fn relative_displacement(&self, state: Loaded<'_, D>) -> Result<Vec<[f64; D]>, Error> {
        self.bodies().relative_displacement(self.surface(), state)
    }
}

/// What `B u + gap` is held to.
#[derive(Clone, Debug)]
pub struct Confirmed<const D: usize> {
    pub v: Vec<[f64; D]>,
    pub gap: Vec<[f64; D]>,
    /// What the step added to the tangential parts of `v`, and nothing along the normal:
    /// rounding of what was before it stays.
    pub slip: Vec<[f64; D]>,
}

impl<const D: usize> Candidates<D> {
    fn new(
        sorted: Sorted<D>,
        seeds: Vec<usize>,
        before: Option<&Bodies>,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let Sorted {
            parts,
            places,
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
            if whole.len() <= MANY {
                whole
            } else {
                contact_set(few, dofs.len())
            }
        });
        let kept = kept.collect();
        let parts = analyse(parts, kept, (places, geometry), before)?;
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
            // Only as many contacts as close will have a part of W.
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

    /// On the same bodies, and with them what has been formed of all contacts.
    fn with_gap(&self, gap: Vec<[f64; D]>) -> Self {
        Self {
            bodies: Arc::clone(&self.bodies),
            surface: Surface {
                gap,
                ..self.surface.clone()
            },
            budget: self.budget,
            stats: self.stats.clone(),
            reach: self.reach.clone(),
            seeds: self.seeds.clone(),
            whole: Arc::clone(&self.whole),
        }
    }

    /// Gaps along normals, and with them the seeds, are as they were.
    fn stretched(&self, stretch: &Stretch) -> Self {
        let mut surface = self.surface.clone();
        surface.stretch(stretch);
        Self {
            bodies: Arc::clone(&self.bodies),
            surface,
            budget: self.budget,
            stats: self.stats.clone(),
            reach: self.reach.clone(),
            seeds: self.seeds.clone(),
            whole: Arc::default(),
        }
    }

    /// Contacts to begin with, ascending.
    #[must_use]
    pub fn seeds(&self) -> &[usize] {
        &self.seeds
    }

    /// `B d` of a rigid motion at all candidates.
    ///
    /// # Errors
    /// None that a motion of its own can cause.
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

    /// The problem of some contacts, ascending; half solves of those of an earlier
    /// view are taken from there.
    ///
    /// # Errors
    /// [`Error::Memory`], [`Error::MemoryLimit`]; [`Error::FloatingBody`] where they
    /// do not feel a rigid motion; [`Error::Shape`] for `mu`.
    pub fn view(
        &self,
        members: Vec<usize>,
        mu: &[f64],
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
        let mu = members.iter().map(|&i| mu[i]).collect();
        let bodies = Arc::clone(&self.bodies);
        let mut stats = self.stats.clone();
        stats.amplification = stats
            .amplification
            .max(self.amplification(&surface, &compliance));
        Ok(View {
            problem: Condensed::of(bodies, Arc::new(surface), mu, compliance, stats)?,
            members,
        })
    }

    /// What the error of this `W` may be, in ε: stiffness against compliance, as
    /// [`Body::amplification`](crate::problem::body::Body::amplification) of S.
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

    /// Half solves of the rows of a share, those of an earlier one copied.
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
                known.insert(global(members, row.row), k);
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

    /// With `W` of all contacts: condensed anew, onto all of them.
    fn whole(&self, stop: &AtomicBool) -> Result<&Condensed<D>, Error> {
        // Two that ask at once both make it, to the same bits: a lock would be held
        // over work of the pool, and its thread may meet the lock again there.
        if let Some(made) = self.whole.get() {
            return Ok(made);
        }
        let bodies = self.bodies.list.iter().zip(self.surface.shares.iter());
        let parts = bodies
            .map(|(body, share)| Analysed::again(body, contact_set(share, body.dofs().len())));
        let parts = parts.collect::<Result<Vec<_>, _>>()?;
        let made = Condensed::from_parts(
            parts,
            self.bodies.supports().clone(),
            self.surface.clone(),
            vec![0.0; self.surface.contacts()],
            &self.budget,
            stop,
        )?;
        Ok(self.whole.get_or_init(|| made))
    }
}

/// The contacts to begin with, where most of many candidates are apart; with
/// `always` wherever there are many.
fn seeds<const D: usize>(surface: &Surface<D>, always: bool) -> Option<Vec<usize>> {
    let largest = surface.gap.iter().fold(0.0_f64, |m, g| m.max(g[0].abs()));
    let touches = |i: usize| surface.gap[i][0] <= TOUCHING * largest;
    let mut chosen = vec![false; surface.contacts()];
    let mut grows = false;
    for share in surface.shares.iter() {
        let mut contacts: Vec<usize> = share.rows.iter().map(|row| row.row / D).collect();
        contacts.dedup();
        let touching = contacts.iter().filter(|&&i| touches(i)).count();
        let many = D * contacts.len() > MANY;
        grows |= many && (always || FEW * touching <= contacts.len());
        for k in 0..PINS {
            if let Some(&contact) = contacts.get(scattered(k, contacts.len())) {
                chosen[contact] = true;
            }
        }
    }
    let members = |i: &usize| chosen[*i] || !always && touches(*i);
    grows.then(|| (0..surface.contacts()).filter(members).collect())
}

/// The `k`-th of a sequence that fills `0..count` evenly and follows no line of a
/// numbering row by row: multiples of the golden ratio.
#[expect(clippy::cast_possible_truncation, reason = "below `count`")]
fn scattered(k: usize, count: usize) -> usize {
    const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
    let turn = (k as u64).wrapping_mul(GOLDEN);
    ((u128::from(turn) * count as u128) >> 64) as usize
}
