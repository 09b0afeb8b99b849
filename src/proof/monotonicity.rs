//! Monotonicity of `r ↦ V`. It proves that the solution is unique, and bounds its distance.
//!
//! With weights `p_i`, `θ_i > 0`, `S = diag(p on n, 1 on t)`, `V = (p v_n + μ‖v_t‖, v_t)`,
//! `d = r − r'` and `w = W d`, the triangle inequality and Young's give
//!
//! ```text
//! (V − V')·d ≥ dᵀSWd − Σ μ ‖w_t‖ |d_n| ≥ dᵀ A d,
//! A = sym(S W) − ½ [ Wᵀ P_tᵀ diag(μθ) P_t W + P_nᵀ diag(μ/θ) P_n ]
//! ```
//!
//! With dilatancy `V = (v_n + (μ − β)‖v_t‖, v_t)`, and μ stands for `μ − β`: only with `p = 1`.
//! Cohesion changes the set of the reactions only, and nothing here.
//!
//! `W` need not be symmetric. For a contact that slides in an approximately known direction,
//! the triangle inequality is not needed: see [`KnownSlip`].

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::law::contact_law::ContactLaw;
use crate::linalg::dense::{self, Op};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::random_signs::random_signs;
use crate::linalg::small::{amax, dot_long, norm, plus_scaled, take_out};
use crate::linalg::verified_cholesky::{self, Lower, gamma};
use crate::proof::tuning;
use crate::reduced::reduced::Reduced;

#[derive(Clone, Debug)]
pub struct Weights {
    /// `p`.
    pub normal: Vec<f64>,
    /// `θ`.
    pub theta: Vec<f64>,
}

/// What is known of `v_t` at a contact, for all points whose `V` are compared.
#[derive(Clone, Copy, Debug)]
pub enum KnownSlip<const D: usize> {
    Nothing,
    /// Its direction is, within `turn`, that of the vector `(0, t)`:
    /// `|‖v_t‖ − ‖v_t'‖ − t·w_t| ≤ turn ‖w_t‖`.
    Slides {
        direction: [f64; D],
        turn: f64,
    },
    /// Its reaction lies inside the cone, so that `v = 0`: then `V = (p v_n, v_t)` may be used,
    /// without the term that needs the inequalities.
    Sticks,
}

impl<const D: usize> KnownSlip<D> {
    /// The remaining share of Young's term.
    fn share(self) -> f64 {
        match self {
            Self::Nothing => 1.0,
            Self::Slides { turn, .. } => turn,
            Self::Sticks => 0.0,
        }
    }
}

/// Reactions that depend on fewer unknowns: each is a kept unknown, and some kept unknowns
/// determine another one, `d_tied = factor · d_kept`.
#[derive(Clone, Debug, Default)]
pub struct Ties {
    pub kept: Vec<usize>,
    pub tied: Vec<Option<(usize, f64)>>,
}

impl Ties {
    pub fn none(kept: Vec<usize>) -> Self {
        let tied = vec![None; kept.len()];
        Self { kept, tied }
    }

    pub fn push(&mut self, unknown: usize, tied: Option<(usize, f64)>) {
        self.kept.push(unknown);
        self.tied.push(tied);
    }

    /// The unknowns used, ascending.
    pub fn unknowns(&self) -> Vec<usize> {
        let tied = self.tied.iter().flatten().map(|&(unknown, _)| unknown);
        let mut all: Vec<usize> = self.kept.iter().copied().chain(tied).collect();
        all.sort_unstable();
        all
    }

    /// `‖Z‖²` with `d = Z δ`, rounded up.
    fn stretch(&self) -> f64 {
        let squares = self.tied.iter().flatten().map(|(_, f)| f * f);
        (1.0 + squares.fold(0.0, f64::max)) * (1.0 + gamma(0))
    }

    /// `Zᵀ A Z` of a symmetric matrix over [`Ties::unknowns`] with an error of `error`.
    pub fn compress(&self, (a, error): (Vec<f64>, f64)) -> (Vec<f64>, f64) {
        if self.tied.iter().all(Option::is_none) {
            return (a, error);
        }
        let all = self.unknowns();
        let at = |unknown: usize| all.partition_point(|&other| other < unknown);
        let columns = self.kept.iter().zip(&self.tied);
        let columns: Vec<_> = columns
            .map(|(&kept, tied)| (at(kept), tied.map(|(unknown, f)| (at(unknown), f))))
            .collect();
        let entry = |i: usize, j: usize| a[j * all.len() + i];
        let mut small = Vec::with_capacity(self.kept.len().pow(2));
        for &(j, of_j) in &columns {
            for &(i, of_i) in &columns {
                let mut sum = entry(i, j);
                if let Some((t, f)) = of_i {
                    sum += f * entry(t, j);
                }
                if let Some((t, f)) = of_j {
                    sum += f * entry(i, t);
                    if let Some((u, g)) = of_i {
                        sum += f * g * entry(u, t);
                    }
                }
                small.push(sum);
            }
        }
        let error = self.stretch() * (error + 16.0 * f64::EPSILON * norm(&a));
        (small, error)
    }
}

