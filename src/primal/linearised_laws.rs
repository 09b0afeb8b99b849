//! The linearised laws of the contacts of a converged step, multiplied so that they have the
//! form of a Newton step ([`Tangent`]).
//!
//! Arrays are by the places of the nodes of contacts: all unknowns of one machine, or the
//! interface of a stiffness that is held elsewhere.

use crate::law::cone::Status;
use crate::linalg::small::Vector;
use crate::primal::contacts::Contacts;
use crate::primal::frames::Frames;
use crate::primal::multiplied_law::MultipliedLaw;
use crate::primal::nodes::at_node;
use crate::primal::tangent::{SlidingTangent, Tangent};
use crate::primal::tuning;
use crate::solver::derivatives::tangent_system::ClosedLaw;

/// The law of one closed contact, multiplied by `M`.
#[derive(Clone, Debug)]
struct LawOfContact<const D: usize> {
    contact: usize,
    /// Place of the first component of the contact among the unknowns; nothing if it has none.
    at: Option<usize>,
    free: [bool; D],
    law: MultipliedLaw<D>,
}

/// The laws of one step, and the system of a Newton step that they have the form of.
#[derive(Clone, Debug)]
pub struct LinearisedLaws<const D: usize> {
    laws: Vec<LawOfContact<D>>,
    pub statuses: Vec<Status>,
    pub tangent: Tangent<D>,
}

impl<const D: usize> LinearisedLaws<D> {
    /// These laws, whose positions are numbers of contacts; `None` if one of them determines
    /// nothing. `free` are the places with an unknown.
    pub fn new(contacts: &Contacts<D>, free: &[bool], laws: &[ClosedLaw<D>]) -> Option<Self> {
        let frames = &contacts.frames;
        let made = laws.iter().map(|law| LawOfContact::new(contacts, law));
        let laws: Vec<_> = made.collect::<Option<_>>()?;
        let mut statuses = vec![Status::Open; contacts.count()];
        let mut held: Vec<bool> = free.iter().map(|free| !free).collect();
        for (_, frame) in frames.with_node() {
            for k in 0..D {
                held[D * frame.node + k] = !frame.free[k];
            }
        }
        let mut sliding = Vec::new();
        for LawOfContact {
            contact,
            at,
            free,
            law,
        } in &laws
        {
            let sticks = law.held == *free && free.contains(&true);
            statuses[*contact] = if sticks { Status::Stick } else { Status::Slip };
            let Some(at) = *at else { continue };
            for k in (0..D).filter(|&k| law.held[k]) {
                held[at + k] = true;
            }
            if law.held != [true; D] {
                sliding.push(SlidingTangent::of_law(*contact, at, *free, law));
            }
        }
        let known = vec![0.0; held.len()];
        let tangent = Tangent {
            sliding,
            held,
            known,
        };
        Some(Self {
            laws,
            statuses,
            tangent,
        })
    }

    /// Makes [`LinearisedLaws::tangent`] that of `s` of each law and `g`, and multiplies `s`.
    pub fn aim(&mut self, s: &mut [[f64; D]], g: &[f64]) {
        for (law, s) in self.laws.iter().zip(&mut *s) {
            *s = (law.law.multiplier * Vector::from(*s)).into();
            let Some(at) = law.at else { continue };
            for k in (0..D).filter(|&k| law.law.held[k]) {
                self.tangent.known[at + k] = s[k];
            }
        }
        let targets = self.laws.iter().zip(&*s);
        let targets = targets.filter(|(law, _)| law.at.is_some() && law.law.held != [true; D]);
        for (one, (law, s)) in self.tangent.sliding.iter_mut().zip(targets) {
            let f = at_node::<D>(g, one.node());
            one.target = Vector::from(*s) - law.law.by_r * f;
        }
    }

    /// `dr` of each law, in the place of its multiplied `s`, from `g`, `dy` and `A dy`.
    pub fn reactions(
        &self,
        frames: &Frames<D>,
        s: &mut [[f64; D]],
        g: &[f64],
        (dy, moved): (&[f64], &[f64]),
    ) {
        let none = vec![[0.0; D]; frames.list.len()];
        let (v, of_a) = (frames.at_contacts(dy), frames.at_contacts(moved));
        let prescribed = self.tangent.prescribed_reactions(frames, &none, &v, &of_a);
        for (law, s) in self.laws.iter().zip(s) {
            // Without an unknown the law alone gives the reaction.
            let Some(at) = law.at else { continue };
            for k in 0..D {
                s[k] = if law.free[k] {
                    moved[at + k] + g[at + k]
                } else {
                    prescribed[law.contact][k]
                };
            }
        }
    }

    /// `b = ρ − by_rᵀ w` of the transposed system, with the part of `w` that `ρ` alone gives; its
    /// part `by_vᵀ w` is subtracted from `e`.
    pub fn pulled(&self, rho: &[[f64; D]], e: &mut [f64]) -> Vec<f64> {
        let mut b = vec![0.0; e.len()];
        for (law, rho) in self.laws.iter().zip(rho) {
            let Some(at) = law.at else { continue };
            // A row without an unknown has w_l = ρ_l.
            let alone = Vector::<D>::from_fn(|k, _| if law.free[k] { 0.0 } else { rho[k] });
            let (pulled, pushed) = (law.law.by_r.tr_mul(&alone), law.law.by_v.tr_mul(&alone));
            for k in (0..D).filter(|&k| law.free[k]) {
                b[at + k] = rho[k] - pulled[k];
                e[at + k] -= pushed[k];
            }
        }
        b
    }

    /// `w` of each law, in the place of `ρ`, from the right side `e` of the transposed system, its
    /// solution `z`, and `moved`: `A` times the pulled `z`, to which this adds the springs.
    pub fn multipliers(&self, rho: &mut [[f64; D]], e: &[f64], z: &[f64], moved: &mut [f64]) {
        self.tangent.add_transposed(z, moved);
        for (law, rho) in self.laws.iter().zip(rho) {
            let of = |k: usize| match law.at {
                Some(at) if law.law.held[k] => e[at + k] - moved[at + k],
                Some(at) if law.free[k] => z[at + k],
                _ => rho[k],
            };
            let omega = Vector::<D>::from_fn(|k, _| of(k));
            *rho = law.law.multiplier.tr_mul(&omega).into();
        }
    }
}

impl<const D: usize> LawOfContact<D> {
    fn new(contacts: &Contacts<D>, law: &ClosedLaw<D>) -> Option<Self> {
        let frame = &contacts.frames.list[law.position];
        let compliance = contacts.compliance.block(law.position).diagonal();
        #[expect(clippy::cast_precision_loss, reason = "a dimension")]
        let least = tuning::least_compliance() * compliance.sum() / D as f64;
        Some(Self {
            contact: law.position,
            at: (frame.node != usize::MAX).then(|| D * frame.node),
            free: frame.free,
            law: MultipliedLaw::new(law.by_r, law.by_v, frame.free, least)?,
        })
    }
}
