//! The arithmetic that takes the time: products and sums of polynomials in several boxes at once.

use crate::basis::Basis;
use pinc_ad::simd::{Isa, Simd, Task};
use std::cell::RefCell;

/// Boxes that are computed together.
pub(crate) const LANES: usize = 8;

/// A number per box.
pub(crate) type Lanes = [f64; LANES];

thread_local! {
    /// Memory of polynomials that are gone: it is used again, since to ask the system for it takes
    /// longer than to fill it.
    static FREE: RefCell<Vec<Vec<Lanes>>> = const { RefCell::new(Vec::new()) };
}

/// So many zeros.
pub(crate) fn memory(count: usize) -> Vec<Lanes> {
    let mut memory = FREE.with_borrow_mut(Vec::pop).unwrap_or_default();
    memory.clear();
    memory.resize(count, [0.0; LANES]);
    memory
}

/// Gives memory back.
pub(crate) fn release(memory: Vec<Lanes>) {
    FREE.with_borrow_mut(|free| free.push(memory));
}

/// The lanes f(0), f(1), ..
pub(crate) fn lanes(f: impl FnMut(usize) -> f64) -> Lanes {
    std::array::from_fn(f)
}

/// The coefficients of a product up to `degrees`; the others are 0.
pub(crate) fn product(
    isa: Isa,
    basis: &Basis,
    degrees: &[Option<usize>],
    a: (&[Lanes], &[bool]),
    b: (&[Lanes], &[bool]),
) -> Vec<Lanes> {
    let mut out = memory(basis.len());
    isa.dispatch(Product { basis, degrees, a, b, out: &mut out });
    out
}

struct Product<'a> {
    basis: &'a Basis,
    degrees: &'a [Option<usize>],
    /// The coefficients, and which powers of the time have any.
    a: (&'a [Lanes], &'a [bool]),
    b: (&'a [Lanes], &'a [bool]),
    out: &'a mut [Lanes],
}

impl Task for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { basis, degrees, a, b, out } = self;
        let of_order = |k: usize, count: usize| {
            let first = basis.of_order(k).start;
            first * LANES..(first + count) * LANES
        };
        let (a_all, b_all) = (a.0.as_flattened(), b.0.as_flattened());
        let out = out.as_flattened_mut();
        for (k, degree) in degrees.iter().enumerate() {
            let Some(degree) = *degree else { continue };
            let count = basis.count(degree);
            let out = &mut out[of_order(k, count)];
            for i in 0..=k {
                if !(a.1[i] && b.1[k - i]) {
                    continue;
                }
                let a = &a_all[of_order(i, count)];
                let b = &b_all[of_order(k - i, count)];
                let mut place = 0;
                while place < count {
                    let pairs = basis.pairs(place);
                    let mut part = place * LANES;
                    let end = part + LANES;
                    while part < end {
                        let lane = part - place * LANES;
                        let mut sum = zero.load(&out[part..]);
                        let mut i = 0;
                        while i < pairs.len() {
                            let [one, other] = pairs[i];
                            let factor = zero.load(&b[usize::from(other) * LANES + lane..]);
                            let value = zero.load(&a[usize::from(one) * LANES + lane..]);
                            sum = value.mul_add(factor, sum);
                            i += 1;
                        }
                        sum.write(&mut out[part..]);
                        part += V::LANES;
                    }
                    place += 1;
                }
            }
        }
    }
}

/// Adds `factor` times `from` to `to`, for each of the factors.
pub(crate) fn add_multiples(isa: Isa, to: &mut [Lanes], from: &[&[Lanes]], factors: &[f64]) {
    isa.dispatch(AddMultiples { to: to.as_flattened_mut(), from, factors });
}

struct AddMultiples<'a> {
    to: &'a mut [f64],
    from: &'a [&'a [Lanes]],
    factors: &'a [f64],
}

impl Task for AddMultiples<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { to, from, factors } = self;
        let mut place = 0;
        while place < to.len() {
            let mut sum = zero.load(&to[place..]);
            let mut i = 0;
            while i < from.len() {
                let value = zero.load(&from[i].as_flattened()[place..]);
                sum = value.mul_add(zero.constant(factors[i]), sum);
                i += 1;
            }
            sum.write(&mut to[place..]);
            place += V::LANES;
        }
    }
}

/// The sums of the absolute values of the coefficients `of`, without rounding upward.
pub(crate) fn norm(isa: Isa, of: &[Lanes]) -> Lanes {
    let mut sum = [0.0; LANES];
    isa.dispatch(Norm { of: of.as_flattened(), sum: &mut sum });
    sum
}

struct Norm<'a> {
    of: &'a [f64],
    sum: &'a mut Lanes,
}

impl Task for Norm<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { of, sum } = self;
        for part in (0..LANES).step_by(V::LANES) {
            let mut total = zero;
            let mut place = part;
            while place < of.len() {
                let value = zero.load(&of[place..]);
                // NaN stays NaN.
                total = total + value.where_nonpositive(-value, value);
                place += LANES;
            }
            total.write(&mut sum[part..]);
        }
    }
}
