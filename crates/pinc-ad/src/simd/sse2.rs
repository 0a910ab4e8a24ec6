//! Vectors of SSE2, which every x86-64 machine has.

use super::{Scalar, Simd, TABLE_SIZE, low_bits};
use crate::lanes::functions_by_lane;
use crate::scalar::without_derivatives;
use std::arch::x86_64::*;
use std::fmt;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// An expression of SSE2 instructions on registers.
macro_rules! sse2 {
    ($value:expr) => {
        // SAFETY: this module is compiled for x86-64 alone, where every machine has SSE2.
        unsafe { $value }
    };
}

/// Two lanes in an SSE register. Products and sums are not fused; functions other than the square
/// root are computed number by number.
#[derive(Clone, Copy)]
pub struct F64x2(__m128d);

impl F64x2 {
    /// The same `value` in both lanes.
    #[inline(always)]
    #[must_use]
    pub fn splat(value: f64) -> Self {
        Self(sse2!(_mm_set1_pd(value)))
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 2] {
        sse2!([_mm_cvtsd_f64(self.0), _mm_cvtsd_f64(_mm_unpackhi_pd(self.0, self.0))])
    }

    #[inline(always)]
    fn of([a, b]: [f64; 2]) -> Self {
        Self(sse2!(_mm_set_pd(b, a)))
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        let [a, b] = self.to_array();
        Self::of([f(a), f(b)])
    }

    /// All bits set in the lanes that are 0 or less.
    #[inline(always)]
    fn nonpositive(self) -> __m128d {
        sse2!(_mm_cmple_pd(self.0, _mm_setzero_pd()))
    }
}

impl fmt::Debug for F64x2 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.to_array().fmt(f)
    }
}

macro_rules! operators {
    ($($Trait:ident $method:ident $intrinsic:ident),*) => {$(
        impl $Trait for F64x2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                Self(sse2!($intrinsic(self.0, b.0)))
            }
        }
        impl $Trait<f64> for F64x2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: f64) -> Self {
                $Trait::$method(self, Self::splat(b))
            }
        }
    )*};
}
operators!(Add add _mm_add_pd, Sub sub _mm_sub_pd, Mul mul _mm_mul_pd, Div div _mm_div_pd);

impl Neg for F64x2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(sse2!(_mm_xor_pd(self.0, _mm_set1_pd(-0.0))))
    }
}

impl Scalar for F64x2 {
    without_derivatives!();
    #[inline(always)]
    fn all_nonpositive(self) -> bool {
        sse2!(_mm_movemask_pd(self.nonpositive())) == 0b11
    }
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(value)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(sse2!(_mm_sqrt_pd(self.0)))
    }
    functions_by_lane!();
    #[inline(always)]
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        let mask = self.nonpositive();
        Self(sse2!(_mm_or_pd(_mm_and_pd(mask, yes.0), _mm_andnot_pd(mask, no.0))))
    }
}

impl Simd for F64x2 {
    const LANES: usize = 2;
    const ROWS: usize = 2;

    #[inline(always)]
    fn generate(self, mut f: impl FnMut(usize) -> f64) -> Self {
        let first = f(0);
        Self::of([first, f(1)])
    }
    #[inline(always)]
    fn load(self, from: &[f64]) -> Self {
        Self::of([from[0], from[1]])
    }
    #[inline(always)]
    fn write(self, out: &mut [f64]) {
        out[..2].copy_from_slice(&self.to_array());
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        b - self * a
    }
    #[inline(always)]
    fn clamp(self, limit: f64) -> Self {
        // These take the second operand where one is NaN.
        let low = sse2!(_mm_max_pd(_mm_set1_pd(-limit), self.0));
        Self(sse2!(_mm_min_pd(_mm_set1_pd(limit), low)))
    }
    #[inline(always)]
    fn lookup(self, table: &'static [f64; TABLE_SIZE]) -> Self {
        self.map(|x| table[low_bits(x)])
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        let [a, b] = self.to_array();
        a + b
    }
    #[inline(always)]
    fn sums(vectors: &[Self]) -> Self {
        let [a, b] = [vectors[0].0, vectors[1].0];
        Self(sse2!(_mm_add_pd(_mm_unpacklo_pd(a, b), _mm_unpackhi_pd(a, b))))
    }
}
