//! Whether supports, springs and contacts can hold every rigid motion of the bodies.
//!
//! This engine has no amounts of rigid motions. A motion that nothing resists would be decided
//! by rounding, so that such problems are refused: the direct engine names the motion.

use crate::bodies::holding::{Holding, MOST_LOOSE};
use crate::bodies::resistance::measure_resistance;
use crate::bodies::tuning::spring_force;
use crate::error::Error;
use crate::linalg::small::norm;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::primal::nodes::Nodes;
use crate::primal::problem::Stiffness;
use crate::tasks;

/// Rigid motions, `m` at each place, and the body of each node: nodes whose free degrees of
/// freedom are coupled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motions<'a> {
    pub(super) values: &'a [f64],
    pub(super) bodies: &'a [u32],
}

/// What holds the bodies.
#[derive(Debug, Default)]
pub(super) struct Supports {
    /// Whether prescribed displacements hold each body, by entries of `K` that are no weak springs.
    pub(super) are_firm: bool,
    /// The bodies that contacts must hold, if there are any.
    pub(super) loose: Option<LooseBodies>,
}

/// Bodies that neither prescribed displacements nor springs hold, ascending, and what holds them
/// but for contacts.
#[derive(Debug)]
pub(super) struct LooseBodies {
    bodies: Vec<usize>,
    holding: Holding,
}

impl LooseBodies {
    /// Whether the contacts with these rows of `B` hold the bodies.
    pub(super) fn are_held_by(
        &self,
        rows: &OwnedMatrix,
        nodes: &Nodes,
        motions: Motions<'_>,
    ) -> bool {
        let d = nodes.place.len() / nodes.count.max(1);
        let m = motions.values.len() / nodes.place.len().max(1);
        let mut holding = self.holding.clone();
        for row in 0..rows.pointer.len() - 1 {
            let size = norm(&rows.entries(row).map(|(_, b)| b).collect::<Vec<f64>>());
            let mut moved = vec![0.0; holding.motions()];
            for (dof, b) in rows.entries(row).filter(|_| size > 0.0) {
                let at = nodes.place[dof] as usize;
                let body = motions.bodies[at / d] as usize;
                if let Ok(body) = self.bodies.binary_search(&body) {
                    let motions = &motions.values[at * m..][..m];
                    for (value, z) in moved[m * body..].iter_mut().zip(motions) {
                        *value += b / size * z;
                    }
                }
            }
            holding.hold(&moved);
        }
        holding.is_held()
    }
}

/// Checks that nothing can move freely. With copies of displacements, springs of the body are weaker than those of the
/// copies, and nothing but that is new: this was checked without copies.
pub(super) fn check<const D: usize>(
    stiffness: &Stiffness,
    contact: &OwnedMatrix,
    motions: Motions<'_>,
    has_copies: bool,
) -> Result<Supports, Error> {
    let (nodes, position) = (&stiffness.nodes, &stiffness.position);
    let m = motions.values.len() / (D * nodes.count).max(1);
    let of = |dof: usize| &motions.values[nodes.place[dof] as usize * m..][..m];
    let body = |dof: usize| motions.bodies[nodes.place[dof] as usize / D] as usize;
    let mut holding = hold_single_nodes::<D>(motions.bodies, m);
    let mut firm = holding.clone();
    let diagonal = |dof: usize| {
        let (node, component) = (nodes.place[dof] as usize / D, nodes.place[dof] as usize % D);
        stiffness.matrix.diagonal_block(node)[component * (D + 1)]
    };
    // A prescribed degree of freedom holds the bodies that it is coupled with.
    for (dof, p) in (0..position.len()).filter_map(|dof| Some((dof, position[dof]?))) {
        let coupled = stiffness.coupling.entries(p).filter(|&(_, k)| k != 0.0);
        let coupled = coupled.map(|(other, k)| (body(other), k.abs() / diagonal(other)));
        let mut bodies: Vec<(usize, f64)> = coupled.collect();
        bodies.sort_by_key(|&(body, _)| body);
        for coupling in bodies.chunk_by(|(a, _), (b, _)| a == b) {
            let body = coupling[0].0;
            holding[body].hold(of(dof));
            if coupling.iter().any(|&(_, share)| share >= spring_force()) {
                firm[body].hold(of(dof));
            }
        }
    }
    // Bodies that supports do not hold, and then those that springs do not hold either.
    let mut moves = vec![false; holding.len()];
    for dof in (0..position.len()).filter(|&dof| position[dof].is_none()) {
        moves[body(dof)] = true;
    }
    let mut loose: Vec<usize> = (0..moves.len()).filter(|&b| moves[b]).collect();
    let are_firm = loose.iter().all(|&body| firm[body].is_held());
    let held = Supports {
        are_firm,
        loose: None,
    };
    loose.retain(|&body| !holding[body].is_held());
    if loose.is_empty() {
        return Ok(held);
    }
    let row = stiffness.rows();
    let springs = tasks::collect(position.len(), |dof| {
        let free = position[dof].is_none() && loose.binary_search(&body(dof)).is_ok();
        let entries = free.then(|| row(dof).into_iter())?;
        let forces = measure_resistance(entries, m, |other, k| of(other)[k], 1.0)?;
        Some((dof, forces))
    });
    for (dof, forces) in springs.into_iter().flatten() {
        if !has_copies && forces.iter().all(|force| force.abs() < spring_force()) {
            return Err(Error::NotIterative {
                reason: "the stiffness has few digits, or weak springs, and supports do not hold \
                         a body",
                dof: Some(dof),
            });
        }
        holding[body(dof)].hold(&forces);
    }
    loose.retain(|&body| !holding[body].is_held());
    let Some(&first) = loose.first() else {
        return Ok(held);
    };
    let dof = (0..position.len()).find(|&dof| body(dof) == first);
    if loose.len() > MOST_LOOSE {
        return Err(Error::NotIterative {
            reason: "contact alone holds too many bodies",
            dof,
        });
    }
    let of_loose = loose.iter().map(|&body| holding[body].clone());
    let loose = LooseBodies {
        holding: Holding::join(of_loose.collect()),
        bodies: loose,
    };
    if loose.are_held_by(contact, nodes, motions) {
        Ok(Supports {
            loose: Some(loose),
            ..held
        })
    } else {
        Err(Error::NotIterative {
            reason: "supports and contacts may leave a body free to move",
            dof,
        })
    }
}

/// A body of one node cannot turn; nothing holds the others yet.
fn hold_single_nodes<const D: usize>(bodies: &[u32], m: usize) -> Vec<Holding> {
    let count = bodies.iter().max().map_or(0, |&last| last as usize + 1);
    let mut holding = vec![Holding::new(m); count];
    let mut nodes_of = vec![0; count];
    for &body in bodies {
        nodes_of[body as usize] += 1;
    }
    for (holding, _) in holding
        .iter_mut()
        .zip(nodes_of)
        .filter(|(_, nodes)| *nodes == 1)
    {
        for rotation in D..m {
            let row: Vec<f64> = (0..m).map(|k| f64::from(u8::from(k == rotation))).collect();
            holding.hold(&row);
        }
    }
    holding
}
