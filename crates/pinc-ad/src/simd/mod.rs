//! Vectors of `f64` in three instruction sets, chosen at run time.
//!
//! This is the only module with `unsafe` code. It is sound by one rule: *a value of a vector type
//! is the proof that its instructions exist*. The only source of a first value is
//! [`Isa::dispatch`], after the CPU has been queried; all others derive from it (by
//! [`Scalar::constant`] and arithmetic).
//!
//! Speed comes from a second rule: everything between [`Isa::dispatch`] and the vector operations
//! is `#[inline(always)]`, so that it all becomes part of the one function that is compiled with
//! the instruction set enabled. A function that is not inlined stays correct but becomes slow.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "intrinsics need it; see the module's soundness rule")
)]

#[cfg(target_arch = "x86_64")]
mod atan;
#[cfg(target_arch = "x86_64")]
mod exp;
#[cfg(target_arch = "x86_64")]
mod ln;
#[cfg(target_arch = "x86_64")]
mod parts;
#[cfg(target_arch = "x86_64")]
mod power;
#[cfg(target_arch = "x86_64")]
mod sse2;
mod tanh;
mod trigonometric;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use tanh::tanh_all;
pub use trigonometric::{cos, sin, sin_cos, tan};

use crate::{Lanes, Scalar};

/// The vectors of [`Isa::Portable`].
#[cfg(target_arch = "x86_64")]
pub type PortableVector = sse2::F64x2;
/// The vectors of [`Isa::Portable`].
#[cfg(not(target_arch = "x86_64"))]
pub type PortableVector = Lanes<4>;

/// Length of the tables of [`Simd::lookup`].
pub const TABLE_SIZE: usize = 1 << PLACE_BITS;

/// Bits of a place in such a table.
const PLACE_BITS: u32 = 11;

/// A vector of `f64` lanes.
pub trait Simd: Scalar + Send + Sync + 'static {
    /// How many lanes there are.
    const LANES: usize;

    /// Rows of the register block of a matrix product: as many as the registers allow.
    const ROWS: usize;

    /// The lanes `f(0), f(1), ..`.
    fn generate(self, f: impl FnMut(usize) -> f64) -> Self;

    /// The first numbers of `from`, one per lane.
    ///
    /// # Panics
    ///
    /// If there are too few.
    fn load(self, from: &[f64]) -> Self;

    /// Writes the lanes to the first places of `out`.
    fn write(self, out: &mut [f64]);

    /// `b - self * a`, fused.
    fn neg_mul_add(self, a: Self, b: Self) -> Self;

    /// Lane by lane into [-limit, limit]; NaN stays NaN.
    fn clamp(self, limit: f64) -> Self;

    /// The entries of `table` whose places are the low bits of the lanes.
    fn lookup(self, table: &'static [f64; TABLE_SIZE]) -> Self;

    /// The sum of the lanes, in a fixed order.
    fn sum(self) -> f64;

    /// The sums of the lanes of as many vectors as there are lanes, in a fixed order: lane i has
    /// the sum of vector i.
    ///
    /// # Panics
    ///
    /// If there are fewer vectors.
    fn sums(vectors: &[Self]) -> Self;
}

/// Work over one vector type, to be compiled for its instruction set by [`Scalar::vectorize`]. Mark
/// `run` `#[inline(always)]`.
pub trait Work {
    /// Its result.
    type Output;

    /// Does the work.
    fn run(self) -> Self::Output;
}

/// An instruction set. The variants are in the order of preference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// x86-64 with AVX-512 F and DQ: 8 lanes, 32 registers.
    Avx512,
    /// x86-64 with AVX2 and FMA: 4 lanes, 16 registers.
    Avx2,
    /// Any machine, with what all of its kind have: on x86-64 two lanes of SSE2, elsewhere arrays
    /// that the compiler vectorizes as well as it can. Products and sums are not fused.
    Portable,
}

impl std::fmt::Display for Isa {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2+fma",
            Self::Portable => "portable",
        })
    }
}

/// Work written over [`Simd`], to be run in the best instruction set. Mark `run`
/// `#[inline(always)]`.
pub trait Task {
    /// Its result.
    type Output;

    /// `zero` is a vector of zeros, from which all other vectors are made.
    fn run<V: Simd>(self, zero: V) -> Self::Output;
}

