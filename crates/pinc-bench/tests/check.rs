//! What `pinc check` finds.

mod common;

use common::repository;
use pinc_bench::{Experiment, Finding, Severity, check};

fn findings(config: &str, sets: &[&str]) -> Vec<Finding> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(&Experiment::load(&repository("configs").join(config), &sets).unwrap())
}

fn warnings(config: &str, sets: &[&str]) -> Vec<String> {
    let findings = findings(config, sets);
    assert!(findings.iter().all(|finding| finding.severity != Severity::Error), "{findings:?}");
    let warnings = findings.into_iter().filter(|finding| finding.severity == Severity::Warning);
    warnings.map(|finding| finding.text).collect()
}

#[test]
fn the_shipped_configs_give_no_cause_for_warnings() {
    for config in ["van-der-pol/main.toml", "four-tanks/main.toml", "smoke/rk4-only.toml"] {
        assert_eq!(warnings(config, &[]), [""; 0], "{config}");
    }
}

#[test]
fn a_net_that_would_have_to_extrapolate_is_warned_of() {
    // The box of the paper's Table 1, left by h3, h4 and both inputs.
    let warnings = warnings("four-tanks/main.toml", &["preset=as-released"]);
    for variable in ["h3", "h4", "u1", "u2"] {
        let expected = format!("the bounds of {variable} reach outside the training domain");
        assert!(warnings.iter().any(|text| text.starts_with(&expected)), "{warnings:?}");
    }
    assert_eq!(warnings.len(), 4, "{warnings:?}");
}

#[test]
fn values_outside_their_bounds_are_warned_of() {
    let sets = ["control.initial_state=[2.0, 0.0]", "control.references.1.value=[-1.5, 0.0]"];
    let warnings = warnings("van-der-pol/main.toml", &sets);
    assert_eq!(
        warnings,
        [
            "control.initial_state: x1 = 2 is outside its bounds",
            "control.references[1]: x1 = -1.5 is outside its bounds",
        ]
    );
}

#[test]
fn time_constants_are_those_that_johansson_published() {
    // At his operating point u = (3, 3) V of the minimum-phase setting; the domain is centred there.
    let sets = ["domain.input_low=[2.0, 2.0]", "domain.input_high=[4.0, 4.0]"];
    let findings = findings("smoke/four-tanks.toml", &sets);
    let text = &findings.iter().find(|f| f.text.starts_with("linearised")).unwrap().text;
    assert!(text.contains("steady state"), "{text}");
    let after = text.split("time constant ").skip(1);
    let mut found: Vec<f64> =
        after.map(|rest| rest.split(' ').next().unwrap().parse().unwrap()).collect();
    found.sort_by(f64::total_cmp);
    // He gives whole seconds, for levels rounded to 0.1 cm: sqrt(h) of the lowest, 1.4 cm, is thus
    // known to 2 %.
    for (found, published) in found.iter().zip([23.0, 30.0, 62.0, 90.0]) {
        assert!((found / published - 1.0).abs() < 0.04, "{found} against {published}: {text}");
    }
    assert_eq!(found.len(), 4);
}
