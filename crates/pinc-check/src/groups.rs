//! Arrays in findings: one line for all elements that are alike.

use crate::numbers::ends;
use crate::{LISTED, short};
use pinc_ode::Variable;
use std::ops::Range;

/// The arrays among variables, and each variable that is no element of one: what a reader calls it,
/// and its places.
pub(crate) fn groups(variables: &[Variable]) -> Vec<(String, Range<usize>)> {
    let names: Vec<&str> = variables.iter().map(|variable| variable.name.as_ref()).collect();
    let groups = Variable::groups(&names).into_iter();
    groups.zip(Variable::grouped_names(&names)).map(|(places, name)| (name, places)).collect()
}

/// Whether there are so many variables that the elements of an array are shown together.
pub(crate) fn are_shown(names: &[&str]) -> bool {
    names.len() > LISTED && Variable::groups(names).len() < names.len()
}

/// Names with their values; an array with the ends of its values.
pub(crate) fn summary(names: &[&str], values: &[f64]) -> String {
    let one = |(group, name): (Range<usize>, String)| {
        let values = &values[group];
        let (low, high) = ends(values.iter().copied());
        match values {
            [value] => format!("{name} = {}", short(*value)),
            _ => format!("{name} = {} to {}", short(low), short(high)),
        }
    };
    let named = Variable::groups(names).into_iter().zip(Variable::grouped_names(names));
    named.map(one).collect::<Vec<_>>().join(", ")
}
