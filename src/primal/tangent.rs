//! The linear system of one Newton step in the displacements.
//!
//! The laws of all contacts, linearised in `(r, v)`, become conditions on `dy`, because
//! `dv = dy` and `dr = (A dy)` at a contact, with `A = Tᵀ K T`:
//!
//! ```text
//! held component (normal of a closed contact, all of a sticking one):  dv_k = −v_k
//! reaction of an open contact:                                        dr = −r
//! tangents of a sliding contact:    dr_t + c dr_n + V dv = −M F_t,    M = (∂F_t/∂r_t)⁻¹
//! every other row:                                                    A dy = −(A y − f)
//! ```
//!
//! Without the column `c = −μ t` the matrix is symmetric and positive definite; the
//! preconditioner is made of that part.

use crate::law::alart_curnier::Linearised;
use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::linalg::parallel::zero_where;
use crate::linalg::small::{Block, Vector};
use crate::primal::frames::Frames;
use crate::primal::multiplied_law::MultipliedLaw;
use crate::primal::nodes::{add_to_node, at_node};
use crate::primal::tuning;
use crate::reduced::reduced::Reduced;
use crate::solver::newton::linearisation::Linearisation;

/// Bound of `1 − c/‖x_t‖` of a sliding contact: where it is zero, the contact is about to
/// stick, and the spring across the direction of slip has no bound.
const LEAST_SLIP: f64 = 1e-6;

/// The rows of a contact that join reactions and displacements, `(I + C) dr + V dv = target`:
/// the tangents of a sliding contact.
#[derive(Clone, Debug)]
pub(super) struct SlidingTangent<const D: usize> {
    pub contact: usize,
    /// Place of the first component in `y`.
    pub at: usize,
    pub free: [bool; D],
    /// Components with such a row.
    pub rows: [bool; D],
    /// `C`; other rows are zero. The column of the normal is `c`.
    pub force: Block<D>,
    /// `V`; other rows are zero.
    pub spring: Block<D>,
    /// `−M F_t`.
    pub target: Vector<D>,
}

/// The system of one Newton step, in the numbering of the places of the contacts.
#[derive(Clone, Debug)]
pub struct Tangent<const D: usize> {
    pub(super) sliding: Vec<SlidingTangent<D>>,
    /// Places whose `dy` is known, or that have no unknown.
    pub held: Vec<bool>,
    /// `dy` at the held places, zero elsewhere.
    pub known: Vec<f64>,
}

impl<const D: usize> Tangent<D> {
    /// Makes the system of a linearised law, in the scaled variables of `reduced`. `free` are
    /// the places with an unknown.
    pub fn new(
        frames: &Frames<D>,
        free: &[bool],
        reduced: &Reduced<D>,
        law: &Linearisation<D>,
    ) -> Self {
        let (scaling, least) = (&reduced.scaling, tuning::least_compliance());
        let mut held: Vec<bool> = free.iter().map(|free| !free).collect();
        let mut known = vec![0.0; held.len()];
        let mut sliding = Vec::new();
        for (i, (frame, at)) in frames.list.iter().zip(&law.at).enumerate() {
            if frame.node == usize::MAX {
                continue;
            }
            let first = D * frame.node;
            // A component of the node without an unknown stands where no component of v is.
            for k in 0..D {
                held[first + k] = !frame.free[k];
            }
            if !reduced.law[i].is_coulomb() {
                let scale = scaling.to_r[i] / scaling.to_v[i];
                let at = separate_dilation(at, &reduced.law[i]);
                let Some(law) = MultipliedLaw::new(at.by_r, at.by_v, frame.free, least) else {
                    continue;
                };
                let s = law.multiplier * at.value / -scaling.to_r[i];
                for k in (0..D).filter(|&k| law.held[k]) {
                    held[first + k] = true;
                    known[first + k] = s[k] * scale;
                }
                if at.status != Status::Open || reduced.law[i].cohesion > 0.0 {
                    let mut rows = SlidingTangent::of_law(i, first, frame.free, &law);
                    rows.spring /= scale;
                    rows.target = s;
                    sliding.push(rows);
                }
                continue;
            }
            let components = match at.status {
                Status::Open => 0..0,
                Status::Slip => 0..1,
                Status::Stick => 0..D,
            };
            for k in components.filter(|&k| frame.free[k]) {
                held[first + k] = true;
                known[first + k] = -at.value[k] / scaling.to_v[i];
            }
            if at.status == Status::Slip {
                let (to_r, to_v) = (scaling.to_r[i], scaling.to_v[i]);
                sliding.push(SlidingTangent::new(i, first, frame.free, at, to_r, to_v));
            }
        }
        Self {
            sliding,
            held,
            known,
        }
    }

