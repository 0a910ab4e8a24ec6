//! The plant's variables: states, inputs, outputs, which are controlled, and which share an axis.

use crate::data::Run;
use pinc_chart::extent;
use pinc_ode::Variable;

/// In an array with more elements than this, not all have curves of their own.
pub(crate) const MOST_SHOWN: usize = 6;
/// Values that differ by less, by ratio, differ by rounding.
pub(crate) const EQUAL: f64 = 1e-13;
/// The share of a panel's height that a curve must take up to be read.
const READABLE: f64 = 0.04;

/// The plant's variables, as the files name them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Variables {
    /// The states, in the plant's order.
    pub(crate) states: Vec<String>,
    /// The inputs, in the plant's order.
    pub(crate) inputs: Vec<String>,
    /// The outputs that are no states, in the plant's order.
    pub(crate) outputs: Vec<String>,
    /// The states and outputs that follow a reference.
    pub(crate) controlled: Vec<String>,
}

impl Variables {
    /// The variables of a run's closed loop, or else of its free run.
    pub(crate) fn of(run: &Run) -> Self {
        if let Some(of) = run.control.loops.first() {
            return Self {
                states: of.table.columns.states.clone(),
                inputs: of.table.columns.inputs.clone(),
                outputs: of.table.columns.outputs.clone(),
                controlled: of.table.columns.controlled.clone(),
            };
        }
        let prediction = run.prediction.as_ref();
        prediction.map_or_else(Self::default, |table| Self {
            states: table.states.clone(),
            inputs: table.inputs.clone(),
            outputs: Vec::new(),
            controlled: Vec::new(),
        })
    }

    /// The place of a state in the plant's order; the outputs follow the states.
    pub(crate) fn index_of(&self, name: &str) -> usize {
        self.states.iter().chain(&self.outputs).position(|s| s == name).unwrap_or(0)
    }

    /// The place of an input in the plant's order.
    pub(crate) fn input_index_of(&self, name: &str) -> usize {
        self.inputs.iter().position(|input| input == name).unwrap_or(0)
    }

    /// For an array with many elements, the first, the middle and the last, and the controlled ones
    /// unless they are many too; all other names.
    pub(crate) fn shown(&self, names: &[String]) -> Vec<String> {
        let mut shown = Vec::new();
        for group in Variable::groups(names) {
            let all = &names[group];
            if all.len() <= MOST_SHOWN {
                shown.extend(all.iter().cloned());
                continue;
            }
            let controlled = all.iter().filter(|name| self.controlled.contains(name)).count();
            let ends = [0, (all.len() - 1) / 2, all.len() - 1];
            let is_shown = |(i, name): &(usize, &String)| {
                let is_followed = controlled <= MOST_SHOWN && self.controlled.contains(name);
                ends.contains(i) || is_followed
            };
            shown.extend(all.iter().enumerate().filter(is_shown).map(|(_, name)| name.clone()));
        }
        shown
    }

    /// The states divided into panels: the controlled ones, and the others.
    pub(crate) fn panels_of(&self, states: &[String]) -> Vec<(String, Vec<String>)> {
        self.divided("states", states)
    }

    /// The outputs divided likewise; nothing if there are none.
    pub(crate) fn output_panels(&self) -> Vec<(String, Vec<String>)> {
        if self.outputs.is_empty() { Vec::new() } else { self.divided("outputs", &self.outputs) }
    }

    fn divided(&self, what: &str, names: &[String]) -> Vec<(String, Vec<String>)> {
        let names = &self.shown(names)[..];
        let is_controlled = |s: &&String| self.controlled.contains(s);
        let (first, rest): (Vec<_>, Vec<_>) = names.iter().partition(is_controlled);
        let owned = |group: Vec<&String>| group.into_iter().cloned().collect::<Vec<_>>();
        if first.is_empty() || rest.is_empty() {
            let title = format!("{}{}", what[..1].to_uppercase(), &what[1..]);
            return vec![(title, names.to_vec())];
        }
        vec![(format!("Controlled {what}"), owned(first)), (format!("Other {what}"), owned(rest))]
    }
}

/// Divides variables so that all in a panel have one unit and ranges of a like size. The title of
/// a panel names its variables if there are several panels.
pub(crate) fn by_axis(
    run: &Run,
    title: String,
    names: Vec<String>,
    range: &dyn Fn(&str) -> (f64, f64),
) -> Vec<(String, Vec<String>)> {
    let mut groups: Vec<Group> = Vec::new();
    for name in names {
        let new = range(&name);
        let takes =
            |of: &&mut Group| run.unit(&of.names[0]) == run.unit(&name) && fit(&of.ranges, new);
        match groups.iter_mut().find(takes) {
            Some(of) => {
                of.names.push(name);
                of.ranges.push(new);
            }
            None => groups.push(Group { names: vec![name], ranges: vec![new] }),
        }
    }
    let divided = groups.len() > 1;
    let titled = |Group { names, .. }: Group| match divided {
        true => (format!("{title}: {}", names.join(", ")), names),
        false => (title.clone(), names),
    };
    groups.into_iter().map(titled).collect()
}

/// The variables of a panel, with their ranges.
struct Group {
    names: Vec<String>,
    ranges: Vec<(f64, f64)>,
}

/// Whether a curve can be read beside others of these ranges, and they beside it: each takes up
/// some of the height that all take together, unless it is constant.
fn fit(ranges: &[(f64, f64)], new: (f64, f64)) -> bool {
    let all = extent(ranges.iter().chain([&new]).flat_map(|range| [range.0, range.1]));
    let height = all.1 - all.0;
    let mut spreads = ranges.iter().chain([&new]).map(|(low, high)| high - low);
    spreads.all(|spread| spread >= READABLE * height || spread <= EQUAL * height)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Curves share a panel where each takes up 4 % of what all take together, wherever that is.
    #[test]
    fn curves_that_can_be_read_together_fit() {
        assert!(fit(&[(100.0, 110.0)], (104.0, 104.5)));
        assert!(fit(&[(100.0, 110.0)], (95.0, 95.7)));
        assert!(!fit(&[(100.0, 110.0)], (90.0, 90.7)));
        assert!(!fit(&[(100.0, 100.3)], (90.0, 100.0)));
        // A constant is no curve.
        assert!(fit(&[(100.0, 110.0)], (105.0, 105.0)));
    }
}
