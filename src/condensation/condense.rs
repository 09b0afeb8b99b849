//! From `K`, `B` and `f` to `S`, `W` and `q`, and back to `u`: (1)–(4).
//!
//! The bodies are the connected components of the free part of `K`. Each is condensed onto its
//! contact set, the free degrees of freedom in `B`: `S = K_cc − K_ci K_ii⁻¹ K_ic`. Then
//! `W = Σ B_c (S + α R Rᵀ)⁻¹ B_cᵀ`, with `R` the rigid motions that the supports leave free.
//! Contacts that share a body are in one island of `W`.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rayon::prelude::*;

use crate::bodies::connected;
use crate::bodies::geometry::{Geometry, Kinematics};
use crate::condensation::analysed::AnalysedBody;
use crate::condensation::assemble::{Source, assemble, bytes_beside};
use crate::condensation::bodies::{Bodies, Loaded, Loads, Supports, forecast, needed};
use crate::condensation::forecast::Notice;
use crate::condensation::pattern_cache::{self, Lookup};
use crate::condensation::stats::Stats;
use crate::condensation::surface::{Share, Surface};
use crate::condensation::tuning;
use crate::error::{Error, check_finite, check_length};
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::small::{TURNED, amax, norm};
use crate::linalg::sparse::csc::{Symmetric, positions};
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::reduced::compliance::Compliance;
use crate::reduced::elliptic_scaling::EllipticScaling;
use crate::reduced::memory::Budget;
use crate::reduced::reduced::{Reduced, Rigid};
use crate::reduced::rotation::Rotation;

/// The arrays of a contact problem, borrowed from the caller.
#[derive(Debug)]
pub struct ProblemArrays<'a, const D: usize, I = usize> {
    /// Symmetric positive semidefinite stiffness, both triangles, by columns; the lower one is read.
    pub stiffness: Symmetric<'a, I>,
    /// `B`, with one row for each component of each contact.
    pub contact: Rows<'a>,
    /// Gap by components.
    pub gap: &'a [[f64; D]],
    pub law: &'a [ContactLaw],
    /// Prescribed degrees of freedom.
    pub fixed: &'a [usize],
    /// The position of each degree of freedom, for the elimination order; in any unit, and the
    /// third coordinate may be zero.
    pub places: Option<&'a [[f64; 3]]>,
    /// What a mesh knows besides.
    pub kinematics: Option<Kinematics<'a>>,
    /// All loads, if no displacement will be requested.
    pub known: Option<Vec<Loads>>,
    pub budget: Budget,
}

/// The arrays of the caller, checked and sorted by bodies.
#[derive(Clone, Debug)]
pub struct SortedProblem<const D: usize> {
    /// Degrees of freedom and stiffness of each body.
    pub parts: Vec<(Vec<usize>, OwnedMatrix)>,
    /// The positions of all degrees of freedom.
    pub geometry: Option<Arc<Geometry>>,
    pub supports: Supports,
    pub surface: Surface<D>,
    pub law: Vec<ContactLaw>,
    pub budget: Budget,
    /// Receiver of the costs, before the factorisation.
    pub notice: Option<Notice>,
}

/// A condensed contact problem: everything that does not depend on the loads.
#[derive(Clone, Debug)]
pub struct Condensed<const D: usize> {
    bodies: Arc<Bodies>,
    surface: Arc<Surface<D>>,
    law: Vec<ContactLaw>,
    compliance: Arc<Compliance<'static, D>>,
    stats: Stats,
}

/// The effect of one set of loads without contact forces.
#[derive(Clone, Debug)]
pub struct FreePart<const D: usize> {
    /// `q` with the whole gap: total relative displacement at `r = 0`, `a = 0`.
    pub q: Vec<[f64; D]>,
    /// `R` and `e`.
    pub rigid: Rigid<D>,
}

