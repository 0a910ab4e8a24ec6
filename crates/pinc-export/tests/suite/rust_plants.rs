//! Controllers of plants in Rust, whose recorded equations are written in C.

use super::controller::{Begin, Case, Source, compare, gauss_newton};
use pinc_mpc::{Bounds, NmpcProblem, Tracked, Weights};
use pinc_ode::{Dims, Integrator};
use pinc_plants::{AcetoneStill, HydraulicServo};

/// The stiff axis needs ten substeps.
#[test]
fn the_servos_controller_takes_the_librarys_steps() {
    let (low, high) = (vec![-0.024, -0.42, -12.0, -0.75], vec![0.024, 0.42, 12.0, 0.75]);
    let weights = Weights::uniform(vec![1e4], vec![0.1]);
    let case = Case {
        problem: NmpcProblem {
            tracked: Tracked::states([0]),
            state_bounds: Bounds::new(low, high),
            input_bounds: Bounds::new(vec![-0.75], vec![0.75]),
            ..NmpcProblem::new(Dims::new(4, 1), 10, weights)
        },
        config: gauss_newton(),
        source: Source::runge_kutta(HydraulicServo::default().equations(), Integrator::Rk4, 10),
        parameters: Vec::new(),
        low: vec![-0.01, -0.05, -3.0, -0.2],
        high: vec![0.01, 0.05, 3.0, 0.2],
        sample_time_s: 0.01,
        outputs_of: None,
        begin: Begin::default(),
        guard: None,
    };
    let seen = compare(&case, 500, 31);
    assert!(seen[0] > 200, "{seen:?}");
}

/// The boiling point is computed by as many steps as the still takes itself.
#[test]
fn the_stills_controller_takes_the_librarys_steps() {
    let weights = Weights::uniform(vec![1e4, 1e4], vec![1.0, 1e-3]);
    let case = Case {
        problem: NmpcProblem {
            state_bounds: Bounds::new(vec![0.03, 0.1], vec![0.3, 0.36]),
            input_bounds: Bounds::new(vec![2.0, 30.0], vec![6.0, 160.0]),
            ..NmpcProblem::new(Dims::new(2, 2), 5, weights)
        },
        config: gauss_newton(),
        source: Source::runge_kutta(AcetoneStill::default().equations(), Integrator::Rk4, 2),
        parameters: Vec::new(),
        low: vec![0.08, 0.15],
        high: vec![0.25, 0.33],
        sample_time_s: 60.0,
        outputs_of: None,
        begin: Begin::default(),
        guard: None,
    };
    let seen = compare(&case, 250, 32);
    assert!(seen[0] > 100, "{seen:?}");
}
