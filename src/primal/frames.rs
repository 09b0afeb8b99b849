//! The variables of the contacts: `v` instead of the displacement of a contact node.
//!
//! Contact `i` has a node `s` of its own, with the columns `B_s` of its rows of `B`, restricted
//! to free degrees of freedom. The new unknowns at this node are `y = B_s u_s`, and all others
//! stay: `u = T y`. Then `v = y + B_f u_f + g` with the prescribed `u_f`, and
//! `Tᵀ (K u − f) = r` at the node: a contact force needs no further equation.

use std::collections::HashMap;

use crate::condensation::sparse::OwnedMatrix;
use crate::error::Error;
use crate::linalg::small::Block;
use crate::primal::nodes::Nodes;
use crate::reduced::elliptic_scaling::EllipticScaling;

/// Largest product of the lengths of a row of `B_s` and of the column of its inverse: normal and
/// tangents of a contact must be independent.
const MOST_OBLIQUE: f64 = 1e6;

/// The variables of one contact.
#[derive(Clone, Debug)]
pub struct Frame<const D: usize> {
    pub node: usize,
    /// `u_s = from_local y`; rows of prescribed degrees of freedom are zero.
    pub from_local: Block<D>,
    /// `y = to_local u_s`.
    pub to_local: Block<D>,
    /// Whether component `k` of `v` has an unknown.
    pub free: [bool; D],
}

/// The variables of all contacts.
#[derive(Clone, Debug)]
pub struct Frames<const D: usize> {
    pub list: Vec<Frame<D>>,
    /// `B` at the prescribed degrees of freedom, by rows.
    prescribed: OwnedMatrix,
}

impl<const D: usize> Frames<D> {
    /// Finds the node of each contact. `contact` are the rows of `B`, `position` the number of
    /// each prescribed degree of freedom, `free` the places of the other ones.
    ///
    /// # Errors
    /// [`Error::NotIterative`] if a contact has more than one node, if two contacts share one,
    /// or if supports are oblique to the axes of a contact.
    pub fn new(
        contact: &OwnedMatrix,
        elliptic: Option<&EllipticScaling>,
        nodes: &Nodes,
        position: &[Option<usize>],
        free: &[bool],
    ) -> Result<Self, Error> {
        let contacts = (contact.pointer.len() - 1) / D;
        let mut owner = HashMap::new();
        let mut list = Vec::with_capacity(contacts);
        let mut prescribed = OwnedMatrix::default();
        for i in 0..contacts {
            let mut own = Rows::<D>::default();
            for k in 0..D {
                let factor = elliptic.map_or(1.0, |elliptic| elliptic.factor(i, k));
                for (dof, value) in contact.entries(D * i + k) {
                    if value == 0.0 {
                        continue;
                    }
                    if let Some(known) = position[dof] {
                        prescribed.index.push(known);
                        prescribed.values.push(factor * value);
                    } else {
                        own.add(k, nodes.place[dof] as usize, factor * value)?;
                    }
                }
                prescribed.pointer.push(prescribed.index.len());
            }
            let frame = own.frame(free)?;
            if let Some(frame) = &frame
                && owner.insert(frame.node, i).is_some()
            {
                return Err(Error::NotIterative {
                    reason: "two contacts share a node",
                });
            }
            // A contact without a free degree of freedom has no unknown, and no node.
            list.push(frame.unwrap_or(Frame {
                node: usize::MAX,
                from_local: Block::zeros(),
                to_local: Block::zeros(),
                free: [false; D],
            }));
        }
        Ok(Self { list, prescribed })
    }

    /// Contacts with a node.
    fn with_node(&self) -> impl Iterator<Item = (usize, &Frame<D>)> {
        let all = self.list.iter().enumerate();
        all.filter(|(_, frame)| frame.node != usize::MAX)
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
        self.change(y, |frame, own| frame.from_local * own);
    }