impl<const D: usize> SortedProblem<D> {
    /// Checks everything that needs no factorisation.
    pub fn new(given: ProblemArrays<D>) -> Result<Self, Error> {
        let n = given.stiffness.n();
        let rows = D * given.gap.len();
        given.contact.check("B", rows, n)?;
        check_finite("gap", given.gap.as_flattened())?;
        contact_law::check(given.law, given.gap.len())?;
        let position = positions("fixed", given.fixed, n)?;
        let symmetry = given.stiffness.check_symmetry()?;

        let (free, global) = connected::free_part(&given.stiffness, symmetry, &position);
        let coupling = connected::columns(&given.stiffness, given.fixed, &position);
        let component = free.view().components();
        let mut parts = connected::split(free, &component);
        let local = connected::local_numbers(&component, parts.len());
        let place = free_places(&position, &component, &local);
        let surface = Surface::new(&given.contact, given.gap, &place, &position, parts.len());
        for dof in parts.iter_mut().flat_map(|(dofs, _)| dofs) {
            *dof = global[*dof];
        }
        if let Some(places) = given.places {
            check_length("coordinates", places.len(), n)?;
            check_finite("coordinates", places.as_flattened())?;
        }
        if let Some(mesh) = &given.kinematics {
            check_length("loss", mesh.loss.len(), n)?;
            check_length("motions", mesh.motions.len(), 3 * (D - 1) * n)?;
            check_finite("motions", mesh.motions)?;
            check_finite("loss", mesh.loss)?;
        }
        let geometry = given.places.map(|at| {
            let mut supported = vec![false; n];
            for &dof in &coupling.index {
                supported[dof] = true;
            }
            Arc::new(Geometry::new(at.to_vec(), D, supported, given.kinematics))
        });
        Ok(Self {
            parts,
            geometry,
            supports: Supports {
                n,
                fixed: given.fixed.to_vec(),
                coupling,
                known: given.known,
            },
            surface,
            law: given.law.to_vec(),
            budget: given.budget,
            notice: None,
        })
    }
}

/// Analyses bodies in parallel. `before` are bodies of an earlier problem, whose analyses are
/// used again for equal patterns. For a few bodies, analyses of all problems of this process
/// are used again, and theirs are stored.
pub fn analyse(
    parts: Vec<(Vec<usize>, OwnedMatrix)>,
    kept: Vec<Vec<usize>>,
    geometry: Option<&Arc<Geometry>>,
    before: Option<&Bodies>,
) -> Result<Vec<AnalysedBody>, Error> {
    let old = |b: usize| before.and_then(|bodies| bodies.list.get(b));
    let few = pattern_cache::limit()? > 0 && parts.len() <= tuning::searched_bodies();
    let own: Vec<f64> = parts
        .par_iter()
        .map(|(_, part)| amax(&part.values))
        .collect();
    let most = own.iter().copied().fold(0.0, f64::max);
    // The unit of a body without stiffness, such as a rigid obstacle under a force, is that of
    // the others. A unit of 1 N/m would make its α so small, in a system of units with large
    // stiffnesses, that W loses the digits of the bodies in contact with it.
    let stiffest = |b: usize| if own[b] > 0.0 { own[b] } else { most };
    let find = |((dofs, stiffness), kept): (&(Vec<usize>, OwnedMatrix), &Vec<usize>)| {
        let places = geometry.map(|geometry| geometry.list_places(dofs));
        let asked = Lookup {
            matrix: stiffness.view(),
            kept,
            places: places.as_deref(),
        };
        asked.find()
    };
    let of_patterns: Vec<_> = parts
        .iter()
        .zip(&kept)
        .map(|body| if few { find(body) } else { None })
        .collect();
    let analysed: Vec<Result<AnalysedBody, Error>> = parts
        .into_par_iter()
        .zip(kept)
        .zip(of_patterns)
        .enumerate()
        .map(|(b, (((dofs, stiffness), kept), of_pattern))| {
            let (geometry, size) = (geometry.cloned(), stiffest(b));
            AnalysedBody::new(dofs, stiffness, kept, geometry, old(b), of_pattern, size)
        })
        .collect();
    let analysed: Vec<AnalysedBody> = analysed.into_iter().collect::<Result<_, _>>()?;
    if few {
        analysed.iter().for_each(AnalysedBody::share);
    }
    Ok(analysed)
}

impl<const D: usize> Condensed<D> {
    /// Orders, factors and forms `W` of all contacts. Analyses of the problem `before` may be
    /// used again.
    pub fn new(
        sorted: SortedProblem<D>,
        before: Option<&Bodies>,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let SortedProblem {
            parts,
            geometry,
            supports,
            surface,
            law,
            budget,
            notice,
        } = sorted;
        let sizes = parts.iter().map(|(dofs, _)| dofs.len());
        let kept = sizes.zip(surface.shares.iter());
        let kept = kept.map(|(n, share)| contact_set(share, n)).collect();
        let parts = analyse(parts, kept, geometry.as_ref(), before)?;
        if let Some(notice) = notice {
            let mut told = forecast(&parts, supports.known.is_some());
            let kept: Vec<usize> = parts.iter().map(|part| part.counts().kept).collect();
            told.bytes_peak += bytes_beside(&surface, &kept);
            notice.leave(told);
        }
        Self::from_parts(parts, supports, surface, law, &budget, stop)
    }

