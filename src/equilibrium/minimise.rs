//! The least value of a convex function over a product of circular cones.
//!
//! `min ½ yᵀP y + c·y` with `h + G y` in the cones and `E y = f`. Without `P`, the multipliers give a
//! bound from below, `c·y ≥ f·w − h·z` with `c = Gᵀ z + Eᵀ w` and `z` in the cones; what rounding
//! leaves of these relations is added to the gap. With `P`, this bounds the linear function with the
//! gradient `c + P y` at the point, and so the gap of the convex one.

use crate::equilibrium::programme::{Limits, NEAR_ROUNDING, Programme};
use crate::error::Error;
use crate::linalg::small::{amax, norm, plus_scaled};
use crate::linalg::sparse::rows::OwnedMatrix;

/// Relative residuals and gap at which a search in space ends.
const IN_SPACE: f64 = 1e-10;

/// A direction leaves the cones by at most this share of its size.
const RAY: f64 = 1e-9;

/// A gap below this share of the value and of the cost is no reason for a second search.
const CLOSE: f64 = 1e-6;

/// `δ` of searches for the least `cost·y + ½ δ‖y‖²`. Where self-stresses leave `y` without a bound
/// at the same cost, the point of the plain search is so large that its rounding hides the cost.
const DAMPING: [f64; 3] = [1e-3, 1e-6, 1e-9];

/// Points of two dampings whose lengths differ by a smaller factor have a bound.
const FAR: f64 = 10.0;

/// The largest share of `y = 0` in a point, which removes what rounding left outside.
const SHRINK: f64 = 1e-10;

/// The set over which functions are minimised.
#[derive(Clone, Debug, Default)]
pub struct ConeSet {
    /// `G` by rows, the rows of a cone consecutive.
    pub rows: OwnedMatrix,
    /// `h`; `y = 0` lies in the set if there are no equations.
    pub offset: Vec<f64>,
    /// Number of rows of each cone: the first is at least the length of the others.
    pub sizes: Vec<usize>,
    /// `E` by rows, and `f`.
    pub equations: OwnedMatrix,
    pub right: Vec<f64>,
    pub unknowns: usize,
    /// `P` by rows, both triangles; without rows for linear functions.
    pub quadratic: OwnedMatrix,
}

/// The end of a search.
#[derive(Clone, Debug)]
pub struct Optimum {
    /// The point, or the direction along which the function falls without bound.
    pub y: Vec<f64>,
    pub bounded: bool,
    /// Difference from the bound by the multipliers; infinite without one.
    pub gap: f64,
    /// `w`, of the equations.
    pub multipliers: Vec<f64>,
}

impl ConeSet {
    /// Finds the least `½ yᵀP y + cost·y`, or a direction without one.
    pub fn minimise(&self, cost: &[f64], limits: Limits) -> Result<Optimum, Error> {
        let mut best = self.search(cost, 0.0, limits)?;
        let mut before: Option<Vec<f64>> = None;
        for damping in DAMPING {
            let enough = CLOSE * (dot(cost, &best.y).abs() + norm(cost));
            if !best.bounded || best.gap <= enough || !self.quadratic.values.is_empty() {
                break;
            }
            let damped = self.search(cost, damping, limits)?;
            // Along a direction without bound, points of two dampings differ by it alone.
            let far = |before: &Vec<f64>| amax(&damped.y) > FAR * amax(before);
            if let Some(before) = before.filter(far) {
                let step = damped.y.iter().zip(before).map(|(y, before)| y - before);
                if let Some(y) = self.find_ray(&step.collect::<Vec<_>>(), cost) {
                    best = Optimum {
                        y,
                        bounded: false,
                        gap: 0.0,
                        multipliers: damped.multipliers,
                    };
                    break;
                }
            }
            before = Some(damped.y.clone());
            if !damped.bounded || damped.gap < best.gap {
                best = damped;
            }
        }
        Ok(best)
    }

    /// The optimum of `cost` from a search for the least `½ yᵀP y + cost·y + ½ damping ‖y‖²`.
    fn search(&self, cost: &[f64], damping: f64, limits: Limits) -> Result<Optimum, Error> {
        let mut programme = Programme::new(self.unknowns);
        if damping > 0.0 {
            programme.square(0..self.unknowns, damping);
        }
        programme.cost.copy_from_slice(cost);
        for row in 0..self.quadratic.pointer.len() - 1 {
            for (column, value) in self.quadratic.entries(row).filter(|(j, _)| *j >= row) {
                programme.quadratic.0.push(row);
                programme.quadratic.1.push(column);
                programme.quadratic.2.push(value);
            }
        }
        for (equation, f) in self.right.iter().enumerate() {
            programme.push(-f, self.equations.entries(equation));
        }
        programme.equal(self.right.len());
        for (first, &size) in self.firsts().zip(&self.sizes) {
            let count = self.count_rows(first, size);
            for row in first..first + count {
                programme.push(self.offset[row], self.rows.entries(row));
            }
            programme.circular(count);
        }
        // Circular cones have no vertices: the last digits would take twice the steps.
        let plane = self.sizes.iter().all(|&size| size <= 2);
        let enough = if plane { NEAR_ROUNDING } else { IN_SPACE };
        let end = programme.solve(enough, limits)?;
        let dual = self.spread(&end.multipliers);
        if !norm(&end.x).is_finite() {
            return Ok(Optimum {
                y: vec![0.0; self.unknowns],
                bounded: true,
                gap: f64::INFINITY,
                multipliers: dual.0,
            });
        }
        let gradient = plus_scaled(cost, 1.0, &product(&self.quadratic, &end.x));
        let (y, bounded, gap) = self.measure(end.x, &dual, &gradient);
        Ok(Optimum {
            y,
            bounded,
            gap,
            multipliers: dual.0,
        })
    }

