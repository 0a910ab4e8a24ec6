//! Enclosures against exact rationals, and against what is known of flows.

mod arithmetic;
mod bounds;
mod elementary;
mod flows;

use num_rational::BigRational;
use num_traits::Zero;

/// The number itself, exactly.
fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).expect("a finite number")
}

/// Whether |a - b| <= bound, exactly.
fn within(a: &BigRational, b: &BigRational, bound: f64) -> bool {
    let distance = if a > b { a - b } else { b - a };
    distance <= exact(bound)
}

/// x^n.
fn power(x: &BigRational, n: u8) -> BigRational {
    (0..n).fold(exact(1.0), |product, _| product * x)
}

fn zero() -> BigRational {
    BigRational::zero()
}
