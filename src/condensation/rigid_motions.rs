//! Finds the rigid motions of a body from its geometry.
//!
//! If the positions of the degrees of freedom are known, all rigid motions `Z` are known
//! exactly. The motions that supports leave free follow from the rank of the few columns `K Z`,
//! on the rows above rounding. No eigenvalue of a stiffness decides it, so a body that bends
//! softly is never taken for a free one.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::condensation::sparse::OwnedMatrix;
use crate::linalg::jacobi::{combine, orthogonalise};
use crate::linalg::small::{dot_long, norm};

/// `|K z|` of a rigid motion of size 1, over the sum of sizes of a row, in ε. Assembled
/// stiffnesses of first and second order, also of flat elements, give at most 1.2, and more
/// after a rotation. A spring or a support gives its share of the row.
const ROUNDING: f64 = 64.0;

/// The same for a combination of motions, which adds the rounding of the rotations.
const COMBINED: f64 = 256.0;

/// Least share of the rows without supports that must be in balance to accept the directions
/// found: with wrong ones hardly any row is.
const BELIEVED: f64 = 0.25;

/// Smaller columns, relative to the largest, belong to motions that the body does not have,
/// such as the rotation of a straight line about itself.
const NO_MOTION: f64 = 1e-10;

/// The position and the direction of each degree of freedom.
#[derive(Debug)]
pub struct Geometry {
    places: Vec<[f64; 3]>,
    dimension: usize,
    /// Whether the stiffness couples a degree of freedom to a prescribed one: its row is not in
    /// balance in a rigid motion of all others.
    supported: Vec<bool>,
    directions: OnceLock<Vec<Option<DofDirection>>>,
}

/// The kind of a degree of freedom: a displacement along an axis, or a rotation about one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DofDirection {
    Along(usize),
    About(usize),
}

impl Geometry {
    #[must_use]
    pub fn new(places: Vec<[f64; 3]>, dimension: usize, supported: Vec<bool>) -> Self {
        Self {
            places,
            dimension,
            supported,
            directions: OnceLock::new(),
        }
    }

    /// Rigid motions of a body without supports, a basis over its degrees of freedom `dofs` of
    /// the stiffness `k`. `None` if the directions of the degrees of freedom cannot be found,
    /// or do not fit the stiffness.
    #[must_use]
    pub fn left_free(&self, dofs: &[usize], k: &OwnedMatrix) -> Option<Vec<Vec<f64>>> {
        let motions = self.motions(dofs)?;
        let nothing = vec![0.0; dofs.len()];
        let forces: Vec<Vec<f64>> = motions
            .par_iter()
            .map(|z| k.residual(z, &nothing))
            .collect();
        let mut sizes = vec![0.0; dofs.len()];
        k.add_absolute_product(&vec![1.0; dofs.len()], &mut sizes);
        let held: Vec<usize> = (0..dofs.len())
            .filter(|&i| {
                forces
                    .iter()
                    .any(|f| f[i].abs() > ROUNDING * f64::EPSILON * sizes[i])
            })
            .collect();
        let unsupported = |i: &usize| !self.supported[dofs[*i]];
        let tell = (0..dofs.len()).filter(unsupported).count();
        let against = held.iter().copied().filter(unsupported).count();
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        if against as f64 > (1.0 - BELIEVED) * tell as f64 {
            return None;
        }
        let mut resisted: Vec<Vec<f64>> = forces
            .iter()
            .map(|f| held.iter().map(|&i| f[i] / sizes[i]).collect())
            .collect();
        let amounts = orthogonalise(&mut resisted);
        let free = resisted.iter().zip(&amounts).filter(|(resisted, _)| {
            let largest = resisted.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            largest <= COMBINED * f64::EPSILON
        });
        Some(
            free.map(|(_, amounts)| combine(&motions, amounts))
                .collect(),
        )
    }

    /// Whether a motion of a body is rigid, with or without supports.
    #[must_use]
    pub fn is_rigid(&self, dofs: &[usize], motion: &[f64]) -> bool {
        /// Largest difference between a motion found by iteration and a rigid one.
        const NEAR: f64 = 1e-3;
        let Some(mut rigid) = self.motions(dofs) else {
            return false;
        };
        orthogonalise(&mut rigid);
        let mut rest = motion.to_vec();
        for z in &rigid {
            let along = dot_long(z, motion) / dot_long(z, z);
            for (value, z) in rest.iter_mut().zip(z) {
                *value -= along * z;
            }
        }
        norm(&rest) <= NEAR * norm(motion)
    }

