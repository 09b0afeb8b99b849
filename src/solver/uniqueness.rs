//! Whether an answer is the only one: a proof that it is, a proof that it is
//! not, or neither.
//!
//! In scaled variables, island by island, for `W` symmetric positive definite.
//!
//! *Only one*, whatever the load, if with `M = diag μ`
//!
//! ```text
//! λ_max(M½ W_tt M½) · λ_max(M½ (W⁻¹)_nn M½) < 4
//! ```
//!
//! because `r ↦ ṽ` is then strongly monotone: with `d = r − r'` and `‖·‖` of `W`,
//! `(ṽ − ṽ')·d ≥ ‖d‖² − Σ μ ‖(W d)_t‖ |d_n|`; Young's inequality with one weight θ
//! bounds the sum by `½ (θ ‖M½ P_t W d‖² + ‖M½ P_n d‖²/θ)`, and since `P_t P_nᵀ = 0`
//! the two quadratic forms live on subspaces orthogonal in `‖·‖`: the larger of
//! their norms counts, not the sum.
//!
//! *Others exist* if the index of this answer is −1: the map of Alart and Curnier
//! has degree +1, so the indices of all answers add up to one.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::small::{Block, Vector, dot_long, norm, tangential_norm};
use crate::problem::reduced::Reduced;
use crate::solver::{enumerate, newton};

/// What is known of the number of answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unique {
    Proved,
    OthersExist,
    Unknown,
}

impl Unique {
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Proved => "proved",
            Self::OthersExist => "others exist",
            Self::Unknown => "unknown",
        }
    }
}

/// Up to this many plane contacts, 4⁶ leaves in milliseconds, statuses are
/// exhausted where both criteria are silent.
const FEW: usize = 6;

/// `W` is symmetric to rounding below this, beside its largest entry.
const SYMMETRIC: f64 = 1e-13;

/// An answer this near to a border between statuses, beside the largest
/// `r̂ − v̂`, is on it.
const BORDER: f64 = 1e-8;

/// Newton corrections that an answer may need to be known that well.
const CORRECTIONS: usize = 3;

/// Above this condition rounding might turn the sign of a determinant.
const WORST_CONDITION: f64 = 1e10;

/// Whether the answer `r`, in the order of positions, is the only one.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn assess<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    if !problem.rigid.modes.is_empty() || problem.contradiction.is_some() {
        return Ok(Unique::Unknown);
    }
    let v = problem.relative_displacement(r, &[]);
    let mut verdict = Unique::Proved;
    for island in problem.compliance.islands() {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        match assess_island(problem, island.nodes.clone(), r, &v) {
            Unique::Proved => {}
            // The other islands may stay as they are.
            Unique::OthersExist => return Ok(Unique::OthersExist),
            Unique::Unknown => verdict = Unique::Unknown,
        }
    }
    Ok(verdict)
}

/// [`assess`] in the plane, where few contacts can be exhausted.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn assess_plane(
    problem: &Reduced<2>,
    r: &[[f64; 2]],
    stop: &AtomicBool,
) -> Result<Unique, Error> {
    let verdict = assess(problem, r, stop)?;
    if verdict != Unique::Unknown || problem.contacts() > FEW {
        return Ok(verdict);
    }
    let all = enumerate::answers(problem, stop)?;
    Ok(match (all.answers.len(), all.complete) {
        (2.., _) => Unique::OthersExist,
        (1, true) => Unique::Proved,
        _ => Unique::Unknown,
    })
}

fn assess_island<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Unique {
    let Some(matrix) = Friction::new(problem, nodes.clone()) else {
        return Unique::Unknown;
    };
    if !matrix.definite(0.0) {
        Unique::Unknown
    } else if matrix.symmetric && matrix.weak() {
        Unique::Proved
    } else if index(problem, nodes, r, v) == Some(-1.0) {
        Unique::OthersExist
    } else {
        Unique::Unknown
    }
}

