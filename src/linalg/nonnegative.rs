//! Least squares with non-negative amounts of columns generated on demand.

use crate::linalg::least_squares;
use crate::linalg::small::norm;

/// Rounds for each component: about two if the cone of the columns has flat sides, up to twelve
/// if it is curved.
const MOST_ROUNDS: usize = 50;

/// Limit of operations, about one second; then the best result so far is returned.
const MOST_OPERATIONS: usize = 1 << 30;

/// The shortest `s = target + Σ x_j c_j`, `x_j ≥ 0`, over columns from `price`. Given `s` and
/// its length, `price` returns a column that makes `s` shorter, or `None`.
///
/// It is the active-set method of Lawson and Hanson with any number of columns: the active
/// columns are independent, and each new one makes `s` shorter.
#[must_use]
pub fn shortest(
    target: &[f64],
    mut price: impl FnMut(&[f64], f64) -> Option<Vec<f64>>,
) -> Vec<f64> {
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut amounts: Vec<f64> = Vec::new();
    let mut s = target.to_vec();
    let mut spent = 0;
    for _ in 0..MOST_ROUNDS * target.len() {
        spent += target.len() * columns.len().pow(2);
        if spent > MOST_OPERATIONS {
            break;
        }
        let before = norm(&s);
        let Some(column) = price(&s, before) else {
            break;
        };
        columns.push(column);
        amounts.push(0.0);
        fit(target, &mut columns, &mut amounts);
        let mut next = combine(target, &columns, &amounts);
        // Orthogonal to the columns up to the rounding of its own length, not of that of the
        // target.
        let views: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let minus: Vec<f64> = next.iter().map(|x| -x).collect();
        for (x, column) in least_squares::solve(&views, &minus).iter().zip(&columns) {
            add(&mut next, *x, column);
        }
        // A column with the resistance θ shortens s by θ²: rounding hides this early.
        if !(norm(&next) <= before * (1.0 + 4.0 * f64::EPSILON)) {
            break;
        }
        s = next;
    }
    s
}

/// Amounts of least squares, without the columns whose amount would be negative.
fn fit(target: &[f64], columns: &mut Vec<Vec<f64>>, amounts: &mut Vec<f64>) {
    while !columns.is_empty() {
        let views: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let minus = |s: Vec<f64>| s.into_iter().map(|x| -x).collect::<Vec<f64>>();
        let mut goal = least_squares::solve(&views, &minus(target.to_vec()));
        // Once more for the rounding: s is small relative to the target.
        let rest = minus(combine(target, columns, &goal));
        for (x, change) in goal.iter_mut().zip(least_squares::solve(&views, &rest)) {
            *x += change;
        }
        // The share of the way at which the first amount becomes zero.
        let mut share = 1.0;
        let mut first = None;
        for (j, (x, to)) in amounts.iter().zip(&goal).enumerate() {
            if *to <= 0.0 && x / (x - to) < share {
                (share, first) = (x / (x - to), Some(j));
            }
        }
        for (x, to) in amounts.iter_mut().zip(&goal) {
            *x += share * (to - *x);
        }
        let Some(first) = first.or_else(|| goal.iter().position(|x| *x <= 0.0)) else {
            amounts.copy_from_slice(&goal);
            return;
        };
        let _ = columns.remove(first);
        let _ = amounts.remove(first);
    }
}

fn combine(target: &[f64], columns: &[Vec<f64>], amounts: &[f64]) -> Vec<f64> {
    let mut s = target.to_vec();
    for (column, x) in columns.iter().zip(amounts) {
        add(&mut s, *x, column);
    }
    s
}

/// `s += x c`.
pub fn add(s: &mut [f64], x: f64, column: &[f64]) {
    for (value, c) in s.iter_mut().zip(column) {
        *value += x * c;
    }
}
