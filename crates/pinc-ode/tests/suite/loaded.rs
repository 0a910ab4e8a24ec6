//! Plants under loads.

use pinc_ad::Dual;
use pinc_ad::simd::{Isa, PortableVector, Simd};
use pinc_ode::{DynRhs, Loaded, VectorDual};
use pinc_plants::FourTanks;
use std::sync::Arc;

const LEAKS: [f64; 4] = [-0.02, 0.0, 0.01, 0.0];
const OFFSETS: [f64; 2] = [-0.3, 0.1];

fn loaded() -> Loaded {
    Loaded::new(Arc::new(FourTanks::antonelo()), vec![], OFFSETS.to_vec(), LEAKS.to_vec())
}

/// f(x, u + d) + w, with the Jacobian that f has there, by itself and in vectors.
#[test]
fn a_load_is_added_to_inputs_and_rates() {
    let (plant, with) = (FourTanks::antonelo(), loaded());
    let (x, u) = ([8.0, 13.0, 3.5, 2.5], [2.9, 3.1]);
    let acting = [u[0] + OFFSETS[0], u[1] + OFFSETS[1]];
    let (mut expected, mut found) = ([0.0; 4], [0.0; 4]);
    DynRhs::rhs(&plant, &x, &acting, &[], &mut expected);
    expected.iter_mut().zip(LEAKS).for_each(|(dx, w)| *dx += w);
    with.rhs(&x, &u, &[], &mut found);
    assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits));
    assert_eq!(with.jacobian(&x, &u, &[]), DynRhs::jacobian(&plant, &x, &acting, &[]));

    let lift = |v: &[f64]| -> Vec<VectorDual<PortableVector>> {
        v.iter().map(|v| Dual::lift(PortableVector::splat(*v))).collect()
    };
    let mut vectors = lift(&[0.0; 4]);
    with.vectorized(Isa::Portable).on().rhs(&lift(&x), &lift(&u), &[], &mut vectors);
    for (vector, expected) in vectors.iter().zip(expected) {
        let mut lanes = [0.0; PortableVector::LANES];
        vector.re.write(&mut lanes);
        assert!(lanes.iter().all(|lane| (lane - expected).abs() < 1e-15), "{lanes:?}, {expected}");
    }
}