/// The symmetric part of `Ŵ` on the components that friction can act on.
struct Friction {
    order: usize,
    /// Column by column.
    matrix: Vec<f64>,
    /// μ of the contact at normal components, and at tangential ones.
    normal: Vec<f64>,
    tangential: Vec<f64>,
    symmetric: bool,
    /// What rounding may have done to an eigenvalue.
    rounding: f64,
}

impl Friction {
    /// `None` where a component that nothing moves is not determined.
    ///
    /// Left out are tangents without friction, whose reaction is zero, and what is
    /// prescribed: rows and columns of zeros, where the rest determines `r` if the
    /// contact stays open or slides by a given amount.
    fn new<const D: usize>(problem: &Reduced<D>, nodes: Range<usize>) -> Option<Self> {
        let mut components = Vec::new();
        for node in nodes.clone() {
            for k in 0..D {
                if k > 0 && problem.mu[node] == 0.0 {
                    continue;
                }
                let felt = |other: usize| {
                    let acts = problem.compliance.pair(node, other).row(k).amax() > 0.0;
                    acts || problem.compliance.pair(other, node).column(k).amax() > 0.0
                };
                if nodes.clone().any(felt) {
                    components.push((node, k));
                } else if problem.q[node][k] == 0.0 {
                    return None;
                }
            }
        }
        let order = components.len();
        let mut matrix = vec![0.0; order * order];
        let (mut skew, mut size) = (0.0_f64, 0.0_f64);
        let scaling = &problem.scaling;
        let entry = |(i, k): (usize, usize), (j, l): (usize, usize)| {
            problem.compliance.pair(i, j)[(k, l)] * (scaling.to_v[i] / scaling.to_r[j])
        };
        for (c, &column) in components.iter().enumerate() {
            for (l, &row) in components.iter().enumerate().skip(c) {
                let (below, above) = (entry(row, column), entry(column, row));
                skew = skew.max((below - above).abs());
                size = size.max(below.abs()).max(above.abs());
                matrix[c * order + l] = 0.5 * (below + above);
            }
        }
        let of_components = |wanted: bool| {
            let mu = |&(node, k): &(usize, usize)| {
                if (k == 0) == wanted {
                    problem.mu[node]
                } else {
                    0.0
                }
            };
            components.iter().map(mu).collect::<Vec<f64>>()
        };
        #[expect(clippy::cast_precision_loss, reason = "an order of a matrix")]
        let n = order as f64;
        let trace: f64 = (0..order).map(|i| matrix[i * (order + 1)].abs()).sum();
        Some(Self {
            order,
            normal: of_components(true),
            tangential: of_components(false),
            matrix,
            symmetric: skew <= SYMMETRIC * size,
            // Cholesky's backward error is below (n + 2) ε tr W in norm; then n
            // times what scaling, and taking the symmetric part, do to an entry.
            rounding: (n + 2.0) * f64::EPSILON * trace
                + n * (4.0 * f64::EPSILON * size + skew.min(SYMMETRIC * size)),
        })
    }

    /// Whether `W − c Mₙ` is positive definite, rounding subtracted.
    fn definite(&self, c: f64) -> bool {
        let mut shifted = self.matrix.clone();
        for (i, mu) in self.normal.iter().enumerate() {
            shifted[i * (self.order + 1)] -= c * mu + self.rounding;
        }
        dense::cholesky(&mut shifted, self.order).is_ok()
    }

    /// The criterion: with `α ≥ λ_max(M½ W_tt M½)`, `(α/4) λ_max(M½ (W⁻¹)_nn M½) < 1`
    /// if and only if `W − (α/4) Mₙ` is positive definite.
    fn weak(&self) -> bool {
        self.largest_tangential()
            .is_some_and(|alpha| self.definite(0.25 * alpha))
    }

