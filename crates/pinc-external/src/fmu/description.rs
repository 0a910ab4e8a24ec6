//! An FMU's `modelDescription.xml`.

use roxmltree::{Document, Node};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The version of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Version {
    Two,
    Three,
}

/// Which of its two interfaces an FMU is used by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FmuKind {
    /// The FMU gives f(x, u), which is integrated here.
    ModelExchange,
    /// The FMU integrates itself.
    CoSimulation,
}

/// A number of the FMU: an element of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// The value reference.
    pub(super) reference: u32,
    pub(super) element: usize,
}

/// What is used of a description.
#[derive(Debug)]
pub(super) struct Description {
    pub(super) version: Version,
    /// The `guid` of version 2, the `instantiationToken` of version 3.
    pub(super) token: String,
    /// The model identifier of each interface that there is.
    pub(super) model_exchange: Option<String>,
    pub(super) co_simulation: Option<String>,
    /// The variables of real numbers by name.
    variables: BTreeMap<String, Real>,
    /// The continuous states, in the order of the FMU's vector.
    pub(super) states: Vec<Place>,
    /// The variables that are their derivatives, whose elements are in the same order.
    pub(super) derivatives: Vec<u32>,
    /// Whether model exchange has directional derivatives.
    pub(super) is_differentiable: bool,
}

/// A variable of real numbers.
#[derive(Clone, Debug)]
struct Real {
    reference: u32,
    /// As many as it has elements; 0 where none are given.
    start: Vec<f64>,
    is_input: bool,
    is_calculated: bool,
}

impl Description {
    /// Reads the text of the file; or says, in words, what is wrong with it.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let document = Document::parse(text).map_err(|error| error.to_string())?;
        let root = document.root_element();
        let (version, token) = match root.attribute("fmiVersion") {
            Some("2.0") => (Version::Two, "guid"),
            Some(three) if three.starts_with("3.") => (Version::Three, "instantiationToken"),
            other => {
                let found = other.unwrap_or("none");
                return Err(format!("fmiVersion {found} given, expected 2.0 or 3.0"));
            }
        };
        let token = root.attribute(token).ok_or_else(|| format!("{token} is missing"))?.to_owned();
        let (model_exchange, co_simulation) =
            (identifier(root, "ModelExchange")?, identifier(root, "CoSimulation")?);
        let (flag, (variables, states, derivatives)) = match version {
            Version::Two => ("providesDirectionalDerivative", variables_of_two(root)?),
            Version::Three => ("providesDirectionalDerivatives", variables_of_three(root)?),
        };
        let flag = child(root, "ModelExchange").and_then(|node| node.attribute(flag));
        Ok(Self {
            version,
            token,
            model_exchange,
            co_simulation,
            variables,
            states,
            derivatives,
            is_differentiable: matches!(flag, Some("true" | "1")),
        })
    }

    /// The place of `name`, a variable or an element of one, counted from 1: `x[2]`.
    pub(super) fn place(&self, name: &str) -> Result<Place, String> {
        if let Some(Real { reference, start, .. }) = self.variables.get(name)
            && start.len() == 1
        {
            return Ok(Place { reference: *reference, element: 0 });
        }
        let element = pinc_ode::Variable::split_name(name).and_then(|(array, index)| {
            let Real { reference, start, .. } = self.variables.get(array)?;
            let element = index.checked_sub(1).filter(|element| *element < start.len())?;
            Some(Place { reference: *reference, element })
        });
        element.ok_or_else(|| {
            let known: Vec<_> = self.variables.keys().map(String::as_str).take(20).collect();
            format!("no real variable is named `{name}`; there are {}", known.join(", "))
        })
    }

    /// The start values of the variable with this reference.
    pub(super) fn start(&self, reference: u32) -> Vec<f64> {
        self.variable(reference).map_or_else(Vec::new, |real| real.start.clone())
    }

    /// Whether the variable with this reference may change at any time, being an input.
    pub(super) fn is_input(&self, reference: u32) -> bool {
        self.variable(reference).is_some_and(|real| real.is_input)
    }

    /// Whether the FMU says of the variable with this reference that it calculates it at the start.
    pub(super) fn is_calculated(&self, reference: u32) -> bool {
        self.variable(reference).is_some_and(|real| real.is_calculated)
    }

    fn variable(&self, reference: u32) -> Option<&Real> {
        self.variables.values().find(|real| real.reference == reference)
    }
}

fn child<'a>(node: Node<'a, 'a>, tag: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|child| child.has_tag_name(tag))
}

fn elements<'a>(root: Node<'a, 'a>, section: &str) -> impl Iterator<Item = Node<'a, 'a>> {
    child(root, section).into_iter().flat_map(|node| node.children()).filter(Node::is_element)
}