    /// `y = T⁻¹ u`, in place; prescribed degrees of freedom become zero.
    pub fn to_local(&self, u: &mut [f64]) {
        self.change(u, |frame, own| frame.to_local * own);
    }

    /// `Tᵀ f`, in place.
    pub fn forces_to_local(&self, f: &mut [f64]) {
        self.change(f, |frame, own| frame.from_local.tr_mul(&own));
    }

    fn change(
        &self,
        values: &mut [f64],
        of: impl Fn(&Frame<D>, nalgebra::SVector<f64, D>) -> nalgebra::SVector<f64, D>,
    ) {
        for (_, frame) in self.with_node() {
            let own = &mut values[D * frame.node..D * (frame.node + 1)];
            let changed = of(frame, nalgebra::SVector::from_column_slice(own));
            own.copy_from_slice(changed.as_slice());
        }
    }

    /// The part of `v` that does not depend on the unknowns: `B_f u_f + g`.
    #[must_use]
    pub fn offsets(&self, gap: &[[f64; D]], prescribed: &[f64]) -> Vec<[f64; D]> {
        let mut offsets = gap.to_vec();
        self.prescribed
            .add_product(prescribed, offsets.as_flattened_mut());
        offsets
    }

    /// The values at the contacts; zero for a component without an unknown.
    #[must_use]
    pub fn at_contacts(&self, y: &[f64]) -> Vec<[f64; D]> {
        let mut values = vec![[0.0; D]; self.list.len()];
        for (i, k, at) in self.unknowns() {
            values[i][k] = y[at];
        }
        values
    }
}

/// The rows of `B` of one contact at free degrees of freedom.
struct Rows<const D: usize> {
    node: Option<usize>,
    block: Block<D>,
    row: [bool; D],
    column: [bool; D],
}

impl<const D: usize> Default for Rows<D> {
    fn default() -> Self {
        Self {
            node: None,
            block: Block::zeros(),
            row: [false; D],
            column: [false; D],
        }
    }
}

impl<const D: usize> Rows<D> {
    fn add(&mut self, row: usize, place: usize, value: f64) -> Result<(), Error> {
        let (node, column) = (place / D, place % D);
        if *self.node.get_or_insert(node) != node {
            return Err(Error::NotIterative {
                reason: "a contact joins more than one node",
            });
        }
        self.block[(row, column)] += value;
        self.row[row] = true;
        self.column[column] = true;
        Ok(())
    }

    /// The variables; `None` for a contact without a free degree of freedom.
    fn frame(self, free: &[bool]) -> Result<Option<Frame<D>>, Error> {
        let Some(node) = self.node else {
            return Ok(None);
        };
        let oblique = Error::NotIterative {
            reason: "a support at a contact is oblique to the normal and the tangents",
        };
        let count = |used: [bool; D]| used.into_iter().filter(|&used| used).count();
        let own: [bool; D] = std::array::from_fn(|k| free[D * node + k]);
        if count(self.row) != count(self.column) || self.column != own {
            return Err(oblique);
        }
        // Ones at the prescribed components make a regular block of full size.
        let mut whole = self.block;
        let held = |used: [bool; D]| (0..D).filter(move |&k| !used[k]);
        for (row, column) in held(self.row).zip(held(self.column)) {
            whole[(row, column)] = 1.0;
        }
        let inverse = whole.try_inverse().ok_or(oblique.clone())?;
        // The condition of normal and tangents, each row of length one.
        let sizes = (0..D).map(|k| whole.row(k).norm() * inverse.column(k).norm());
        if sizes.fold(0.0, f64::max) > MOST_OBLIQUE {
            return Err(oblique);
        }
        let inside = |row: usize, column: usize| self.column[row] && self.row[column];
        Ok(Some(Frame {
            node,
            from_local: Block::from_fn(|i, j| if inside(i, j) { inverse[(i, j)] } else { 0.0 }),
            to_local: self.block,
            free: self.row,
        }))
    }
}
