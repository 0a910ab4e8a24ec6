//! Controllers in C whose steps are cut off, one after another.

use super::controller::{Budget, Source, compare_within, equations, oscillator_case, tanks_case};
use pinc_mpc::{Bounds, QpMethod, Tracked, Weights};
use pinc_ode::Integrator;

const ANY: Budget = |_, draws| draws.budget(8.0);

/// Plans on their way are improved, waited for, and followed in the end.
#[test]
fn steps_cut_off_one_after_another_are_the_librarys() {
    let seen = compare_within(&oscillator_case(), 500, 31, ANY);
    assert!(seen[0] > 100 && seen[2] > 200, "{seen:?}");
    // For longer than a plan that was good is followed without having been improved.
    let tight: Budget = |k, _| if k < 3 { [0.0; 2] } else { [2.0; 2] };
    for case in [oscillator_case(), tanks_case()] {
        let seen = compare_within(&case, 250, 32, tight);
        assert!(seen[2] > 150, "{seen:?}");
    }
}

/// A plan that nobody has judged leads to where the model has no value: the step begins afresh.
#[test]
fn steps_cut_off_where_the_model_has_no_value_are_the_librarys() {
    let mut case = oscillator_case();
    let cart = equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "derivatives": {"x1": "x2", "x2": "u - 0.1*sqrt(1.2 - x1^2)"}}"#,
    );
    case.source = Source::runge_kutta(cart, Integrator::Rk4, 1);
    case.problem.tracked = Tracked::states([1]);
    case.problem.weights = Weights::uniform(vec![10.0], vec![0.01]);
    case.problem.state_bounds = Bounds::none(2);
    case.problem.input_bounds = Bounds::new(vec![-0.2], vec![0.2]);
    (case.low, case.high) = (vec![-0.5; 2], vec![0.5; 2]);
    let seen = compare_within(&case, 500, 36, ANY);
    assert!(seen[2] > 100 && seen[5] > 10, "{seen:?}");
}

/// Large enough to be interrupted in linearizing and condensing, in the Cholesky factor and in the
/// first working set.
#[test]
fn large_controllers_are_cut_off_where_the_librarys_are() {
    let mut case = tanks_case();
    case.config.qp = QpMethod::Condensed;
    (case.low, case.high) = (vec![6.5, 6.5, 1.6, 1.6], vec![11.5, 11.5, 3.9, 3.9]);
    (case.problem.horizon, case.problem.control_horizon) = (20, 20);
    let seen = compare_within(&case, 100, 34, |_, draws| draws.budget(60.0));
    assert!(seen[2] > 50, "{seen:?}");
    (case.problem.horizon, case.problem.control_horizon) = (70, 3);
    case.problem.state_bounds = Bounds::none(4);
    let some: Budget = |k, draws| match k {
        0 => draws.budget(3.0),
        // The plan comes from a step that was not cut off: only C linearizes it anew, and asks
        // after 32 and 64 stages. Three questions lead to the program's first step.
        2 => {
            let [more, _] = draws.budget(2.0);
            [2.0 + more, 4.0 + more]
        }
        // The plan is of a step cut off before its end was judged: both linearize.
        3 => draws.budget(10.0),
        _ => [0.0; 2],
    };
    let seen = compare_within(&case, 375, 35, some);
    assert!(seen[0] > 300 && seen[2] > 10, "{seen:?}");
}
