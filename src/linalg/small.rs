//! Vectors and blocks of one contact, of order 2 and 3, with types of nalgebra.

use nalgebra::{SMatrix, SVector};

/// A vector of one contact, components normal first `(n, t1[, t2])`.
pub type Vector<const D: usize> = SVector<f64, D>;

/// A block that couples two contacts, or one with itself.
pub type Block<const D: usize> = SMatrix<f64, D, D>;

/// Euclidean length of the tangential part, without overflow or underflow of the squares: a
/// slip of 1e-200 is not zero.
pub fn tangential_norm<const D: usize>(a: &[f64; D]) -> f64 {
    if D == 2 {
        return a[1].abs();
    }
    if D > 3 {
        return norm(&a[1..]);
    }
    let squares = a[1] * a[1] + a[2] * a[2];
    if squares > LEAST && squares < MOST {
        squares.sqrt() // hypot takes several times as long
    } else {
        a[1].hypot(a[2])
    }
}

/// `a · b`.
pub fn dot<const D: usize>(a: &[f64; D], b: &[f64; D]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// `a − s b`.
pub fn minus_scaled<const D: usize>(a: &[f64; D], s: f64, b: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|k| a[k] - s * b[k])
}

/// `y ← y + s x`.
pub fn add_scaled(y: &mut [f64], s: f64, x: &[f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += s * x;
    }
}

/// Removes the component of `x` along a vector `q` of length one, and returns it.
pub fn take_out(x: &mut [f64], q: &[f64]) -> f64 {
    let along = dot_long(q, x);
    add_scaled(x, -along, q);
    along
}

/// `x + s y`.
pub fn plus_scaled(x: &[f64], s: f64, y: &[f64]) -> Vec<f64> {
    let mut sum = x.to_vec();
    add_scaled(&mut sum, s, y);
    sum
}

/// `x + s y`, contact by contact.
pub fn rows_plus_scaled<const D: usize>(x: &[[f64; D]], s: f64, y: &[[f64; D]]) -> Vec<[f64; D]> {
    let mut sum = x.to_vec();
    add_scaled(sum.as_flattened_mut(), s, y.as_flattened());
    sum
}

/// Each contact times its factor.
pub fn scale_rows<const D: usize>(rows: &[[f64; D]], factors: &[f64]) -> Vec<[f64; D]> {
    let rows = rows.iter().zip(factors);
    rows.map(|(row, s)| row.map(|c| c * s)).collect()
}

/// Squares whose sum lies between these have lost nothing.
const LEAST: f64 = 1e-280;
const MOST: f64 = 1e280;

/// A component of a motion at a contact below this share of its length there is rounding: of turned
/// frames, and of motions that were made orthogonal.
pub const TURNED: f64 = 1e-13;

/// Euclidean norm of a long vector. If squares are outside the range of doubles, the vector is
/// first divided by its largest number: a vector that is not zero has a length.
pub fn norm(a: &[f64]) -> f64 {
    let squares = a.iter().map(|x| x * x).sum::<f64>();
    if squares > LEAST && squares < MOST {
        return squares.sqrt();
    }
    let largest = amax(a);
    if squares.is_nan() || largest == 0.0 || a.iter().any(|x| x.is_infinite()) {
        return squares.sqrt();
    }
    largest * a.iter().map(|x| (x / largest).powi(2)).sum::<f64>().sqrt()
}

/// [`norm`] of numbers that need no vector.
pub fn norm_of(numbers: impl Iterator<Item = f64> + Clone) -> f64 {
    let squares = numbers.clone().map(|x| x * x).sum::<f64>();
    if squares > LEAST && squares < MOST {
        return squares.sqrt();
    }
    norm(&numbers.collect::<Vec<_>>())
}

/// Largest magnitude.
pub fn amax(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// The first place of the largest magnitude.
pub fn place_of_largest(values: &[f64]) -> usize {
    let size = |i: usize| values[i].abs();
    (0..values.len()).fold(0, |best, i| if size(i) > size(best) { i } else { best })
}

/// The root of a sum of squares, or the largest number if the squares are outside the range of
/// doubles: a vector that is not zero has a length.
pub fn length(squares: f64, largest: f64) -> f64 {
    if squares <= 1e-280 {
        largest
    } else {
        squares.sqrt() // of a NaN too
    }
}

/// `a · b` for long vectors, in eight running sums. The order is fixed, and so are the bits;
/// the compiler can use wide registers.
pub fn dot_long(a: &[f64], b: &[f64]) -> f64 {
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (x, y) in a8.iter().zip(b8) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    let pairs = [
        sums[0] + sums[4],
        sums[1] + sums[5],
        sums[2] + sums[6],
        sums[3] + sums[7],
    ];
    (pairs[0] + pairs[2]) + (pairs[1] + pairs[3]) + rest
}