    /// All rigid motions of these degrees of freedom, linearly independent, of size 1.
    fn motions(&self, dofs: &[usize]) -> Option<Vec<Vec<f64>>> {
        let all = self
            .directions
            .get_or_init(|| directions(&self.places, self.dimension));
        let own: Vec<DofDirection> = dofs.iter().map(|&i| all[i]).collect::<Option<_>>()?;
        let d = self.dimension;
        let mut centre = [0.0; 3];
        for &i in dofs {
            for (c, x) in centre.iter_mut().zip(&self.places[i]) {
                #[expect(clippy::cast_precision_loss, reason = "a count")]
                let count = dofs.len() as f64;
                *c += x / count;
            }
        }
        let arm = |i: usize| -> [f64; 3] { std::array::from_fn(|k| self.places[i][k] - centre[k]) };
        let reach = dofs
            .iter()
            .flat_map(|&i| arm(i))
            .fold(0.0_f64, |m, x| m.max(x.abs()));
        let translation = |axis: usize| {
            let of = |own: &DofDirection| f64::from(u8::from(*own == DofDirection::Along(axis)));
            own.iter().map(of).collect::<Vec<_>>()
        };
        let rotation = |axis: usize| {
            // e_axis × x has −x_b along a and x_a along b, (axis, a, b) in cyclic order.
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            let of = |(own, &i): (&DofDirection, &usize)| match *own {
                DofDirection::Along(k) if k == a => -arm(i)[b] / reach,
                DofDirection::Along(k) if k == b => arm(i)[a] / reach,
                DofDirection::About(k) if k == axis => 1.0 / reach,
                _ => 0.0,
            };
            own.iter().zip(dofs).map(of).collect::<Vec<_>>()
        };
        let mut found: Vec<Vec<f64>> = (0..d).map(translation).collect();
        if reach > 0.0 {
            let axes = if d == 2 { 2..3 } else { 0..3 };
            found.extend(axes.map(rotation));
        }
        // A point, or a line in space, has fewer motions than columns.
        let mut independent = found.clone();
        let amounts = orthogonalise(&mut independent);
        let largest = independent.iter().map(|z| norm(z)).fold(0.0, f64::max);
        if independent.iter().all(|z| norm(z) > NO_MOTION * largest) {
            return Some(found);
        }
        let kept = independent.iter().zip(&amounts);
        let kept = kept.filter(|(z, _)| norm(z) > NO_MOTION * largest);
        Some(kept.map(|(_, amounts)| combine(&found, amounts)).collect())
    }
}

/// Directions of degrees of freedom from their positions. Those at one position are, in
/// ascending order, displacements along the axes, then rotations if their number is that of a
/// node of a beam or a shell. Bodies that touch share positions: then runs of consecutive
/// numbers are nodes.
fn directions(places: &[[f64; 3]], dimension: usize) -> Vec<Option<DofDirection>> {
    let key = |i: usize| places[i].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&i| (key(i), i));
    let mut found = vec![None; places.len()];
    for at_place in order.chunk_by(|&i, &j| key(i) == key(j)) {
        for node in nodes(at_place, dimension) {
            for (k, &dof) in node.iter().enumerate() {
                found[dof] = Some(if k < dimension {
                    DofDirection::Along(k)
                } else if dimension == 2 {
                    DofDirection::About(2)
                } else {
                    DofDirection::About(k - 3)
                });
            }
        }
    }
    found
}

/// The nodes at one position, each with its degrees of freedom in the order of directions.
fn nodes(dofs: &[usize], dimension: usize) -> Vec<Vec<usize>> {
    let with_rotations = if dimension == 2 { 3 } else { 6 };
    let of_node = |count: usize| count == dimension || count == with_rotations;
    let runs: Vec<&[usize]> = dofs.chunk_by(|i, j| j - i == 1).collect();
    if runs.iter().all(|run| of_node(run.len())) {
        return runs.into_iter().map(<[usize]>::to_vec).collect();
    }
    if of_node(dofs.len()) {
        return vec![dofs.to_vec()];
    }
    if runs.iter().all(|run| run.len().is_multiple_of(dimension)) {
        return runs
            .iter()
            .flat_map(|run| run.chunks(dimension))
            .map(<[usize]>::to_vec)
            .collect();
    }
    if dofs.len().is_multiple_of(dimension) {
        // First all x, then all y: for each axis one from each node.
        let count = dofs.len() / dimension;
        let node = |k: usize| (0..dimension).map(|axis| dofs[axis * count + k]).collect();
        return (0..count).map(node).collect();
    }
    Vec::new()
}
