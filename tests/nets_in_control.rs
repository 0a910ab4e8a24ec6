//! Nets as the model in the closed loops of the paper: optimal plans, the same inputs by every
//! method for the quadratic programs, and true statuses whatever the net.
//!
//! The loops, the conditions of optimality and the random steps are those that pinc-mpc's own tests
//! use with RK4.

#[path = "../crates/pinc-mpc/tests/suite/agreement.rs"]
mod agreement;
#[path = "../crates/pinc-mpc/tests/suite/faulty.rs"]
mod faulty;
#[path = "../crates/pinc-mpc/tests/suite/optimality.rs"]
mod optimality;
#[path = "../crates/pinc-mpc/tests/suite/problems.rs"]
mod problems;
#[expect(dead_code, reason = "only other tests draw indices")]
#[path = "../crates/pinc-mpc/tests/suite/stream.rs"]
mod stream;
#[path = "../crates/pinc-mpc/tests/suite/survey.rs"]
mod survey;
mod trained;

use agreement::disagreement;
use optimality::judge;
use pinc_mpc::SqpStatus;
use pinc_net::{Domain, PincModel};
use pinc_plants::{FourTanks, VanDerPol};
use problems::{four_tanks, four_tanks_loop, van_der_pol, van_der_pol_loop};
use survey::{Draw, share, survey};
use trained::train;

fn oscillator(mu: f64, iterations: u64) -> PincModel {
    let domain = Domain::new(vec![-3.0..=3.0; 2], [-1.0..=1.0]);
    train(VanDerPol { mu }, (0.5, 12), domain, iterations)
}

fn tanks(plant: FourTanks, iterations: u64) -> PincModel {
    let states = [2.0..=20.0, 2.0..=20.0, 0.6..=5.5, 0.6..=5.5];
    train(plant, (10.0, 12), Domain::new(states, vec![0.0..=5.0; 2]), iterations)
}

#[test]
fn every_plan_of_the_oscillators_loop_is_optimal() {
    judge(van_der_pol_loop(), oscillator(1.0, 300));
}

#[test]
fn every_plan_of_the_tanks_loop_is_optimal() {
    judge(four_tanks_loop(), tanks(FourTanks::antonelo(), 200));
}

/// Where rows are active without force, an interior point is off by the root of its tolerance.
#[test]
fn the_methods_control_the_oscillator_alike() {
    let worst = disagreement(van_der_pol_loop(), oscillator(1.0, 300));
    assert!(worst < 1e-5, "{worst:e}");
}

#[test]
fn the_methods_control_the_tanks_alike() {
    let worst = disagreement(four_tanks_loop(), tanks(FourTanks::antonelo(), 200));
    assert!(worst < 1e-7, "{worst:e}");
}

/// Random states and references far outside what the net has learned.
#[test]
fn a_net_for_the_oscillator_from_anywhere() {
    let draw = Draw { states: &[[-3.0, 3.0]; 2], references: &[[-1.5, 1.5]; 2] };
    let [usual, _] = survey(oscillator(1.0, 300), &van_der_pol(), &draw);
    assert!(share(&usual, &[SqpStatus::Converged, SqpStatus::InfeasibleQp]) > 0.99, "{usual:?}");
}

/// The weights of another plant: an oscillator with four times the damping, and tanks with other
/// outlets.
#[test]
fn nets_for_other_plants_from_anywhere() {
    let draw = Draw { states: &[[-3.0, 3.0]; 2], references: &[[-1.5, 1.5]; 2] };
    survey(oscillator(4.0, 100), &van_der_pol(), &draw);
    let draw = Draw { states: &[[0.1, 20.0]; 4], references: &[[0.0, 22.0]; 2] };
    survey(tanks(FourTanks::johansson_nonminimum(), 100), &four_tanks(), &draw);
}

/// Weights that no training has touched.
#[test]
fn nets_that_have_learned_nothing_from_anywhere() {
    let draw = Draw { states: &[[0.1, 20.0]; 4], references: &[[0.0, 22.0]; 2] };
    survey(tanks(FourTanks::antonelo(), 1), &four_tanks(), &draw);
}
