//! `pinc check`: looks at the plant and the config before anything is trained.
//!
//! An examination takes the [`Subject`] and gives [`Finding`]s; the list of them is [`EXAMINATIONS`].

mod bounds;
mod data;
mod derivatives;
mod excursions;
mod finding;
mod gain;
mod linear;
mod references;
mod region;
mod stability;
mod steady;
mod substeps;
#[cfg(test)]
mod tests;

pub use finding::{Finding, Severity};

use crate::spec::Experiment;
use faer::Mat;
use pinc_ode::DynPlant;
use region::Region;
use steady::{Point, SteadyStateResult};

/// One look at a plant and its config.
type Examination = fn(&Subject<'_>) -> Vec<Finding>;

/// All of them, in the order of their findings.
const EXAMINATIONS: [Examination; 9] = [
    dimensions,
    derivatives::examine,
    stability::examine,
    gain::examine,
    references::examine,
    bounds::examine,
    excursions::examine,
    substeps::examine,
    data::examine,
];

/// Examines the plant of a config (which is itself valid, or it would not have loaded) on the
/// training domain, or else within the controller's bounds.
#[must_use]
pub fn check(experiment: &Experiment) -> Vec<Finding> {
    examine(&*experiment.plant.dyn_plant(), experiment)
}

/// The findings as JSON text: a list of objects with the fields of [`Finding`].
///
/// # Panics
///
/// Never: findings are words.
#[must_use]
pub fn findings_json(findings: &[Finding]) -> String {
    serde_json::to_string_pretty(findings).expect("words can be JSON")
}

fn examine(plant: &dyn DynPlant, experiment: &Experiment) -> Vec<Finding> {
    let Some(region) = Region::of(experiment, plant.dims()) else {
        return vec![
            Finding::warning("", "no [domain] and no [control]: nothing to look at")
                .because("an examination needs to know where the plant is used")
                .change("give [domain], the box that a net is to be trained on"),
        ];
    };
    let subject = Subject::new(plant, experiment, region);
    EXAMINATIONS.iter().flat_map(|examination| examination(&subject)).collect()
}

/// What is examined.
struct Subject<'a> {
    plant: &'a dyn DynPlant,
    experiment: &'a Experiment,
    region: Region,
    /// Where each of the controller's references can be held.
    holds: Vec<SteadyStateResult>,
    /// The steady state in the middle of the region, if there is one.
    centre: Option<Point>,
}

impl<'a> Subject<'a> {
    fn new(plant: &'a dyn DynPlant, experiment: &'a Experiment, region: Region) -> Self {
        let mut subject = Self { plant, experiment, region, holds: Vec::new(), centre: None };
        subject.holds = steady::holds(&subject);
        subject.centre = steady::of_centre(&subject);
        subject
    }

    /// f(x, u).
    fn rhs(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        let mut dx = vec![0.0; x.len()];
        self.plant.rhs(x, u, &[], &mut dx);
        dx
    }

    /// df/d(x, u), `[nx, nx + nu]`.
    fn jacobian(&self, x: &[f64], u: &[f64]) -> Mat<f64> {
        let columns = x.len() + u.len();
        let jacobian = self.plant.jacobian(x, u, &[]);
        Mat::from_fn(x.len(), columns, |row, column| jacobian[row * columns + column])
    }

    /// Length T of a step, where the config says it; else 1 s, as a unit of time.
    fn step_s(&self) -> f64 {
        self.experiment.sample_time_s().unwrap_or(1.0)
    }

    /// The steady states that the plant is to be at, with their names: those of the references, or else
    /// that of the middle.
    fn operating_points(&self) -> Vec<(String, &Point)> {
        let mut points: Vec<(String, &Point)> = Vec::new();
        for (k, hold) in self.holds.iter().enumerate() {
            if let SteadyStateResult::Within(point) | SteadyStateResult::Outside(point) = hold
                && !points.iter().any(|(_, other)| self.region.same(other, point))
            {
                points.push((format!("the steady state of control.references[{k}]"), point));
            }
        }
        if points.is_empty() {
            let centre = self.centre.iter();
            points.extend(centre.map(|p| (format!("the steady state of {}", self.region.name), p)));
        }
        points
    }

    /// The states that are to follow the references, by their places.
    fn controlled(&self) -> Vec<usize> {
        let control = self.experiment.control.iter();
        let names = control.flat_map(|control| &control.controlled);
        let place = |name: &String| self.plant.states().iter().position(|s| s.name == *name);
        names.filter_map(place).collect()
    }

    /// Names with values, as a reader needs them.
    fn state(&self, x: &[f64]) -> String {
        let names = self.plant.states().iter().map(|v| v.name.as_ref());
        named(names, &self.without_rounding(x, 0))
    }

    fn input(&self, u: &[f64]) -> String {
        let names = self.plant.inputs().iter().map(|v| v.name.as_ref());
        named(names, &self.without_rounding(u, self.region.dims.nx))
    }

    /// The values of the variables from `first` on, with 0 for what is 0 but for rounding.
    fn without_rounding(&self, values: &[f64], first: usize) -> Vec<f64> {
        let is_zero = |i: usize, v: f64| v.abs() < 1e-12 * self.region.width(first + i);
        values.iter().enumerate().map(|(i, &v)| if is_zero(i, v) { 0.0 } else { v }).collect()
    }
}

fn dimensions(subject: &Subject<'_>) -> Vec<Finding> {
    let (states, inputs) = (subject.plant.states(), subject.plant.inputs());
    let list = |what: &str, variables: &[pinc_ode::Variable]| {
        let with_unit = variables.iter().map(|v| match v.unit.as_ref() {
            "" => v.name.to_string(),
            unit => format!("{} ({unit})", v.name),
        });
        let plural = if variables.len() == 1 { "" } else { "s" };
        let names = with_unit.collect::<Vec<_>>().join(", ");
        format!("{} {what}{plural}: {names}", variables.len())
    };
    let text = format!("{}; {}", list("state", states), list("input", inputs));
    vec![Finding::fact("", text)]
}

/// Names with their values, as "h1 = 9.16, h2 = 14.2".
fn named<'n>(names: impl Iterator<Item = &'n str>, values: &[f64]) -> String {
    let pairs = names.zip(values).map(|(name, value)| format!("{name} = {}", short(*value)));
    pairs.collect::<Vec<_>>().join(", ")
}

/// A number with five digits.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e5).contains(&size) => {
            let text = format!("{value:.5}");
            let mut text = text[..text.len().min(if value < 0.0 { 8 } else { 7 })].to_owned();
            if text.contains('.') {
                text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
            }
            text
        }
        _ => format!("{value:.3e}"),
    }
}
