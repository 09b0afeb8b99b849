//! Eigenvalues of symmetric matrices.

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{MatMut, MatRef, Par, Spec};

use crate::linalg::dense::kernels::leave_wide;

/// Eigenvalues, ascending, and eigenvectors, as columns, of a symmetric matrix. Its lower
/// triangle is read; the vectors replace `a`.
pub fn symmetric_eigen(a: &mut [f64], n: usize, values: &mut [f64]) {
    assert_eq!(a.len(), n * n);
    assert_eq!(values.len(), n);
    if n == 0 {
        return;
    }
    let matrix = a.to_vec();
    let scratch =
        self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Spec::default());
    self_adjoint_evd(
        MatRef::from_column_major_slice(&matrix, n, n),
        DiagMut::from_slice_mut(values),
        Some(MatMut::from_column_major_slice_mut(a, n, n)),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Spec::default(),
    )
    .expect("eigenvalues of a finite symmetric matrix");
    leave_wide();
}