    /// The right side for the unknown part of `dy`, from `e = A y − f` and `moved`, `A` times
    /// [`Tangent::known`], which this changes.
    pub fn right_side(&self, e: &[f64], moved: &mut [f64]) -> Vec<f64> {
        self.add_laws(&self.known, moved);
        let mut right: Vec<f64> = e.iter().zip(&*moved).map(|(e, a)| -e - a).collect();
        for one in &self.sliding {
            for k in (0..D).filter(|&k| one.unknown(k)) {
                right[one.at + k] = one.target[k] - moved[one.at + k];
            }
        }
        self.clear(&mut right);
        right
    }

    /// Whether a contact slides; without one the system is linear while no status changes.
    pub fn slides(&self) -> bool {
        !self.sliding.is_empty()
    }

    /// Adds what the laws of sliding contacts add to `A x`: with `A x` in `out`, it becomes
    /// `J x` in the rows that are not held.
    pub fn add_laws(&self, x: &[f64], out: &mut [f64]) {
        for one in &self.sliding {
            let (dv, da) = (at_node(x, one.node()), at_node(out, one.node()));
            let change = one.force * da + one.spring * dv;
            add_to_node(out, one.node(), change);
        }
    }

    /// The first half of `Jᵀ z`, with `z` zero at held places: `Jᵀ z = A u + ` what
    /// [`Tangent::add_transposed`] adds, and this makes `u` of `z`.
    pub fn pull(&self, z: &mut [f64]) {
        for one in &self.sliding {
            let change = one.force.tr_mul(&at_node::<D>(z, one.node()));
            add_to_node(z, one.node(), change);
        }
    }

    /// Adds the springs of `Jᵀ z`.
    pub fn add_transposed(&self, z: &[f64], out: &mut [f64]) {
        for one in &self.sliding {
            let pulled = one.spring.tr_mul(&at_node::<D>(z, one.node()));
            add_to_node(out, one.node(), pulled);
        }
    }

    /// Sets the held places to zero.
    pub fn clear(&self, values: &mut [f64]) {
        zero_where(&self.held, true, values);
    }

    /// The change of the reactions along prescribed tangents, which no row of `A` has, from
    /// `dy` and `A dy` at the contacts. `r` are the present reactions.
    pub(super) fn prescribed_reactions(
        &self,
        frames: &Frames<D>,
        r: &[[f64; D]],
        dy: &[[f64; D]],
        moved: &[[f64; D]],
    ) -> Vec<[f64; D]> {
        let mut change = vec![[0.0; D]; r.len()];
        for (i, frame) in frames.list.iter().enumerate() {
            for k in (0..D).filter(|&k| !frame.free[k]) {
                change[i][k] = -r[i][k];
            }
        }
        for one in &self.sliding {
            let i = one.contact;
            let dv = Vector::<D>::from_column_slice(&dy[i]);
            let forced = one.force * Vector::from(moved[i]);
            let found = one.target - forced - one.spring * dv;
            for k in (0..D).filter(|&k| one.rows[k] && !one.free[k]) {
                change[i][k] = found[k];
            }
        }
        change
    }

    /// The symmetric part of the springs of sliding contacts, with their nodes.
    pub fn springs_of_nodes(&self) -> impl Iterator<Item = (usize, Block<D>)> {
        let all = self.sliding.iter();
        all.map(|one| (one.node(), one.symmetric_spring()))
    }

    /// The symmetric part of the springs of sliding contacts, with the contacts.
    pub(super) fn springs_of_contacts(&self) -> impl Iterator<Item = (usize, Block<D>)> {
        let all = self.sliding.iter();
        all.map(|one| (one.contact, one.symmetric_spring()))
    }

