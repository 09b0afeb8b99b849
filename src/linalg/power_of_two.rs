//! Powers of two, which scale a number without rounding.

/// `e` with `2^e ≤ x < 2^(e+1)`, 0 for zero.
pub fn exponent(x: f64) -> i32 {
    if x == 0.0 {
        return 0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "within ±1075")]
    let guess = x.log2().floor() as i32;
    // log2 may round to the next power of two.
    if times_two_to(1.0, guess) > x {
        guess - 1
    } else if times_two_to(1.0, guess + 1) <= x {
        guess + 1
    } else {
        guess
    }
}

/// `x · 2^e`, exact inside the range of doubles.
pub fn times_two_to(x: f64, e: i32) -> f64 {
    let [first, second] = factors(e);
    x * first * second
}

/// Two factors whose product is `2^e`, which alone may be outside the range of doubles.
pub fn factors(e: i32) -> [f64; 2] {
    let half = e / 2;
    [2.0_f64.powi(half), 2.0_f64.powi(e - half)]
}
