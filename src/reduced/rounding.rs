//! Rounding errors of the certificate.

use crate::law::bipotential::law_step;
use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::{norm, tangential_norm};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::{Normals, force_size, ratio, shorten};

/// Rounding error of each term of a sum, relative to the term.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Rounding errors of `F`, in absolute value.
pub(super) struct Rounding {
    /// `4 ε ‖ |Ŵ||r̂| + |R̂||â| + |q̂| ‖`, as far as it changes `F`; not the rounding of `r̂`.
    pub(super) felt: f64,
    /// `felt` of normals in their own scale.
    pub(super) pressed: f64,
    /// `pressed`, whether the normals change `F` or not.
    pub(super) normal: f64,
    /// `normal`, including the rounding of motions and reactions.
    pub(super) plain: f64,
    /// The total with friction: if `r ≠ 0`, `ṽ_n` includes μ times the rounding of `v_t`.
    pub(super) bound: f64,
    /// Rounding of the balance of forces, relative to the forces.
    balance: f64,
}

impl Rounding {
    /// `felt` and `pressed` for the point as it is; all else with at most the rigid motion of a
    /// solution: the rounding of a larger one is no reason for a larger tolerance.
    pub(super) fn new<const D: usize>(
        problem: &Reduced<D>,
        normals: &Normals<D>,
        r: &[[f64; D]],
        v: &[[f64; D]],
        a: &[f64],
    ) -> Self {
        let mut still = vec![[0.0; D]; r.len()];
        problem.compliance.absolute_product(r, &mut still);
        let values = still.as_flattened_mut().iter_mut();
        for (value, q) in values.zip(problem.q.as_flattened()) {
            *value += q.abs();
        }
        let whole = Self::of(problem, normals, r, v, a, &still);
        let shorter = shorten(problem, a, problem.scaling.displacement_norm(&still));
        if *shorter == *a {
            return whole;
        }
        Self {
            felt: whole.felt,
            pressed: whole.pressed,
            ..Self::of(problem, normals, r, v, &shorter, &still)
        }
    }

    /// `still` are the sizes of the terms of `W r + q`.
    fn of<const D: usize>(
        problem: &Reduced<D>,
        normals: &Normals<D>,
        r: &[[f64; D]],
        v: &[[f64; D]],
        a: &[f64],
        still: &[[f64; D]],
    ) -> Self {
        let scaling = &problem.scaling;
        let (mut felt, mut bound) = (still.to_vec(), still.to_vec());
        let [mut pressed, mut normal, mut plain] = [(); 3].map(|()| vec![0.0; r.len()]);
        for (i, still) in still.iter().enumerate() {
            let (law, own) = (&problem.law[i], normals.factor(i));
            let (scaled_r, scaled_v) = scaling.scale(i, &r[i], &v[i]);
            let mut terms = *still;
            let mut blur = 0.0;
            for (k, term) in terms.iter_mut().enumerate() {
                let rigid = problem.rigid.modes.at(i);
                *term += rigid.map(|(c, mode)| (mode[k] * a[c]).abs()).sum::<f64>();
                *term *= ROUNDING * scaling.to_v[i];
            }
            if law.dilatancy > 0.0 {
                terms[0] += law.dilatancy * tangential_norm(&terms); // v_n − β‖v_t‖ is compared
            }
            normal[i] = terms[0] * own;
            // Rigid motions have an error of ε times their length. The normal part of a motion
            // along a wall is such an error; times a motion without bound it would look like
            // pressure.
            for (c, mode) in problem.rigid.modes.at(i) {
                blur += norm(mode) * a[c].abs();
            }
            let terms = terms.map(|c| c.max(ROUNDING * scaling.to_v[i] * blur));
            let share = feeling(&scaled_r, &scaled_v, &problem.scaled_law(i), terms[0]);
            pressed[i] = normal[i] * share[0];
            felt[i] = std::array::from_fn(|k| terms[k] * share[k]);
            let of_r = scaled_r.map(|c| ROUNDING * c.abs());
            plain[i] = (terms[0] * own).max(of_r[0] / own);
            // τ = r̂ − ṽ̂ rounds r̂ too. If W_ii is near its mean, this is already included. A
            // contact of rigid bodies has W_ii = 0, and its reactions may grow until ṽ̂ is below
            // their rounding.
            bound[i] = std::array::from_fn(|k| terms[k].max(of_r[k]));
            if r[i].iter().any(|&c| c != 0.0) {
                bound[i][0] += law.mu * tangential_norm(&bound[i]);
            }
        }
        let mut balance = 0.0;
        if !problem.rigid.modes.is_empty() {
            let forces = scaling.reaction_norm(r) + scaling.force_norm(&scaling.load);
            balance = ROUNDING * ratio(forces, force_size(problem, r));
        }
        Self {
            felt: norm(felt.as_flattened()),
            pressed: norm(&pressed),
            normal: norm(&normal),
            plain: norm(&plain),
            bound: norm(bound.as_flattened()),
            balance,
        }
    }

    /// The error of η for an absolute error; `whole` is the denominator of η.
    pub(super) fn floor(&self, absolute: f64, whole: f64) -> f64 {
        // η is exactly zero if its reference size is zero.
        let law = if whole > 0.0 { absolute / whole } else { 0.0 };
        law.max(self.balance)
    }
}

/// Upper bounds for the change of `F` of a contact with the components of `v̂`: zero if the
/// contact is open by more than `rounding`; small for tangential components if the contact
/// slides far under a small pressure, because they only turn a small force.
fn feeling<const D: usize>(
    r: &[f64; D],
    v: &[f64; D],
    law: &ContactLaw,
    rounding: f64,
) -> [f64; D] {
    let open = law.opening(v) > rounding;
    if open && law.cohesion == 0.0 && r.iter().all(|&c| c == 0.0) {
        return [0.0; D];
    }
    let (projected, status) = law_step(r, v, 1.0, *law);
    let mut share = [1.0; D];
    if open && law.cohesion > 0.0 && status == Status::Open {
        share[0] = 0.0;
    }
    if status == Status::Slip || law.cohesion > 0.0 {
        let tau: [f64; D] = std::array::from_fn(|k| r[k] - v[k]);
        let turned = tangential_norm(&projected) / tangential_norm(&tau).max(f64::MIN_POSITIVE);
        share[1..].fill(turned.min(1.0));
    }
    share
}
