//! Monotony of `r ↦ V`, which proves that there is one answer and bounds how far it is.
//!
//! With weights `p_i`, `θ_i > 0`, `S = diag(p on n, 1 on t)`, `V = (p v_n + μ‖v_t‖, v_t)`,
//! `d = r − r'` and `w = W d`, the triangle inequality and Young's give
//!
//! ```text
//! (V − V')·d ≥ dᵀSWd − Σ μ ‖w_t‖ |d_n| ≥ dᵀ A d,
//! A = sym(S W) − ½ [ Wᵀ P_tᵀ diag(μθ) P_t W + P_nᵀ diag(μ/θ) P_n ]
//! ```
//!
//! `W` need not be symmetric. Where it is known that a contact slides, and nearly
//! whither, the triangle inequality is not needed: see [`Known`].

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::below::{self, Lower, gamma};
use crate::linalg::binary::{exponent, times_two_to};
use crate::linalg::dense::{self, Op};
use crate::linalg::small::norm;
use crate::problem::reduced::Reduced;

/// Weights of contacts, one each.
#[derive(Clone, Debug)]
pub struct Weights {
    /// `p`.
    pub normal: Vec<f64>,
    /// `θ`.
    pub theta: Vec<f64>,
}

/// What is known of `v_t` at a contact, at all points between which `V` is compared.
#[derive(Clone, Copy, Debug)]
pub enum Known<const D: usize> {
    Nothing,
    /// It has, within `turn`, the direction of this vector `(0, t)`:
    /// `|‖v_t‖ − ‖v_t'‖ − t·w_t| ≤ turn ‖w_t‖`.
    Slides {
        direction: [f64; D],
        turn: f64,
    },
}

/// Units of a problem in powers of two: what is scaled by them is exact.
#[derive(Clone, Debug)]
pub struct Units {
    /// `v̂ = v · 2^to_v`, contact by contact.
    pub to_v: Vec<i32>,
    /// `r̂ = r · 2^to_r`.
    pub to_r: Vec<i32>,
    /// `v̂·r̂ = v·r · 2^to_energy`.
    pub to_energy: i32,
}

impl Units {
    /// The scaling of a problem, rounded to powers of two.
    #[must_use]
    pub fn of<const D: usize>(problem: &Reduced<D>) -> Self {
        let scaling = &problem.scaling;
        let product = scaling.to_v.first().map_or(1.0, |v| v * scaling.to_r[0]);
        // A power of two but for rounding.
        let to_energy = exponent(1.25 * product);
        let to_v: Vec<i32> = scaling.to_v.iter().map(|&s| exponent(s)).collect();
        Self {
            to_r: to_v.iter().map(|e| to_energy - e).collect(),
            to_v,
            to_energy,
        }
    }
}

/// `Ŵ` on the components that friction can act on, exactly.
#[derive(Clone, Debug)]
pub struct Monotony<const D: usize> {
    pub nodes: Range<usize>,
    /// Position and component of each unknown.
    pub components: Vec<(usize, usize)>,
    /// Unknown of each component of each contact.
    place: Vec<[Option<usize>; D]>,
    pub mu: Vec<f64>,
    /// Column by column.
    matrix: Vec<f64>,
    /// Symmetric to the bit.
    pub symmetric: bool,
}

/// Nothing moves the contact at this position, which just touches or does not slide:
/// its reaction is any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Touching(pub usize);

