//! Which trials of a sweep over parameters of the plant share a net.

#[cfg(test)]
mod tests;

use pinc_config::Trial;
use std::collections::{BTreeMap, HashSet};

/// How many nets these trials need, in words, where parameters of their plants differ: one for
/// all of them, if it takes the parameters as inputs, or one for each plant.
pub(super) fn nets_of_parameters(trials: &[Trial]) -> Option<String> {
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
