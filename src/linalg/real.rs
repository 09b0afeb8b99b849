//! Single and double precision behind one trait.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// A number of a vector or of a matrix: `f32` or `f64`.
pub trait Real:
    Copy
    + Default
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    /// The nearest number of this type.
    fn rounded(x: f64) -> Self;

    /// The same number in double precision.
    fn double(self) -> f64;

    /// `self · a + b`, in one rounding if the processor has the instruction: without it, a call
    /// of the C library would take fifty times as long.
    fn times_plus<const FMA: bool>(self, a: Self, b: Self) -> Self;
}

macro_rules! real {
    ($type:ty) => {
        impl Real for $type {
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation, reason = "rounding is the purpose")]
            fn rounded(x: f64) -> Self {
                x as $type
            }

            #[inline(always)]
            fn double(self) -> f64 {
                f64::from(self)
            }

            #[inline(always)]
            fn times_plus<const FMA: bool>(self, a: Self, b: Self) -> Self {
                if FMA {
                    self.mul_add(a, b)
                } else {
                    self * a + b
                }
            }
        }
    };
}

real!(f32);
real!(f64);
