//! Near-null vectors from the matrix alone, where no coordinates give the rotations.
//!
//! Multigrid with the translations as its only motions removes what these represent. What is left
//! of irregular vectors after a few cycles are the motions that it cannot remove: they become
//! near-null vectors in addition [Brezina et al. 2005].

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::block_matrix::BlockMatrix;
use crate::linalg::amg::multigrid::Multigrid;
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::settings::CycleSettings;
use crate::linalg::amg::symmetric_blocks::SymmetricBlocks;
use crate::linalg::amg::tuning;
use crate::linalg::conjugate_gradients;
use crate::linalg::parallel::{axpy, largest, map, norm, zero_where};
use crate::linalg::random_signs::random_signs;

/// The residual that the check must reach: a free motion has a part of about one in an irregular
/// vector of `n` plus and minus ones, whose norm is `√n`, and that part of the residual stays. It
/// is far below `1/√n` and far above rounding.
const SMALL: f64 = 1e-9;

/// Rounding of `K x` in units of that part, from which on the motion is free: K then resists it by
/// its own rounding alone, about `ε |K|`, and the solution is as large as one over this. A support
/// may be 1e11 times softer than its body.
const ROUNDING: f64 = 1e-2;

/// Replaces the rotations among the motions of `about`, which are zero, by motions that the
/// translations do not represent. `single` is `matrix` in single precision.
///
/// # Errors
/// As [`Multigrid::new`]; [`Error::Multigrid`] too if the equations cannot be solved, such as
/// those of a body that is free to move.
pub fn complete(
    about: &mut LevelNodes,
    matrix: &SymmetricBlocks,
    single: &BlockMatrix,
    settings: &CycleSettings,
    stop: &AtomicBool,
) -> Result<(), Error> {
    let held = matrix.held();
    let (b, n) = (matrix.block_size(), held.len());
    let m = about.motions.len() / n.max(1);
    let cycle =
        |about: &LevelNodes| Multigrid::new(single.clone(), about.clone(), held, settings, stop);
    let free = |seed| {
        let mut x = random_signs(n, seed);
        zero_where(held, true, &mut x);
        x
    };
    let mut multigrid = cycle(about)?;
    let (mut product, mut change) = (vec![0.0; n], vec![0.0; n]);
    for k in b..m {
        let mut x = free(k as u64);
        for _ in 0..tuning::softening_cycles() {
            matrix.product(&x, &mut product);
            zero_where(held, true, &mut product);
            multigrid.apply(&product, &mut change);
            zero_where(held, true, &mut change);
            axpy(-1.0, &change, &mut x);
            // No unit of K or of the vector may leave the range of numbers.
            let size = largest(&x);
            if size > 0.0 {
                map(&mut x, |x| x / size);
            }
        }
        for (row, x) in about.motions.chunks_exact_mut(m).zip(x) {
            row[k] = x;
        }
    }
    drop(multigrid);
    let mut multigrid = cycle(about)?;
    let found = conjugate_gradients::solve(
        |x, out| {
            matrix.product(x, out);
            zero_where(held, true, out);
        },
        |r, z| {
            multigrid.apply(r, z);
            zero_where(held, true, z);
        },
        &free(0),
        SMALL,
        tuning::check_products(),
        stop,
    )?;
    matrix.absolute_product(&found.x, &mut product);
    if found.reached && f64::EPSILON * norm(&product) < ROUNDING {
        Ok(())
    } else {
        Err(Error::Multigrid {
            reason: "the equations of the supported bodies are not solved",
        })
    }
}