/// The model identifier of an interface, which is also the name of a file.
fn identifier(root: Node<'_, '_>, tag: &str) -> Result<Option<String>, String> {
    let name = child(root, tag).and_then(|node| node.attribute("modelIdentifier"));
    let is_plain = |c: char| c.is_alphanumeric() || "_-.".contains(c);
    match name {
        Some(name) if name.is_empty() || name.starts_with('.') || !name.chars().all(is_plain) => {
            Err(format!("modelIdentifier {name:?} given, expected a C identifier"))
        }
        name => Ok(name.map(str::to_owned)),
    }
}

fn whole<T: std::str::FromStr>(node: Node<'_, '_>, key: &str) -> Result<T, String> {
    let value = node.attribute(key).and_then(|text| text.trim().parse().ok());
    let name = node.attribute("name").unwrap_or(node.tag_name().name());
    value.ok_or_else(|| format!("{name}: {key} is missing or no whole number"))
}

fn is_input(node: Node<'_, '_>) -> bool {
    node.attribute("causality") == Some("input")
}

fn is_calculated(node: Node<'_, '_>) -> bool {
    node.attribute("initial") == Some("calculated")
        || matches!(node.attribute("causality"), Some("calculatedParameter" | "independent"))
}

/// All of them, the states, and the references of these' derivatives.
type Variables = (BTreeMap<String, Real>, Vec<Place>, Vec<u32>);

fn variables_of_two(root: Node<'_, '_>) -> Result<Variables, String> {
    let all: Vec<_> = elements(root, "ModelVariables").collect();
    let mut variables = BTreeMap::new();
    for node in &all {
        let Some(real) = child(*node, "Real") else { continue };
        let start = real.attribute("start").and_then(|text| text.trim().parse().ok());
        let (reference, start) = (whole(*node, "valueReference")?, vec![start.unwrap_or(0.0)]);
        let name = node.attribute("name").unwrap_or_default().to_owned();
        let (is_input, is_calculated) = (is_input(*node), is_calculated(*node));
        variables.insert(name, Real { reference, start, is_input, is_calculated });
    }
    // Variables are counted from 1.
    let numbered = |index: usize| index.checked_sub(1).and_then(|i| all.get(i)).copied();
    let structure = child(root, "ModelStructure");
    let derivatives = structure.into_iter().flat_map(|node| elements(node, "Derivatives"));
    let (mut states, mut rates) = (Vec::new(), Vec::new());
    for unknown in derivatives {
        let variable = numbered(whole(unknown, "index")?);
        let variable = variable.and_then(|node| Some((node, child(node, "Real")?)));
        let (node, derivative) = variable.ok_or("a derivative is no real variable")?;
        rates.push(whole(node, "valueReference")?);
        let state = numbered(whole(derivative, "derivative")?);
        let state = state.ok_or("a derivative is of no variable")?;
        states.push(Place { reference: whole(state, "valueReference")?, element: 0 });
    }
    Ok((variables, states, rates))
}

