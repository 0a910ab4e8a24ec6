//! Vectors of AVX-512 and of AVX2 with FMA, and the functions that are compiled with them.

use super::parts::FloatParts;
use super::{PLACE_BITS, Scalar, Simd, TABLE_SIZE, Task, Work, low_bits};
use crate::scalar::without_derivatives;
use std::arch::x86_64::*;
use std::fmt;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
pub(super) fn run_avx512<T: Task>(task: T) -> T::Output {
    task.run(F64x8(_mm512_setzero_pd()))
}

#[target_feature(enable = "avx2,fma")]
pub(super) fn run_avx2<T: Task>(task: T) -> T::Output {
    task.run(F64x4(_mm256_setzero_pd()))
}

#[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
fn work_avx512<W: Work>(work: W) -> W::Output {
    work.run()
}

#[target_feature(enable = "avx2,fma")]
fn work_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}

/// The arithmetic of a vector type, from the names of its intrinsics.
macro_rules! vector {
    ($V:ident, $lanes:literal, $set1:ident, $add:ident, $sub:ident, $mul:ident, $div:ident,
     $sqrt:ident, $fmadd:ident, $storeu:ident, $work:ident) => {
        impl $V {
            #[inline(always)]
            fn to_array(self) -> [f64; $lanes] {
                let mut out = [0.0; $lanes];
                // SAFETY: `self` proves the instructions; `out` has room for all lanes.
                unsafe { $storeu(out.as_mut_ptr(), self.0) };
                out
            }

            /// A function without vector instructions, lane by lane.
            #[inline(always)]
            fn map(self, f: impl Fn(f64) -> f64) -> Self {
                let lanes = self.to_array();
                self.generate(|i| f(lanes[i]))
            }
        }

        impl fmt::Debug for $V {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.to_array().fmt(f)
            }
        }

        vector!(@operator $V Add add $add);
        vector!(@operator $V Sub sub $sub);
        vector!(@operator $V Mul mul $mul);
        vector!(@operator $V Div div $div);

        impl Neg for $V {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.constant(-0.0) - self
            }
        }

        impl Scalar for $V {
            without_derivatives!();
            #[inline(always)]
            fn all_nonpositive(self) -> bool {
                self.are_nonpositive()
            }
            #[inline(always)]
            fn constant(self, value: f64) -> Self {
                // SAFETY: `self` proves the instructions.
                Self(unsafe { $set1(value) })
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: `self` proves the instructions.
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn exp(self) -> Self {
                super::exp::exp(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                super::ln::ln(self)
            }
            #[inline(always)]
            fn sin(self) -> Self {
                super::trigonometric::sin(self)
            }
            #[inline(always)]
            fn cos(self) -> Self {
                super::trigonometric::cos(self)
            }
            #[inline(always)]
            fn tan(self) -> Self {
                super::trigonometric::tan(self)
            }
            #[inline(always)]
            fn atan(self) -> Self {
                super::atan::atan(self)
            }
            #[inline(always)]
            fn powf(self, p: f64) -> Self {
                if super::power::is_partial(p) {
                    super::power::powf(self, p)
                } else {
                    self.map(|x| x.powf(p))
                }
            }
            #[inline(always)]
            fn tanh(self) -> Self {
                super::tanh::tanh(self)
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                // SAFETY: `self` proves the instructions.
                Self(unsafe { $fmadd(self.0, a.0, b.0) })
            }
            #[inline(always)]
            fn vectorize<W: Work>(self, work: W) -> W::Output {
                // SAFETY: `self` proves the instructions.
                unsafe { $work(work) }
            }
            #[inline(always)]
            fn where_nonpositive(self, yes: Self, no: Self) -> Self {
                self.select_nonpositive(yes, no)
            }
        }
    };
    (@operator $V:ident $Trait:ident $method:ident $intrinsic:ident) => {
        impl $Trait for $V {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                // SAFETY: `self` proves the instructions.
                Self(unsafe { $intrinsic(self.0, b.0) })
            }
        }
        impl $Trait<f64> for $V {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: f64) -> Self {
                $Trait::$method(self, self.constant(b))
            }
        }
    };
}

/// Eight lanes in an AVX-512 register.
#[derive(Clone, Copy)]
pub(crate) struct F64x8(__m512d);

vector!(
    F64x8,
    8,
    _mm512_set1_pd,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_sqrt_pd,
    _mm512_fmadd_pd,
    _mm512_storeu_pd,
    work_avx512
);

