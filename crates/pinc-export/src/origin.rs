//! The origin of an export, and the comment that states it.

use pinc_net::PincNet;
use pinc_ode::Variable;
use std::fmt::Write as _;

/// Where an export comes from.
#[derive(Clone, Debug)]
pub struct Origin {
    /// The version of the program that wrote it.
    pub version: String,
    /// A hash of what was exported, in hexadecimal digits.
    pub hash: String,
    /// The states with their units.
    pub states: Vec<Variable>,
    /// The inputs with their units.
    pub inputs: Vec<Variable>,
    /// The outputs with their units, where a plant has outputs of its own.
    pub outputs: Vec<Variable>,
    /// What is proven of the net's errors, if it has a certificate.
    pub proven: Option<String>,
}

impl Origin {
    /// The origin of a net, with the units that it was trained in.
    #[must_use]
    pub fn of_net(net: &PincNet, version: &str, hash: &str) -> Self {
        let variable = |name: &String| {
            let unit = net.units.get(name).cloned().unwrap_or_default();
            Variable { name: name.clone().into(), unit: unit.into() }
        };
        let variables = |names: &[String]| names.iter().map(variable).collect();
        Self {
            version: version.to_owned(),
            hash: hash.to_owned(),
            states: variables(net.state_names()),
            inputs: variables(net.input_names()),
            outputs: Vec::new(),
            proven: None,
        }
    }

    /// The quantities at these places among the states and, behind them, the outputs.
    pub(crate) fn quantities<'s>(
        &'s self,
        places: &'s [usize],
    ) -> impl Iterator<Item = &'s Variable> {
        let all = move |place: usize| self.states.iter().chain(&self.outputs).nth(place);
        places.iter().filter_map(move |&place| all(place))
    }

    /// The states, in order.
    pub(crate) fn state_list(&self) -> String {
        list(self.states.iter())
    }

    /// The inputs, in order.
    pub(crate) fn input_list(&self) -> String {
        list(self.inputs.iter())
    }

    /// The comment at the head of a file.
    pub(crate) fn banner(&self, title: &str, net: Option<&PincNet>) -> String {
        let mut text = format!(
            "/*\n * {title}\n *\n * Written by pinc {}; do not edit.\n * Hash of what was exported: \
             {}\n *\n * States:  {}\n * Inputs:  {}\n",
            comment(&self.version),
            comment(&self.hash),
            comment(&self.state_list()),
            comment(&self.input_list()),
        );
        if let Some(net) = net {
            text += " *\n * Domain of the net:\n";
            for row in domain(net, self) {
                let _ = writeln!(text, " *   {}", comment(&row));
            }
            if let Some(proven) = &self.proven {
                let _ =
                    writeln!(text, " *\n * Certificate, in double precision: {}", comment(proven));
            }
        }
        text + " */"
    }
}

/// The box of a net, a row per variable.
pub(crate) fn domain(net: &PincNet, origin: &Origin) -> Vec<String> {
    let variables = origin.states.iter().chain(&origin.inputs);
    let rows = variables.zip(net.domain().ends());
    rows.map(|(variable, (low, high))| format!("{} from {low} to {high}", named(variable)))
        .collect()
}

/// Variables with their units, in order.
pub(crate) fn list<'v>(variables: impl Iterator<Item = &'v Variable>) -> String {
    variables.map(named).collect::<Vec<_>>().join(", ")
}

fn named(variable: &Variable) -> String {
    match &*variable.unit {
        "" => variable.name.to_string(),
        unit => format!("{} ({unit})", variable.name),
    }
}

/// A text that neither ends the comment that it is in nor looks like the beginning of another, and
/// has no trigraphs.
pub(crate) fn comment(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in plain(text).chars() {
        let parts = [('*', '/'), ('/', '*'), ('?', '?')];
        if safe.chars().next_back().is_some_and(|last| parts.contains(&(last, c))) {
            safe.push(' ');
        }
        safe.push(c);
    }
    safe
}

/// A text within the quotes of an attribute in XML, which cannot have control characters at all.
pub(crate) fn attribute(text: &str) -> String {
    let text = plain(text);
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    escaped.replace('"', "&quot;")
}

/// A text with spaces for what controls something, and for what XML does not allow.
fn plain(text: &str) -> String {
    text.replace(|c: char| c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}'), " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comment_is_one_comment() {
        assert_eq!(comment("m/s*/ int x; /*\n1\u{0}2"), "m/s* / int x; / * 1 2");
        // `/*/` would begin one and end another.
        assert_eq!(comment("/*/"), "/ * /");
        assert_eq!(comment("**/ ??/"), "** / ? ?/");
        assert_eq!(comment("m2/s, \u{b0}C"), "m2/s, \u{b0}C");
    }

    #[test]
    fn an_attribute_has_no_markup_and_no_control_characters() {
        assert_eq!(attribute("<\"a\"&b>\u{1}\u{7f}\n"), "&lt;&quot;a&quot;&amp;b&gt;   ");
        assert_eq!(attribute("\u{ffff}m\u{b3}"), " m\u{b3}");
    }
}
