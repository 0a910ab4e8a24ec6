//! The closed loops of the paper with each method for the QPs, RK4 as the model: the same inputs.

use crate::agreement::disagreement;
use crate::problems::{four_tanks_loop, van_der_pol_loop};
use pinc_mpc::Weight;
use pinc_ode::Rk4;
use pinc_plants::{FourTanks, VanDerPol};

#[test]
fn the_methods_control_the_tanks_alike() {
    let worst = disagreement(four_tanks_loop(), Rk4::new(FourTanks::antonelo(), 10.0, 4));
    assert!(worst < 1e-7, "{worst:e}");
}

/// Where rows are active without force, an interior point is off by the root of its tolerance.
#[test]
fn the_methods_control_the_oscillator_alike() {
    let worst = disagreement(van_der_pol_loop(), Rk4::new(VanDerPol::default(), 0.5, 4));
    assert!(worst < 1e-5, "{worst:e}");
}

/// A terminal weight that all but prescribes where the horizon ends, and a longer horizon.
#[test]
fn the_methods_agree_with_a_heavy_terminal_weight() {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    for last in [5, 20] {
        let mut run = four_tanks_loop();
        run.problem.horizon = last;
        run.problem.control_horizon = last;
        run.problem.weights.terminal = Some(Weight::Diagonal(vec![1e6; 2]));
        let worst = disagreement(run, model.clone());
        assert!(worst < 1e-6, "N = {last}: {worst:e}");
    }
}
