//! Finds the rigid motions of a body from its geometry, part 1 of the theorem.
//!
//! If the positions of the degrees of freedom are known, all rigid motions `Z` are known
//! exactly. The motions that supports leave free follow from the rank of the few columns `K Z`,
//! on the rows above rounding. No eigenvalue of a stiffness decides it, so a body that bends
//! softly is never taken for a free one.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::bodies::basis::list_motions;
use crate::bodies::directions::{DofDirection, find_directions};
use crate::bodies::rank::{Combinations, SAME_BODY, keep_independent};
use crate::bodies::resistance::{ROUNDING, measure_resistance};
use crate::bodies::tuning;
use crate::linalg::jacobi::{combine, orthogonalise};
use crate::linalg::small::{add_scaled, amax, dot_long, norm};
use crate::linalg::sparse::rows::OwnedMatrix;

/// [`ROUNDING`] for a combination of motions, which adds the rounding of the rotations.
const COMBINED: f64 = 4.0 * ROUNDING;

/// Rows of one task.
const ROWS: usize = 1 << 12;

/// What a mesh says of its degrees of freedom, where positions do not tell it.
#[derive(Clone, Copy, Debug)]
pub struct Kinematics<'a> {
    /// What all rigid motions move at each degree of freedom, `n × m` by rows; a body may be far
    /// from the centre of its rotations.
    pub motions: &'a [f64],
    /// The terms from which the entries of each row of `K` were summed, in times these entries:
    /// of a rigid set whose stiffness is that of many nodes, little is left.
    pub loss: &'a [f64],
}

/// The position and the direction of each degree of freedom.
#[derive(Debug)]
pub struct Geometry {
    places: Vec<[f64; 3]>,
    dimension: usize,
    /// Whether the stiffness couples a degree of freedom to a prescribed one: its row is not in
    /// balance in a rigid motion of all others.
    supported: Vec<bool>,
    directions: OnceLock<Vec<Option<DofDirection>>>,
    /// The rigid motions and the losses of [`Kinematics`].
    known: Option<(Vec<f64>, Vec<f64>)>,
}

impl Geometry {
    pub fn new(
        places: Vec<[f64; 3]>,
        dimension: usize,
        supported: Vec<bool>,
        known: Option<Kinematics<'_>>,
    ) -> Self {
        Self {
            places,
            dimension,
            supported,
            directions: OnceLock::new(),
            known: known.map(|mesh| (mesh.motions.to_vec(), mesh.loss.to_vec())),
        }
    }

    /// The positions of some degrees of freedom.
    pub fn list_places(&self, dofs: &[usize]) -> Vec<[f64; 3]> {
        dofs.iter().map(|&i| self.places[i]).collect()
    }

    /// Rigid motions that the stiffness `k` of a body leaves free, a basis over its degrees of
    /// freedom `dofs`. `None` if the directions of the degrees of freedom cannot be found, or do
    /// not fit the stiffness.
    pub fn find_free_motions(&self, dofs: &[usize], k: &OwnedMatrix) -> Option<Vec<Vec<f64>>> {
        let motions = self.list_motions(dofs)?;
        let measure = |i: usize| {
            let motion = |j: usize, k: usize| motions[k][j];
            let loss = self.known.as_ref().map_or(1.0, |(_, loss)| loss[dofs[i]]);
            let forces = measure_resistance(k.entries(i), motions.len(), motion, loss);
            forces.map(|forces| (i, forces))
        };
        let rows = (0..dofs.len()).into_par_iter().with_min_len(ROWS);
        let resisting: Vec<(usize, Vec<f64>)> = rows.filter_map(measure).collect();
        let unsupported = |i: &usize| !self.supported[dofs[*i]];
        let tell = (0..dofs.len()).filter(unsupported).count();
        let against = resisting
            .iter()
            .map(|(i, _)| *i)
            .filter(unsupported)
            .count();
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        if against as f64 > (1.0 - tuning::believed_share()) * tell as f64 {
            return None;
        }
        let column = |k: usize| resisting.iter().map(|(_, forces)| forces[k]).collect();
        let resisted = Combinations::new((0..motions.len()).map(column).collect());
        let free = resisted.columns.iter().zip(&resisted.amounts);
        let free = free.filter(|(resisted, _)| amax(resisted) <= COMBINED * f64::EPSILON);
        Some(
            free.map(|(_, amounts)| combine(&motions, amounts))
                .collect(),
        )
    }

    /// Whether a motion of a body is rigid, with or without supports.
    pub fn is_rigid(&self, dofs: &[usize], motion: &[f64]) -> bool {
        let Some(mut rigid) = self.list_motions(dofs) else {
            return false;
        };
        let _ = orthogonalise(&mut rigid);
        let mut rest = motion.to_vec();
        for z in &rigid {
            let along = dot_long(z, motion) / dot_long(z, z);
            add_scaled(&mut rest, -along, z);
        }
        norm(&rest) <= tuning::near_rigid() * norm(motion)
    }

    /// All rigid motions of these degrees of freedom, linearly independent, of size 1.
    fn list_motions(&self, dofs: &[usize]) -> Option<Vec<Vec<f64>>> {
        if let Some((motions, loss)) = &self.known {
            return Some(restrict(motions, motions.len() / loss.len().max(1), dofs));
        }
        let all = self
            .directions
            .get_or_init(|| find_directions(&self.places, self.dimension));
        let directions: Vec<DofDirection> = dofs.iter().map(|&i| all[i]).collect::<Option<_>>()?;
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
        let mut motions = list_motions(self.dimension);
        if !(reach > 0.0) {
            motions.truncate(self.dimension);
        }
        let columns = motions.iter().map(|motion| {
            let at = directions.iter().zip(dofs);
            at.map(|(&direction, &i)| motion.at(direction, arm(i), reach))
                .collect()
        });
        // A point, or a line in space, has fewer motions than columns.
        Some(keep_independent(columns.collect(), SAME_BODY))
    }
}

/// The independent ones of `m` motions at some degrees of freedom, orthogonal, of size 1.
fn restrict(motions: &[f64], m: usize, dofs: &[usize]) -> Vec<Vec<f64>> {
    let column = |k: usize| dofs.iter().map(|&i| motions[i * m + k]).collect();
    let of = Combinations::new((0..m).map(column).collect());
    let exceeds: Vec<bool> = of.exceed(SAME_BODY).collect();
    let kept = of.columns.into_iter().zip(exceeds);
    kept.filter_map(|(mut z, exceeds)| {
        let largest = amax(&z);
        for x in &mut z {
            *x /= largest;
        }
        (exceeds && largest > 0.0).then_some(z)
    })
    .collect()
}