    /// The symmetric part of the springs of all contacts with a node, zero unless they slide.
    pub(super) fn springs(&self, frames: &Frames<D>) -> Vec<f64> {
        let mut of_contacts = vec![Block::<D>::zeros(); frames.list.len()];
        for (contact, spring) in self.springs_of_contacts() {
            of_contacts[contact] = spring;
        }
        let with_node = frames.with_node();
        let blocks = with_node.flat_map(|(i, _)| of_contacts[i].iter().copied());
        blocks.collect()
    }
}

/// The rows of a law, those of a contact that dilates combined so that the normal one has no
/// reaction, `dv_n + β t·dv_t = …`, and the others no `v_n`.
fn separate_dilation<const D: usize>(at: &Linearised<D>, law: &ContactLaw) -> Linearised<D> {
    let mut rows = *at;
    if law.dilatancy == 0.0 || at.status != Status::Slip {
        return rows;
    }
    // by_v = (1, β t)/h in the normal row, with the direction t of the reaction, h = 1 + μβ.
    let mut dilates = at.by_v.row(0) / at.by_v[(0, 0)];
    let mut t = dilates.transpose() / law.dilatancy;
    t[0] = 0.0;
    rows.value[0] += law.dilatancy * t.dot(&at.value);
    rows.by_r.fill_row(0, 0.0);
    rows.by_v.set_row(0, &dilates);
    dilates *= law.mu * at.by_v[(0, 0)];
    let shift = law.mu * at.by_v[(0, 0)] * rows.value[0];
    for k in 1..D {
        rows.value[k] -= shift * t[k];
        for l in 0..D {
            rows.by_v[(k, l)] -= dilates[l] * t[k];
        }
        rows.by_v[(k, 0)] = 0.0;
    }
    rows
}

impl<const D: usize> SlidingTangent<D> {
    fn new(
        contact: usize,
        at: usize,
        free: [bool; D],
        law: &Linearised<D>,
        to_r: f64,
        to_v: f64,
    ) -> Self {
        // ∂F_t/∂r_t = I − G with G = g (I − t tᵀ), so that M = I + G/(1 − g).
        let mut turned = Block::<D>::identity() - law.by_r;
        turned.fill_row(0, 0.0);
        turned.fill_column(0, 0.0);
        let g = turned.trace();
        let inverse = Block::identity() + turned / (1.0 - g).max(LEAST_SLIP);
        let mut force = Block::<D>::zeros();
        force.set_column(0, &(inverse * law.by_r.column(0)));
        let mut spring = inverse * law.by_v * (to_v / to_r);
        let mut target = inverse * law.value / -to_r;
        force.fill_row(0, 0.0);
        target[0] = 0.0;
        spring.fill_row(0, 0.0);
        Self {
            contact,
            at,
            free,
            rows: std::array::from_fn(|k| k > 0),
            force,
            spring,
            target,
        }
    }

    /// The rows of a multiplied law that are not held, without a target.
    pub(super) fn of_law(
        contact: usize,
        at: usize,
        free: [bool; D],
        law: &MultipliedLaw<D>,
    ) -> Self {
        let rows = law.held.map(|held| !held);
        let mut force = law.by_r;
        for k in (0..D).filter(|&k| rows[k]) {
            force[(k, k)] -= 1.0;
        }
        Self {
            contact,
            at,
            free,
            rows,
            force,
            spring: law.by_v,
            target: Vector::zeros(),
        }
    }

    pub(super) fn node(&self) -> usize {
        self.at / D
    }

    /// Whether a component has such a row and an unknown.
    fn unknown(&self, k: usize) -> bool {
        self.rows[k] && self.free[k]
    }

    /// The symmetric part of `V` among the components with such a row. Dilatancy joins the normal
    /// to the tangents in one direction only, and its symmetric part would not be definite.
    fn symmetric_spring(&self) -> Block<D> {
        let part = Block::<D>::from_fn(|i, j| {
            if self.unknown(i) && self.unknown(j) && (i == 0) == (j == 0) {
                self.spring[(i, j)]
            } else {
                0.0
            }
        });
        (part + part.transpose()) * 0.5
    }
}
