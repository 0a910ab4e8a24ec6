//! Nets that trials share.

use super::*;
use pinc_config::{Experiment, Plants, trials};
use std::path::Path;

/// The trials of a sweep of three oscillators, with the parameters that the net takes.
fn oscillators(parameters: &str) -> Vec<Trial> {
    oscillators_with(parameters, "[0.6, 0.9, 1.2]", "")
}

/// The same with these values of mu, and with a further axis.
fn oscillators_with(parameters: &str, values: &str, axis: &str) -> Vec<Trial> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/van-der-pol.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let grid = "\n[[sweep.grid]]\nkey = \"plant.van-der-pol.mu\"\nvalues = ";
    let sweep = format!("{grid}{values}\n{axis}");
    let text = text.replace("[training]", &format!("{parameters}\n[training]")) + &sweep;
    let experiment = Experiment::parse(Path::new("a.toml"), &text, &[], &Plants::built_in());
    trials(&experiment.unwrap()).unwrap()
}

#[test]
fn trials_over_parameters_that_the_net_takes_share_it() {
    let apart = oscillators("");
    let units: HashSet<_> = apart.iter().map(Trial::unit).collect();
    assert_eq!(units.len(), 3);
    let said = nets_of_parameters(&apart).unwrap();
    assert!(said.contains("3 nets for 3 trials"), "{said}");
    assert!(said.contains("[domain.parameters] mu = [0.6, 1.2]"), "{said}");
    let together = oscillators("[domain.parameters]\nmu = [0.5, 1.5]\n");
    let units: HashSet<_> = together.iter().map(Trial::unit).collect();
    assert_eq!(units.len(), 1);
    let ids: HashSet<_> = together.iter().map(|trial| &trial.id).collect();
    assert_eq!(ids.len(), 3, "the loops differ");
    let told: Vec<_> = together.iter().map(|trial| trial.experiment.model_parameters()).collect();
    assert_eq!(told, [[0.6], [0.9], [1.2]]);
    let said = nets_of_parameters(&together).unwrap();
    assert_eq!(said, "3 trials share one net with the inputs mu");
}

#[test]
fn nothing_is_reported_where_no_parameter_differs() {
    assert_eq!(nets_of_parameters(&oscillators("")[..1]), None);
    assert_eq!(nets_of_parameters(&[]), None);
}

/// The range holds all values, whatever their order; nets that also differ in their size would not
/// become one.
#[test]
fn nets_that_differ_in_something_else_are_not_to_be_shared() {
    let said = nets_of_parameters(&oscillators_with("", "[0.9, 1.2, 0.6, 0.7]", "")).unwrap();
    assert!(said.contains("4 nets for 4 trials") && said.contains("mu = [0.6, 1.2]"), "{said}");
    let axis = "[[sweep.grid]]\nkey = \"model.neurons\"\nvalues = [4, 5]\n";
    assert_eq!(nets_of_parameters(&oscillators_with("", "[0.6, 0.9]", axis)), None);
    // Loops that differ share the nets of their plants.
    let axis = "[[sweep.grid]]\nkey = \"control.n2\"\nvalues = [5, 6]\n";
    let said = nets_of_parameters(&oscillators_with("", "[0.6, 0.9]", axis)).unwrap();
    assert!(said.starts_with("2 nets for 4 trials, whose plants differ;"), "{said}");
    let parameters = "[domain.parameters]\nmu = [0.5, 1.5]\n";
    let axis = "[[sweep.grid]]\nkey = \"model.neurons\"\nvalues = [4, 5]\n";
    let said = nets_of_parameters(&oscillators_with(parameters, "[0.6, 0.9]", axis)).unwrap();
    assert_eq!(said, "4 trials share 2 nets with the inputs mu");
}
