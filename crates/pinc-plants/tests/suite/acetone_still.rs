//! The still: published facts of the mixture, and derivatives through the boiling point.

use pinc_ad::{Lanes, central_difference, jacobian};
use pinc_ode::Plant;
use pinc_plants::AcetoneStill;
use proptest::prelude::*;

const CELSIUS: f64 = 273.15;

/// Normal boiling points, table B.2 of Smith, Van Ness and Abbott. Antoine's equation gives them to
/// about 0.05 K.
#[test]
fn pure_liquids_boil_at_their_boiling_points() {
    let still = AcetoneStill::default();
    for (acetone, methanol, expected) in [(1.0, 0.0, 56.2), (0.0, 1.0, 64.7), (0.0, 0.0, 100.0)] {
        let found = still.boiling_point(acetone, methanol) - CELSIUS;
        assert!((found - expected).abs() < 0.05, "{found}, expected {expected}");
    }
}

/// Acetone and methanol have an azeotrope of minimal boiling point near 0.79 acetone and 55.5 C
/// (Gmehling et al., *Azeotropic Data*: 0.78 to 0.80 at atmospheric pressure).
#[test]
fn the_azeotrope_is_where_it_is_measured() {
    let still = AcetoneStill::default();
    let at = |i: u32| f64::from(i) / 1000.0;
    let lowest = (0..=1000)
        .min_by(|&i, &j| {
            let boiling = |i| still.boiling_point(at(i), 1.0 - at(i));
            boiling(i).total_cmp(&boiling(j))
        })
        .map(at)
        .unwrap_or_default();
    assert!((0.78..=0.80).contains(&lowest), "{lowest}");
    assert!((still.boiling_point(lowest, 1.0 - lowest) - CELSIUS - 55.5).abs() < 0.2);
}

fn rhs(x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut dx = vec![0.0; 2];
    AcetoneStill::default().rhs(x, u, &[], &mut dx);
    dx
}

proptest! {
    /// The derivatives through the inner solution agree with differences; the rates are of order
    /// 1e-3 /s, which a difference has to about 1e-13 / 6e-6.
    #[test]
    fn derivatives_through_the_boiling_point(
        acetone in 0.01..0.6, methanol in 0.01..0.39, feed in 2.0..6.0, heat in 30.0..160.0,
    ) {
        let at = [acetone, methanol, feed, heat];
        let still = AcetoneStill::default();
        let exact = jacobian(|v, dx| still.rhs(&v[..2], &v[2..], &[], dx), &at, 2);
        for (k, exact) in exact.iter().enumerate() {
            let f = |v: &[f64]| rhs(&v[..2], &v[2..])[k / 4];
            let difference = central_difference(f, &at, k % 4);
            prop_assert!((exact - difference).abs() < 1e-8, "{k}: {exact} {difference}");
        }
    }

    /// The iterations are the same in lanes as one by one.
    #[test]
    fn lanes_agree(acetone in 0.01..0.6, methanol in 0.01..0.39) {
        let x = [Lanes::<4>::splat(acetone), Lanes::splat(methanol)];
        let u = [Lanes::splat(4.0), Lanes::splat(100.0)];
        let mut dx = x;
        AcetoneStill::default().rhs(&x, &u, &[], &mut dx);
        let expected = rhs(&[acetone, methanol], &[4.0, 100.0]);
        for (lanes, expected) in dx.iter().zip(expected) {
            prop_assert!((lanes.0[3] - expected).abs() < 1e-15);
        }
    }
}
