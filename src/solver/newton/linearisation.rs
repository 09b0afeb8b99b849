//! The law of all contacts, linearised for one Newton step, (19).

use crate::law::alart_curnier::{Linearised, linearised, open_rows};
use crate::law::cone::Status;
use crate::law::frozen::Frozen;
use crate::linalg::small::{Block, Vector};
use crate::reduced::reduced::Reduced;
use crate::solver::tuning;

/// Cost of a dense LU of order `n`, in products with `W` that skip most entries.
pub fn factorisation_cost<const D: usize>(problem: &Reduced<D>, n: usize) -> f64 {
    let compliance = &problem.compliance;
    let entries = if compliance.is_sparse() {
        compliance.entries()
    } else {
        (D * problem.contacts()).pow(2)
    };
    #[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
    let (n, entries) = (n as f64, entries.max(1) as f64);
    n.powi(3) / (tuning::unknowns_a_product() * entries)
}

/// Cost of the inverses of all islands in the same units: each costs one and a half times an
/// LU.
pub fn inversion_cost<const D: usize>(problem: &Reduced<D>) -> f64 {
    let compliance = &problem.compliance;
    if !compliance.is_sparse() {
        return 1.5 * factorisation_cost(problem, D * problem.contacts());
    }
    let islands = compliance.islands().iter();
    islands
        .map(|island| 1.5 * factorisation_cost(problem, D * island.nodes.len()))
        .sum()
}

/// Cuts the rows of a matrix into those of each contact, `size` numbers each.
pub(super) fn cut<'m, T>(
    contacts: &'m [T],
    size: impl Fn(&T) -> usize,
    mut rows: &'m mut [f64],
) -> Vec<(&'m T, &'m mut [f64])> {
    let own = |contact: &'m T| {
        let (own, rest) = std::mem::take(&mut rows).split_at_mut(size(contact));
        rows = rest;
        (contact, own)
    };
    contacts.iter().map(own).collect()
}

/// `by_r dr + by_v dv = −value` at each contact, scaled.
#[derive(Debug)]
pub struct Linearisation<const D: usize> {
    pub at: Vec<Linearised<D>>,
    /// The `α` of `dv = (Ŵ + α) dr + …`: zero except in a proximal step.
    pub shift: f64,
    /// Whether the statuses replace (19): `v_n = 0` if closed, `v = 0` if sticking.
    pub by_status: bool,
}

impl<const D: usize> Linearisation<D> {
    /// Linearises at a point `(r, v)`.
    pub fn new(problem: &Reduced<D>, r: &[[f64; D]], v: &[[f64; D]]) -> Self {
        Self::with_step(problem, r, v, 1.0)
    }

    /// Linearises the map of `r̂ − ρ v̂` at a point `(r, v)`.
    pub fn with_step(problem: &Reduced<D>, r: &[[f64; D]], v: &[[f64; D]], rho: f64) -> Self {
        let of_node = |i: usize| {
            let (r, v) = problem.scaling.scale(i, &r[i], &v[i]);
            let v = v.map(|c| c * rho);
            let mut at = linearised(&r, &v, problem.scaled_law(i));
            at = match at.status {
                Status::Stick => hold(problem, i, &r, &v),
                // A contact that no reaction can move is not closed by one.
                _ if !movable(problem, i, 0) => hold_open(problem, i, &r, &v),
                Status::Open => hold_open(problem, i, &r, &v),
                Status::Slip => at,
            };
            at.by_v *= rho;
            at
        };
        Self::of(r.len(), of_node, true)
    }

    fn of(contacts: usize, of_node: impl Fn(usize) -> Linearised<D>, by_status: bool) -> Self {
        Self {
            at: (0..contacts).map(of_node).collect(),
            shift: 0.0,
            by_status,
        }
    }

    /// Adds a change to the `v` of the point, with the same derivatives.
    pub fn move_by(&mut self, problem: &Reduced<D>, change: &[[f64; D]]) {
        for ((at, change), scale) in self.at.iter_mut().zip(change).zip(&problem.scaling.to_v) {
            at.value += at.by_v * Vector::from(change.map(|c| c * scale));
        }
    }

    /// Linearises frozen laws, one for each contact, at a point `(r, v)`.
    pub fn frozen(
        problem: &Reduced<D>,
        laws: &[Frozen<D>],
        r: &[[f64; D]],
        v: &[[f64; D]],
    ) -> Self {
        let scaling = &problem.scaling;
        let of_node = |i: usize| {
            let (r, v) = scaling.scale(i, &r[i], &v[i]);
            let law = laws[i].scaled(scaling.to_v[i], scaling.to_r[i]);
            let mut at = law.linearised(&r, &v);
            for k in 0..D {
                // A component that nothing can move is not held by a reaction.
                if at.status != Status::Open && !movable(problem, i, k) {
                    release(&mut at, k);
                    at.value[k] = 0.0;
                }
            }
            at
        };
        Self::of(r.len(), of_node, false)
    }

    /// Some contacts held in every direction and the others open, from `(r, v)`.
    pub fn held(
        problem: &Reduced<D>,
        holds: impl Fn(usize) -> bool,
        r: &[[f64; D]],
        v: &[[f64; D]],
    ) -> Self {
        let of_node = |i: usize| {
            let (r, v) = problem.scaling.scale(i, &r[i], &v[i]);
            if !holds(i) || !movable(problem, i, 0) {
                return hold_open(problem, i, &r, &v);
            }
            let mut at = hold(problem, i, &r, &v);
            if !problem.law[i].has_friction() {
                at.status = Status::Slip; // one unknown, the normal one
                for (k, r) in r.iter().enumerate().skip(1) {
                    release(&mut at, k);
                    at.value[k] = *r;
                }
            }
            at
        };
        Self::of(r.len(), of_node, true)
    }
}

/// Rows of an open contact. A tangential component that nothing moves is not held by the reaction
/// of cohesion: it takes the step of (11).
fn hold_open<const D: usize>(
    problem: &Reduced<D>,
    node: usize,
    r: &[f64; D],
    v: &[f64; D],
) -> Linearised<D> {
    let mut open = open_rows(r, v, &problem.scaled_law(node));
    if problem.law[node].cohesion > 0.0 {
        for k in (1..D).filter(|&k| !movable(problem, node, k)) {
            release(&mut open, k);
        }
    }
    open
}

/// Gives a component the row of a reaction alone.
fn release<const D: usize>(at: &mut Linearised<D>, k: usize) {
    at.by_v.fill_row(k, 0.0);
    at.by_r.fill_row(k, 0.0);
    at.by_r[(k, k)] = 1.0;
}

/// Rows of `v = 0`. A prescribed component cannot be held: its row makes the reaction zero.
fn hold<const D: usize>(
    problem: &Reduced<D>,
    node: usize,
    r: &[f64; D],
    v: &[f64; D],
) -> Linearised<D> {
    let by_v = Block::from_fn(|i, j| f64::from(u8::from(i == j && movable(problem, node, i))));
    let by_r = Block::identity() - by_v;
    Linearised {
        status: Status::Stick,
        value: by_r * Vector::from(*r) + by_v * Vector::from(*v),
        by_r,
        by_v,
    }
}

/// Whether a reaction moves a component of a contact.
pub fn movable<const D: usize>(problem: &Reduced<D>, node: usize, k: usize) -> bool {
    let mut modes = problem.scaling.modes.at(node);
    problem.compliance.block(node)[(k, k)] > 0.0 || modes.any(|(_, mode)| mode[k] != 0.0)
}
