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

/// The loop of the self-test begins where the model has no value, or comes there.
#[test]
fn a_loop_without_a_value_is_refused_where_it_ends() {
    let refused = |x2: &str| {
        let text = format!(
            r#"{{"states": [{{"name": "x1"}}, {{"name": "x2"}}], "inputs": [{{"name": "u"}}],
                "derivatives": {{"x1": "1", "x2": "{x2}"}}}}"#
        );
        let source = Source::runge_kutta(equations(&text), Integrator::Rk4, 4);
        let case = Case { source, ..oscillator_case() };
        match case.export(None) {
            Err(error @ ExportError::NoValue { .. }) => {
                assert!(error.to_string().starts_with("control.initial_state"), "{error}");
                let ExportError::NoValue { t, x, .. } = error else { unreachable!() };
                assert!(x.iter().all(|x| x.is_finite()), "{x:?}");
                t
            }
            other => panic!("{x2}: {:?}", other.map(|files| files.len())),
        }
    };
    assert!(refused("u - log(-1 - x1^2)") <= 0.0);
    assert!(refused("u - x2 + 0.01*log(1.5 - x1)") > 0.0);
}
