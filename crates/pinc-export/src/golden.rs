//! The golden vectors of self-tests.

use pinc_ode::{Dims, Linearization, Model, Stages};

/// How many there are.
pub(crate) const CASES: usize = 12;

/// Points of a model with its results, one row each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Golden {
    pub(crate) x: Vec<Vec<f64>>,
    pub(crate) u: Vec<Vec<f64>>,
    pub(crate) next: Vec<Vec<f64>>,
    pub(crate) a: Vec<Vec<f64>>,
    pub(crate) b: Vec<Vec<f64>>,
}

impl Golden {
    /// The steps of `model` at points spread over the box of these ends, states first.
    pub(crate) fn of(model: &mut dyn Model, p: &[f64], ends: &[(f64, f64)]) -> Self {
        let Dims { nx, nu, .. } = model.dims();
        let mut all = Self::default();
        for point in points(ends) {
            let (x, u) = point.split_at(nx);
            let mut next = vec![0.0; nx];
            let (mut a, mut b) = (vec![0.0; nx * nx], vec![0.0; nx * nu]);
            model.linearize(
                Stages { x, u, p },
                Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
            );
            all.x.push(x.to_vec());
            all.u.push(u.to_vec());
            all.next.push(next);
            all.a.push(a);
            all.b.push(b);
        }
        all
    }
}

/// Points in a box, evenly spread: multiples of the roots of primes, less what is whole
/// (Kronecker's sequence).
pub(crate) fn points(ends: &[(f64, f64)]) -> Vec<Vec<f64>> {
    let mut primes = Vec::<u32>::new();
    for candidate in 2.. {
        if primes.len() == ends.len() {
            break;
        }
        if primes.iter().all(|prime| candidate % prime != 0) {
            primes.push(candidate);
        }
    }
    let roots: Vec<f64> = primes.into_iter().map(|prime| f64::from(prime).sqrt()).collect();
    let mut count = 0.0;
    let mut next = || {
        count += 1.0;
        let parts = roots.iter().map(|root| (count * root).fract());
        parts.zip(ends).map(|(part, (low, high))| low + part * (high - low)).collect()
    };
    (0..CASES).map(|_| next()).collect()
}
