//! What `pinc check` says of plants with arrays and of many references.

use crate::common::repository;
use pinc_config::{Experiment, Plants};
use pinc_runs::{Finding, Severity, check};

fn findings(config: &str, sets: &[&str]) -> Vec<Finding> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let path = repository("configs").join(config);
    check(&Experiment::load(&path, &sets, &Plants::built_in()).unwrap())
}

fn text(findings: &[Finding]) -> String {
    findings.iter().map(|finding| format!("{finding}\n")).collect()
}

#[test]
fn an_array_is_one_line() {
    let rod = findings("distributed/rod.toml", &["control.duration_s=50"]);
    let said = text(&rod);
    assert!(rod.iter().all(|finding| finding.severity != Severity::Error), "{said}");
    assert!(said.contains("20 states: T[1..20] (degC); 1 input: P (W)"), "{said}");
    let held = "T[4] = 120 is held at T[1..20] = 55.40";
    assert!(said.contains(held), "{said}");
    assert!(rod.len() <= 20, "{said}");
    // Bounds, domain and start of a whole array in one finding each.
    let sets = ["control.duration_s=50", "control.state_low=[130.0]", "control.state_high=[260.0]"];
    let said = text(&findings("distributed/rod.toml", &sets));
    assert!(said.contains("T[1] = 100 is outside its bounds"), "{said}");
    assert!(!said.contains("T[2] = 100 is outside its bounds"), "{said}");
    assert!(said.contains("the bounds of T[1..20] reach outside the training domain"), "{said}");
}

#[test]
fn terms_of_an_array_are_one_finding() {
    let sets = ["control.duration_s=200", "domain.state_low=[-1.0]", "plant.expression.sizes.n=10"];
    let said = text(&findings("distributed/reactor.toml", &sets));
    assert_eq!(said.matches("the denominator T[").count(), 1, "{said}");
}

#[test]
fn each_value_of_the_references_is_looked_at_once_and_not_more_than_fifty() {
    let references = |values: &dyn Fn(usize) -> usize| {
        let steps = (0..400)
            .map(|k| format!("{{ start_s = {}.0, value = [{}.0] }}", 5 * k, 100 + values(k)));
        format!("control.references=[{}]", steps.collect::<Vec<_>>().join(", "))
    };
    let held = |values: &dyn Fn(usize) -> usize| {
        let sets = ["plant.expression.sizes.n=5", "control.duration_s=50", &references(values)];
        text(&findings("distributed/rod.toml", &sets))
    };
    let few = held(&|k| k % 3);
    assert_eq!(few.matches("is held at").count(), 3, "{few}");
    assert!(
        few.contains("control.references[1]: T[1] = 101 (and 132 times more) is held"),
        "{few}"
    );
    let many = held(&|k| k % 60);
    assert_eq!(many.matches("is held at").count(), 50, "{many}");
    let left = "control.references: steady states were looked for at the first 50 different \
                values, not at the 10 others";
    assert!(many.contains(left), "{many}");
}

#[test]
fn a_long_loop_of_a_large_model_is_rehearsed_in_part() {
    let sets = ["control.models=[\"rosenbrock\"]", "control.rosenbrock_substeps=40"];
    let said = text(&findings("distributed/rod.toml", &sets));
    let expected =
        "the first 5 steps of the closed loop with Rosenbrock succeed; the other 115 were left";
    assert!(said.contains(expected), "{said}");
}
