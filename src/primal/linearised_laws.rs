//! The linearised laws of the contacts of a converged step, multiplied so that they have the
//! form of a Newton step ([`Tangent`]).
//!
//! Arrays are by the places of the nodes of contacts: all unknowns of one machine, or the
//! interface of a stiffness that is held elsewhere.

use crate::law::cone::Status;
use crate::linalg::small::{Block, Vector};
use crate::primal::contacts::Contacts;
use crate::primal::frames::Frames;
use crate::primal::tangent::{SlidingTangent, Tangent};
use crate::primal::tuning;
use crate::solver::derivatives::tangent_system::ClosedLaw;

/// The law of one closed contact, multiplied by `M`.
#[derive(Clone, Debug)]
struct Multiplied<const D: usize> {
    contact: usize,
    /// Place of its first component; nothing for a contact without an unknown.
    at: Option<usize>,
    free: [bool; D],
    held: [bool; D],
    multiplier: Block<D>,
    /// `M by_r` and `M by_v` in the rows that are not held.
    by_r: Block<D>,
    by_v: Block<D>,
}

/// The laws of one step, and the system of a Newton step that they have the form of.
#[derive(Clone, Debug)]
pub struct LinearisedLaws<const D: usize> {
    laws: Vec<Multiplied<D>>,
    pub statuses: Vec<Status>,
    pub tangent: Tangent<D>,
}

impl<const D: usize> LinearisedLaws<D> {
    /// These laws, whose positions are numbers of contacts; `None` if one of them determines
    /// nothing. `free` are the places with an unknown.
    #[must_use]
    pub fn new(contacts: &Contacts<D>, free: &[bool], laws: &[ClosedLaw<D>]) -> Option<Self> {
        let frames = &contacts.frames;
        let made = laws.iter().map(|law| Multiplied::new(contacts, law));
        let laws: Vec<_> = made.collect::<Option<_>>()?;
        let mut statuses = vec![Status::Open; contacts.count()];
        let mut held: Vec<bool> = free.iter().map(|free| !free).collect();
        for (_, frame) in frames.with_node() {
            for k in 0..D {
                held[D * frame.node + k] = !frame.free[k];
            }
        }
        let mut sliding = Vec::new();
        for law in &laws {
            let sticks = law.held == law.free && law.free.contains(&true);
            statuses[law.contact] = if sticks { Status::Stick } else { Status::Slip };
            let Some(at) = law.at else { continue };
            for k in (0..D).filter(|&k| law.held[k]) {
                held[at + k] = true;
            }
            let rows = law.held.map(|held| !held);
            if rows.contains(&true) {
                let mut force = law.by_r;
                for k in (0..D).filter(|&k| rows[k]) {
                    force[(k, k)] -= 1.0;
                }
                sliding.push(SlidingTangent {
                    contact: law.contact,
                    at,
                    free: law.free,
                    rows,
                    force,
                    spring: law.by_v,
                    target: Vector::zeros(),
                });
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
            *s = (law.multiplier * Vector::from(*s)).into();
            let Some(at) = law.at else { continue };
            for k in (0..D).filter(|&k| law.held[k]) {
                self.tangent.known[at + k] = s[k];
            }
        }
        let targets = self.laws.iter().zip(&*s);
        let targets = targets.filter(|(law, _)| law.at.is_some() && law.held != [true; D]);
        for (one, (law, s)) in self.tangent.sliding.iter_mut().zip(targets) {
            let f = Vector::<D>::from_column_slice(&g[one.at..one.at + D]);
            one.target = Vector::from(*s) - law.by_r * f;
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
    #[must_use]
    pub fn pulled(&self, rho: &[[f64; D]], e: &mut [f64]) -> Vec<f64> {
        let mut b = vec![0.0; e.len()];
        for (law, rho) in self.laws.iter().zip(rho) {
            let Some(at) = law.at else { continue };
            // A row without an unknown has w_l = ρ_l.
            let alone = Vector::<D>::from_fn(|k, _| if law.free[k] { 0.0 } else { rho[k] });
            let (pulled, pushed) = (law.by_r.tr_mul(&alone), law.by_v.tr_mul(&alone));
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
                Some(at) if law.held[k] => e[at + k] - moved[at + k],
                Some(at) if law.free[k] => z[at + k],
                _ => rho[k],
            };
            let omega = Vector::<D>::from_fn(|k, _| of(k));
            *rho = law.multiplier.tr_mul(&omega).into();
        }
    }
}

impl<const D: usize> Multiplied<D> {
    fn new(contacts: &Contacts<D>, law: &ClosedLaw<D>) -> Option<Self> {
        let frame = &contacts.frames.list[law.position];
        let mut by_v = law.by_v;
        for k in (0..D).filter(|&k| !frame.free[k]) {
            by_v.fill_column(k, 0.0);
        }
        let held: [bool; D] = std::array::from_fn(|k| {
            let others = (0..D).filter(|&l| l != k);
            let alone = others.map(|l| by_v[(k, l)].abs()).sum::<f64>() == 0.0;
            frame.free[k] && alone && by_v[(k, k)] != 0.0 && law.by_r.row(k).amax() == 0.0
        });
        let compliance = contacts.compliance.block(law.position).diagonal();
        #[expect(clippy::cast_precision_loss, reason = "a dimension")]
        let least = tuning::least_compliance() * compliance.sum() / D as f64;
        let mut multiplied = law.by_r + by_v * least;
        for k in (0..D).filter(|&k| held[k]) {
            multiplied.fill_row(k, 0.0);
            multiplied.fill_column(k, 0.0);
            multiplied[(k, k)] = by_v[(k, k)];
        }
        let multiplier = multiplied.try_inverse()?;
        let (mut by_r, mut by_v) = (multiplier * law.by_r, multiplier * by_v);
        for k in (0..D).filter(|&k| held[k]) {
            by_r.fill_row(k, 0.0);
            by_v.fill_row(k, 0.0);
        }
        Some(Self {
            contact: law.position,
            at: (frame.node != usize::MAX).then(|| D * frame.node),
            free: frame.free,
            held,
            multiplier,
            by_r,
            by_v,
        })
    }
}