    /// Number of rows of a cone in the programme: a half-line has no other component.
    fn count_rows(&self, first: usize, size: usize) -> usize {
        let used = |row: usize| self.offset[row] != 0.0 || !self.rows.is_empty_row(row);
        if (first + 1..first + size).any(used) {
            size
        } else {
            1
        }
    }

    /// The multipliers of the equations, and those of all rows.
    fn spread(&self, multipliers: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (equations, mut rest) = multipliers.split_at(self.right.len());
        let mut rows = vec![0.0; self.offset.len()];
        for (first, &size) in self.firsts().zip(&self.sizes) {
            let count = self.count_rows(first, size);
            rows[first..first + count].copy_from_slice(&rest[..count]);
            rest = &rest[count..];
        }
        (equations.to_vec(), rows)
    }

    /// The point, or the direction; which of them, and the gap.
    fn measure(
        &self,
        mut y: Vec<f64>,
        dual: &(Vec<f64>, Vec<f64>),
        cost: &[f64],
    ) -> (Vec<f64>, bool, f64) {
        let (equations, multipliers) = dual;
        let point = |y: &[f64]| plus_scaled(&product(&self.rows, y), 1.0, &self.offset);
        let value = dot(cost, &y);
        let least_bound = dot(equations, &self.right) - dot(&self.offset, multipliers);
        let balanced = self.leaves(&y) <= 1e-6 * (norm(&self.right) + norm(&y));
        let bound_holds = (value - least_bound).abs() <= 1e-4 * (value.abs() + least_bound.abs());
        if !(balanced && bound_holds)
            && let Some(ray) = self.find_ray(&y, cost)
        {
            return (ray, false, 0.0);
        }
        if self.right.is_empty() {
            // A share of y = 0, which is in the cones, removes what rounding left outside.
            let inside = self.depths(&point(&y));
            let shares = self.depths(&self.offset).into_iter().zip(inside);
            let share = shares.filter(|(zero, lack)| *lack < 0.0 && zero > lack);
            let share = share.map(|(zero, lack)| -lack / (zero - lack));
            let share = share.filter(|share| *share <= SHRINK).fold(0.0, f64::max);
            for amount in &mut y {
                *amount *= 1.0 - share;
            }
        }
        let point = point(&y);
        let [wide, short] = [&point, multipliers].map(|s| (-least(&self.depths(s))).max(0.0));
        let mut missing = cost.to_vec();
        for (matrix, multipliers) in [(&self.rows, multipliers), (&self.equations, equations)] {
            let opposite: Vec<f64> = multipliers.iter().map(|z| -z).collect();
            matrix.add_transposed_product(&opposite, &mut missing);
        }
        let firsts = |x: &[f64]| self.firsts().map(|row| x[row].abs()).sum::<f64>();
        let reach = firsts(&point) + firsts(&self.offset);
        let gap = (dot(cost, &y) - least_bound).max(0.0);
        let rest = short * reach + wide * firsts(multipliers);
        let rest = rest + norm(&missing) * norm(&y) + self.leaves(&y) * norm(equations);
        (y, true, gap + rest)
    }

    /// The direction of `y`, with a cost of −1, if the function falls along it without bound.
    fn find_ray(&self, y: &[f64], cost: &[f64]) -> Option<Vec<f64>> {
        let falls = -dot(cost, y);
        let moved = product(&self.rows, y);
        let along = norm(&product(&self.equations, y));
        // Along self-stresses without an end, rounding of a large `y` has a cost too.
        let descends = falls > RAY * norm(y) * norm(cost);
        let inside = -least(&self.depths(&moved)) <= RAY * amax(&moved);
        let still = along <= RAY * norm(y) * norm(&self.equations.values).max(1.0);
        (descends && inside && still).then(|| y.iter().map(|y| y / falls).collect())
    }

    /// `‖E y − f‖`.
    fn leaves(&self, y: &[f64]) -> f64 {
        let left = product(&self.equations, y);
        norm(&plus_scaled(&left, -1.0, &self.right))
    }

    fn firsts(&self) -> impl Iterator<Item = usize> + '_ {
        self.sizes.iter().scan(0, |next, size| {
            let first = *next;
            *next += size;
            Some(first)
        })
    }

    /// `s_0 − ‖s_t‖` of each cone: negative outside.
    fn depths(&self, s: &[f64]) -> Vec<f64> {
        let cones = self.firsts().zip(&self.sizes);
        let depth = |(first, size): (usize, &usize)| s[first] - norm(&s[first + 1..first + size]);
        cones.map(depth).collect()
    }
}

fn product(matrix: &OwnedMatrix, y: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; matrix.pointer.len() - 1];
    matrix.add_product(y, &mut product);
    product
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn least(numbers: &[f64]) -> f64 {
    numbers.iter().fold(f64::INFINITY, |m, x| m.min(*x))
}