    /// Makes it from bodies analysed with their whole contact sets.
    pub(crate) fn from_parts(
        parts: Vec<AnalysedBody>,
        supports: Supports,
        surface: Surface<D>,
        law: Vec<ContactLaw>,
        budget: &Budget,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let kept: Vec<usize> = parts.iter().map(|part| part.counts().kept).collect();
        let needed = needed(&parts, supports.known.is_some()) + bytes_beside(&surface, &kept);
        let mut bodies = Bodies::new(parts, supports, needed, budget, stop)?;
        let mut stats = bodies.stats();

        let started = Instant::now();
        let source = &mut Source::Fresh(&mut bodies.list);
        let compliance = assemble(source, &surface, budget)?;
        stats.seconds_compliance += started.elapsed().as_secs_f64();
        Self::of(Arc::new(bodies), Arc::new(surface), law, compliance, stats)
    }

    /// Makes it from bodies, contacts and their compliance.
    pub fn of(
        bodies: Arc<Bodies>,
        surface: Arc<Surface<D>>,
        law: Vec<ContactLaw>,
        compliance: Compliance<'static, D>,
        mut stats: Stats,
    ) -> Result<Self, Error> {
        stats.islands = compliance.islands().len();
        let made = Self {
            bodies,
            surface,
            law,
            compliance: Arc::new(compliance),
            stats,
        };
        let rigid = Rigid {
            modes: made.modes().into(),
            load: vec![0.0; made.bodies.motions().len()],
        };
        let q = vec![[0.0; D]; made.contacts()];
        match Reduced::new(&made.compliance, &q, &made.law, &rigid) {
            Err(Error::DependentMotion { mode }) => Err(Error::FloatingBody {
                dof: made.bodies.most_moved(mode),
            }),
            Err(other) => Err(other),
            Ok(_) => Ok(made),
        }
    }

    /// The same contacts with other laws.
    pub fn with_law(&self, law: Vec<ContactLaw>) -> Result<Self, Error> {
        contact_law::check(&law, self.contacts())?;
        Ok(Self {
            law,
            ..self.clone()
        })
    }

    /// The same contacts with other gaps, one for each contact and finite:
    /// [`Problem::with_gap`] checks this.
    ///
    /// [`Problem::with_gap`]: crate::condensation::problem::Problem::with_gap
    pub(crate) fn with_gap(&self, gap: Vec<[f64; D]>) -> Self {
        Self {
            surface: Arc::new(Surface {
                gap,
                ..(*self.surface).clone()
            }),
            ..self.clone()
        }
    }

    /// The same contacts in scaled variables, on the same bodies.
    pub fn scaled(&self, elliptic: &EllipticScaling) -> Result<Self, Error> {
        let mut surface = (*self.surface).clone();
        surface.scale(elliptic);
        Ok(Self {
            surface: Arc::new(surface),
            compliance: Arc::new(self.compliance.scaled(elliptic)?),
            ..self.clone()
        })
    }

    /// The same contacts in rotated frames, on the same bodies.
    pub fn rotated(&self, rotation: &Rotation<D>) -> Result<Self, Error> {
        Ok(Self {
            surface: Arc::new(self.surface.rotated(rotation)),
            compliance: Arc::new(self.compliance.rotated(rotation)?),
            ..self.clone()
        })
    }

    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    pub fn bodies(&self) -> &Arc<Bodies> {
        &self.bodies
    }

    pub fn surface(&self) -> &Surface<D> {
        &self.surface
    }

    pub fn contacts(&self) -> usize {
        self.surface.contacts()
    }

    pub fn law(&self) -> &[ContactLaw] {
        &self.law
    }

