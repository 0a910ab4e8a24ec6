//! Controllers by other methods, in other units, and with outputs, against the library's.

use super::controller::{
    Case, Source, compare, equations, gauss_newton, oscillator, oscillator_case,
};
use pinc_mpc::{Bounds, NmpcProblem, QpMethod, Softness, SqpConfig, Tracked, Weights};
use pinc_ode::{Dims, Integrator};

pub(crate) fn with_rk5() -> Case {
    let source = Source::runge_kutta(oscillator(), Integrator::Rk5, 2);
    Case { source, ..oscillator_case() }
}

/// The method of order 5.
#[test]
fn controllers_with_rk5_take_the_librarys_steps() {
    let seen = compare(&with_rk5(), 250, 20);
    assert!(seen[0] > 100, "{seen:?}");
}

/// Inputs without an effect leave no table behind that nothing reads, which compilers warn of.
#[test]
fn an_input_without_effect_is_exported_cleanly() {
    let equations = equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "derivatives": {"x1": "x2", "x2": "-x1 - x2^3"}}"#,
    );
    let source = Source::runge_kutta(equations, Integrator::Rk4, 2);
    let printed = Case { source, ..oscillator_case() }.sources().assert_portable("ctl");
    assert!(printed.contains("20 steps"), "{printed}");
}

/// No derivative passes through a sign, whatever is inside and around it: no variable is left behind
/// that nothing reads.
#[test]
fn signs_of_functions_and_functions_of_signs_are_exported_cleanly() {
    let equations = equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "derivatives": {"x1": "x2 + 0.001*abs(sign(x1))*sign(x2 - 3)^2",
                            "x2": "u - x1 - 0.001*sign(tanh(x2)) - 0.001*exp(-abs(sign(u)))"},
            "outputs": {"side": "x1 + 0.001*sqrt(sign(sin(x2) - 0.5)^2) + max(sign(x1*x2), 0)"}}"#,
    );
    let base = oscillator_case();
    let source = Source::runge_kutta(equations, Integrator::Rk4, 2);
    let tracked = vec![Tracked::Output(0), Tracked::State(1)];
    let problem = NmpcProblem { tracked, ..base.problem };
    Case { source, problem, ..oscillator_case() }.sources().assert_portable("ctl");
}

/// The oscillator in other units: x1 and u in thousandths, x2 in units of 4096.
pub(crate) fn in_odd_units() -> Case {
    let equations = equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "let": {"a": "x1/8192", "b": "x2*4096"},
            "derivatives": {"x1": "8192*b", "x2": "((1 - a^2)*b - a + u/8192)/4096"}}"#,
    );
    let base = oscillator_case();
    let (x1, x2) = (8192.0, 1.0 / 4096.0);
    let sides = |v: f64| vec![v * x1, v * x2];
    Case {
        problem: NmpcProblem {
            state_bounds: Bounds::new(sides(-1.0), sides(1.0)),
            input_bounds: Bounds::new(vec![-x1], vec![x1]),
            weights: Weights::uniform(
                vec![10.0 / (x1 * x1), 10.0 / (x2 * x2)],
                vec![1.0 / (x1 * x1)],
            ),
            ..base.problem
        },
        source: Source::runge_kutta(equations, Integrator::Rk4, 4),
        low: sides(-1.3),
        high: sides(1.3),
        ..oscillator_case()
    }
}

/// Quantities that are not of ordinary size are scaled as in the library.
#[test]
fn controllers_in_odd_units_take_the_librarys_steps() {
    let mut case = in_odd_units();
    let units = case.problem.units(case.model().dims(), None);
    assert!(units.states[0] > 1.0 && units.states[1] < 1.0 && units.inputs[0] > 1.0, "{units:?}");
    // Differences are counted in these units.
    let seen = compare(&case, 1000, 21);
    assert!(seen[0] > 400 && seen[3] > 20, "{seen:?}");
    case.problem.delay = 1;
    case.problem.state_softness = Softness::Penalty(vec![50.0 / 8192.0, 5.0 * 4096.0]);
    case.problem.increment_bounds = Bounds::new(vec![-2000.0], vec![3000.0]);
    let seen = compare(&case, 250, 22);
    assert!(seen[0] > 20, "{seen:?}");
}