/// Units of a problem as powers of two: scaling with them is exact.
#[derive(Clone, Debug)]
pub struct Units {
    /// `v̂ = v · 2^to_v` of each contact.
    pub to_v: Vec<i32>,
    /// `r̂ = r · 2^to_r`.
    pub to_r: Vec<i32>,
    /// `v̂·r̂ = v·r · 2^to_energy`.
    pub to_energy: i32,
}

impl Units {
    /// The scaling of a problem, rounded to powers of two.
    pub fn of<const D: usize>(problem: &Reduced<D>) -> Self {
        let scaling = &problem.scaling;
        let to_v: Vec<i32> = scaling.to_v.iter().map(|&s| exponent(s)).collect();
        let first = scaling.to_v.first().zip(scaling.to_r.first());
        // Their product is a power of two up to rounding. It may be outside the range of
        // doubles while both are inside.
        let to_energy = first.map_or(0, |(&v, &r)| {
            let (of_v, of_r) = (exponent(v), exponent(r));
            let digits = times_two_to(v, -of_v) * times_two_to(r, -of_r);
            of_v + of_r + exponent(1.25 * digits)
        });
        Self {
            to_r: to_v.iter().map(|e| to_energy - e).collect(),
            to_v,
            to_energy,
        }
    }
}

/// `Ŵ` on the components that can have a reaction, exactly or with errors of its entries.
#[derive(Clone, Debug)]
pub struct Monotonicity<const D: usize> {
    pub nodes: Range<usize>,
    /// Position and component of each unknown.
    pub components: Vec<(usize, usize)>,
    /// Unknown of each component of each contact.
    place: Vec<[Option<usize>; D]>,
    /// `μ − β`.
    pub mu: Vec<f64>,
    /// Whether a contact can have tangential reactions.
    rough: Vec<bool>,
    /// A common θ for other variables in these units, up to a factor: those in which blocks of
    /// `W` have a mean diagonal of one, and those of the caller.
    pub shapes: [Vec<f64>; 2],
    /// Column by column.
    matrix: Vec<f64>,
    /// Relative error of each entry.
    pub entry_rounding: f64,
    /// Whether it is bitwise symmetric. With errors of its entries, the true one may not be.
    pub symmetric: bool,
}

/// Nothing moves the contact at this position, which just touches or does not slide: any
/// reaction is possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Touching(pub usize);

impl<const D: usize> Monotonicity<D> {
    /// It omits tangents without friction, whose reaction is zero; contacts that stay open
    /// because nothing moves their normals; and tangents that nothing moves, which add a
    /// constant to `V`.
    ///
    /// # Errors
    /// [`Touching`] if the other reactions do not determine the reaction of a component that
    /// nothing moves.
    pub fn new(problem: &Reduced<D>, units: &Units, nodes: Range<usize>) -> Result<Self, Touching> {
        let mut components = Vec::new();
        let mut place = vec![[None; D]; nodes.len()];
        for position in nodes.clone() {
            for (k, unknown) in place[position - nodes.start].iter_mut().enumerate() {
                if k > 0 && !problem.law[position].has_friction() {
                    continue;
                }
                let felt = |other: usize| {
                    let acts = problem.compliance.pair(position, other).row(k).amax() > 0.0;
                    acts || problem.compliance.pair(other, position).column(k).amax() > 0.0
                };
                if nodes.clone().any(felt) {
                    *unknown = Some(components.len());
                    components.push((position, k));
                } else if problem.q[position][k] == 0.0 {
                    return Err(Touching(position));
                } else if k == 0 && problem.law[position].cohesion == 0.0 {
                    break;
                }
            }
        }
        let order = components.len();
        let mut matrix = vec![0.0; order * order];
        for (column, &pushed) in matrix.chunks_exact_mut(order.max(1)).zip(&components) {
            for (value, &moved) in column.iter_mut().zip(&components) {
                *value = scaled_entry(problem, units, moved, pushed);
            }
        }
        #[expect(clippy::float_cmp, reason = "symmetric to the bit is what is asked")]
        let symmetric =
            (0..order).all(|j| (0..j).all(|i| matrix[j * order + i] == matrix[i * order + j]));
        let laws = problem.law[nodes.clone()].iter();
        let scaled = |i: usize| times_two_to(problem.scaling.to_v[i], -units.to_v[i]).powi(2);
        let first = nodes.start;
        let plain = |i: usize| times_two_to(1.0, 2 * (units.to_v[first] - units.to_v[i]));
        Ok(Self {
            mu: laws.clone().map(ContactLaw::correction).collect(),
            rough: laws.map(ContactLaw::has_friction).collect(),
            shapes: [
                nodes.clone().map(scaled).collect(),
                nodes.clone().map(plain).collect(),
            ],
            nodes,
            components,
            place,
            matrix,
            entry_rounding: problem.entry_rounding,
            symmetric,
        })
    }

