//! All condensed bodies of a problem, and the loads on them.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rayon::prelude::*;

use crate::condensation::analysed::AnalysedBody;
use crate::condensation::body::{Body, Imbalance, Recovered};
use crate::condensation::forecast::Forecast;
use crate::condensation::stats::Stats;
use crate::condensation::surface::Surface;
use crate::condensation::tuning;
use crate::error::{Error, check_finite, check_length};
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::reduced::memory::Budget;

/// Totals of one step: forces on all degrees of freedom, prescribed displacements.
pub type Loads = (Vec<f64>, Vec<f64>);

/// Displacements and the digits below their rounding, and the imbalance of each body.
type InTwo = ([Vec<f64>; 2], Vec<Imbalance>);

/// Data of the bodies besides their stiffness.
#[derive(Clone, Debug, Default)]
pub struct Supports {
    /// Degrees of freedom of all bodies.
    pub n: usize,
    /// Prescribed degrees of freedom.
    pub fixed: Vec<usize>,
    /// Columns of `K` at the prescribed degrees of freedom; rows of free ones only.
    pub coupling: OwnedMatrix,
    /// All loads, if they are given in advance: then no factor is kept.
    pub known: Option<Vec<Loads>>,
}

/// Bodies with their supports.
#[derive(Debug)]
pub struct Bodies {
    pub list: Vec<Body>,
    supports: Supports,
    /// Body of each rigid motion, and its number within this body.
    motions: Vec<(usize, usize)>,
    /// Seconds until S, and after it.
    seconds: [f64; 2],
    /// Predicted bytes.
    needed: u128,
}

/// A state of the bodies: total loads, reactions, and amounts of the rigid motions.
#[derive(Clone, Copy, Debug)]
pub struct Loaded<'a, const D: usize> {
    pub load: &'a [f64],
    pub prescribed: &'a [f64],
    pub reaction: &'a [[f64; D]],
    pub rigid: &'a [f64],
}

/// A change of `v` at all contacts, and of `e`.
pub type Change<const D: usize> = (Vec<[f64; D]>, Vec<f64>);

/// `f − K_fp u_p` of a load.
#[derive(Debug)]
pub struct Force {
    values: Vec<f64>,
    /// The load alone.
    load: Vec<f64>,
    known: Option<usize>,
}

impl Supports {
    /// `f − K_fp u_p` at the free degrees of freedom.
    fn force(&self, load: &[f64], prescribed: &[f64]) -> Result<Vec<f64>, Error> {
        check_length("load", load.len(), self.n)?;
        check_finite("load", load)?;
        check_length("prescribed", prescribed.len(), self.fixed.len())?;
        check_finite("prescribed", prescribed)?;
        let mut force = load.to_vec();
        let minus: Vec<f64> = prescribed.iter().map(|u| -u).collect();
        self.coupling.add_transposed_product(&minus, &mut force);
        Ok(force)
    }
}

impl Bodies {
    /// Factors analysed bodies, small ones in parallel; `needed` are the bytes of all of it.
    pub fn new(
        parts: Vec<AnalysedBody>,
        supports: Supports,
        needed: u128,
        budget: &Budget,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let what = "the condensation of K";
        let spare = parts.iter().map(AnalysedBody::bytes_spare).sum();
        budget.check(what, needed, spare)?;
        // Leaving the stack to the next factorisation saves time, if the memory is free.
        let left: u128 = parts.iter().map(AnalysedBody::bytes_left).sum();
        let leave = supports.known.is_none() && budget.check(what, needed + left, spare).is_ok();
        for part in &parts {
            part.leave_stack(leave);
        }
        let needed = needed + if leave { left } else { 0 };
        let loads = supports.known.as_ref().map(|known| {
            let force = |(load, prescribed): &Loads| supports.force(load, prescribed);
            known.iter().map(force).collect::<Result<Vec<_>, _>>()
        });
        let loads = loads.transpose()?;
        let condense = |part: AnalysedBody| part.condense(loads.as_deref(), stop);
        let started = Instant::now();
        let small = parts
            .iter()
            .all(|part| part.counts().flops < tuning::serial_flops());
        let list: Vec<Result<Body, Error>> = if small {
            parts.into_par_iter().map(condense).collect()
        } else {
            parts.into_iter().map(condense).collect()
        };
        let list: Vec<Body> = list.into_iter().collect::<Result<_, _>>()?;
        let wall = started.elapsed().as_secs_f64();
        let spent = |k: usize| list.iter().map(|body| body.seconds[k]).sum::<f64>();
        let motions = list.iter().enumerate();
        Ok(Self {
            // For parallel bodies, each part gets its share of the elapsed time.
            seconds: [0, 1].map(|k| wall * spent(k) / (spent(0) + spent(1)).max(wall)),
            motions: motions
                .flat_map(|(b, body)| (0..body.motions()).map(move |k| (b, k)))
                .collect(),
            list,
            supports,
            needed,
        })
    }