    /// An upper bound of `λ_max(M½ W_tt M½)` that is certain: a power iteration
    /// gives a lower one, and `c I − M½ W_tt M½` is shown to be definite for a `c`
    /// above it.
    fn largest_tangential(&self) -> Option<f64> {
        /// Products of the power iteration.
        const PRODUCTS: usize = 20;
        /// Tried above its result; the last ones for clustered eigenvalues.
        const ABOVE: [f64; 3] = [1.02, 1.1, 1.5];
        let rough: Vec<usize> = (0..self.order)
            .filter(|&i| self.tangential[i] > 0.0)
            .collect();
        let n = rough.len();
        if n == 0 {
            return Some(0.0);
        }
        let mut matrix = vec![0.0; n * n];
        for (c, &j) in rough.iter().enumerate() {
            for (l, &i) in rough.iter().enumerate().skip(c) {
                let entry = (self.tangential[i] * self.tangential[j]).sqrt()
                    * self.matrix[j * self.order + i];
                matrix[c * n + l] = entry;
                matrix[l * n + c] = entry;
            }
        }
        let mut x = signs(n, 0);
        let mut reached = 0.0;
        for _ in 0..PRODUCTS {
            let y: Vec<f64> = matrix
                .chunks_exact(n)
                .map(|row| dot_long(row, &x))
                .collect();
            let length = norm(&y);
            reached = length / norm(&x);
            x = y.iter().map(|value| value / length).collect();
        }
        let greatest = self.tangential.iter().fold(0.0_f64, |m, &mu| m.max(mu));
        ABOVE.iter().map(|factor| factor * reached).find(|bound| {
            let mut below: Vec<f64> = matrix.iter().map(|x| -x).collect();
            for i in 0..n {
                // (n + 2) ε tr(c I) besides what W itself brings.
                #[expect(clippy::cast_precision_loss, reason = "an order of a matrix")]
                let own = (n as f64).powi(2) * f64::EPSILON * bound;
                below[i * (n + 1)] += bound - greatest * self.rounding - own;
            }
            dense::cholesky(&mut below, n).is_ok()
        })
    }
}

/// The index of an answer, `det(B + A W)/|det(B + A W)|`, with `B`, `A` the
/// derivatives of (19) by `r` and by `v`; open contacts count 1. `None` at a border
/// between statuses, where (19) has no derivative, and where rounding might turn
/// the sign.
fn index<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Option<f64> {
    let (mut r, mut v) = (r.to_vec(), v.to_vec());
    for _ in 0..CORRECTIONS {
        let margin = margin(problem, nodes.clone(), &r, &v)?;
        let (next, sign) = newton_step(problem, nodes.clone(), &r, &v)?;
        let next_v = problem.relative_displacement(&next, &[]);
        let change = nodes.clone().map(|i| {
            let force = (0..D).map(|k| (next[i][k] - r[i][k]).abs() * problem.scaling.to_r[i]);
            let motion = (0..D).map(|k| (next_v[i][k] - v[i][k]).abs() * problem.scaling.to_v[i]);
            force.chain(motion).fold(0.0, f64::max)
        });
        if change.fold(0.0, f64::max) <= 0.1 * margin {
            return Some(sign);
        }
        (r, v) = (next, next_v);
    }
    None
}

/// What an answer is away from all borders at least; `None` where it is on one.
fn margin<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Option<f64> {
    let scaling = &problem.scaling;
    let x = |i: usize| -> [f64; D] {
        std::array::from_fn(|k| r[i][k] * scaling.to_r[i] - v[i][k] * scaling.to_v[i])
    };
    let size = nodes
        .clone()
        .flat_map(x)
        .fold(0.0_f64, |m, c| m.max(c.abs()));
    let margin = BORDER * size;
    let clear = |i: usize| {
        let (x, mu) = (x(i), problem.mu[i]);
        let from_limit = (tangential_norm(&x) - mu * x[0]).abs() / mu.hypot(1.0);
        x[0].abs() > margin && (x[0] < 0.0 || mu == 0.0 || from_limit > margin)
    };
    nodes.clone().all(clear).then_some(margin)
}

