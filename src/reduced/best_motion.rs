//! The rigid motion for which η of a given reaction is least.
//!
//! The law says of `v̂ = v̂₀ + R̂ â` at each contact: `v_n ≥ 0` without a reaction; `v_n = 0` if
//! it is pressed; `v_t = 0` inside the cone, and `v_t = −λ r_t` with `λ ≥ 0` on its border. These
//! sets are convex cones, and the squared distance from them is a convex function of `â`, which
//! has pieces that are quadratic. Its minimum does not depend on a start point.
//!
//! Reactions have errors. So a number counts as zero below a threshold, from rounding up to the
//! reactions themselves: η of a solution with an error ε is found with a threshold of a few ε.
//! The direction of a small friction force that slides far has a large error, which `F` feels
//! little: distances across it have the weight `‖r_t‖/(‖r_t‖ + λ)`, with λ of the motion before.
//! Steps of Gauss–Newton for `F` follow.

use std::sync::atomic::AtomicBool;

use crate::law::bipotential;
use crate::law::cone::derivative;
use crate::linalg::least_squares;
use crate::linalg::small::{
    Block, Vector, add_scaled, amax, dot, norm, plus_scaled, rows_plus_scaled, scale_rows,
    tangential_norm,
};
use crate::reduced::gram::factor_gram;
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{law_norm, residual};
use crate::reduced::tuning;

/// Share of its contacts' resistance that holds a free motion, of many: above the rounding of products.
const HELD: f64 = 1e-10;
/// Directions with a resistance of 1e-8 or more keep 1e-8 of their error.
const CORRECTIONS: usize = 4;

/// The relative displacements that the law allows with a reaction.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Allowed<const D: usize> {
    /// `v_n ≥ 0`.
    Lifted,
    /// `v_n = 0`.
    Glides,
    /// `v_n = 0`, and `v_t` along this unit vector; the weight of distances across it.
    Slides([f64; D], f64),
    Sticks,
}

impl<const D: usize> Allowed<D> {
    /// With a reaction whose components below `zero` count as zero.
    fn with(r: &[f64; D], mu: f64, zero: f64) -> Self {
        let friction = tangential_norm(r);
        if r[0].max(friction) <= zero {
            Self::Lifted
        } else if (mu * r[0]).max(friction) <= zero {
            Self::Glides
        } else if friction > 0.0 && friction >= mu * r[0] - zero {
            let mut direction = r.map(|c| -c / friction);
            direction[0] = 0.0;
            Self::Slides(direction, 1.0)
        } else {
            Self::Sticks
        }
    }

    /// With the weight that `F` has for a reaction and its `v`.
    fn weigh(self, r: &[f64; D], v: &[f64; D]) -> Self {
        match self {
            Self::Slides(direction, _) => {
                let (friction, slip) = (tangential_norm(r), dot(&direction, v).max(0.0));
                Self::Slides(direction, friction / (friction + slip))
            }
            _ => self,
        }
    }

    /// The weighted part of `v` outside, and its derivative. `margin` is the rounding of `v`: a
    /// lifted contact does not penetrate by rounding.
    fn outside(&self, v: &[f64; D], margin: f64) -> ([f64; D], Block<D>) {
        let mut counted = Block::<D>::zeros();
        let mut rest = [0.0; D];
        match self {
            Self::Lifted if v[0] >= margin => {}
            Self::Lifted | Self::Glides => {
                let least = if matches!(self, Self::Lifted) {
                    margin
                } else {
                    0.0
                };
                rest[0] = v[0] - least;
                counted[(0, 0)] = 1.0;
            }
            Self::Slides(direction, weight) => {
                let along = Vector::from(*direction) * Vector::from(*direction).transpose();
                counted = Block::identity() * *weight;
                counted[(0, 0)] = 1.0;
                let share = if dot(direction, v) > 0.0 { 0.0 } else { 1.0 };
                counted += along * (share - weight);
                rest = (counted * Vector::from(*v)).into();
            }
            Self::Sticks => {
                rest = *v;
                counted = Block::identity();
            }
        }
        (rest, counted)
    }
}

/// A reaction with its relative displacement without rigid motions.
struct Search<'a, 'b, const D: usize> {
    problem: &'a Reduced<'b, D>,
    r: &'a [[f64; D]],
    still: Vec<[f64; D]>,
    /// Scaled.
    force: Vec<[f64; D]>,
    free: Vec<[f64; D]>,
}

