//! Numbers of twice the precision, and elimination with them: the reference for condensation
//! in plain precision.

use std::ops::{Add, Div, Mul, Sub};

/// The unevaluated sum `high + low`, about 32 digits (Dekker 1971).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Double {
    pub(crate) high: f64,
    low: f64,
}

fn two_sum(a: f64, b: f64) -> Double {
    let high = a + b;
    let part = high - a;
    Double {
        high,
        low: (a - (high - part)) + (b - part),
    }
}

fn two_product(a: f64, b: f64) -> Double {
    let split = |a: f64| {
        let c = 134_217_729.0 * a; // 2²⁷ + 1
        let high = c - (c - a);
        (high, a - high)
    };
    let high = a * b;
    let ((a1, a2), (b1, b2)) = (split(a), split(b));
    Double {
        high,
        low: ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2,
    }
}

impl From<f64> for Double {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Add for Double {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        let sum = two_sum(self.high, b.high);
        two_sum(sum.high, sum.low + self.low + b.low)
    }
}

impl Sub for Double {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        self + Self {
            high: -b.high,
            low: -b.low,
        }
    }
}

impl Mul for Double {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        let product = two_product(self.high, b.high);
        two_sum(
            product.high,
            product.low + self.high * b.low + self.low * b.high,
        )
    }
}

impl Div for Double {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let first = self.high / b.high;
        let rest = self - b * first.into();
        let second = rest.high / b.high;
        let rest = rest - b * second.into();
        two_sum(first, second) + (rest.high / b.high).into()
    }
}

/// `K_cc − K_ci K_ii⁻¹ K_ic` of a dense symmetric matrix, by plain elimination
/// of the unknowns not in `kept`, in the order of their numbers.
pub(crate) fn schur(n: usize, dense: &[f64], kept: &[usize]) -> Vec<Double> {
    let mut a: Vec<Double> = dense.iter().map(|&v| v.into()).collect();
    let mut left = vec![true; n];
    for p in (0..n).filter(|p| !kept.contains(p)) {
        left[p] = false;
        let row: Vec<Double> = a[p * n..(p + 1) * n].to_vec();
        let filled: Vec<usize> = (0..n).filter(|&i| left[i] && row[i].high != 0.0).collect();
        for (at, &i) in filled.iter().enumerate() {
            let factor = row[i] / row[p];
            for &j in &filled[at..] {
                let value = a[i * n + j] - factor * row[j];
                (a[i * n + j], a[j * n + i]) = (value, value);
            }
        }
    }
    kept.iter()
        .flat_map(|&i| kept.iter().map(move |&j| (i, j)))
        .map(|(i, j)| a[i * n + j])
        .collect()
}
