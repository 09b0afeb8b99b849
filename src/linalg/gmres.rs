//! GMRES with right preconditioning, without restarts.

use crate::linalg::krylov_triangle::KrylovTriangle;
use crate::linalg::small::{add_scaled, norm, take_out};

/// `A x`, or the error of the product.
pub type Product<'a, E> = &'a dyn Fn(&[f64]) -> Result<Vec<f64>, E>;

/// The result of GMRES.
#[derive(Clone, Debug)]
pub struct GmresSolution {
    pub x: Vec<f64>,
    /// Products with the matrix used.
    pub products: usize,
    /// `‖b − A x‖ / ‖b‖` from the recurrence, plus its rounding.
    pub residual: f64,
}

/// Minimises `‖b − A M⁻¹ y‖` over growing Krylov spaces, `x = M⁻¹ y`, until the residual is
/// `tol ‖b‖` or `most` products are used.
///
/// `apply` is `A`; `precondition` is `M⁻¹`, in place. An error of either is returned.
pub fn solve<E>(
    apply: Product<'_, E>,
    precondition: &dyn Fn(&mut [f64]),
    b: &[f64],
    tol: f64,
    most: usize,
) -> Result<GmresSolution, E> {
    let size = norm(b);
    let mut found = GmresSolution {
        x: vec![0.0; b.len()],
        products: 0,
        residual: 0.0,
    };
    if size == 0.0 {
        return Ok(found);
    }
    let mut basis = vec![b.iter().map(|value| value / size).collect::<Vec<f64>>()];
    let mut triangle = KrylovTriangle::new(size);
    found.residual = 1.0;
    let mut largest = 0.0_f64;
    while found.products < most && found.residual > tol {
        let mut direction = basis[basis.len() - 1].clone();
        precondition(&mut direction);
        let mut w = apply(&direction)?;
        found.products += 1;
        let before = norm(&w);
        largest = largest.max(before);
        let mut column = vec![0.0; basis.len()];
        // Two passes give orthogonality up to rounding.
        for _ in 0..2 {
            for (h, q) in column.iter_mut().zip(&basis) {
                *h += take_out(&mut w, q);
            }
        }
        let length = norm(&w);
        if !triangle.extend(column, length, 0.0) {
            break;
        }
        found.residual = triangle.residual() / size;
        if length <= f64::EPSILON * before {
            break; // the space holds the solution
        }
        basis.push(w.iter().map(|value| value / length).collect());
    }
    let amounts = triangle.solve();
    // The recurrence does not contain the rounding of the products, which is as large as the
    // solution. If the solution has grown without bound, the matrix is singular.
    found.residual += 4.0 * f64::EPSILON * largest * norm(&amounts) / size;
    for (y, q) in amounts.iter().zip(&basis) {
        add_scaled(&mut found.x, *y, q);
    }
    precondition(&mut found.x);
    Ok(found)
}