/// The oscillator with outputs: a position with a bend in it, a power, and a force.
fn with_outputs() -> Case {
    let equations = equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "derivatives": {"x1": "x2", "x2": "(1 - x1^2)*x2 - x1 + u"},
            "outputs": {"bent": "x1 + 0.2*x1^3", "force": "2*u - 0.5*x1", "power": "u*x2"}}"#,
    );
    let base = oscillator_case();
    Case {
        source: Source::runge_kutta(equations, Integrator::Rk4, 4),
        problem: NmpcProblem { state_bounds: Bounds::none(2), ..base.problem },
        ..oscillator_case()
    }
}

pub(crate) fn tracking() -> Case {
    let mut case = with_outputs();
    case.problem.tracked = vec![Tracked::Output(0), Tracked::State(1)];
    case.problem.output_bounds = Some(Bounds::new(vec![-1.0; 3], vec![1.0; 3]));
    case
}

/// Outputs that are tracked, with states or without; outputs that are bounded, softly or not; all
/// of it in other units too.
#[test]
fn controllers_with_outputs_take_the_librarys_steps() {
    let infinite = f64::INFINITY;
    let bounds = Bounds::new(vec![-1.0, -infinite, -0.4], vec![1.0, 1.5, infinite]);
    let with = |change: &dyn Fn(&mut NmpcProblem)| {
        let mut case = with_outputs();
        change(&mut case.problem);
        case
    };
    let tracked = || vec![Tracked::Output(0), Tracked::State(1)];
    let cases = [
        with(&|p| p.tracked = tracked()),
        with(&|p| p.output_bounds = Some(bounds.clone())),
        with(&|p| {
            p.output_bounds = Some(bounds.clone());
            p.output_softness = Softness::Exact;
            (p.tracked, p.n1, p.delay) = (tracked(), 2, 1);
        }),
        with(&|p| {
            p.output_bounds = Some(bounds.clone());
            p.output_softness = Softness::Penalty(vec![30.0, 20.0, 10.0]);
            p.tracked = vec![Tracked::Output(1), Tracked::Output(0)];
            p.control_horizon = 3;
            p.state_bounds = Bounds::new(vec![-1.5; 2], vec![1.5; 2]);
        }),
        with(&|p| {
            // Bounds of 4e-3 that are large beside nothing, and a cost of another size.
            let sides = vec![infinite, infinite, 0.004];
            p.output_bounds = Some(Bounds::new(vec![-infinite, -infinite, -0.004], sides));
            p.weights = Weights::uniform(vec![1e8, 1e8], vec![1e7]);
            p.tracked = tracked();
        }),
    ];
    for (i, case) in cases.iter().enumerate() {
        let seen = compare(case, 250, 30 + i as u64);
        assert!(seen[0] > 20, "case {i}: {seen:?}");
    }
}

/// A chain of lags from the input to what is tracked: without a weight on the input, the Hessian is
/// singular, as late inputs come too late.
#[test]
fn controllers_without_a_weight_on_the_input_take_the_librarys_steps() {
    let lags = 6;
    let names: Vec<String> = (1..=lags).map(|i| format!("x{i}")).collect();
    let states: Vec<_> = names.iter().map(|name| format!(r#"{{"name": "{name}"}}"#)).collect();
    let rates: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(i, name)| {
            let before = i.checked_sub(1).map_or("u", |before| names[before].as_str());
            format!(r#""{name}": "{before} - {name} - 0.1*{name}^3""#)
        })
        .collect();
    let chain = equations(&format!(
        r#"{{"states": [{}], "inputs": [{{"name": "u"}}], "derivatives": {{{}}}}}"#,
        states.join(", "),
        rates.join(", ")
    ));
    let weights = Weights::uniform(vec![10.0], vec![0.0]);
    let case = Case {
        problem: NmpcProblem {
            tracked: Tracked::states([lags - 1]),
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            ..NmpcProblem::new(Dims::new(lags, 1), 12, weights)
        },
        config: SqpConfig { qp: QpMethod::Condensed, ..gauss_newton() },
        source: Source::runge_kutta(chain, Integrator::Rk4, 1),
        low: vec![-0.5; lags],
        high: vec![0.5; lags],
        sample_time_s: 0.3,
        ..oscillator_case()
    };
    let seen = compare(&case, 1000, 40);
    assert!(seen[0] > 800, "{seen:?}");
}
