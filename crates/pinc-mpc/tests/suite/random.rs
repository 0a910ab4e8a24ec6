//! Both plants from random states, with RK4 as the model.

use crate::problems::{four_tanks, van_der_pol};
use crate::survey::{Draw, share, survey};
use pinc_mpc::SqpStatus;
use pinc_ode::Rk4;
use pinc_plants::{FourTanks, VanDerPol};

#[test]
fn van_der_pol_from_anywhere() {
    let draw = Draw { states: &[[-3.0, 3.0]; 2], references: &[[-1.5, 1.5]; 2] };
    let [usual, _] = survey(Rk4::new(VanDerPol::default(), 0.5, 4), &van_der_pol(), &draw);
    // From most of these states the bounds |x| <= 1 cannot be met in a step.
    assert!(share(&usual, &[SqpStatus::Converged]) > 0.1, "{usual:?}");
    assert!(share(&usual, &[SqpStatus::Converged, SqpStatus::InfeasibleQp]) > 0.99, "{usual:?}");
}

/// Within their bounds all states of the tanks have feasible plans.
#[test]
fn four_tanks_from_within_the_bounds() {
    let levels = [[2.0, 20.0], [2.0, 20.0], [0.6, 5.5], [0.6, 5.5]];
    let draw = Draw { states: &levels, references: &[[2.0, 20.0]; 2] };
    let [usual, _] = survey(Rk4::new(FourTanks::antonelo(), 10.0, 4), &four_tanks(), &draw);
    assert!(share(&usual, &[SqpStatus::Converged]) > 0.999, "{usual:?}");
}

#[test]
fn four_tanks_from_anywhere() {
    let draw = Draw { states: &[[0.1, 20.0]; 4], references: &[[0.0, 22.0]; 2] };
    let [usual, _] = survey(Rk4::new(FourTanks::antonelo(), 10.0, 4), &four_tanks(), &draw);
    assert!(share(&usual, &[SqpStatus::Converged, SqpStatus::InfeasibleQp]) > 0.99, "{usual:?}");
}
