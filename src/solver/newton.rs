//! Semismooth Newton of Alart and Curnier on the closed contacts, (19) and (20).
//!
//! In scaled variables, where ρ = 1, with `x = r̂ − v̂`, `c = μ (x_n)₊`, `t = x_t/‖x_t‖`:
//!
//! ```text
//! x_n ≤ 0       open:  F = r                    (leaves the system)
//! ‖x_t‖ ≤ c     stick: F = v
//! else          slip:  F = (v_n, r_t − c t)
//! ```
//!
//! The line search is monotone in the residual of the judge, which is cheap
//! because `v` is affine in `r`.

use crate::error::Error;
use crate::linalg::dense;
use crate::linalg::small::{Block, Vector, tangential_norm};
use crate::problem::reduced::Reduced;
use crate::problem::residual::residual;
use crate::solver::Outcome;
use crate::solver::monitor::{Monitor, Verdict};

/// Newton steps at the most.
const MOST_STEPS: usize = 40;

/// Halvings of a step at the most.
const MOST_HALVINGS: usize = 12;

/// A factorisation does `n/3` times the operations of a product of the same
/// order, from the cache, which is about ten times faster a piece.
const UNKNOWNS_A_PRODUCT: f64 = 30.0;

/// What a factorisation of order `n` costs, in products with a `W` of order `m`.
#[must_use]
pub fn factorisation_cost(n: usize, m: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "orders of matrices")]
    let (n, m) = (n as f64, m as f64);
    n / UNKNOWNS_A_PRODUCT * (n / m).powi(2)
}

/// How a run of Newton steps ended.
#[derive(Debug)]
pub enum End<const D: usize> {
    /// The monitor stopped it.
    Stop(Outcome),
    /// It came to a stand at a better point `(r, a)`.
    Better(Vec<[f64; D]>, Vec<f64>),
    /// It did not move.
    Stalled,
}

/// Newton steps from `(r, a)` until converged or at a stand.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    rigid: &[f64],
    monitor: &mut Monitor<D>,
) -> Result<End<D>, Error> {
    let mut r = r.to_vec();
    let mut rigid = rigid.to_vec();
    let mut v = problem.relative_displacement(&r, &rigid);
    monitor.count(1.0);
    let mut here = residual(problem, &r, &v, &rigid);
    let mut moved = false;
    for _ in 0..MOST_STEPS {
        let Some((to_r, to_rigid)) = step(problem, &r, &v, monitor) else {
            break;
        };
        let to_v = problem.relative_displacement(&to_r, &to_rigid);
        let mut share = 1.0;
        let accepted = (0..MOST_HALVINGS).find_map(|_| {
            let next_r = between(&r, &to_r, share);
            let next_v = between(&v, &to_v, share);
            let next_rigid: Vec<f64> = rigid
                .iter()
                .zip(&to_rigid)
                .map(|(x, y)| x + share * (y - x))
                .collect();
            let there = residual(problem, &next_r, &next_v, &next_rigid);
            if there <= (1.0 - 1e-4 * share) * here {
                return Some((next_r, next_v, next_rigid, there));
            }
            share *= 0.5;
            None
        });
        let Some((next_r, next_v, next_rigid, there)) = accepted else {
            break;
        };
        (r, v, rigid, here) = (next_r, next_v, next_rigid, there);
        moved = true;
        match monitor.look(&r, &v, &rigid, true)? {
            Verdict::Stop(outcome) => return Ok(End::Stop(outcome)),
            Verdict::Refresh => {
                v = problem.relative_displacement(&r, &rigid);
                here = residual(problem, &r, &v, &rigid);
            }
            Verdict::Continue => {}
        }
        if share < 1e-2 {
            break; // creeping: sweeps do better
        }
    }
    Ok(if moved {
        End::Better(r, rigid)
    } else {
        End::Stalled
    })
}

/// `x + share (y − x)`, exactly `y` for a whole step.
fn between<const D: usize>(x: &[[f64; D]], y: &[[f64; D]], share: f64) -> Vec<[f64; D]> {
    if share >= 1.0 {
        return y.to_vec();
    }
    let blend =
        |(x, y): (&[f64; D], &[f64; D])| std::array::from_fn(|k| x[k] + share * (y[k] - x[k]));
    x.iter().zip(y).map(blend).collect()
}

/// The rows of one contact: `by_r r' + by_v v' = right` at the next point.
struct Rows<const D: usize> {
    node: usize,
    by_r: Block<D>,
    by_v: Block<D>,
    right: Vector<D>,
}

/// The solution with some contacts held in every direction and the others open.
/// `None` where it is not unique.
#[must_use]
pub fn held_at<const D: usize>(
    problem: &Reduced<D>,
    holds: impl Fn(usize) -> bool,
    monitor: &mut Monitor<D>,
) -> Option<(Vec<[f64; D]>, Vec<f64>)> {
    let rows: Vec<Rows<D>> = (0..problem.contacts())
        .filter(|&node| holds(node) && movable(problem, node, 0))
        .map(|node| {
            let (by_r, by_v) = held(problem, node);
            Rows {
                node,
                by_r,
                by_v,
                right: Vector::zeros(),
            }
        })
        .collect();
    solve_rows(problem, &rows, monitor)
}

