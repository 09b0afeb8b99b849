//! Sums of products in twice the working precision, for residuals: after cancellation, the
//! result is accurate to the last digit of the data.
//!
//! Knuth's sum and the product by a fused multiply-add have exactly known errors, which a
//! second number collects [ORO05].

/// A sum, and the rounding errors so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sum {
    high: f64,
    low: f64,
}

impl Sum {
    pub fn new(value: f64) -> Self {
        Self {
            high: value,
            low: 0.0,
        }
    }

    #[inline]
    pub fn add(&mut self, value: f64) {
        let sum = self.high + value;
        let part = sum - self.high;
        self.low += (self.high - (sum - part)) + (value - part);
        self.high = sum;
    }

    /// Adds `a b`. Without an instruction for it, which the caller may have, the C library
    /// multiplies and adds, to the same bits.
    #[inline(always)]
    pub fn add_product(&mut self, a: f64, b: f64) {
        let product = a * b;
        self.low += a.mul_add(b, -product);
        self.add(product);
    }

    #[inline]
    pub fn add_sum(&mut self, other: Self) {
        self.add(other.high);
        self.low += other.low;
    }

    pub fn value(&self) -> f64 {
        self.high + self.low
    }

    /// The value, and the digits below its rounding.
    pub fn parts(&self) -> (f64, f64) {
        let value = self.value();
        (value, (self.high - value) + self.low)
    }
}

/// `a · b`.
pub fn dot(a: &[f64], b: &[f64]) -> Sum {
    // Four sums in parallel: in one sum each term waits for the one before.
    let mut sums = [Sum::default(); 4];
    let (a4, a_rest) = a.as_chunks::<4>();
    let (b4, b_rest) = b.as_chunks::<4>();
    for (x, y) in a4.iter().zip(b4) {
        for k in 0..4 {
            sums[k].add_product(x[k], y[k]);
        }
    }
    for (x, y) in a_rest.iter().zip(b_rest) {
        sums[0].add_product(*x, *y);
    }
    let mut total = Sum::default();
    for sum in sums {
        total.add_sum(sum);
    }
    total
}

/// A sum of products without any rounding: numbers whose digits do not overlap, smallest first
/// [Shewchuk, *Discrete Comput. Geom.* 18, 1997]. Products below 1e-290 are rounded.
#[derive(Clone, Debug, Default)]
pub struct ExactSum {
    parts: Vec<f64>,
}

impl ExactSum {
    fn add(&mut self, value: f64) {
        let mut carried = value;
        let mut kept = 0;
        for k in 0..self.parts.len() {
            let part = self.parts[k];
            let sum = carried + part;
            let other = sum - carried;
            let rest = (carried - (sum - other)) + (part - other);
            if rest != 0.0 {
                self.parts[kept] = rest;
                kept += 1;
            }
            carried = sum;
        }
        self.parts.truncate(kept);
        if carried != 0.0 {
            self.parts.push(carried);
        }
    }

    /// Adds `a b`.
    pub fn add_product(&mut self, a: f64, b: f64) {
        let product = a * b;
        self.add(a.mul_add(b, -product));
        self.add(product);
    }

    /// Whether the sum is one number, which `value` gives without rounding.
    pub fn is_number(&self) -> bool {
        self.parts.len() <= 1
    }

    /// The sum with a relative error of at most 2 ε, and its sign: zero only if the sum is.
    pub fn value(&self) -> f64 {
        self.parts.iter().sum()
    }
}