/// The rigid motion `a` for which η of a reaction is least.
pub fn best_motion<const D: usize>(problem: &Reduced<D>, r: &[[f64; D]]) -> Vec<f64> {
    let scaling = &problem.scaling;
    if scaling.modes.is_empty() {
        return Vec::new();
    }
    let search = Search::new(problem, r);
    let largest = norm(search.force.as_flattened());
    let mut motion = vec![0.0; scaling.modes.len()];
    if search.law(&motion) <= f64::EPSILON * largest {
        return motion; // no motion changes the balance
    }
    let mut best = (search.eta(&motion), motion.clone());
    let mut laws: Vec<Allowed<D>> = Vec::new();
    let mut zero = (0.5 * f64::EPSILON * largest).max(f64::MIN_POSITIVE);
    loop {
        let forces = search.force.iter().zip(&problem.law);
        let next = forces.map(|(r, law)| Allowed::with(r, law.mu, zero));
        let next: Vec<_> = next.collect();
        if next != laws {
            laws = next;
            let mut weighted = laws.clone();
            for _ in 0..tuning::motion_weightings() {
                motion = search.approach(&weighted, motion);
                for trial in [motion.clone(), search.refine(motion.clone())] {
                    let eta = search.eta(&trial);
                    if eta < best.0 {
                        best = (eta, trial);
                    }
                }
                let before = weighted.clone();
                let contacts = search.force.iter().zip(search.at(&motion));
                for (law, (r, v)) in weighted.iter_mut().zip(contacts) {
                    *law = law.weigh(r, &v);
                }
                // In the plane nothing lies across a direction.
                if D == 2 || weighted == before {
                    break;
                }
            }
        }
        // A smaller η would have been found with a smaller threshold.
        // Written such that reactions that are no number end it.
        if !(zero < largest) || best.0 * largest <= 0.01 * zero {
            break;
        }
        zero *= tuning::next_threshold();
    }
    scaling.rigid_from_scaled(&best.1)
}

impl<'a, 'b, const D: usize> Search<'a, 'b, D> {
    fn new(problem: &'a Reduced<'b, D>, r: &'a [[f64; D]]) -> Self {
        let still = problem.relative_displacement(r, &[]);
        Self {
            problem,
            r,
            force: scale_rows(r, &problem.scaling.to_r),
            free: scale_rows(&still, &problem.scaling.to_v),
            still,
        }
    }

    /// `v` in the units of the caller, with the rounding of [`Reduced::relative_displacement`].
    fn relative_displacement(&self, a: &[f64]) -> Vec<[f64; D]> {
        let mut v = self.still.clone();
        self.problem.add_rigid(a, &mut v);
        v
    }

    fn eta(&self, motion: &[f64]) -> f64 {
        let a = self.problem.scaling.rigid_from_scaled(motion);
        residual(self.problem, self.r, &self.relative_displacement(&a), &a)
    }

    fn law(&self, motion: &[f64]) -> f64 {
        let a = self.problem.scaling.rigid_from_scaled(motion);
        law_norm(self.problem, self.r, &self.relative_displacement(&a))
    }

    /// `R̂ â`.
    fn rigid(&self, motion: &[f64]) -> Vec<[f64; D]> {
        let mut moved = vec![[0.0; D]; self.free.len()];
        self.problem.scaling.modes.add_product(motion, &mut moved);
        moved
    }

    /// `v̂`.
    fn at(&self, motion: &[f64]) -> Vec<[f64; D]> {
        rows_plus_scaled(&self.rigid(motion), 1.0, &self.free)
    }