    pub fn order(&self) -> usize {
        self.supports.n
    }

    pub fn fixed(&self) -> &[usize] {
        &self.supports.fixed
    }

    pub fn supports(&self) -> &Supports {
        &self.supports
    }

    /// Body of each rigid motion, and its number within this body.
    pub fn motions(&self) -> &[(usize, usize)] {
        &self.motions
    }

    /// The degree of freedom with the largest displacement in a rigid motion.
    pub fn most_moved(&self, motion: usize) -> usize {
        let (body, k) = self.motions[motion];
        self.list[body].most_moved(k)
    }

    /// `K` by rows, from the matrices of the bodies. It lacks the entries between two
    /// prescribed degrees of freedom, on which no result depends.
    pub fn stiffness(&self) -> OwnedMatrix {
        let mut rows: Vec<Vec<(usize, f64)>> = vec![Vec::new(); self.order()];
        for body in &self.list {
            for (local, &dof) in body.dofs().iter().enumerate() {
                let entries = body.row_of_stiffness(local);
                rows[dof].extend(entries.map(|(j, k)| (body.dofs()[j], k)));
            }
        }
        for (p, &dof) in self.fixed().iter().enumerate() {
            for (i, k) in self.supports.coupling.entries(p) {
                rows[i].push((dof, k));
                rows[dof].push((i, k));
            }
        }
        let mut whole = OwnedMatrix::default();
        for mut row in rows {
            row.sort_unstable_by_key(|&(column, _)| column);
            whole.push(row);
        }
        whole
    }

    /// The loads of a step on the free degrees of freedom.
    pub fn force(&self, load: &[f64], prescribed: &[f64]) -> Result<Force, Error> {
        let values = self.supports.force(load, prescribed)?;
        let known = self.supports.known.as_ref().map(|known| {
            let same = |loads: &Loads| loads.0 == load && loads.1 == prescribed;
            known.iter().position(same)
        });
        let lost = self.list.iter().any(|body| body.factor().is_none());
        if lost && known == Some(None) {
            return Err(Error::UnknownLoads);
        }
        Ok(Force {
            values,
            load: load.to_vec(),
            known: known.flatten(),
        })
    }

    /// Adds `B K⁻¹ f` to `v` and returns `e = Rᵀ f_c`, (4).
    pub fn free_displacement<const D: usize>(
        &self,
        surface: &Surface<D>,
        force: &Force,
        v: &mut [[f64; D]],
    ) -> Vec<f64> {
        let mut load = Vec::with_capacity(self.motions.len());
        for (body, share) in self.list.iter().zip(surface.shares.iter()) {
            let condensed = body.condense(&force.values, force.known);
            share.add_free_displacement(body, &condensed, v.as_flattened_mut());
            load.extend(body.rigid_load(&force.load, &force.values));
        }
        load
    }

