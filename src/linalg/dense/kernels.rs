//! faer's kernels on one thread, with the upper halves of the registers cleared afterwards.

use faer::linalg::matmul::triangular;
use faer::linalg::matmul::triangular::BlockStructure;
use faer::linalg::{matmul as product, triangular_solve};
use faer::{Accum, MatMut, MatRef, Par};

/// Clears the upper halves of the wide registers. faer's kernels do not: other code that the
/// same thread runs after them would be up to fifteen times slower, because each of its
/// instructions waits for the upper halves.
pub(super) fn leave_wide() {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx") {
        // SAFETY: the processor has the instruction, and no value of this code is in the upper
        // halves that it clears.
        unsafe { std::arch::x86_64::_mm256_zeroupper() }
    }
}

pub(super) fn faer_matmul(
    c: MatMut<'_, f64>,
    add: Accum,
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
    alpha: f64,
    par: Par,
) {
    product::matmul(c, add, a, b, alpha, par);
    leave_wide();
}

#[expect(clippy::too_many_arguments, reason = "faer's")]
pub(super) fn triangular_matmul(
    c: MatMut<'_, f64>,
    of_c: BlockStructure,
    add: Accum,
    a: MatRef<'_, f64>,
    of_a: BlockStructure,
    b: MatRef<'_, f64>,
    of_b: BlockStructure,
    alpha: f64,
    par: Par,
) {
    triangular::matmul(c, of_c, add, a, of_a, b, of_b, alpha, par);
    leave_wide();
}

/// faer's triangular solves of these names.
macro_rules! solves {
    ($($name:ident)+) => {$(
        pub(super) fn $name(triangle: MatRef<'_, f64>, x: MatMut<'_, f64>, par: Par) {
            triangular_solve::$name(triangle, x, par);
            leave_wide();
        }
    )+};
}

solves! {
    solve_lower_triangular_in_place
    solve_upper_triangular_in_place
    solve_unit_lower_triangular_in_place
    solve_unit_upper_triangular_in_place
}