    pub fn order(&self) -> usize {
        self.components.len()
    }

    /// What is known of each contact without a point.
    pub fn nothing_known(&self) -> Vec<KnownSlip<D>> {
        vec![KnownSlip::Nothing; self.mu.len()]
    }

    pub fn all(&self) -> Vec<usize> {
        (0..self.order()).collect()
    }

    /// The unknown of a component of the contact at a position, if there is one.
    pub fn unknown(&self, position: usize, k: usize) -> Option<usize> {
        self.place[position - self.nodes.start][k]
    }

    /// The contact, from the first one, and the component of an unknown.
    pub fn contact(&self, unknown: usize) -> (usize, usize) {
        let (position, k) = self.components[unknown];
        (position - self.nodes.start, k)
    }

    /// Whether a tangent with friction that nothing moves belongs to a contact that may close:
    /// its reaction follows from the others, and their bound is not a bound of it.
    pub fn led_tangent(&self) -> Option<usize> {
        self.nodes.clone().find(|&position| {
            let contact = position - self.nodes.start;
            let place = &self.place[contact];
            let moves = place.iter().any(Option::is_some);
            self.rough[contact] && moves && place.iter().any(Option::is_none)
        })
    }

    /// The symmetric part of `Ŵ` on some unknowns, by columns, and the norm of its rounding
    /// error.
    pub fn symmetric_part(&self, kept: &[usize]) -> (Vec<f64>, f64) {
        let order = self.order();
        let mut half = Vec::with_capacity(kept.len().pow(2));
        for &j in kept {
            for &i in kept {
                half.push(0.5 * (self.matrix[j * order + i] + self.matrix[i * order + j]));
            }
        }
        let error = if self.symmetric {
            0.0
        } else {
            2.0 * f64::EPSILON * norm(&half)
        };
        (half, error + self.entry_rounding * norm(&self.matrix))
    }

    /// `A` on some unknowns, by columns, and the norm of its rounding error. `kept` is
    /// ascending; a contact without kept unknowns has the same reaction at all points compared.
    pub fn form(
        &self,
        kept: &[usize],
        weights: &Weights,
        known: &[KnownSlip<D>],
    ) -> (Vec<f64>, f64) {
        let (m, order) = (kept.len(), self.order());
        let entry = |row: usize, column: usize| self.matrix[column * order + row];
        // Rows of the Young term: unknown, and root of its weight.
        let mut rows = Vec::new();
        for &unknown in kept {
            let (contact, k) = self.contact(unknown);
            let share = known[contact].share();
            let weight = share * self.mu[contact] * weights.theta[contact];
            if k > 0 && weight > 0.0 {
                rows.push((unknown, weight.sqrt()));
            }
        }
        // S W with the directions of sliding in its normal rows, and the sizes of its terms.
        let mut moved = Vec::with_capacity(m * m);
        let mut young = Vec::with_capacity(rows.len() * m);
        let mut squares = 0.0;
        for &column in kept {
            for &row in kept {
                let (contact, k) = self.contact(row);
                let mut value = entry(row, column);
                let mut size = value.abs();
                if k == 0 {
                    value *= weights.normal[contact];
                    size *= weights.normal[contact];
                    if let KnownSlip::Slides { direction, .. } = known[contact] {
                        for (l, t) in direction.iter().enumerate().skip(1) {
                            if let Some(tangent) = self.place[contact][l] {
                                let term = self.mu[contact] * t * entry(tangent, column);
                                value += term;
                                size += term.abs();
                            }
                        }
                    }
                }
                moved.push(value);
                squares += size * size;
            }
            young.extend(rows.iter().map(|&(row, root)| root * entry(row, column)));
        }
        let mut a = vec![0.0; m * m];
        for j in 0..m {
            for i in 0..m {
                a[j * m + i] = 0.5 * (moved[j * m + i] + moved[i * m + j]);
            }
        }
        if !rows.is_empty() {
            let shape = (m, m, rows.len());
            dense::matmul(
                &mut a,
                shape,
                -0.5,
                &young,
                Op::Transposed,
                &young,
                Op::Plain,
                1.0,
            );
        }
        let mut largest = 0.0_f64;
        for (i, &unknown) in kept.iter().enumerate() {
            let (contact, k) = self.contact(unknown);
            let share = known[contact].share();
            if k == 0 && self.mu[contact] > 0.0 {
                let loss = 0.5 * share * self.mu[contact] / weights.theta[contact];
                a[i * (m + 1)] -= loss;
                largest = largest.max(loss);
            }
        }
        // About three roundings in each entry of S W; in the product, those of sums with as
        // many terms as rows; one more in the difference.
        let error = 8.0 * f64::EPSILON * (squares.sqrt() + largest)
            + gamma(rows.len() + 8) * norm(&young).powi(2)
            + self.entry_rounding * (squares.sqrt() + 2.0 * norm(&young).powi(2));
        (a, error)
    }
}