impl F64x8 {
    /// Sums of two neighbours: of this vector in the even lanes, of `b` in the odd ones.
    #[inline(always)]
    fn neighbours(self, b: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe {
            _mm512_add_pd(_mm512_unpacklo_pd(self.0, b.0), _mm512_unpackhi_pd(self.0, b.0))
        })
    }

    /// Sums of two neighbouring pairs: of this vector in the lower half, of `b` in the upper half.
    #[inline(always)]
    fn quarters(self, b: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe {
            let even = _mm512_shuffle_f64x2::<0x88>(self.0, b.0);
            _mm512_add_pd(even, _mm512_shuffle_f64x2::<0xdd>(self.0, b.0))
        })
    }

    #[inline(always)]
    fn are_nonpositive(self) -> bool {
        // SAFETY: `self` proves the instructions.
        let mask = unsafe { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, _mm512_setzero_pd()) };
        mask == 0xff
    }

    #[inline(always)]
    fn select_nonpositive(self, yes: Self, no: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe {
            let mask = _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, _mm512_setzero_pd());
            _mm512_mask_blend_pd(mask, no.0, yes.0)
        })
    }
}

impl FloatParts for F64x8 {
    #[inline(always)]
    fn parts(self) -> (Self, Self) {
        // SAFETY: `self` proves the instructions.
        unsafe {
            let mantissa = _mm512_getmant_pd::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_SRC>(self.0);
            (Self(mantissa), Self(_mm512_getexp_pd(self.0)))
        }
    }
    #[inline(always)]
    fn times_power(self, k: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe { _mm512_scalef_pd(self.0, k.0) })
    }
}

impl Simd for F64x8 {
    const LANES: usize = 8;
    const ROWS: usize = 5;

    #[inline(always)]
    fn generate(self, f: impl FnMut(usize) -> f64) -> Self {
        let lanes: [f64; 8] = std::array::from_fn(f);
        // SAFETY: `self` proves the instructions; `lanes` holds eight numbers.
        Self(unsafe { _mm512_loadu_pd(lanes.as_ptr()) })
    }
    #[inline(always)]
    fn load(self, from: &[f64]) -> Self {
        let lanes = &from[..8];
        // SAFETY: `self` proves the instructions; `lanes` holds eight numbers.
        Self(unsafe { _mm512_loadu_pd(lanes.as_ptr()) })
    }
    #[inline(always)]
    fn write(self, out: &mut [f64]) {
        out[..8].copy_from_slice(&self.to_array());
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe { _mm512_fnmadd_pd(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn clamp(self, limit: f64) -> Self {
        // SAFETY: `self` proves the instructions. These take the second operand where one is NaN.
        Self(unsafe {
            let low = _mm512_max_pd(_mm512_set1_pd(-limit), self.0);
            _mm512_min_pd(_mm512_set1_pd(limit), low)
        })
    }
    #[inline(always)]
    fn lookup(self, table: &'static [f64; TABLE_SIZE]) -> Self {
        // SAFETY: `self` proves the instructions; the mask keeps each place within the table.
        Self(unsafe {
            let mask = _mm512_set1_epi64((1 << PLACE_BITS) - 1);
            let places = _mm512_and_si512(_mm512_castpd_si512(self.0), mask);
            _mm512_i64gather_pd::<8>(places, table.as_ptr())
        })
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        let [a, b, c, d, e, f, g, h] = self.to_array();
        ((a + b) + (c + d)) + ((e + f) + (g + h))
    }
    #[inline(always)]
    fn sums(vectors: &[Self]) -> Self {
        let [a, b, c, d, e, f, g, h] = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| vectors[i]);
        let first = a.neighbours(b).quarters(c.neighbours(d));
        first.quarters(e.neighbours(f).quarters(g.neighbours(h)))
    }
}

/// Four lanes in an AVX register.
#[derive(Clone, Copy)]
pub(crate) struct F64x4(__m256d);

vector!(
    F64x4,
    4,
    _mm256_set1_pd,
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_div_pd,
    _mm256_sqrt_pd,
    _mm256_fmadd_pd,
    _mm256_storeu_pd,
    work_avx2
);

/// 1.5 * 2^52: adding it rounds a number to an integer, which is then in the low bits.
const INTEGER: f64 = 6_755_399_441_055_744.0;

/// What is added to an exponent of 2 where it stands in the bits of a number.
const BIAS: f64 = 1023.0;

impl F64x4 {
    /// 2 to the power of a whole number between -1022 and 1023.
    #[inline(always)]
    fn power_of_two(self) -> Self {
        let exponent = self + (INTEGER + BIAS);
        // SAFETY: `self` proves the instructions.
        Self(unsafe {
            _mm256_castsi256_pd(_mm256_slli_epi64::<52>(_mm256_castpd_si256(exponent.0)))
        })
    }

    #[inline(always)]
    fn are_nonpositive(self) -> bool {
        // SAFETY: `self` proves the instructions.
        let mask =
            unsafe { _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(self.0, _mm256_setzero_pd())) };
        mask == 0xf
    }

    #[inline(always)]
    fn select_nonpositive(self, yes: Self, no: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe {
            let mask = _mm256_cmp_pd::<_CMP_LE_OQ>(self.0, _mm256_setzero_pd());
            _mm256_blendv_pd(no.0, yes.0, mask)
        })
    }
}

