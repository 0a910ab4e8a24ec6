//! Which trials of a sweep over parameters of the plant share a net.

use crate::{Experiment, Trial};
use std::collections::{BTreeMap, HashSet};

impl Experiment {
    /// What is left where only the net is trained. A net of a family does not depend on what the
    /// plant's own values are for the parameters that it takes as inputs.
    pub(crate) fn training_alone(&self) -> Self {
        let mut alone = self.normalized();
        (alone.prediction, alone.control, alone.one_step) = (None, None, None);
        let ranges = self.domain.iter().flat_map(|domain| &domain.parameters);
        let middle = ranges.map(|of| (of.name.clone(), of.low + 0.5 * (of.high - of.low)));
        alone.plant = alone.plant.with_parameters(&middle.collect());
        alone
    }
}

/// How many nets these trials need, in words, where parameters of their plants differ: one for
/// all of them, if it takes the parameters as inputs, or one for each plant.
#[must_use]
pub fn nets_of_parameters(trials: &[Trial]) -> Option<String> {
    let with_net: Vec<_> = trials.iter().filter(|trial| trial.training.is_some()).collect();
    let nets: HashSet<_> = with_net.iter().map(|trial| trial.unit()).collect();
    let mut ranges: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for (name, value) in with_net.iter().flat_map(|trial| trial.experiment.plant.parameters()) {
        let (low, high) = ranges.entry(name).or_insert((value, value));
        (*low, *high) = (low.min(value), high.max(value));
    }
    ranges.retain(|_, (low, high)| low < high);
    let first = with_net.first().filter(|_| !ranges.is_empty())?;
    let varying = first.experiment.varying();
    let (trials, nets) = (with_net.len(), nets.len());
    let values = |trial: &&&Trial| format!("{:?}", trial.experiment.plant.parameters());
    let plants: HashSet<_> = with_net.iter().map(|trial| values(&trial)).collect();
    ranges.retain(|name, _| !varying.contains(&name.as_str()));
    if ranges.is_empty() {
        let count = if nets == 1 { "one net".to_owned() } else { format!("{nets} nets") };
        let names = varying.join(", ");
        return Some(format!("{trials} trials share {count} with the inputs {names}"));
    }
    // Nets that differ in something else too would not become one.
    if nets > plants.len() {
        return None;
    }
    let ranges = ranges.iter().map(|(name, (low, high))| format!("{name} = [{low:?}, {high:?}]"));
    let ranges = ranges.collect::<Vec<_>>().join(", ");
    Some(format!(
        "{nets} nets for {trials} trials, whose plants differ; with [domain.parameters] {ranges} \
         one net would serve them all"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plants, trials};
    use std::path::Path;

    /// The trials of a sweep of three oscillators, with the parameters that the net takes.
    fn oscillators(parameters: &str) -> Vec<Trial> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/van-der-pol.toml");
        let text = std::fs::read_to_string(path).unwrap();
        let sweep = "\n[[sweep.grid]]\nkey = \"plant.van-der-pol.mu\"\nvalues = [0.6, 0.9, 1.2]\n";
        let text = text.replace("[training]", &format!("{parameters}\n[training]")) + sweep;
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
        let told: Vec<_> =
            together.iter().map(|trial| trial.experiment.model_parameters()).collect();
        assert_eq!(told, [[0.6], [0.9], [1.2]]);
        let said = nets_of_parameters(&together).unwrap();
        assert_eq!(said, "3 trials share one net with the inputs mu");
    }

    #[test]
    fn nothing_is_reported_where_no_parameter_differs() {
        assert_eq!(nets_of_parameters(&oscillators("")[..1]), None);
        assert_eq!(nets_of_parameters(&[]), None);
    }
}
