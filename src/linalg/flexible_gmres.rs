//! GMRES with a preconditioner that may change from step to step, with restarts.

use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_running};
use crate::linalg::krylov_triangle::KrylovTriangle;
use crate::linalg::pages::zeros;
use crate::linalg::parallel::{axpy, dot, largest, map, map2, norm};
use crate::linalg::power_of_two::{exponent, factors};
use crate::linalg::real::Real;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Of `‖b − A x‖ / ‖b‖`.
    pub tol: f64,
    /// Steps between restarts. Each takes 8 bytes for each unknown.
    pub restart: usize,
    /// Products with the matrix, those of restarts not counted.
    pub most: usize,
}

/// The result of flexible GMRES.
#[derive(Clone, Debug)]
pub struct FlexibleSolution {
    pub x: Vec<f64>,
    /// Products with preconditioned directions.
    pub products: usize,
    /// `‖b − A x‖ / ‖b‖`: from the recurrence since the last restart, which began with the true
    /// residual, as far as the basis resolves it.
    pub residual: f64,
    /// Whether `residual` is at most the tolerance.
    pub reached: bool,
}

/// A preconditioned direction in single precision. The preconditioner computes in single
/// precision, so nothing is lost.
type Direction = Vec<f32>;

/// Part of the residual that a space leaves at the least: its basis in single precision is
/// orthogonal to some 1e-7.
const SPACE: f64 = 1e-5;
/// Below this part of the residual that a space starts with, the recurrence is rounding.
const ROUNDING: f64 = 1e-6;

/// Minimises `‖b − A x‖` over growing spaces of preconditioned directions [Saad 1993]. A small
/// tolerance takes several spaces, each with its equal part: the residual that a space starts with
/// is exact.
///
/// `apply` writes `A x` to its second argument; `precondition` writes `M⁻¹ v`.
pub fn solve(
    mut apply: impl FnMut(&[f64], &mut [f64]),
    mut precondition: impl FnMut(&[f64], &mut [f64]),
    b: &[f64],
    limits: Limits,
    stop: &AtomicBool,
) -> Result<FlexibleSolution, Error> {
    let size = norm(b);
    let mut found = FlexibleSolution {
        x: vec![0.0; b.len()],
        products: 0,
        residual: if size == 0.0 { 0.0 } else { 1.0 },
        reached: size == 0.0,
    };
    let mut r = b.to_vec();
    let (mut z, mut w) = (vec![0.0; b.len()], vec![0.0; b.len()]);
    while !found.reached && found.products < limits.most {
        let start = norm(&r);
        let left = limits.tol / found.residual;
        let goal = found.residual * left.powf((left.ln() / SPACE.ln()).ceil().max(1.0).recip());
        let mut space = Space::new(std::mem::take(&mut r), start);
        while space.directions.len() < limits.restart.max(1) && found.products < limits.most {
            check_running(stop)?;
            precondition(&space.last, &mut z);
            let direction = rounded(&mut z);
            apply(&z, &mut w);
            found.products += 1;
            let grows = space.extend(direction, &mut w);
            found.residual = space.triangle.residual() / size;
            if !grows || found.residual <= goal.max(limits.tol) {
                break;
            }
        }
        let progress = space.triangle.residual() < start;
        space.add_minimiser(&mut found.x);
        found.reached = found.residual <= limits.tol && found.residual * size >= ROUNDING * start;
        if !progress {
            break; // a singular matrix, or rounding
        }
        if !found.reached {
            r = vec![0.0; b.len()];
            apply(&found.x, &mut r);
            map2(&mut r, b, |product, b| b - product);
            found.residual = norm(&r) / size;
            found.reached = found.residual <= limits.tol;
        }
    }
    Ok(found)
}

/// Scales a direction by a power of two to the range of single precision and rounds it. GMRES
/// may scale each direction: its coefficient changes in return.
fn rounded(z: &mut [f64]) -> Direction {
    let size = largest(z);
    let [first, second] = factors(if size.is_finite() { -exponent(size) } else { 0 });
    let mut direction: Direction = zeros(z.len());
    map2(&mut direction, z, |_, z: f64| {
        f32::rounded(z * first * second)
    });
    map2(z, &direction, |_, z: f32| z.double());
    direction
}

/// The Krylov space since the last restart.
struct Space {
    basis: Vec<Vec<f32>>,
    /// The last vector of the basis before it was rounded.
    last: Vec<f64>,
    directions: Vec<Direction>,
    triangle: KrylovTriangle,
}

impl Space {
    fn new(mut r: Vec<f64>, size: f64) -> Self {
        scale(&mut r, size);
        Self {
            basis: vec![single(&r)],
            last: r,
            directions: Vec::new(),
            triangle: KrylovTriangle::new(size),
        }
    }

    /// Adds a direction and its product `w`, which is changed. Returns whether the space can grow
    /// further.
    fn extend(&mut self, direction: Direction, w: &mut Vec<f64>) -> bool {
        /// What is left of a vector below this part of it has lost digits to cancellation.
        const CANCELLED: f64 = 0.1;
        let before = norm(w);
        let mut column = vec![0.0; self.basis.len()];
        self.orthogonalise(w, &mut column);
        let mut length = norm(w);
        if length < CANCELLED * before {
            self.orthogonalise(w, &mut column);
            length = norm(w);
        }
        if !self.triangle.extend(column, length, f64::EPSILON * before) {
            return false;
        }
        self.directions.push(direction);
        let grows = length > f64::EPSILON * before;
        if grows {
            scale(w, length);
            self.basis.push(single(w));
            std::mem::swap(&mut self.last, w);
        }
        grows
    }

    /// Removes the components of `w` along the basis, one after another.
    fn orthogonalise(&self, w: &mut [f64], column: &mut [f64]) {
        for (h, q) in column.iter_mut().zip(&self.basis) {
            let along = dot(q, w);
            *h += along;
            axpy(-along, q, w);
        }
    }

    /// `x ← x + Z y`, `y` the solution of the triangle.
    fn add_minimiser(self, x: &mut [f64]) {
        for (y, direction) in self.triangle.solve().iter().zip(&self.directions) {
            axpy(*y, direction, x);
        }
    }
}

fn single(w: &[f64]) -> Vec<f32> {
    let mut rounded = zeros(w.len());
    map2(&mut rounded, w, |_, w: f64| f32::rounded(w));
    rounded
}

/// `w ← w / length`.
fn scale(w: &mut [f64], length: f64) {
    map(w, |w| w / length);
}
