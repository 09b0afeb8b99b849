//! Conjugate gradients with a preconditioner.

use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_running};
use crate::linalg::parallel::{axpy, dot, norm, xpay};

/// The result of conjugate gradients.
#[derive(Clone, Debug)]
pub struct CgSolution {
    pub x: Vec<f64>,
    /// Products with the matrix used.
    pub products: usize,
    /// `‖b − A x‖ / ‖b‖` from the recurrence.
    pub residual: f64,
    /// Whether `residual` is at most the tolerance.
    pub reached: bool,
}

/// Solves `A x = b`, `A` symmetric positive semidefinite and `b` in its range, until the residual
/// is `tol ‖b‖` or `most` products are used. It ends earlier where the energy of a direction is
/// not positive: `A` or the preconditioner is then not positive definite, or rounding is reached.
///
/// `apply` writes `A x` to its second argument; `precondition` writes `M⁻¹ r`. The change of the
/// residual enters the direction (Polak and Ribière), because a preconditioner in single
/// precision is not quite constant.
pub fn solve(
    mut apply: impl FnMut(&[f64], &mut [f64]),
    mut precondition: impl FnMut(&[f64], &mut [f64]),
    b: &[f64],
    tol: f64,
    most: usize,
    stop: &AtomicBool,
) -> Result<CgSolution, Error> {
    let n = b.len();
    let size = norm(b);
    let mut found = CgSolution {
        x: vec![0.0; n],
        products: 0,
        residual: if size == 0.0 { 0.0 } else { 1.0 },
        reached: size == 0.0,
    };
    let mut r = b.to_vec();
    let (mut z, mut p, mut q) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut last, mut across) = (1.0, 0.0);
    while !found.reached && found.products < most {
        check_running(stop)?;
        precondition(&r, &mut z);
        let along = dot(&r, &z);
        let beta = if found.products == 0 {
            0.0
        } else {
            (along - across) / last
        };
        last = along;
        xpay(&z, beta, &mut p);
        apply(&p, &mut q);
        found.products += 1;
        let energy = dot(&p, &q);
        let step = along / energy;
        if !(along > 0.0 && energy > 0.0 && step.is_finite()) {
            break;
        }
        axpy(step, &p, &mut found.x);
        axpy(-step, &q, &mut r);
        across = dot(&r, &z);
        found.residual = norm(&r) / size;
        found.reached = found.residual <= tol;
    }
    Ok(found)
}