impl Isa {
    /// All that this machine can run, the fastest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        #[cfg(target_arch = "x86_64")]
        let vectors = {
            let narrow = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let wide = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq");
            [(Self::Avx512, narrow && wide), (Self::Avx2, narrow)]
        };
        #[cfg(not(target_arch = "x86_64"))]
        let vectors: [(Self, bool); 0] = [];
        let there = vectors.into_iter().filter_map(|(isa, there)| there.then_some(isa));
        there.chain([Self::Portable]).collect()
    }

    /// The fastest that this machine can run.
    #[must_use]
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// The lanes of a vector.
    #[must_use]
    pub fn lanes(self) -> usize {
        match self {
            Self::Avx512 => 8,
            Self::Avx2 => 4,
            Self::Portable => PortableVector::LANES,
        }
    }

    /// Busies one core with fused multiply-adds on registers alone, `rounds` times twelve
    /// independent vectors, and returns how many floating-point operations these were (two per
    /// lane). Timed by the caller, it gives the peak that a kernel can be compared with.
    #[must_use]
    pub fn multiply_add_rounds(self, rounds: u64) -> u64 {
        self.dispatch(MultiplyAdd { rounds })
    }

    /// Runs `task` in this instruction set.
    ///
    /// # Panics
    ///
    /// If the machine does not have it.
    #[inline]
    pub fn dispatch<T: Task>(self, task: T) -> T::Output {
        match self {
            Self::Portable => task.run(PortableVector::splat(0.0)),
            vectors => vectors.dispatch_vectors(task),
        }
    }

    /// Runs `task` in this instruction set, which is not [`Isa::Portable`]: for work that is done
    /// in another way there, and need not be compiled for it.
    ///
    /// # Panics
    ///
    /// If the machine does not have it, or it is the portable one.
    #[inline]
    pub fn dispatch_vectors<T: Task>(self, task: T) -> T::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                assert!(
                    is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq")
                );
                // SAFETY: the features were detected on the line above.
                unsafe { x86::run_avx512(task) }
            }
            vectors => vectors.dispatch_narrow(task),
        }
    }

    /// Runs `task` in vectors of four lanes also where there are wider ones: for work that gains
    /// nothing from these, and need not be compiled for them.
    ///
    /// # Panics
    ///
    /// If the machine has no vectors, or this is the portable instruction set.
    #[inline]
    pub fn dispatch_narrow<T: Task>(self, task: T) -> T::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 | Self::Avx2 => {
                assert!(is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"));
                // SAFETY: the features were detected on the line above.
                unsafe { x86::run_avx2(task) }
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => {
                drop(task);
                panic!("{self} does not exist on this machine")
            }
            Self::Portable => panic!("the portable instruction set has no vectors"),
        }
    }
}

/// See [`Isa::multiply_add_rounds`].
struct MultiplyAdd {
    rounds: u64,
}

impl Task for MultiplyAdd {
    type Output = u64;

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> u64 {
        // Enough independent sums to hide the latency of 4 cycles on two ports.
        const SUMS: usize = 12;
        let (factor, term) = (zero.constant(0.999), zero.constant(1e-3));
        let mut sums = [zero; SUMS];
        for _ in 0..self.rounds {
            for sum in &mut sums {
                *sum = sum.mul_add(factor, term);
            }
        }
        std::hint::black_box(sums);
        self.rounds * (SUMS * V::LANES * 2) as u64
    }
}

/// The lowest bits of a number: a place in a table.
#[inline(always)]
fn low_bits(x: f64) -> usize {
    let [first, second, ..] = x.to_bits().to_le_bytes();
    usize::from(u16::from_le_bytes([first, second])) % TABLE_SIZE
}

impl Simd for Lanes<4> {
    const LANES: usize = 4;
    const ROWS: usize = 2;

    #[inline(always)]
    fn generate(self, f: impl FnMut(usize) -> f64) -> Self {
        Self(std::array::from_fn(f))
    }
    #[inline(always)]
    fn load(self, from: &[f64]) -> Self {
        Self(std::array::from_fn(|i| from[..4][i]))
    }
    #[inline(always)]
    fn write(self, out: &mut [f64]) {
        out[..4].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        b - self * a
    }
    #[inline(always)]
    fn clamp(self, limit: f64) -> Self {
        Self(self.0.map(|x| x.clamp(-limit, limit)))
    }
    #[inline(always)]
    fn lookup(self, table: &'static [f64; TABLE_SIZE]) -> Self {
        Self(self.0.map(|x| table[low_bits(x)]))
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        let [a, b, c, d] = self.0;
        (a + b) + (c + d)
    }
    #[inline(always)]
    fn sums(vectors: &[Self]) -> Self {
        Self(std::array::from_fn(|i| vectors[i].sum()))
    }
}