/// The whole Newton step, from the scaled linearisation: the next `(r, a)`.
/// `None` where its matrix is singular.
fn step<const D: usize>(
    problem: &Reduced<D>,
    r: &[[f64; D]],
    v: &[[f64; D]],
    monitor: &mut Monitor<D>,
) -> Option<(Vec<[f64; D]>, Vec<f64>)> {
    let rows: Vec<Rows<D>> = (0..r.len())
        .filter_map(|i| rows(problem, i, &r[i], &v[i]))
        .collect();
    solve_rows(problem, &rows, monitor)
}

/// Solves the rows of closed contacts with the balance of forces; the other
/// contacts carry nothing.
fn solve_rows<const D: usize>(
    problem: &Reduced<D>,
    rows: &[Rows<D>],
    monitor: &mut Monitor<D>,
) -> Option<(Vec<[f64; D]>, Vec<f64>)> {
    let scaling = &problem.scaling;
    let modes = &scaling.modes;
    let n = D * rows.len() + modes.len();
    if n == 0 {
        return Some((vec![[0.0; D]; problem.contacts()], Vec::new()));
    }
    let mut matrix = vec![0.0; n * n];
    let mut right = vec![0.0; n];
    for (k, row) in rows.iter().enumerate() {
        let scale_v = scaling.to_v[row.node];
        for (l, other) in rows.iter().enumerate() {
            let w = problem.compliance.pair(row.node, other.node);
            let mut block = row.by_v * w * (scale_v / scaling.to_r[other.node]);
            if k == l {
                block += row.by_r;
            }
            for j in 0..D {
                for i in 0..D {
                    matrix[(D * l + j) * n + D * k + i] = block[(i, j)];
                }
            }
        }
        for (c, mode) in modes.iter().enumerate() {
            let motion = row.by_v * Vector::<D>::from(mode[row.node]);
            let column = D * rows.len() + c;
            for i in 0..D {
                matrix[column * n + D * k + i] = motion[i];
                matrix[(D * k + i) * n + column] = mode[row.node][i];
            }
        }
        let free = Vector::<D>::from(problem.q[row.node]) * scale_v;
        let known = row.right - row.by_v * free;
        right[D * k..D * (k + 1)].copy_from_slice(known.as_slice());
    }
    for (c, load) in scaling.load.iter().enumerate() {
        right[D * rows.len() + c] = -load;
    }
    monitor.count(factorisation_cost(n, D * problem.contacts()));
    dense::solve_general(&mut matrix, n, &mut right).ok()?;
    if right.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let mut next = vec![[0.0; D]; problem.contacts()];
    for (row, value) in rows.iter().zip(right.as_chunks::<D>().0) {
        next[row.node] = value.map(|c| c / scaling.to_r[row.node]);
    }
    let rigid = scaling.rigid_from_scaled(&right[D * rows.len()..]);
    Some((next, rigid))
}

/// The linearised law of one contact; nothing for an open one, whose `r` is zero.
fn rows<const D: usize>(
    problem: &Reduced<D>,
    node: usize,
    r: &[f64; D],
    v: &[f64; D],
) -> Option<Rows<D>> {
    let scaling = &problem.scaling;
    let r = Vector::<D>::from(*r) * scaling.to_r[node];
    let v = Vector::<D>::from(*v) * scaling.to_v[node];
    let x: [f64; D] = (r - v).into();
    if x[0] <= 0.0 || !movable(problem, node, 0) {
        return None;
    }
    let mu = problem.mu[node];
    let c = mu * x[0];
    let length = tangential_norm(&x);
    let mut by_r = Block::<D>::zeros();
    let mut by_v = Block::<D>::identity();
    let mut f = v;
    if mu == 0.0 || length > c {
        // Slip; without friction the tangential reaction is zero.
        let mut t = Vector::<D>::zeros();
        let mut g = Block::<D>::zeros();
        if mu > 0.0 {
            t = Vector::from(x) / length;
            t[0] = 0.0;
            g = (Block::identity() - t * t.transpose()) * (c / length);
        }
        for i in 1..D {
            for j in 1..D {
                by_r[(i, j)] = f64::from(u8::from(i == j)) - g[(i, j)];
                by_v[(i, j)] = g[(i, j)];
            }
            by_r[(i, 0)] = -mu * t[i];
            by_v[(i, 0)] = mu * t[i];
            f[i] = r[i] - c * t[i];
        }
    } else {
        (by_r, by_v) = held(problem, node);
        f = by_r * r + by_v * v;
    }
    let right = by_r * r + by_v * v - f;
    Some(Rows {
        node,
        by_r,
        by_v,
        right,
    })
}

/// Whether anything moves a component of a contact.
fn movable<const D: usize>(problem: &Reduced<D>, node: usize, k: usize) -> bool {
    problem.compliance.block(node)[(k, k)] > 0.0
        || problem
            .scaling
            .modes
            .iter()
            .any(|mode| mode[node][k] != 0.0)
}

/// Rows that hold a contact still: `v = 0`, and no reaction along a component
/// that is prescribed and cannot be held.
fn held<const D: usize>(problem: &Reduced<D>, node: usize) -> (Block<D>, Block<D>) {
    let by_v = Block::from_fn(|i, j| f64::from(u8::from(i == j && movable(problem, node, i))));
    (Block::identity() - by_v, by_v)
}
