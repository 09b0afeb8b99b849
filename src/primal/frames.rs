//! The variables of the contacts: `v` instead of the displacement of a contact node.
//!
//! Contact `i` has a node `s` of its own, with the columns `B_s` of its rows of `B`, restricted
//! to free degrees of freedom, and masters `m` on other bodies with the columns `B_m`. The new
//! unknowns at `s` are `y = B_s u_s + Σ B_m u_m`, and all others stay: `u = T y`. Then
//! `v = y + B_f u_f + g` with the prescribed `u_f`, and `Tᵀ (K u − f) = r` at the node: a contact
//! force needs no further equation, and each master feels its part of it.

use crate::error::Error;
use crate::linalg::compensated::Sum;
use crate::linalg::small::Block;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::primal::nodes::{at_node, set_node};
use crate::primal::own_nodes::{AboutNodes, Columns, Frame, choose};
use crate::reduced::elliptic_scaling::EllipticScaling;

/// The variables of all contacts.
#[derive(Clone, Debug)]
pub struct Frames<const D: usize> {
    pub list: Vec<Frame<D>>,
    /// Contacts with a node; the masters of each are no nodes of earlier ones.
    order: Vec<u32>,
    /// Start of the masters of each contact.
    start: Vec<usize>,
    /// Node and columns `B_m` of each master.
    masters: Columns<D>,
    /// `B` at the prescribed degrees of freedom, by rows.
    prescribed: OwnedMatrix,
}

impl<const D: usize> Frames<D> {
    /// Finds the node of each contact. `contact` are the rows of `B`; `place` and `position` are
    /// the place of each degree of freedom, and its number among the prescribed ones.
    pub fn new(
        contact: &OwnedMatrix,
        elliptic: Option<&EllipticScaling>,
        place: &[u32],
        position: &[Option<usize>],
        nodes: &AboutNodes<'_, D>,
    ) -> Result<Self, Error> {
        let contacts = (contact.pointer.len() - 1) / D;
        let mut of_contacts: Vec<Columns<D>> = Vec::with_capacity(contacts);
        let mut prescribed = OwnedMatrix::default();
        for i in 0..contacts {
            let mut columns = Columns::new();
            for k in 0..D {
                let factor = elliptic.map_or(1.0, |elliptic| elliptic.factor(i, k));
                for (dof, value) in contact.entries(D * i + k) {
                    if value == 0.0 {
                        continue;
                    }
                    if let Some(known) = position[dof] {
                        prescribed.index.push(known);
                        prescribed.values.push(factor * value);
                        continue;
                    }
                    let place = place[dof] as usize;
                    let (node, column) = (place / D, place % D);
                    let at = columns.iter().position(|(other, _)| *other == node);
                    let at = at.unwrap_or_else(|| {
                        columns.push((node, Block::zeros()));
                        columns.len() - 1
                    });
                    columns[at].1[(k, column)] += factor * value;
                }
                prescribed.pointer.push(prescribed.index.len());
            }
            of_contacts.push(columns);
        }
        let (list, order) = choose(&of_contacts, nodes)?;
        let (mut start, mut masters) = (vec![0], Vec::new());
        for (frame, columns) in list.iter().zip(of_contacts) {
            masters.extend(columns.into_iter().filter(|(node, _)| *node != frame.node));
            start.push(masters.len());
        }
        Ok(Self {
            list,
            order,
            start,
            masters,
            prescribed,
        })
    }

    /// Whether a contact joins nodes.
    pub fn join(&self) -> bool {
        !self.masters.is_empty()
    }

    /// Nodes and columns `B_m` of the masters of a contact.
    pub fn masters(&self, contact: usize) -> &[(usize, Block<D>)] {
        &self.masters[self.start[contact]..self.start[contact + 1]]
    }

    /// Contacts with a node, such that the masters of each are no nodes of earlier ones.
    pub fn with_node(&self) -> impl DoubleEndedIterator<Item = (usize, &Frame<D>)> {
        let all = self.order.iter();
        all.map(|&i| (i as usize, &self.list[i as usize]))
    }

    /// The unknown of each free component: contact, component, position in `y`.
    pub fn unknowns(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        self.with_node().flat_map(|(i, frame)| {
            let free = (0..D).filter(|&k| frame.free[k]);
            free.map(move |k| (i, k, D * frame.node + k))
        })
    }

    /// Nodes of the contacts with the block `T` of each.
    pub fn blocks(&self) -> impl Iterator<Item = (usize, &Block<D>)> {
        self.with_node()
            .map(|(_, frame)| (frame.node, &frame.from_local))
    }

