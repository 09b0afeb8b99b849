//! Whether supports, springs and contacts can hold every rigid motion of the bodies.
//!
//! This engine has no amounts of rigid motions. A motion that nothing resists would be decided
//! by rounding, so that such problems are refused: the direct engine names the motion.

use rayon::prelude::*;

use crate::condensation::sparse::OwnedMatrix;
use crate::error::Error;
use crate::linalg::jacobi::orthogonalise;
use crate::linalg::small::norm;
use crate::linalg::sparse::csc::{Index, Symmetric};
use crate::primal::nodes::Nodes;

/// A force of a rigid motion below this part of its terms is rounding: no spring resists it.
const ROUNDING: f64 = 1e-12;

/// And above this part it is that of a spring. Between the two, `K` may have few digits, whose
/// errors look like weak springs.
const SPRING: f64 = 1e-4;

/// Smallest singular value of the held motions, relative to the largest. All lengths are
/// relative to the size of the bodies.
const LEAST: f64 = 1e-8;

/// More loose bodies than this are left to the direct engine.
const MOST_BODIES: usize = 32;

/// Rigid motions, `m` at each place, and the body of each node: nodes whose free degrees of
/// freedom are coupled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motions<'a> {
    pub(super) values: &'a [f64],
    pub(super) bodies: &'a [u32],
}

/// The rows of what holds a body, one column for each of its motions.
type Columns = Vec<Vec<f64>>;

/// Checks that nothing can move freely. `position` is the number of each prescribed degree of
/// freedom.
///
/// # Errors
/// [`Error::NotIterative`].
pub(super) fn check<const D: usize, I: Index>(
    stiffness: &Symmetric<'_, I>,
    contact: &OwnedMatrix,
    nodes: &Nodes,
    motions: Motions<'_>,
    position: &[Option<usize>],
) -> Result<(), Error> {
    let m = motions.values.len() / (D * nodes.count).max(1);
    let of = |dof: usize| &motions.values[nodes.place[dof] as usize * m..][..m];
    let body = |dof: usize| motions.bodies[nodes.place[dof] as usize / D] as usize;
    let mut alone = single_nodes::<D>(motions.bodies, m);
    prescribed(&mut alone, stiffness, position, of, body);
    // Bodies that supports do not hold, and then those that springs do not hold either.
    let mut free = vec![false; alone.len()];
    for dof in (0..position.len()).filter(|&dof| position[dof].is_none()) {
        free[body(dof)] = true;
    }
    for (free, columns) in free.iter_mut().zip(&alone) {
        *free &= !are_independent(columns.clone());
    }
    if free.contains(&true) {
        let wanted = |dof: usize| position[dof].is_none() && free[body(dof)];
        for (dof, row) in springs(stiffness, m, of, wanted)? {
            hold(&mut alone[body(dof)], &row);
        }
    }
    let mut number = vec![None; alone.len()];
    let mut loose = Vec::new();
    for (body, columns) in alone.into_iter().enumerate() {
        if free[body] && !are_independent(columns.clone()) {
            number[body] = Some(loose.len());
            loose.push(columns);
        }
    }
    if loose.is_empty() {
        return Ok(());
    }
    if loose.len() > MOST_BODIES {
        return Err(Error::NotIterative {
            reason: "contact alone holds too many bodies",
        });
    }
    let mut columns = side_by_side(loose, m);
    contacts(&mut columns, contact, m, of, |dof| number[body(dof)]);
    if are_independent(columns) {
        Ok(())
    } else {
        Err(Error::NotIterative {
            reason: "supports and contacts may leave a body free to move",
        })
    }
}

/// Adds a row to the columns.
fn hold(columns: &mut Columns, row: &[f64]) {
    for (column, &value) in columns.iter_mut().zip(row) {
        column.push(value);
    }
}

/// What holds each body: a body of one node cannot turn, nothing holds the others yet.
fn single_nodes<const D: usize>(bodies: &[u32], m: usize) -> Vec<Columns> {
    let count = bodies.iter().max().map_or(0, |&last| last as usize + 1);
    let mut alone = vec![vec![Vec::new(); m]; count];
    let mut nodes_of = vec![0; count];
    for &body in bodies {
        nodes_of[body as usize] += 1;
    }
    for body in (0..count).filter(|&body| nodes_of[body] == 1) {
        for rotation in D..m {
            let row: Vec<f64> = (0..m).map(|k| f64::from(u8::from(k == rotation))).collect();
            hold(&mut alone[body], &row);
        }
    }
    alone
}

