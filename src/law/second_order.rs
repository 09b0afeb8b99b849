//! The second-order cone `L = {x₀ ≥ ‖x_t‖}` at one contact, for interior-point methods.
//!
//! Coulomb's law is: `z = (μ r_n, r_t) ∈ L`, `s = (ṽ_n/μ, v_t) ∈ L`, `z·s = r·ṽ = 0`. Products
//! and scalings are those of the Jordan algebra of the cone [AG03], [NT97].

use crate::linalg::small::{Block, Vector};

/// `x₀² − ‖x_t‖²`, without the cancellation of squares.
pub fn determinant<const D: usize>(x: &Vector<D>) -> f64 {
    let t = tangential(x);
    (x[0] - t) * (x[0] + t)
}

/// `x ∘ y = (x·y, x₀ y_t + y₀ x_t)`.
pub fn product<const D: usize>(x: &Vector<D>, y: &Vector<D>) -> Vector<D> {
    let mut out = y * x[0] + x * y[0];
    out[0] = x.dot(y);
    out
}

/// The `y` of `x ∘ y = b`, `x` inside the cone.
pub fn quotient<const D: usize>(b: &Vector<D>, x: &Vector<D>) -> Vector<D> {
    let first = (2.0 * x[0] * b[0] - x.dot(b)) / determinant(x);
    let mut y = (b - x * first) / x[0];
    y[0] = first;
    y
}

/// The largest `α` for which `x + α dx` lies in the cone; infinite if all do.
pub fn longest_step<const D: usize>(x: &Vector<D>, dx: &Vector<D>) -> f64 {
    // The first positive root of `a α² + 2 b α + c`, c > 0.
    let (a, c) = (determinant(dx), determinant(x));
    let b = 2.0 * x[0] * dx[0] - x.dot(dx);
    let discriminant = b * b - a * c;
    let mut longest = f64::INFINITY;
    if discriminant >= 0.0 {
        let root = discriminant.sqrt();
        if b < 0.0 {
            longest = c / (root - b);
        } else if a < 0.0 {
            longest = (-b - root) / a;
        }
    }
    if dx[0] < 0.0 {
        longest = longest.min(-x[0] / dx[0]);
    }
    longest
}

/// The symmetric Nesterov–Todd matrix `P`, with `P z = P⁻¹ s = λ`.
#[derive(Clone, Copy, Debug)]
pub struct NesterovTodd<const D: usize> {
    pub forward: Block<D>,
    pub inverse: Block<D>,
    /// `λ`.
    pub point: Vector<D>,
}

impl<const D: usize> NesterovTodd<D> {
    /// Made from `z` and `s`; `None` if rounding has put one of them on the boundary.
    pub fn new(z: &Vector<D>, s: &Vector<D>) -> Option<Self> {
        let (of_z, of_s) = (determinant(z), determinant(s));
        if !(of_z > 0.0 && of_s > 0.0 && z[0] > 0.0 && s[0] > 0.0) {
            return None;
        }
        let mirrored = |x: &Vector<D>| {
            let mut y = -x;
            y[0] = x[0];
            y
        };
        let (unit_z, unit_s) = (z / of_z.sqrt(), s / of_s.sqrt());
        let half = (0.5 * (1.0 + unit_z.dot(&unit_s))).sqrt();
        let mut w = (unit_s + mirrored(&unit_z)) / (2.0 * half);
        w[0] += 1.0;
        w /= (2.0 * w[0]).sqrt();
        let beta = (of_s / of_z).sqrt().sqrt();
        let reflection = Block::from_diagonal(&mirrored(&Vector::repeat(1.0)));
        let back = mirrored(&w);
        let forward = (w * w.transpose() * 2.0 - reflection) * beta;
        let inverse = (back * back.transpose() * 2.0 - reflection) / beta;
        let point = forward * z;
        let sound = point.iter().all(|c| c.is_finite()) && determinant(&point) > 0.0;
        sound.then_some(Self {
            forward,
            inverse,
            point,
        })
    }
}

/// `‖x_t‖`.
pub fn tangential<const D: usize>(x: &Vector<D>) -> f64 {
    let squares: f64 = (1..D).map(|k| x[k] * x[k]).sum();
    squares.sqrt()
}
