//! The error of S, and its bound.
//!
//! What is computed is the exact Schur complement of a matrix `K + ΔK`,
//! `|ΔK_ij| ≤ γ d_i d_j` with `d_i = √K_ii` and `γ` at most a rounding for each
//! unknown eliminated (Higham, *Accuracy and Stability*, theorem 10.3). With
//! `X = K_ci K_ii⁻¹` this moves S by `[−X I] ΔK [−X I]ᵀ`, that is
//!
//! ```text
//! |ΔS_ij| ≤ γ D_i D_j      D_i = d_i + Σ_k |X_ik| d_k
//! ```
//!
//! to first order: no unit, of the whole or of one unknown, is in it, and no
//! condition number. Rounding the entries of K once moves S as much, so no
//! algorithm does better.

use std::sync::Arc;

use bipot_rs::error::Error;
use bipot_rs::linalg::sparse::csc::Symmetric;
use bipot_rs::linalg::sparse::multifrontal::Factor;
use bipot_rs::linalg::sparse::symbolic::{Options, Symbolic};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::matrices::Sparse;
use crate::common::double_double::{self, Double};
use crate::common::{GO, with_threads};

/// Roundings `γ/ε` that are allowed. A bound on the sum of n roundings is n; as
/// they have either sign, and only the unknowns along a path of the elimination
/// tree meet, far fewer are left. The most of a hundred thousand random
/// matrices is 1.7.
pub(crate) const ROUNDINGS: f64 = 4.0;

pub(crate) fn factor_view(k: &Symmetric, kept: &[usize]) -> Result<Factor, Error> {
    let symbolic = Symbolic::analyse(k, kept, &Options::default())?;
    Factor::new(Arc::new(symbolic), k, &GO)
}

pub(crate) fn factor(k: &Sparse, kept: &[usize]) -> Result<Factor, Error> {
    factor_view(&k.view(), kept)
}

/// S, whose bits are those of its mirror image and the same on one thread and
/// on two.
pub(crate) fn schur(k: &Sparse, kept: &[usize]) -> Vec<f64> {
    let run = || factor(k, kept).unwrap().schur().to_vec();
    let (s, other) = (with_threads(1, run), with_threads(2, run));
    let m = kept.len();
    assert_eq!(s.len(), m * m);
    assert!(
        s.iter()
            .zip(&other)
            .all(|(a, b)| a.to_bits() == b.to_bits())
    );
    for i in 0..m {
        assert!((0..i).all(|j| s[i * m + j].to_bits() == s[j * m + i].to_bits()));
    }
    s
}

/// Distance of S from the truth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Errors {
    /// Largest error by the largest entry.
    pub(crate) of_largest: f64,
    /// Largest error of an entry `(i, j)` by `√(S_ii S_jj)`.
    pub(crate) of_diagonal: f64,
    /// Largest error of an entry by `ε D_i D_j`.
    pub(crate) roundings: f64,
}

/// The errors of S beside elimination in twice the precision.
pub(crate) fn errors(k: &Sparse, kept: &[usize]) -> Errors {
    let dense = k.dense();
    let exact = double_double::schur(k.n, &dense, kept);
    let of_factor = compare(&schur(k, kept), &exact, &reach(k.n, &dense, kept));
    assert!(of_factor.roundings <= ROUNDINGS, "{of_factor:?}");
    of_factor
}

/// What one rounding of every entry of K does to S: no algorithm that starts from
/// rounded entries can be trusted with more. The worst of some draws, for few numbers
/// may decide: a stiff grain afloat in soft ground is off by what the rounding of its
/// six rigid motions happens to be, and one draw may be lucky with them.
pub(crate) fn errors_of_data(k: &Sparse, kept: &[usize]) -> Errors {
    const DRAWS: u64 = 4;
    let dense = k.dense();
    let exact = double_double::schur(k.n, &dense, kept);
    let reach = reach(k.n, &dense, kept);
    let draw = |seed| {
        let mut random = StdRng::seed_from_u64(seed);
        let mut rounded = dense.clone();
        for j in 0..k.n {
            for i in 0..=j {
                let up = [-1.0, 1.0][usize::from(random.random_bool(0.5))];
                let value = dense[j * k.n + i] * (1.0 + up * 0.5 * f64::EPSILON);
                (rounded[j * k.n + i], rounded[i * k.n + j]) = (value, value);
            }
        }
        let moved = double_double::schur(k.n, &rounded, kept);
        let moved: Vec<f64> = moved.iter().map(|d| d.high).collect();
        compare(&moved, &exact, &reach)
    };
    let worse = |a: Errors, b: Errors| Errors {
        of_largest: a.of_largest.max(b.of_largest),
        of_diagonal: a.of_diagonal.max(b.of_diagonal),
        roundings: a.roundings.max(b.roundings),
    };
    (2..=DRAWS).map(draw).fold(draw(1), worse)
}

pub(crate) fn compare(s: &[f64], exact: &[Double], reach: &[f64]) -> Errors {
    let m = reach.len();
    assert_eq!(s.len(), m * m);
    let largest = exact.iter().map(|e| e.high.abs()).fold(0.0, f64::max);
    let mut found = Errors {
        of_largest: 0.0,
        of_diagonal: 0.0,
        roundings: 0.0,
    };
    let worse = |known: &mut f64, error: f64, by: f64| {
        // No error of nothing is none; a NaN is infinitely wrong.
        let ratio = if error == 0.0 { 0.0 } else { error / by };
        *known = known.max(if ratio.is_nan() { f64::INFINITY } else { ratio });
    };
    for i in 0..m {
        for j in 0..m {
            let at = i * m + j;
            let error = (Double::from(s[at]) - exact[at]).high.abs();
            let diagonal = exact[i * m + i].high.abs().sqrt() * exact[j * m + j].high.abs().sqrt();
            worse(&mut found.of_largest, error, largest);
            worse(&mut found.of_diagonal, error, diagonal);
            worse(
                &mut found.roundings,
                error,
                f64::EPSILON * reach[i] * reach[j],
            );
        }
    }
    found
}

/// `D` of each kept unknown, by dense elimination and substitution: a bound
/// needs no more than plain precision.
pub(crate) fn reach(n: usize, dense: &[f64], kept: &[usize]) -> Vec<f64> {
    let d: Vec<f64> = (0..n).map(|i| dense[i * n + i].sqrt()).collect();
    let interior: Vec<usize> = (0..n).filter(|i| !kept.contains(i)).collect();
    // Rows of the interior, interior columns first.
    let order: Vec<usize> = interior.iter().chain(kept).copied().collect();
    let mut rows: Vec<Vec<f64>> = interior
        .iter()
        .map(|&i| order.iter().map(|&j| dense[i * n + j]).collect())
        .collect();
    for p in 0..rows.len() {
        let (done, below) = rows.split_at_mut(p + 1);
        let pivot = &done[p];
        for row in below.iter_mut().filter(|row| row[p] != 0.0) {
            let factor = row[p] / pivot[p];
            (p..n).for_each(|j| row[j] -= factor * pivot[j]);
        }
    }
    let back = |(c, &own): (usize, &usize)| {
        let mut x = vec![0.0; rows.len()];
        for p in (0..rows.len()).rev() {
            let later: f64 = (p + 1..rows.len()).map(|q| rows[p][q] * x[q]).sum();
            x[p] = (rows[p][rows.len() + c] - later) / rows[p][p];
        }
        let moved = x.iter().zip(&interior).map(|(x, &k)| x.abs() * d[k]);
        d[own] + moved.sum::<f64>()
    };
    kept.iter().enumerate().map(back).collect()
}
