//! The map of Alart and Curnier at one contact and its derivative, (19).
//!
//! In scaled variables, where ρ = 1, with `x = r − v`, `c = μ (x_n)₊`, `t = x_t/‖x_t‖`:
//!
//! ```text
//! x_n ≤ 0       open:  F = r
//! ‖x_t‖ ≤ c     stick: F = v
//! else          slip:  F = (v_n, r_t − c t)
//! ```

use crate::law::cone::Status;
use crate::linalg::small::{Block, Vector, tangential_norm};

/// `F ≈ value + by_r dr + by_v dv` at one contact.
#[derive(Clone, Copy, Debug)]
pub struct Linearised<const D: usize> {
    pub status: Status,
    pub value: Vector<D>,
    pub by_r: Block<D>,
    pub by_v: Block<D>,
}

/// `F` and an element of its generalised derivative at `(r, v)`, scaled.
#[must_use]
pub fn linearised<const D: usize>(r: &[f64; D], v: &[f64; D], mu: f64) -> Linearised<D> {
    let x: [f64; D] = std::array::from_fn(|k| r[k] - v[k]);
    if x[0] <= 0.0 {
        return Linearised {
            status: Status::Open,
            value: Vector::from(*r),
            by_r: Block::identity(),
            by_v: Block::zeros(),
        };
    }
    let c = mu * x[0];
    let length = tangential_norm(&x);
    if mu > 0.0 && length <= c {
        return Linearised {
            status: Status::Stick,
            value: Vector::from(*v),
            by_r: Block::zeros(),
            by_v: Block::identity(),
        };
    }
    // Slip; without friction the tangential reaction is zero.
    let mut t = Vector::<D>::zeros();
    let mut g = Block::<D>::zeros();
    if mu > 0.0 {
        t = Vector::from(x) / length;
        t[0] = 0.0;
        // (c/‖x_t‖)(I − t tᵀ): the derivative of c t.
        g = (Block::identity() - t * t.transpose()) * (c / length);
    }
    let mut slip = Linearised {
        status: Status::Slip,
        value: Vector::from(*v),
        by_r: Block::zeros(),
        by_v: Block::zeros(),
    };
    slip.by_v[(0, 0)] = 1.0;
    for i in 1..D {
        slip.value[i] = r[i] - c * t[i];
        for j in 1..D {
            slip.by_r[(i, j)] = f64::from(u8::from(i == j)) - g[(i, j)];
            slip.by_v[(i, j)] = g[(i, j)];
        }
        slip.by_r[(i, 0)] = -mu * t[i];
        slip.by_v[(i, 0)] = mu * t[i];
    }
    slip
}
