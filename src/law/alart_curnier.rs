//! The map of Alart and Curnier at one contact and its derivative, (19).
//!
//! In scaled variables, where ρ = 1, with `x = r − v`, `c = μ (x_n)₊`, `t = x_t/‖x_t‖`:
//!
//! ```text
//! x_n ≤ 0       open:  F = r
//! ‖x_t‖ ≤ c     stick: F = v
//! else          slip:  F = (v_n, r_t − c t)
//! ```
//!
//! That is `F = r − R(x)`, where `R(x)` is the reaction of a contact with `v = r − x`: the
//! response of a plastic point with springs of one. With cohesion or dilatancy it is the map.

use crate::law::cone::Status;
use crate::law::contact_law::ContactLaw;
use crate::law::plastic_point::{Rate, respond};
use crate::linalg::small::{Block, Vector, minus_scaled, tangential_norm};

/// `F ≈ value + by_r dr + by_v dv` at one contact.
#[derive(Clone, Copy, Debug)]
pub struct Linearised<const D: usize> {
    pub status: Status,
    pub value: Vector<D>,
    pub by_r: Block<D>,
    pub by_v: Block<D>,
}

impl<const D: usize> Linearised<D> {
    /// Rows without entries, of a contact that slips.
    pub fn empty() -> Self {
        Self {
            status: Status::Slip,
            value: Vector::zeros(),
            by_r: Block::zeros(),
            by_v: Block::zeros(),
        }
    }

    /// How many components of `v`, from the normal one, the rows make zero.
    pub fn held(&self) -> usize {
        match self.status {
            Status::Open => 0,
            Status::Slip => usize::from(self.by_r.row(0).iter().all(|&c| c == 0.0)),
            Status::Stick => D,
        }
    }
}

/// `F` and an element of its generalised derivative at `(r, v)`, scaled.
pub fn linearised<const D: usize>(
    r: &[f64; D],
    v: &[f64; D],
    law: impl Into<ContactLaw>,
) -> Linearised<D> {
    let law: ContactLaw = law.into();
    let mu = law.mu;
    let x = minus_scaled(r, 1.0, v);
    if !law.is_coulomb() {
        return respond_at(r, v, &x, &law);
    }
    if x[0] <= 0.0 {
        return open_rows(r, v, &law);
    }
    let c = mu * x[0];
    let length = tangential_norm(&x);
    let mut rows = Linearised {
        value: Vector::from(*v),
        ..Linearised::empty()
    };
    if mu > 0.0 && length <= c {
        (rows.status, rows.by_v) = (Status::Stick, Block::identity());
        return rows;
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
    rows.by_v[(0, 0)] = 1.0;
    for i in 1..D {
        rows.value[i] = r[i] - c * t[i];
        for j in 1..D {
            rows.by_r[(i, j)] = f64::from(u8::from(i == j)) - g[(i, j)];
            rows.by_v[(i, j)] = g[(i, j)];
        }
        rows.by_r[(i, 0)] = -mu * t[i];
        rows.by_v[(i, 0)] = mu * t[i];
    }
    rows
}

/// The rows of an open contact, also where `x` is not: `r_n = 0`, and friction up to the cohesion.
pub fn open_rows<const D: usize>(r: &[f64; D], v: &[f64; D], law: &ContactLaw) -> Linearised<D> {
    if law.cohesion == 0.0 {
        return Linearised {
            status: Status::Open,
            value: Vector::from(*r),
            by_r: Block::identity(),
            ..Linearised::empty()
        };
    }
    let mut x = minus_scaled(r, 1.0, v);
    x[0] = -1.0;
    let without_dilation = ContactLaw {
        dilatancy: 0.0,
        ..*law
    };
    respond_at(r, v, &x, &without_dilation)
}

/// `r − R(x)`, in the digits of `v` where that is zero.
fn respond_at<const D: usize>(
    r: &[f64; D],
    v: &[f64; D],
    x: &[f64; D],
    law: &ContactLaw,
) -> Linearised<D> {
    let at = respond(x, [1.0, 1.0], law, &Rate::default());
    let rests = at.flow[1..].iter().all(|&c| c == 0.0);
    let open = at.jacobian.row(0).iter().all(|&c| c == 0.0);
    let value = |k: usize| match k {
        0 if open => r[0],
        0 => v[0] - at.flow[0],
        _ if rests => v[k],
        _ => r[k] - at.stress[k],
    };
    Linearised {
        status: match (open, rests) {
            (true, _) => Status::Open,
            (false, true) => Status::Stick,
            (false, false) => Status::Slip,
        },
        value: Vector::from_fn(|k, _| value(k)),
        by_r: Block::identity() - at.jacobian,
        by_v: at.jacobian,
    }
}