    /// `u = T y`, in place.
    pub fn to_displacements(&self, y: &mut [f64]) {
        for (i, frame) in self.with_node().rev() {
            let mut own = at_node(y, frame.node);
            for (node, block) in self.masters(i) {
                own -= block * at_node(y, *node);
            }
            set_node(y, frame.node, frame.from_local * own);
        }
    }

    /// `|T| |y|`, in place: the size of the terms of [`Frames::to_displacements`].
    pub fn terms_of_displacements(&self, y: &mut [f64]) {
        for value in y.iter_mut() {
            *value = value.abs();
        }
        for (i, frame) in self.with_node().rev() {
            let mut own = at_node(y, frame.node);
            for (node, block) in self.masters(i) {
                own += block.abs() * at_node(y, *node);
            }
            set_node(y, frame.node, frame.from_local.abs() * own);
        }
    }

    /// `y = T⁻¹ u`, in place; prescribed degrees of freedom become zero.
    pub fn to_local(&self, u: &mut [f64]) {
        for (i, frame) in self.with_node() {
            let mut own = frame.to_local * at_node(u, frame.node);
            for (node, block) in self.masters(i) {
                own += block * at_node(u, *node);
            }
            set_node(u, frame.node, own);
        }
    }

    /// `Tᵀ f`, in place.
    pub fn forces_to_local(&self, f: &mut [f64]) {
        for (i, frame) in self.with_node() {
            let own = frame.from_local.tr_mul(&at_node(f, frame.node));
            for (node, block) in self.masters(i) {
                let force = at_node(f, *node) - block.tr_mul(&own);
                set_node(f, *node, force);
            }
            set_node(f, frame.node, own);
        }
    }

    /// `Tᵀ f` with sums in twice the precision, in place; `low` are the digits of `f` below its
    /// rounding.
    pub(super) fn forces_to_local_in_two(&self, f: &mut [f64], low: &mut [f64]) {
        for (i, frame) in self.with_node() {
            let s = D * frame.node;
            let sums: [Sum; D] = std::array::from_fn(|k| {
                let mut sum = Sum::default();
                for l in 0..D {
                    sum.add_product(frame.from_local[(l, k)], low[s + l]);
                    sum.add_product(frame.from_local[(l, k)], f[s + l]);
                }
                sum
            });
            for (k, sum) in sums.into_iter().enumerate() {
                (f[s + k], low[s + k]) = sum.parts();
            }
            for (node, block) in self.masters(i) {
                for k in 0..D {
                    let at = D * node + k;
                    let mut sum = Sum::new(f[at]);
                    sum.add(low[at]);
                    for l in 0..D {
                        sum.add_product(-block[(l, k)], low[s + l]);
                        sum.add_product(-block[(l, k)], f[s + l]);
                    }
                    (f[at], low[at]) = sum.parts();
                }
            }
        }
    }

    /// `|Tᵀ| f` for `f ≥ 0`, in place.
    pub fn terms_of_forces(&self, f: &mut [f64]) {
        for (i, frame) in self.with_node() {
            let own = frame.from_local.abs().tr_mul(&at_node(f, frame.node));
            for (node, block) in self.masters(i) {
                let force = at_node(f, *node) + block.abs().tr_mul(&own);
                set_node(f, *node, force);
            }
            set_node(f, frame.node, own);
        }
    }

    /// The part of `v` that does not depend on the unknowns: `B_f u_f + g`. Where a held node
    /// follows an obstacle, it touches: what is left of `v_n` is rounding, not penetration.
    pub fn offsets(&self, gap: &[[f64; D]], prescribed: &[f64]) -> Vec<[f64; D]> {
        let held = &self.prescribed;
        let mut offsets = gap.to_vec();
        held.add_product(prescribed, offsets.as_flattened_mut());
        for (i, (frame, v)) in self.list.iter().zip(&mut offsets).enumerate() {
            if !frame.free[0] && held.cancels(D * i, prescribed, gap[i][0], v[0]) {
                v[0] = 0.0;
            }
        }
        offsets
    }

    /// The values at the contacts; zero for a component without an unknown.
    pub fn at_contacts(&self, y: &[f64]) -> Vec<[f64; D]> {
        let mut values = vec![[0.0; D]; self.list.len()];
        for (i, k, at) in self.unknowns() {
            values[i][k] = y[at];
        }
        values
    }
}
