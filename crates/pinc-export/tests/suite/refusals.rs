//! Controllers that cannot be generated.

use super::controller::{Case, Source, equations, oscillator_case};
use pinc_export::ExportError;
use pinc_expr::PlantEquations;
use pinc_mpc::{QpMethod, Weights};
use pinc_ode::Integrator;

#[test]
fn what_generated_controllers_lack_is_refused() {
    let refused = |change: &dyn Fn(&mut Case), word: &str| {
        let mut case = oscillator_case();
        change(&mut case);
        match case.export(None) {
            Err(ExportError::Feature { feature, .. }) => {
                assert!(feature.contains(word), "{feature}");
            }
            other => panic!("{word}: {other:?}"),
        }
    };
    refused(&|case| case.config.real_time = true, "real-time");
    refused(&|case| case.config.qp = QpMethod::Riccati, "QP method");
    refused(&|case| case.config.qp = QpMethod::Clarabel, "QP method");
    refused(
        &|case| {
            (case.problem.horizon, case.problem.control_horizon) = (41, 41);
        },
        "QP method",
    );
}

/// Numbers of the config that are finite, and what is made of them is not.
#[test]
fn what_overflows_in_c_is_refused() {
    let refused = |change: &dyn Fn(&mut Case), word: &str| {
        let mut case = oscillator_case();
        change(&mut case);
        match case.export(None) {
            Err(ExportError::NotFinite { what }) => assert!(what.contains(word), "{what}"),
            other => panic!("{word}: {:?}", other.map(|files| files.len())),
        }
    };
    // Twice that.
    let weights = || Weights::uniform(vec![1.2e308, 10.0], vec![1e-308]);
    refused(&|case| case.problem.weights = weights(), "weights");
    let plant = equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "derivatives": {"x1": "x2", "x2": "u - x1/(1e200*1e200)"}}"#,
    );
    let source = |plant: &PlantEquations| Source::runge_kutta(plant.clone(), Integrator::Rk4, 4);
    refused(&|case| case.source = source(&plant), "constant");
}