/// An `α` with `L Lᵀ ≽ α H`, proved, for a symmetric `A` with the lower factor `lower` and a
/// positive definite `H`; both with their rounding errors.
pub fn least_ratio(
    (form, error): (&[f64], f64),
    lower: &Lower,
    (half, of_half): (&[f64], f64),
    stop: &AtomicBool,
) -> Result<Option<f64>, Error> {
    let m = lower.order();
    if m == 0 {
        return Ok(Some(1.0));
    }
    let largest = largest(m, |x| {
        lower.backward(x);
        let y = product(half, x);
        x.copy_from_slice(&y);
        lower.forward(x);
    });
    for above in tuning::MARGINS {
        let alpha = 1.0 / (above * largest);
        let rest = plus_scaled(form, -alpha, half);
        // L Lᵀ is even lower than A.
        let sizes = norm(form) + alpha * norm(half);
        let room = error + alpha * of_half + lower.lowered() + 4.0 * f64::EPSILON * sizes;
        if verified_cholesky::is_definite(rest, m, room, stop)? {
            return Ok(Some(alpha));
        }
    }
    Ok(None)
}

/// An entry of `Ŵ`: the displacement of one component by the reaction of another.
pub(super) fn scaled_entry<const D: usize>(
    problem: &Reduced<D>,
    units: &Units,
    (i, k): (usize, usize),
    (j, l): (usize, usize),
) -> f64 {
    let entry = problem.compliance.pair(i, j)[(k, l)];
    times_two_to(entry, units.to_v[i] - units.to_r[j])
}

/// A lower estimate of the largest eigenvalue of a symmetric positive semidefinite operator, by
/// Lanczos's method. The irregular first vector has components along all eigenvectors.
pub(super) fn largest(n: usize, apply: impl Fn(&mut [f64])) -> f64 {
    let mut x = random_signs(n, 0);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    let (mut length, mut size) = (norm(&x), 0.0_f64);
    for _ in 0..tuning::lanczos_products().min(n) {
        // The remainder is rounding: the Krylov space is complete.
        if !(length > 1e-10 * size) {
            break;
        }
        for value in &mut x {
            *value /= length;
        }
        let mut y = x.clone();
        apply(&mut y);
        let along = dot_long(&x, &y);
        if !along.is_finite() {
            break;
        }
        if !diagonal.is_empty() {
            beside.push(length);
        }
        diagonal.push(along);
        size = size.max(along.abs()).max(norm(&y));
        basis.push(x);
        // Orthogonal to all of them: otherwise converged vectors return.
        for _ in 0..2 {
            for earlier in &basis {
                let _ = take_out(&mut y, earlier);
            }
        }
        length = norm(&y);
        x = y;
    }
    largest_of_tridiagonal(&diagonal, &beside)
}

/// By bisection with counts of negative pivots.
fn largest_of_tridiagonal(diagonal: &[f64], beside: &[f64]) -> f64 {
    const HALVINGS: usize = 50;
    let (mut low, mut high) = (0.0, amax(diagonal) + 2.0 * amax(beside));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let mut pivot = 1.0;
        let below = diagonal.iter().enumerate().all(|(k, d)| {
            let square = if k == 0 { 0.0 } else { beside[k - 1].powi(2) };
            pivot = d - middle - square / pivot;
            pivot < 0.0
        });
        if below {
            high = middle;
        } else {
            low = middle;
        }
    }
    low
}

/// `A x` of a symmetric matrix.
pub(super) fn product(a: &[f64], x: &[f64]) -> Vec<f64> {
    let rows = a.chunks_exact(x.len().max(1));
    rows.map(|row| dot_long(row, x)).collect()
}