/// A prescribed degree of freedom holds the bodies that it is coupled with.
fn prescribed<'a, I: Index>(
    alone: &mut [Columns],
    stiffness: &Symmetric<'_, I>,
    position: &[Option<usize>],
    of: impl Fn(usize) -> &'a [f64],
    body: impl Fn(usize) -> usize,
) {
    for dof in (0..position.len()).filter(|&dof| position[dof].is_some()) {
        let mut held: Vec<usize> = stiffness
            .column(dof)
            .filter(|&(other, k)| k != 0.0 && position[other].is_none())
            .map(|(other, _)| body(other))
            .collect();
        held.sort_unstable();
        held.dedup();
        for body in held {
            hold(&mut alone[body], of(dof));
        }
    }
}

/// The columns of all loose bodies in one matrix: a block of `m` columns for each.
fn side_by_side(loose: Vec<Columns>, m: usize) -> Columns {
    let mut columns = vec![Vec::new(); m * loose.len()];
    for (number, own) in loose.into_iter().enumerate() {
        let above = columns.iter().map(Vec::len).max().unwrap_or(0);
        let height = above + own.first().map_or(0, Vec::len);
        for (k, own) in own.into_iter().enumerate() {
            columns[m * number + k].resize(above, 0.0);
            columns[m * number + k].extend(own);
        }
        for column in &mut columns {
            column.resize(height, 0.0);
        }
    }
    columns
}

/// Adds the relative displacements of the contacts by the motions of the loose bodies.
fn contacts<'a>(
    columns: &mut Columns,
    contact: &OwnedMatrix,
    m: usize,
    of: impl Fn(usize) -> &'a [f64],
    number: impl Fn(usize) -> Option<usize>,
) {
    for row in 0..contact.pointer.len() - 1 {
        let size = norm(&contact.entries(row).map(|(_, b)| b).collect::<Vec<f64>>());
        let mut moved = vec![0.0; columns.len()];
        for (dof, b) in contact.entries(row) {
            if let Some(body) = number(dof).filter(|_| size > 0.0) {
                for (value, z) in moved[m * body..].iter_mut().zip(of(dof)) {
                    *value += b / size * z;
                }
            }
        }
        hold(columns, &moved);
    }
}

/// The rows of `K` with a spring among those `wanted`, and the forces of the motions in them.
///
/// # Errors
/// [`Error::NotIterative`] if forces are neither rounding nor those of a spring.
fn springs<'a, I: Index>(
    stiffness: &Symmetric<'_, I>,
    m: usize,
    of: impl Fn(usize) -> &'a [f64] + Copy + Sync,
    wanted: impl Fn(usize) -> bool + Sync,
) -> Result<Vec<(usize, Vec<f64>)>, Error> {
    let found: Vec<(usize, Vec<f64>)> = (0..stiffness.n())
        .into_par_iter()
        .with_min_len(1 << 12)
        .filter(|&dof| wanted(dof))
        .filter_map(|dof| spring(stiffness, dof, m, of).map(|row| (dof, row)))
        .collect();
    let weak = |row: &[f64]| row.iter().all(|force| force.abs() < SPRING);
    if found.iter().any(|(_, row)| weak(row)) {
        return Err(Error::NotIterative {
            reason: "the stiffness has few digits, or weak springs, and supports do not hold a body",
        });
    }
    Ok(found)
}

/// The forces of the motions in a row of `K`, relative to their terms; `None` if all of them
/// are rounding.
fn spring<'a, I: Index>(
    stiffness: &Symmetric<'_, I>,
    dof: usize,
    m: usize,
    of: impl Fn(usize) -> &'a [f64],
) -> Option<Vec<f64>> {
    let (mut forces, mut sizes) = (vec![0.0; m], vec![0.0; m]);
    for (other, k) in stiffness.column(dof) {
        for ((force, size), z) in forces.iter_mut().zip(&mut sizes).zip(of(other)) {
            *force += k * z;
            *size += (k * z).abs();
        }
    }
    let mut any = false;
    for (force, size) in forces.iter_mut().zip(sizes) {
        if force.abs() <= ROUNDING * size {
            *force = 0.0;
        } else {
            *force /= size;
            any = true;
        }
    }
    any.then_some(forces)
}

/// Whether the columns are independent.
fn are_independent(mut columns: Vec<Vec<f64>>) -> bool {
    if columns.first().is_none_or(Vec::is_empty) {
        return columns.is_empty();
    }
    orthogonalise(&mut columns);
    let sizes = columns.iter().map(|column| norm(column));
    let (least, most) = sizes.fold((f64::INFINITY, 0.0_f64), |(least, most), size| {
        (least.min(size), most.max(size))
    });
    most > 0.0 && least > LEAST * most
}
