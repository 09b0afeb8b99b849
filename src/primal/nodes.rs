//! The degrees of freedom of each node, as blocks of the stiffness.

use crate::error::Error;
use crate::linalg::small::{Vector, add_scaled};
use crate::linalg::sparse::csc::narrow;
use crate::linalg::sparse::rows::OwnedMatrix;

/// The block of each degree of freedom.
#[derive(Clone, Debug)]
pub struct Nodes {
    /// `D node + component` of each degree of freedom.
    pub place: Vec<u32>,
    pub count: usize,
    /// `D` coordinates of each node, if they are known.
    pub coordinates: Option<Vec<f64>>,
}

impl Nodes {
    /// Groups `n` degrees of freedom into nodes of `D` components. They are numbered by nodes,
    /// `D node + component`, or, if `places` or the rows of `contact` show it, by components,
    /// `n / D component + node`.
    pub fn new<const D: usize>(
        n: usize,
        places: Option<&[[f64; 3]]>,
        contact: &OwnedMatrix,
    ) -> Result<Self, Error> {
        let refused = |reason| Err(Error::NotIterative { reason, dof: None });
        if !n.is_multiple_of(D) {
            return refused("the number of degrees of freedom is not a multiple of the dimension");
        }
        let count = n / D;
        let by_node = |dof: usize| (dof / D, dof % D);
        let by_component = |dof: usize| (dof % count, dof / count);
        let Some(places) = places else {
            // A contact has few nodes, each with all components.
            let by_nodes = nodes_of_contacts::<D>(contact, |dof| by_node(dof).0);
            let by_components = nodes_of_contacts::<D>(contact, |dof| by_component(dof).0);
            return Ok(if by_components < by_nodes {
                Self::of::<D>(count, by_component, None)
            } else {
                Self::of::<D>(count, by_node, None)
            });
        };
        let together = |of: &dyn Fn(usize) -> (usize, usize)| {
            let mut first = vec![None; count];
            places.iter().enumerate().all(|(dof, at)| {
                let known = first[of(dof).0].get_or_insert(*at);
                known.map(f64::to_bits) == at.map(f64::to_bits)
            })
        };
        if together(&by_node) {
            Ok(Self::of::<D>(count, by_node, Some(places)))
        } else if together(&by_component) {
            Ok(Self::of::<D>(count, by_component, Some(places)))
        } else {
            refused("the degrees of freedom of a node have different coordinates")
        }
    }

    fn of<const D: usize>(
        count: usize,
        split: impl Fn(usize) -> (usize, usize),
        places: Option<&[[f64; 3]]>,
    ) -> Self {
        let place = |dof| {
            let (node, component) = split(dof);
            narrow(D * node + component)
        };
        let coordinates = places.map(|places| {
            let mut at = vec![0.0; D * count];
            for (dof, x) in places.iter().enumerate() {
                let (node, component) = split(dof);
                at[D * node + component] = x[component];
            }
            at
        });
        Self {
            place: (0..D * count).map(place).collect(),
            count,
            coordinates,
        }
    }

    /// Values by degree of freedom in the order of blocks.
    pub fn gather(&self, values: &[f64]) -> Vec<f64> {
        let mut blocks = vec![0.0; values.len()];
        for (&at, &value) in self.place.iter().zip(values) {
            blocks[at as usize] = value;
        }
        blocks
    }

    /// The inverse of [`Nodes::gather`].
    pub fn scatter(&self, blocks: &[f64]) -> Vec<f64> {
        self.place.iter().map(|&at| blocks[at as usize]).collect()
    }
}

/// The components of a node in values by places.
pub fn at_node<const D: usize>(values: &[f64], node: usize) -> Vector<D> {
    Vector::from_column_slice(&values[D * node..D * (node + 1)])
}

pub fn set_node<const D: usize>(values: &mut [f64], node: usize, own: Vector<D>) {
    values[D * node..D * (node + 1)].copy_from_slice(own.as_slice());
}

pub fn add_to_node<const D: usize>(values: &mut [f64], node: usize, change: Vector<D>) {
    add_scaled(
        &mut values[D * node..D * (node + 1)],
        1.0,
        change.as_slice(),
    );
}

/// The number of nodes of the rows of each contact, added over all contacts.
fn nodes_of_contacts<const D: usize>(
    contact: &OwnedMatrix,
    node: impl Fn(usize) -> usize,
) -> usize {
    let contacts = (contact.pointer.len() - 1) / D;
    let of_contact = |i: usize| {
        let rows = (D * i..D * (i + 1)).flat_map(|row| contact.entries(row));
        let mut nodes: Vec<usize> = rows.map(|(dof, _)| node(dof)).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.len()
    };
    (0..contacts).map(of_contact).sum()
}