    /// `W`, for what outlives this problem.
    pub fn shared_compliance(&self) -> &Arc<Compliance<'static, D>> {
        &self.compliance
    }

    /// `W`.
    pub fn compliance(&self) -> &Compliance<'static, D> {
        &self.compliance
    }

    /// Columns of `B_c R` over all contacts.
    pub fn modes(&self) -> Vec<Vec<[f64; D]>> {
        let of_motion = |&(b, k): &(usize, usize)| {
            let mut mode = vec![[0.0; D]; self.contacts()];
            let body = &self.bodies.list[b];
            self.surface.shares[b].add_motion(body, k, 1.0, mode.as_flattened_mut());
            for moved in &mut mode {
                let least = TURNED * norm(moved);
                *moved = moved.map(|c| if c.abs() <= least { 0.0 } else { c });
            }
            mode
        };
        self.bodies.motions().iter().map(of_motion).collect()
    }

    /// `q` and `e` of a load `f` and prescribed displacements, (4).
    pub fn free_part(&self, load: &[f64], prescribed: &[f64]) -> Result<FreePart<D>, Error> {
        let force = self.bodies.force(load, prescribed)?;
        let mut q = self.surface.gap.clone();
        let held = &self.surface.held;
        held.add_product(prescribed, q.as_flattened_mut());
        for &i in self.surface.unmoved.iter() {
            // If a wall moves exactly onto the surface of a held node, it touches: the rest of
            // the sum is rounding, not penetration.
            if held.cancels(D * i, prescribed, self.surface.gap[i][0], q[i][0]) {
                q[i][0] = 0.0;
            }
        }
        let work = self.bodies.free_displacement(&self.surface, &force, &mut q);
        if work.iter().all(|&e| e == 0.0) {
            self.close_what_touches(load, prescribed, &mut q);
        }
        let modes = self.modes().into();
        Ok(FreePart {
            q,
            rigid: Rigid { modes, load: work },
        })
    }

    /// Sets a free displacement `q_n` to zero that is the rounding error of a sum which cancels,
    /// as where heating closes a gap exactly, if no contact penetrates by more.
    ///
    /// Reactions would else be determined by rounding alone, and their scale, that of η, too.
    fn close_what_touches(&self, load: &[f64], prescribed: &[f64], q: &mut [[f64; D]]) {
        /// Only for a smaller share of the displacements is the rounding computed.
        const NEAR: f64 = 1e-8;
        let deepest = q.iter().fold(0.0_f64, |m, v| m.max(-v[0]));
        let moved = q.iter().zip(&self.surface.gap);
        let size = moved.fold(0.0_f64, |m, (q, g)| {
            m.max(g[0].abs()).max((q[0] - g[0]).abs())
        });
        if deepest == 0.0 || deepest > NEAR * size {
            return;
        }
        let state = Loaded {
            load,
            prescribed,
            reaction: &vec![[0.0; D]; q.len()],
            rigid: &vec![0.0; self.bodies.motions().len()],
        };
        let rounding = self
            .displacement(state)
            .and_then(|u| self.bodies.stiffness_rounding(&self.surface, &u));
        let Ok(samples) = rounding else { return };
        let mut error = vec![0.0; q.len()];
        for share in self.surface.shares.iter() {
            let rows = share.rows.iter().filter(|row| row.row % D == 0);
            let contacts: Vec<usize> = rows.map(|row| row.row / D).collect();
            // A sample may be small at one contact: the largest of a body holds for all of its.
            let of_body = contacts
                .iter()
                .flat_map(|&i| samples.iter().map(move |(moved, _)| moved[i][0].abs()));
            let largest = of_body.fold(0.0, f64::max);
            for i in contacts {
                error[i] += largest;
            }
        }
        for (v, error) in q.iter_mut().zip(&error) {
            if v[0].abs() <= 16.0 * error {
                v[0] = 0.0;
            }
        }
    }

    /// As [`Bodies::displacement`].
    pub fn displacement(&self, state: Loaded<'_, D>) -> Result<Vec<f64>, Error> {
        self.bodies.displacement(&self.surface, state)
    }

    /// As [`Bodies::relative_displacement`].
    pub fn relative_displacement(&self, state: Loaded<'_, D>) -> Result<Vec<[f64; D]>, Error> {
        self.bodies.relative_displacement(&self.surface, state)
    }
}

/// Local degrees of freedom in the rows, in the order of occurrence.
pub fn contact_set(share: &Share, order: usize) -> Vec<usize> {
    let mut met = vec![false; order];
    let mut kept = Vec::new();
    for &(dof, _) in share.rows.iter().flat_map(|row| &row.entries) {
        if !std::mem::replace(&mut met[dof], true) {
            kept.push(dof);
        }
    }
    kept
}

/// Body and local number of each free degree of freedom.
fn free_places(
    position: &[Option<usize>],
    component: &[usize],
    local: &[usize],
) -> Vec<Option<(usize, usize)>> {
    let mut next = 0;
    let place = |fixed: &Option<usize>| {
        if fixed.is_some() {
            return None;
        }
        next += 1;
        Some((component[next - 1], local[next - 1]))
    };
    position.iter().map(place).collect()
}
