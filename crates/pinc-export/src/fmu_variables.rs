//! The variables of functional mock-up units.

use crate::origin::attribute;
use crate::template::constant;
use pinc_mpc::Bounds;
use pinc_ode::Variable;

/// What a variable is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Output,
    /// The derivative of the state at this place.
    Derivative(usize),
    Input,
    Start,
    Tunable,
}

impl Role {
    /// Its attributes in both versions; outputs and inputs are `discrete` where they are sampled.
    pub(crate) fn attributes(self, sampled: bool) -> String {
        let own = match self {
            Self::Output => {
                let kind = if sampled { "discrete" } else { "continuous" };
                return format!(
                    "causality=\"output\" variability=\"{kind}\" initial=\"calculated\""
                );
            }
            Self::Derivative(_) => "causality=\"local\" variability=\"continuous\"",
            Self::Input => "causality=\"input\" variability=\"continuous\"",
            Self::Start => "causality=\"parameter\" variability=\"fixed\" initial=\"exact\"",
            Self::Tunable => "causality=\"parameter\" variability=\"tunable\" initial=\"exact\"",
        };
        own.to_owned()
    }
}

/// A real variable.
pub(crate) struct Real {
    pub(crate) name: String,
    pub(crate) description: &'static str,
    pub(crate) unit: String,
    pub(crate) role: Role,
    pub(crate) start: f64,
    pub(crate) low: Option<f64>,
    pub(crate) high: Option<f64>,
    pub(crate) nominal: Option<f64>,
}

impl Real {
    /// Its attributes that both versions write alike.
    pub(crate) fn attributes(&self) -> String {
        let number = |key: &str, value: Option<f64>| {
            value.map_or_else(String::new, |value| format!(" {key}=\"{}\"", constant(value)))
        };
        let unit = match &*self.unit {
            "" => String::new(),
            unit => format!(" unit=\"{}\"", attribute(unit)),
        };
        let calculated = matches!(self.role, Role::Output | Role::Derivative(_));
        let start = (!calculated).then_some(self.start);
        [
            unit,
            number("min", self.low),
            number("max", self.high),
            number("nominal", self.nominal),
            number("start", start),
        ]
        .concat()
    }
}

/// Variables by their names with this ending.
pub(crate) fn list(
    variables: &[Variable],
    ending: &'static str,
    role: Role,
    starts: &[f64],
) -> Vec<Real> {
    let real = |(variable, &start): (&Variable, &f64)| Real {
        name: format!("{}{ending}", variable.name),
        description: match ending {
            "_start" => "value at the start",
            "_ref" => "reference, held over the horizon",
            "_estimate" => "estimate",
            "_q" => "weight of the distance from the reference",
            "_r" => "weight of the change in a step",
            "_low" => "lower bound",
            "_high" => "upper bound",
            _ => "",
        },
        unit: variable.unit.to_string(),
        role,
        start,
        low: None,
        high: None,
        nominal: None,
    };
    variables.iter().zip(starts).map(real).collect()
}

/// The derivatives of states.
pub(crate) fn derivatives(states: &[Variable]) -> Vec<Real> {
    let of = |(place, (state, real)): (usize, (&Variable, Real))| Real {
        name: format!("der({})", state.name),
        unit: if state.unit.is_empty() { String::new() } else { format!("{}/s", state.unit) },
        role: Role::Derivative(place),
        ..real
    };
    let reals = list(states, "", Role::Output, &vec![0.0; states.len()]);
    states.iter().zip(reals).enumerate().map(of).collect()
}

/// The variables with the sizes that follow from bounds on both sides.
pub(crate) fn sized(mut variables: Vec<Real>, bounds: &Bounds) -> Vec<Real> {
    for (of, (low, high)) in variables.iter_mut().zip(bounds.low.iter().zip(&bounds.high)) {
        of.nominal = Some(low.abs().max(high.abs())).filter(|size| *size > 0.0 && size.is_finite());
    }
    variables
}

/// The variables with their sizes and bounds.
pub(crate) fn bounded(variables: Vec<Real>, bounds: &Bounds) -> Vec<Real> {
    let mut variables = sized(variables, bounds);
    for (of, (low, high)) in variables.iter_mut().zip(bounds.low.iter().zip(&bounds.high)) {
        (of.low, of.high) =
            (Some(*low).filter(|v| v.is_finite()), Some(*high).filter(|v| v.is_finite()));
    }
    variables
}

#[cfg(test)]
mod tests {
    use super::*;

    const INFINITE: f64 = f64::INFINITY;

    fn variables() -> Vec<Variable> {
        vec![Variable::new("h", "cm"), Variable::new("p<q", "bar"), Variable::new("n", "")]
    }

    /// The size of a variable is the larger of its bounds; one without a finite size has none, and a
    /// bound that is infinite is no bound.
    #[test]
    fn attributes_have_the_bounds_that_there_are() {
        let bounds = Bounds::new(vec![-3.0, 0.5, -INFINITE], vec![2.0, INFINITE, INFINITE]);
        let starts = [0.25, 1.0, -4.0];
        let shown =
            |reals: Vec<Real>| -> Vec<String> { reals.iter().map(Real::attributes).collect() };
        let inputs = || list(&variables(), "", Role::Input, &starts);
        assert_eq!(
            shown(bounded(inputs(), &bounds)),
            [
                " unit=\"cm\" min=\"-3.0\" max=\"2.0\" nominal=\"3.0\" start=\"0.25\"",
                " unit=\"bar\" min=\"0.5\" start=\"1.0\"",
                " start=\"-4.0\"",
            ]
        );
        let sizes = " unit=\"cm\" nominal=\"3.0\" start=\"0.25\"";
        assert_eq!(shown(sized(inputs(), &bounds))[0], sizes);
        // What is 0 has no size, and what is calculated has no start.
        let zero = Bounds::new(vec![0.0; 3], vec![0.0; 3]);
        let outputs = list(&variables(), "", Role::Output, &starts);
        let expected = [" unit=\"cm\"", " unit=\"bar\"", ""];
        assert_eq!(shown(sized(outputs, &zero)), expected);
    }

    /// The unit of a derivative is per second; of a number, there is none.
    #[test]
    fn names_and_units_follow_from_the_variables() {
        let rates = derivatives(&variables());
        let names: Vec<&str> = rates.iter().map(|real| &*real.name).collect();
        assert_eq!(names, ["der(h)", "der(p<q)", "der(n)"]);
        let units: Vec<&str> = rates.iter().map(|real| &*real.unit).collect();
        assert_eq!(units, ["cm/s", "bar/s", ""]);
        let places = rates.iter().map(|real| matches!(real.role, Role::Derivative(2)));
        assert_eq!(places.collect::<Vec<_>>(), [false, false, true]);
        let starts = list(&variables(), "_start", Role::Start, &[1.0, 2.0, 3.0]);
        assert_eq!((&*starts[2].name, starts[2].start), ("n_start", 3.0));
        assert_eq!(starts[0].description, "value at the start");
    }
}