/// The next point of Newton's method on (19), and the sign of its determinant.
fn newton_step<const D: usize>(
    problem: &Reduced<D>,
    nodes: Range<usize>,
    r: &[[f64; D]],
    v: &[[f64; D]],
) -> Option<(Vec<[f64; D]>, f64)> {
    let scaling = &problem.scaling;
    let rows: Vec<newton::Rows<D>> = nodes
        .clone()
        .filter_map(|i| newton::rows(problem, i, &r[i], &v[i]))
        .collect();
    let n = D * rows.len();
    let mut matrix = vec![0.0; n * n];
    let mut right = vec![0.0; n];
    for (k, row) in rows.iter().enumerate() {
        let scale = scaling.to_v[row.node];
        for (l, other) in rows.iter().enumerate() {
            let w = problem.compliance.pair(row.node, other.node);
            let mut block: Block<D> = row.by_v * w * (scale / scaling.to_r[other.node]);
            if k == l {
                block += row.by_r;
            }
            for i in 0..D {
                for j in 0..D {
                    matrix[(D * k + i) * n + D * l + j] = block[(i, j)];
                }
            }
        }
        let free = Vector::<D>::from(problem.q[row.node]) * scale;
        let known = row.right - row.by_v * free;
        right[D * k..D * (k + 1)].copy_from_slice(known.as_slice());
    }
    let size = norm(&matrix);
    let lu = Lu::factor(matrix, n)?;
    // For random signs z, E ‖A⁻¹ z‖² is the square of Frobenius' norm of A⁻¹.
    for seed in 1..=3 {
        if !(size * norm(&lu.solve(&signs(n, seed))) <= WORST_CONDITION) {
            return None;
        }
    }
    let solved = lu.solve(&right);
    let mut next = r.to_vec();
    next[nodes].fill([0.0; D]);
    for (row, value) in rows.iter().zip(solved.as_chunks::<D>().0) {
        next[row.node] = value.map(|c| c / scaling.to_r[row.node]);
    }
    Some((next, lu.sign))
}

/// Plus and minus ones without a pattern, the same at each call.
fn signs(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    (0..n)
        .map(|_| {
            // Marsaglia's xorshift.
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            if state >> 63 == 0 { 1.0 } else { -1.0 }
        })
        .collect()
}

/// `P A = L U` with partial pivoting, row by row.
struct Lu {
    n: usize,
    factors: Vec<f64>,
    /// The row that stands at each place.
    order: Vec<usize>,
    /// Sign of the determinant.
    sign: f64,
}

impl Lu {
    /// `None` where a pivot is zero.
    fn factor(mut a: Vec<f64>, n: usize) -> Option<Self> {
        let mut order: Vec<usize> = (0..n).collect();
        let mut sign = 1.0;
        for k in 0..n {
            let size = |i: &usize| a[i * n + k].abs();
            let best = (k..n).max_by(|i, j| size(i).total_cmp(&size(j)))?;
            if best != k {
                let (above, below) = a.split_at_mut(best * n);
                above[k * n..(k + 1) * n].swap_with_slice(&mut below[..n]);
                order.swap(k, best);
                sign = -sign;
            }
            let pivot = a[k * n + k];
            if !(pivot.abs() > 0.0) {
                return None;
            }
            sign *= pivot.signum();
            let (done, rest) = a.split_at_mut((k + 1) * n);
            let pivots = &done[k * n + k + 1..];
            for row in rest.chunks_exact_mut(n) {
                let factor = row[k] / pivot;
                row[k] = factor;
                if factor != 0.0 {
                    for (value, p) in row[k + 1..].iter_mut().zip(pivots) {
                        *value -= factor * p;
                    }
                }
            }
        }
        Some(Self {
            n,
            factors: a,
            order,
            sign,
        })
    }

    /// `A⁻¹ b`.
    fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.order.iter().map(|&i| b[i]).collect();
        for k in 0..self.n {
            let row = &self.factors[k * self.n..(k + 1) * self.n];
            x[k] -= dot_long(&row[..k], &x[..k]);
        }
        for k in (0..self.n).rev() {
            let row = &self.factors[k * self.n..(k + 1) * self.n];
            x[k] = (x[k] - dot_long(&row[k + 1..], &x[k + 1..])) / row[k];
        }
        x
    }
}