    /// The displacement `u` of all degrees of freedom under the loads and the reactions of each
    /// state, (23).
    ///
    /// Iterative refinement with `K` itself removes the rounding of the factorisation.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`]; [`Error::FactorDropped`]; [`Error::NotBalanced`]
    /// if `K u = f + Bᵀ r` does not hold up to rounding.
    pub fn displacements<const D: usize>(
        &self,
        surface: &Surface<D>,
        states: &[Loaded<'_, D>],
    ) -> Result<Vec<Vec<f64>>, Error> {
        let both = self.displacements_in_two(surface, states)?;
        Ok(both.into_iter().map(|[u, _]| u).collect())
    }

    /// Displacements of all bodies, with the digits of `u` below its rounding.
    fn displacements_in_two<const D: usize>(
        &self,
        surface: &Surface<D>,
        states: &[Loaded<'_, D>],
    ) -> Result<Vec<[Vec<f64>; 2]>, Error> {
        let of_state = |(both, left): InTwo| {
            left.iter().try_for_each(Imbalance::check)?;
            Ok(both)
        };
        let recovered = self.recovered(surface, states, Body::displacements)?;
        recovered.into_iter().map(of_state).collect()
    }

    /// The displacements of each state and the digits below their rounding, and the imbalance of
    /// each body.
    fn recovered<const D: usize>(
        &self,
        surface: &Surface<D>,
        states: &[Loaded<'_, D>],
        of_body: impl Fn(&Body, &[&[f64]], &[f64], &[&[f64]]) -> Result<Recovered, Error>,
    ) -> Result<Vec<InTwo>, Error> {
        let mut forces = Vec::with_capacity(states.len());
        for state in states {
            check_length("reaction", state.reaction.len(), surface.contacts())?;
            check_length("rigid motion", state.rigid.len(), self.motions.len())?;
            forces.push(self.supports.force(state.load, state.prescribed)?);
        }
        let none = || ([(); 2].map(|()| vec![0.0; self.order()]), Vec::new());
        let mut all: Vec<_> = states.iter().map(|_| none()).collect();
        for (([u, _], _), state) in all.iter_mut().zip(states) {
            for (&dof, &value) in self.fixed().iter().zip(state.prescribed) {
                u[dof] = value;
            }
        }
        let forces: Vec<&[f64]> = forces.iter().map(Vec::as_slice).collect();
        let mut first = 0;
        for (body, share) in self.list.iter().zip(surface.shares.iter()) {
            let motions = first..first + body.motions();
            first = motions.end;
            let own: Vec<&[f64]> = states.iter().map(|s| &s.rigid[motions.clone()]).collect();
            let push = |s: &Loaded<D>| share.push(body, s.reaction.as_flattened());
            let pushes: Vec<f64> = states.iter().flat_map(push).collect();
            let n = body.dofs().len();
            let recovered = of_body(body, &forces, &pushes, &own)?;
            for ((_, left), of_body) in all.iter_mut().zip(&recovered.left) {
                left.push(*of_body);
            }
            let parts = [recovered.u, recovered.low];
            for (part, values) in parts.iter().enumerate() {
                for ((u, _), values) in all.iter_mut().zip(values.chunks_exact(n.max(1))) {
                    for (&i, value) in body.dofs().iter().zip(values) {
                        u[part][i] = *value;
                    }
                }
            }
        }
        Ok(all)
    }

    /// [`Bodies::displacements`] of states that are differences, whose forces may cancel to
    /// rounding: their balance is not checked, and only lost digits are restored.
    pub fn changes<const D: usize>(
        &self,
        surface: &Surface<D>,
        states: &[Loaded<'_, D>],
    ) -> Result<Vec<Vec<f64>>, Error> {
        let recovered = self.recovered(surface, states, Body::changes)?;
        Ok(recovered.into_iter().map(|([u, _], _)| u).collect())
    }

    /// [`Bodies::displacements`] of one state.
    pub fn displacement<const D: usize>(
        &self,
        surface: &Surface<D>,
        state: Loaded<'_, D>,
    ) -> Result<Vec<f64>, Error> {
        Ok(self.displacements(surface, &[state])?.remove(0))
    }

    /// `B u + gap` at the displacement of a state, with sums in twice the precision.
    pub fn relative_displacement<const D: usize>(
        &self,
        surface: &Surface<D>,
        state: Loaded<'_, D>,
    ) -> Result<Vec<[f64; D]>, Error> {
        let [u, low] = self.displacements_in_two(surface, &[state])?.remove(0);
        Ok(surface.relative_displacement(&self.list, self.fixed(), &u, Some(&low)))
    }

    /// Samples of the changes of `B u` and of `e` by the rounding of the entries of `K`.
    pub fn stiffness_rounding<const D: usize>(
        &self,
        surface: &Surface<D>,
        u: &[f64],
    ) -> Result<Vec<Change<D>>, Error> {
        let mut displacements: Vec<Vec<f64>> = Vec::new();
        let mut work: Vec<Vec<f64>> = Vec::new();
        for body in &self.list {
            let samples = body.stiffness_rounding(u)?;
            displacements.resize(samples.len(), vec![0.0; self.order()]);
            work.resize(samples.len(), Vec::new());
            for (k, sample) in samples.into_iter().enumerate() {
                for (&i, value) in body.dofs().iter().zip(sample.displacement) {
                    displacements[k][i] = value;
                }
                work[k].extend(sample.work);
            }
        }
        let moved = |u: &Vec<f64>| surface.product(&self.list, self.fixed(), u);
        Ok(displacements.iter().map(moved).zip(work).collect())
    }

    /// The rounding error of `e` of these loads. A proof that nothing balances the loads must
    /// exceed it. It costs a solve for each rigid motion.
    pub fn load_rounding(&self, load: &[f64], prescribed: &[f64]) -> Result<Vec<f64>, Error> {
        let force = self.supports.force(load, prescribed)?;
        let mut all = Vec::with_capacity(self.motions.len());
        for body in &self.list {
            all.extend(body.load_rounding(&force)?);
        }
        Ok(all)
    }

    /// The counts of all bodies.
    pub fn stats(&self) -> Stats {
        let counts = || self.list.iter().map(|body| body.ordered().counts());
        let ordered = self.list.iter().filter(|body| body.ordered().was_ordered);
        let most = |of: fn(&Body) -> f64| self.list.iter().map(of).fold(0.0, f64::max);
        Stats {
            forecast: Forecast::new(self.needed, counts()),
            factor_kept: self.list.iter().all(|body| body.factor().is_some()),
            islands: 0,
            cond_s: most(|body| body.contact.condition),
            amplification: most(|body| body.contact.amplification),
            orderings: ordered.count(),
            seconds_order: counts().map(|counts| counts.seconds_order).sum(),
            seconds_symbolic: counts().map(|counts| counts.seconds_symbolic).sum(),
            seconds_factor: self.seconds[0],
            seconds_compliance: self.seconds[1],
        }
    }
}

/// The counts of bodies that are analysed but not condensed; `dropped` as in [`needed`].
pub fn forecast(parts: &[AnalysedBody], dropped: bool) -> Forecast {
    Forecast::new(
        needed(parts, dropped),
        parts.iter().map(AnalysedBody::counts),
    )
}

/// Largest number of bytes during a condensation: those of all bodies, and the working memory
/// of the body that needs most.
pub fn needed(parts: &[AnalysedBody], dropped: bool) -> u128 {
    let mut held = 0;
    let mut most = 0;
    for part in parts {
        let counts = part.counts();
        let square = 8 * (counts.kept as u128).pow(2);
        let peak = if dropped {
            counts.bytes_peak_dropped
        } else {
            counts.bytes_peak
        } as u128;
        let factor = if dropped {
            0
        } else {
            counts.bytes_factor as u128 - square
        };
        // The Cholesky factor exists beside S, then beside the inverse, which is W.
        let stays = factor + 2 * square;
        let height = peak.max(stays);
        held += part.bytes() + stays;
        most = most.max(height - stays);
    }
    held + most
}