impl<const D: usize> Monotony<D> {
    /// Left out are tangents without friction, whose reaction is zero; contacts that
    /// stay open since nothing moves their normals; and tangents that nothing moves,
    /// on which `V` depends by a constant.
    ///
    /// # Errors
    /// [`Touching`] where the reaction of a component that nothing moves is not
    /// determined by the rest.
    pub fn new(problem: &Reduced<D>, units: &Units, nodes: Range<usize>) -> Result<Self, Touching> {
        let mut components = Vec::new();
        let mut place = vec![[None; D]; nodes.len()];
        for position in nodes.clone() {
            for k in 0..D {
                if k > 0 && problem.mu[position] == 0.0 {
                    continue;
                }
                let felt = |other: usize| {
                    let acts = problem.compliance.pair(position, other).row(k).amax() > 0.0;
                    acts || problem.compliance.pair(other, position).column(k).amax() > 0.0
                };
                if nodes.clone().any(felt) {
                    place[position - nodes.start][k] = Some(components.len());
                    components.push((position, k));
                } else if problem.q[position][k] == 0.0 {
                    return Err(Touching(position));
                } else if k == 0 {
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
        Ok(Self {
            mu: problem.mu[nodes.clone()].to_vec(),
            nodes,
            components,
            place,
            matrix,
            symmetric,
        })
    }

    #[must_use]
    pub fn order(&self) -> usize {
        self.components.len()
    }

    /// All unknowns.
    #[must_use]
    pub fn all(&self) -> Vec<usize> {
        (0..self.order()).collect()
    }

    /// Unknown of a component of the contact at a position, where it is one.
    #[must_use]
    pub fn unknown(&self, position: usize, k: usize) -> Option<usize> {
        self.place[position - self.nodes.start][k]
    }

    /// Contact, counted from the first, and component of an unknown.
    #[must_use]
    pub fn contact(&self, unknown: usize) -> (usize, usize) {
        let (position, k) = self.components[unknown];
        (position - self.nodes.start, k)
    }

    /// A tangent with friction that nothing moves, at a contact that may close: its
    /// reaction follows from the others, and no bound of theirs is one of it.
    #[must_use]
    pub fn led_tangent(&self) -> Option<usize> {
        self.nodes.clone().find(|&position| {
            let contact = position - self.nodes.start;
            let place = &self.place[contact];
            self.mu[contact] > 0.0 && place[0].is_some() && place.iter().any(Option::is_none)
        })
    }

    /// The symmetric part of `Ŵ` on some unknowns, column by column, and what rounding
    /// has made of it in norm.
    #[must_use]
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
        (half, error)
    }

    /// `A` on some unknowns, column by column, and what rounding has made of it in
    /// norm. `kept` is ascending; contacts none of whose unknowns is kept have the
    /// same reaction at all points that are compared.
    #[must_use]
    pub fn form(&self, kept: &[usize], weights: &Weights, known: &[Known<D>]) -> (Vec<f64>, f64) {
        let (m, order) = (kept.len(), self.order());
        let entry = |row: usize, column: usize| self.matrix[column * order + row];
        // Rows of the Young term: unknown, and root of its weight.
        let mut rows = Vec::new();
        for &unknown in kept {
            let (contact, k) = self.contact(unknown);
            let share = match known[contact] {
                Known::Nothing => 1.0,
                Known::Slides { turn, .. } => turn,
            };
            let weight = share * self.mu[contact] * weights.theta[contact];
            if k > 0 && weight > 0.0 {
                rows.push((unknown, weight.sqrt()));
            }
        }
        // S W with the directions of sliding in its normal rows, and its sizes.
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
                    if let Known::Slides { direction, .. } = known[contact] {
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
            let share = match known[contact] {
                Known::Nothing => 1.0,
                Known::Slides { turn, .. } => turn,
            };
            if k == 0 && self.mu[contact] > 0.0 {
                let loss = 0.5 * share * self.mu[contact] / weights.theta[contact];
                a[i * (m + 1)] -= loss;
                largest = largest.max(loss);
            }
        }
        // Of each entry of S W some three roundings, of the product those of sums of
        // as many terms as it has rows, of their difference one more.
        let error = 8.0 * f64::EPSILON * (squares.sqrt() + largest)
            + gamma(rows.len() + 8) * norm(&young).powi(2);
        (a, error)
    }

    /// An `α` with `L Lᵀ ≽ α sym W` on some unknowns, proved: `lower` is below `form`.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn least_ratio(
        &self,
        kept: &[usize],
        (form, error): (&[f64], f64),
        lower: &Lower,
        stop: &AtomicBool,
    ) -> Result<Option<f64>, Error> {
        /// Above what the iteration finds, which lies below the truth.
        const ABOVE: [f64; 5] = [1.02, 1.1, 1.3, 2.0, 8.0];
        let m = kept.len();
        if m == 0 {
            return Ok(Some(1.0));
        }
        let (half, of_half) = self.symmetric_part(kept);
        let largest = power(m, |x| {
            lower.backward(x);
            let y = product(&half, x);
            x.copy_from_slice(&y);
            lower.forward(x);
        });
        for above in ABOVE {
            let alpha = 1.0 / (above * largest);
            let pairs = form.iter().zip(&half);
            let rest: Vec<f64> = pairs.map(|(a, w)| a - alpha * w).collect();
            // L Lᵀ itself lies lower than A.
            let sizes = norm(form) + alpha * norm(&half);
            let room = error + alpha * of_half + lower.lowered() + 4.0 * f64::EPSILON * sizes;
            if below::is_definite(rest, m, room, stop)? {
                return Ok(Some(alpha));
            }
        }
        Ok(None)
    }
}

/// An entry of `Ŵ`: by the reaction of one component on another.
pub(super) fn scaled_entry<const D: usize>(
    problem: &Reduced<D>,
    units: &Units,
    (i, k): (usize, usize),
    (j, l): (usize, usize),
) -> f64 {
    let entry = problem.compliance.pair(i, j)[(k, l)];
    times_two_to(entry, units.to_v[i] - units.to_r[j])
}

/// The largest eigenvalue of a symmetric positive semidefinite operator, from below.
pub(super) fn power(n: usize, apply: impl Fn(&mut [f64])) -> f64 {
    const PRODUCTS: usize = 30;
    let mut x = crate::linalg::signs::signs(n, 0);
    let mut reached = 0.0;
    for _ in 0..PRODUCTS {
        let length = norm(&x);
        if !(length > 0.0) {
            break;
        }
        for value in &mut x {
            *value /= length;
        }
        apply(&mut x);
        reached = norm(&x);
    }
    reached
}

/// `A x` of a symmetric matrix.
pub(super) fn product(a: &[f64], x: &[f64]) -> Vec<f64> {
    let rows = a.chunks_exact(x.len().max(1));
    rows.map(|row| crate::linalg::small::dot_long(row, x))
        .collect()
}
