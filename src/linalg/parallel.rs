//! Long vectors on all threads of the pool, with the same bits for any number of them: the
//! chunks are fixed, and their partial sums are added in order.

use crate::linalg::real::Real;
use crate::tasks;

/// Entries of one task, and of one partial sum.
const CHUNK: usize = 4096;

/// `a · b`, summed in double precision.
pub fn dot<A: Real, B: Real>(a: &[A], b: &[B]) -> f64 {
    let chunks = a.chunks(CHUNK).zip(b.chunks(CHUNK));
    let partial = tasks::map(chunks, |_, (a, b)| dot_of_chunk(a, b));
    partial.iter().sum()
}

/// Eight sums side by side: one alone would wait for each addition.
fn dot_of_chunk<A: Real, B: Real>(a: &[A], b: &[B]) -> f64 {
    let mut sums = [0.0; 8];
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k].double() * b[k].double();
        }
    }
    let rest = rest_a.iter().zip(rest_b);
    let rest: f64 = rest.map(|(a, b)| a.double() * b.double()).sum();
    rest + sums.iter().sum::<f64>()
}

/// Largest magnitude; NaN if an entry is NaN.
pub fn largest<T: Real>(a: &[T]) -> f64 {
    let greater = |x: f64, y: f64| if x > y || x.is_nan() { x } else { y };
    let of_chunk = |_: usize, a: &[T]| {
        // Eight side by side, as in `dot`.
        let (eights, rest) = a.as_chunks::<8>();
        let mut most = [0.0; 8];
        for values in eights {
            for k in 0..8 {
                most[k] = greater(most[k], values[k].double().abs());
            }
        }
        let rest = rest.iter().map(|x| x.double().abs());
        most.into_iter().chain(rest).fold(0.0, greater)
    };
    tasks::map(a.chunks(CHUNK), of_chunk)
        .into_iter()
        .fold(0.0, greater)
}

/// Euclidean norm. If squares are outside the range of doubles, the vector is first divided by
/// its largest entry.
pub fn norm<T: Real>(a: &[T]) -> f64 {
    /// Squares whose sum lies between these have lost nothing.
    const SAFE: std::ops::Range<f64> = 1e-280..1e280;
    let squares = dot(a, a);
    if SAFE.contains(&squares) {
        return squares.sqrt();
    }
    let size = largest(a);
    if squares.is_nan() || size == 0.0 || size.is_infinite() {
        return squares.sqrt();
    }
    let part = |_: usize, a: &[T]| -> f64 { a.iter().map(|x| (x.double() / size).powi(2)).sum() };
    let partial = tasks::map(a.chunks(CHUNK), part);
    size * partial.iter().sum::<f64>().sqrt()
}

/// `y ← y + s x`.
pub fn axpy<X: Real, Y: Real>(s: f64, x: &[X], y: &mut [Y]) {
    let s = Y::rounded(s);
    map2(y, x, |y, x| y + s * Y::rounded(x.double()));
}

/// `y ← x + s y`.
pub fn xpay<T: Real>(x: &[T], s: f64, y: &mut [T]) {
    let s = T::rounded(s);
    map2(y, x, |y, x| x + s * y);
}

/// `y ← f(y)`, entry by entry.
pub fn map<T: Real>(y: &mut [T], f: impl Fn(T) -> T + Sync) {
    tasks::for_each(y.chunks_mut(CHUNK), |_, y| {
        for y in y {
            *y = f(*y);
        }
    });
}

/// Sets the entries to zero where the mask is `value`.
pub fn zero_where(mask: &[bool], value: bool, y: &mut [f64]) {
    tasks::for_each(
        y.chunks_mut(CHUNK).zip(mask.chunks(CHUNK)),
        |_, (y, mask)| {
            for (y, &mask) in y.iter_mut().zip(mask) {
                if mask == value {
                    *y = 0.0;
                }
            }
        },
    );
}

/// `y ← f(y, x)`, entry by entry.
pub fn map2<X: Real, Y: Real>(y: &mut [Y], x: &[X], f: impl Fn(Y, X) -> Y + Sync) {
    tasks::for_each(y.chunks_mut(CHUNK).zip(x.chunks(CHUNK)), |_, (y, x)| {
        for (y, &x) in y.iter_mut().zip(x) {
            *y = f(*y, x);
        }
    });
}