    /// The step of least squares with `rest + J R̂ step = 0`, with `J` of each contact.
    fn step(&self, rest: &[f64], jacobian: &[Block<D>]) -> Vec<f64> {
        let modes = &self.problem.scaling.modes;
        let moved = modes.map(|i, _, m| (jacobian[i] * Vector::from(*m)).into());
        if !self.problem.scaling.is_sparse() {
            let columns = moved.columns();
            let right: Vec<f64> = rest.iter().map(|x| -x).collect();
            return least_squares::solve(columns.iter().map(|c| c.as_flattened()), &right);
        }
        // What the law leaves free is held by little, whose effect each correction reduces.
        let row = |row: usize, add: &mut dyn FnMut(usize, f64)| match row.checked_sub(rest.len()) {
            Some(motion) => add(motion, HELD.sqrt()),
            None => (moved.at(row / D)).for_each(|(c, motion)| add(c, motion[row % D])),
        };
        let (count, never) = (modes.len(), AtomicBool::new(false));
        let mut step = vec![0.0; count];
        let Ok(gram) = factor_gram(rest.len() + count, count, row, &never) else {
            return step;
        };
        for _ in 0..CORRECTIONS {
            let mut left = rest.as_chunks::<D>().0.to_vec();
            moved.add_product(&step, &mut left);
            let mut back = moved.work(&left, &vec![1.0; left.len()]);
            gram.condense(&mut back, 1);
            gram.recover(&mut back, 1);
            add_scaled(&mut step, -1.0, &back);
        }
        step
    }

    /// The motion with the least distance from what the law allows: Newton's steps, each with the
    /// best length.
    fn approach(&self, laws: &[Allowed<D>], mut motion: Vec<f64>) -> Vec<f64> {
        for _ in 0..tuning::motion_steps() {
            let v = self.at(&motion);
            let size = amax(v.as_flattened());
            let margin = 16.0 * f64::EPSILON * (size + norm(&motion));
            let outside = |v: &[[f64; D]]| -> (Vec<[f64; D]>, Vec<Block<D>>) {
                let contacts = laws.iter().zip(v);
                contacts.map(|(law, v)| law.outside(v, margin)).unzip()
            };
            let (rest, counted) = outside(&v);
            let step = self.step(rest.as_flattened(), &counted);
            let along = self.rigid(&step);
            let slope = |share: f64| -> f64 {
                let (rest, counted) = outside(&rows_plus_scaled(&v, share, &along));
                let contacts = rest.iter().zip(&counted).zip(&along);
                contacts
                    .map(|((x, counted), d)| Vector::from(*x).dot(&(counted * Vector::from(*d))))
                    .sum()
            };
            // The rest is rounding of v̂.
            if !(slope(0.0) < -(0.1 * margin).powi(2)) {
                break;
            }
            let (mut share, mut least) = (1.0, 0.0);
            if slope(1.0) > 0.0 {
                for _ in 0..50 {
                    let middle = 0.5 * (least + share);
                    if slope(middle) > 0.0 {
                        share = middle;
                    } else {
                        least = middle;
                    }
                }
            }
            add_scaled(&mut motion, share, &step);
        }
        motion
    }

    /// Steps of Gauss–Newton that make `‖F‖` smaller.
    fn refine(&self, mut motion: Vec<f64>) -> Vec<f64> {
        let mut law = self.law(&motion);
        for _ in 0..tuning::motion_steps() {
            let (rest, jacobian) = self.linearise(&motion);
            let step = self.step(&rest, &jacobian);
            let shorter = (0..10).map(|halvings| 0.5_f64.powi(halvings));
            let better = shorter
                .map(|share| plus_scaled(&motion, share, &step))
                .map(|trial| (self.law(&trial), trial))
                .find(|(value, _)| *value < law);
            let Some(trial) = better else { break };
            (law, motion) = trial;
        }
        motion
    }

    /// `F`, and `∂F/∂v̂` of each contact.
    fn linearise(&self, motion: &[f64]) -> (Vec<f64>, Vec<Block<D>>) {
        let mut rest = Vec::with_capacity(D * self.r.len());
        let mut jacobian = Vec::with_capacity(self.r.len());
        let contacts = self.force.iter().zip(self.at(motion));
        for (i, (force, v)) in contacts.enumerate() {
            let law = self.problem.scaled_law(i);
            let (projected, _) = bipotential::law_step(force, &v, 1.0, law);
            rest.extend(force.iter().zip(&projected).map(|(x, p)| x - p));
            let tau = Vector::from(*force) - Vector::from(bipotential::corrected(&v, law));
            let slip = tangential_norm(&v);
            let mut change = Block::<D>::identity();
            if slip > 0.0 {
                for k in 1..D {
                    change[(0, k)] = law.correction() * v[k] / slip;
                }
            }
            jacobian.push(derivative(&tau.into(), law) * change);
        }
        (rest, jacobian)
    }
}