impl FloatParts for F64x4 {
    #[inline(always)]
    fn parts(self) -> (Self, Self) {
        const SHIFT: f64 = 4_503_599_627_370_496.0;
        const FRACTION: i64 = (1 << 52) - 1;
        let number = |value: f64| self.constant(value).0;
        // SAFETY: `self` proves the instructions. The exponent becomes the low bits of 2^52.
        unsafe {
            let bits = _mm256_castpd_si256(self.0);
            let fraction = _mm256_and_si256(bits, _mm256_set1_epi64x(FRACTION));
            let one = _mm256_castpd_si256(number(1.0));
            let exponent = _mm256_srli_epi64::<52>(bits);
            let shifted = _mm256_or_si256(exponent, _mm256_castpd_si256(number(SHIFT)));
            let mantissa = Self(_mm256_castsi256_pd(_mm256_or_si256(fraction, one)));
            (mantissa, Self(_mm256_castsi256_pd(shifted)) - (SHIFT + BIAS))
        }
    }
    #[inline(always)]
    fn times_power(self, k: Self) -> Self {
        // By halves, so that each is a normal number: the last product alone rounds.
        let half = k.mul_add(k.constant(0.5), k.constant(INTEGER)) - INTEGER;
        self * half.power_of_two() * (k - half).power_of_two()
    }
}

impl Simd for F64x4 {
    const LANES: usize = 4;
    const ROWS: usize = 2;

    #[inline(always)]
    fn generate(self, f: impl FnMut(usize) -> f64) -> Self {
        let lanes: [f64; 4] = std::array::from_fn(f);
        // SAFETY: `self` proves the instructions; `lanes` holds four numbers.
        Self(unsafe { _mm256_loadu_pd(lanes.as_ptr()) })
    }
    #[inline(always)]
    fn load(self, from: &[f64]) -> Self {
        let lanes = &from[..4];
        // SAFETY: `self` proves the instructions; `lanes` holds four numbers.
        Self(unsafe { _mm256_loadu_pd(lanes.as_ptr()) })
    }
    #[inline(always)]
    fn write(self, out: &mut [f64]) {
        out[..4].copy_from_slice(&self.to_array());
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: `self` proves the instructions.
        Self(unsafe { _mm256_fnmadd_pd(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn clamp(self, limit: f64) -> Self {
        // SAFETY: `self` proves the instructions. These take the second operand where one is NaN.
        Self(unsafe {
            let low = _mm256_max_pd(_mm256_set1_pd(-limit), self.0);
            _mm256_min_pd(_mm256_set1_pd(limit), low)
        })
    }
    #[inline(always)]
    fn lookup(self, table: &'static [f64; TABLE_SIZE]) -> Self {
        // Four loads: the gather instruction is slower on many processors that have no AVX-512.
        let [a, b, c, d] = self.to_array().map(|x| table[low_bits(x)]);
        // SAFETY: `self` proves the instructions.
        Self(unsafe { _mm256_set_pd(d, c, b, a) })
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        let [a, b, c, d] = self.to_array();
        (a + b) + (c + d)
    }
    #[inline(always)]
    fn sums(vectors: &[Self]) -> Self {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| vectors[i].0);
        // SAFETY: the vectors prove the instructions.
        Self(unsafe {
            let (ab, cd) = (_mm256_hadd_pd(a, b), _mm256_hadd_pd(c, d));
            let low = _mm256_permute2f128_pd::<0x20>(ab, cd);
            _mm256_add_pd(low, _mm256_permute2f128_pd::<0x31>(ab, cd))
        })
    }
}