fn variables_of_three(root: Node<'_, '_>) -> Result<Variables, String> {
    let reals = || elements(root, "ModelVariables").filter(|node| node.has_tag_name("Float64"));
    let mut variables = BTreeMap::new();
    for node in reals() {
        let mut length = 1;
        for dimension in node.children().filter(|child| child.has_tag_name("Dimension")) {
            let size: Result<usize, _> = whole(dimension, "start");
            let name = node.attribute("name").unwrap_or_default();
            length *= size
                .map_err(|_| format!("{name}: a size that depends on a parameter is not read"))?;
        }
        let given = node.attribute("start").unwrap_or_default().split_whitespace();
        let mut start: Vec<f64> = given.filter_map(|text| text.parse().ok()).collect();
        start.resize(length, 0.0);
        let name = node.attribute("name").unwrap_or_default().to_owned();
        let reference = whole(node, "valueReference")?;
        let (is_input, is_calculated) = (is_input(node), is_calculated(node));
        variables.insert(name, Real { reference, start, is_input, is_calculated });
    }
    let (mut states, mut rates) = (Vec::new(), Vec::new());
    let structure = elements(root, "ModelStructure");
    for unknown in structure.filter(|node| node.has_tag_name("ContinuousStateDerivative")) {
        let reference: u32 = whole(unknown, "valueReference")?;
        rates.push(reference);
        let is_it = |node: &Node<'_, '_>| whole(*node, "valueReference") == Ok(reference);
        let derivative = reals().find(is_it).ok_or("a derivative is no variable of Float64")?;
        let reference = whole(derivative, "derivative")?;
        let state = variables.values().find(|real| real.reference == reference);
        let length = state.ok_or("a derivative is of no variable")?.start.len();
        states.extend((0..length).map(|element| Place { reference, element }));
    }
    Ok((variables, states, rates))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An oscillator with two states, an input and an array, as FMI 2 and FMI 3 describe it.
    const TWO: &str = r#"<fmiModelDescription fmiVersion="2.0" guid="g2">
<ModelExchange modelIdentifier="osc" providesDirectionalDerivative="1"/>
<ModelVariables>
<ScalarVariable name="u" valueReference="6" causality="input"><Real start="0.5"/></ScalarVariable>
<ScalarVariable name="flag" valueReference="1"><Boolean/></ScalarVariable>
<ScalarVariable name="x" valueReference="8" initial="calculated"><Real start="2"/></ScalarVariable>
<ScalarVariable name="der(x)" valueReference="9"><Real derivative="3"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Derivatives><Unknown index="4"/></Derivatives></ModelStructure>
</fmiModelDescription>"#;

    const THREE: &str = r#"<fmiModelDescription fmiVersion="3.0" instantiationToken="g3">
<CoSimulation modelIdentifier="osc"/>
<ModelVariables>
<Float64 name="x" valueReference="1" start="1 2"><Dimension start="2"/><Dimension start="2"/></Float64>
<Float64 name="der(x)" valueReference="3" derivative="1"><Dimension start="4"/></Float64>
<Float64 name="u" valueReference="6" causality="input" start="0.25"/>
</ModelVariables>
<ModelStructure><ContinuousStateDerivative valueReference="3"/></ModelStructure>
</fmiModelDescription>"#;

    fn at(reference: u32, element: usize) -> Place {
        Place { reference, element }
    }

    #[test]
    fn variables_of_version_two_are_counted_from_one() {
        let found = Description::parse(TWO).unwrap();
        assert_eq!((found.version, &*found.token), (Version::Two, "g2"));
        assert_eq!(found.model_exchange.as_deref(), Some("osc"));
        assert_eq!((found.co_simulation.as_deref(), found.is_differentiable), (None, true));
        assert_eq!((&found.states[..], &found.derivatives[..]), (&[at(8, 0)][..], &[9][..]));
        assert_eq!((found.place("u"), found.start(6)), (Ok(at(6, 0)), vec![0.5]));
        assert_eq!([6, 8].map(|of| found.is_input(of)), [true, false]);
        assert_eq!([6, 8].map(|of| found.is_calculated(of)), [false, true]);
        let error = found.place("flag").unwrap_err();
        assert_eq!(error, "no real variable is named `flag`; there are der(x), u, x");
    }

    /// The elements of an array are counted from 1; what is not given starts at 0.
    #[test]
    fn arrays_of_version_three_have_elements() {
        let found = Description::parse(THREE).unwrap();
        assert_eq!((found.version, &*found.token), (Version::Three, "g3"));
        assert_eq!((found.model_exchange.as_deref(), found.is_differentiable), (None, false));
        assert_eq!(found.start(1), [1.0, 2.0, 0.0, 0.0]);
        assert_eq!(found.states, [0, 1, 2, 3].map(|element| at(1, element)));
        assert_eq!(found.derivatives, [3]);
        assert_eq!(found.place("x[1]"), Ok(at(1, 0)));
        assert_eq!(found.place("x[4]"), Ok(at(1, 3)));
        assert_eq!(found.place("u"), Ok(at(6, 0)));
        for unknown in ["x", "x[0]", "x[5]", "y", "u[2]"] {
            assert!(found.place(unknown).is_err(), "{unknown}");
        }
    }

    #[test]
    fn what_cannot_be_read_is_refused_in_words() {
        let with = |text: &str, from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            Description::parse(&text.replacen(from, to, 1)).map(|found| found.version)
        };
        let version = |version: &str| with(THREE, "\"3.0\"", &format!("\"{version}\""));
        assert_eq!(
            [version("3.1"), version("3.0-beta.5")],
            [Ok(Version::Three), Ok(Version::Three)]
        );
        for other in ["3", "30.0", "1.0", ""] {
            let said = format!("fmiVersion {other} given, expected 2.0 or 3.0");
            assert_eq!(version(other), Err(said));
        }
        let none = with(TWO, "fmiVersion=\"2.0\"", "");
        assert_eq!(none, Err("fmiVersion none given, expected 2.0 or 3.0".to_owned()));
        assert_eq!(with(TWO, "guid=\"g2\"", ""), Err("guid is missing".to_owned()));
        for name in ["", ".hidden", "../osc", "o c"] {
            let error = with(TWO, "\"osc\"", &format!("\"{name}\"")).unwrap_err();
            assert_eq!(error, format!("modelIdentifier {name:?} given, expected a C identifier"));
        }
        assert_eq!(with(TWO, "\"osc\"", "\"o-s.c_2\""), Ok(Version::Two));
        let missing = with(TWO, "valueReference=\"6\"", "valueReference=\"six\"");
        assert_eq!(missing, Err("u: valueReference is missing or no whole number".to_owned()));
        let of = with(TWO, "index=\"4\"", "index=\"2\"");
        assert_eq!(of, Err("a derivative is no real variable".to_owned()));
        let size = with(THREE, "<Dimension start=\"2\"/>", "<Dimension valueReference=\"7\"/>");
        assert_eq!(size, Err("x: a size that depends on a parameter is not read".to_owned()));
    }
}
