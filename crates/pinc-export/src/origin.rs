//! Where an export comes from, and the comment that says so.

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
    /// The states with their units; a net alone knows no units.
    pub states: Vec<Variable>,
    /// The inputs with their units.
    pub inputs: Vec<Variable>,
    /// The outputs with their units, where a plant has outputs of its own.
    pub outputs: Vec<Variable>,
}

impl Origin {
    /// The origin of a net without units.
    #[must_use]
    pub fn of_net(net: &PincNet, version: &str, hash: &str) -> Self {
        let variables = |names: &[String]| {
            let variable =
                |name: &String| Variable { name: name.clone().into(), unit: String::new().into() };
            names.iter().map(variable).collect()
        };
        Self {
            version: version.to_owned(),
            hash: hash.to_owned(),
            states: variables(net.state_names()),
            inputs: variables(net.input_names()),
            outputs: Vec::new(),
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
        list(&self.states)
    }

    /// The inputs, in order.
    pub(crate) fn input_list(&self) -> String {
        list(&self.inputs)
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

fn list(variables: &[Variable]) -> String {
    variables.iter().map(named).collect::<Vec<_>>().join(", ")
}

fn named(variable: &Variable) -> String {
    match &*variable.unit {
        "" => variable.name.to_string(),
        unit => format!("{} ({unit})", variable.name),
    }
}

/// A text that does not end the comment that it is in.
pub(crate) fn comment(text: &str) -> String {
    text.replace("*/", "* /").replace(['\n', '\r'], " ")
}

/// A text within the quotes of an attribute in XML.
pub(crate) fn attribute(text: &str) -> String {
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    escaped.replace('"', "&quot;").replace(['\n', '\r'], " ")
}
