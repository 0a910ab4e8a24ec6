#![doc = include_str!("../README.md")]
//! # Tour
//!
//! An examination takes the `Subject` and gives [`Finding`]s; the list of them is `EXAMINATIONS`.
//! The caller runs closed loops and reads files, and passes the results in as [`Evidence`].

#![forbid(unsafe_code)]

mod algebraic;
mod bounds;
mod cost;
mod data;
mod derivatives;
mod estimation;
mod excursions;
mod finding;
mod gain;
mod gate;
mod groups;
mod horizon;
mod irregularities;
mod kept;
mod loop_plant;
mod memory;
mod minimized;
mod net_size;
mod numbers;
mod proven;
mod references;
mod region;
mod rehearsal;
mod rest;
mod saturation;
mod soundness;
mod stability;
mod substeps;
mod time_unit;
mod tube;
mod work;

pub use cost::{Cost, ModelCost};
pub use finding::{Finding, Severity};
pub use memory::hidden_memory;
pub use proven::{proven_error, step_error};
pub use soundness::{IntegratorBox, Soundness};
pub use work::{Metered, Work};

use kept::Kept;
use numbers::{named, short};
use pinc_analysis::{HeldPoint, OperatingPoint, Region, SteadyStateSearch};
use pinc_config::{Experiment, ModelKind, TimeUnit};
use pinc_net::Measurements;
use pinc_ode::{DynPlant, DynRhs, Trajectory, Variable};
use pinc_record::{ReferenceMetrics, ViolationMetrics};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt;
use std::path::PathBuf;

/// The number of states from which costly examinations take fewer points.
const MANY_STATES: usize = 40;

/// One look at a plant and its config.
struct Examination {
    /// What it looks at.
    topic: &'static str,
    examine: fn(&Subject<'_>) -> Vec<Finding>,
}

const fn on(topic: &'static str, examine: fn(&Subject<'_>) -> Vec<Finding>) -> Examination {
    Examination { topic, examine }
}

/// All of them, in the order of their findings.
const EXAMINATIONS: [Examination; 21] = [
    on("dimensions", dimensions),
    on("values and derivatives", derivatives::examine),
    on("algebraic variables", algebraic::examine),
    on("poles, jumps and kinks", irregularities::examine),
    on("the unit of time", time_unit::examine),
    on("modes and stability", stability::examine),
    on("the horizon", horizon::examine),
    on("gains and zeros", gain::examine),
    on("references", references::examine),
    on("the plant of the loop", loop_plant::examine),
    on("the estimator", estimation::examine),
    on("bounds", bounds::examine),
    on("saturated inputs", saturation::examine),
    on("the tube", tube::examine),
    on("the closed loop", rehearsal::examine),
    on("where trajectories go", excursions::examine),
    on("the integrators' errors", substeps::examine),
    on("costs", cost::examine),
    on("the size of the net", net_size::examine),
    on("measurements", data::examine),
    on("what is minimized", minimized::examine),
];

/// Those that need no equation.
const OF_BLACK_BOXES: [Examination; 5] = [
    on("dimensions", dimensions),
    on("the black box", without_equation),
    on("the memory of the black box", memory::examine),
    on("the closed loop", rehearsal::examine),
    on("what is minimized", minimized::examine),
];

/// Values of references for which steady states are looked for.
const MOST_REFERENCES: usize = 50;

/// More states, modes or zeros than these are summed up.
const LISTED: usize = 6;

/// A closed loop that was run once and not recorded.
#[derive(Clone, Debug)]
pub struct Rehearsal {
    /// The integrator that was the model.
    pub model: ModelKind,
    /// The plant's trajectory.
    pub trace: Trajectory,
    /// How many steps ended with which status.
    pub status: BTreeMap<String, usize>,
    /// Whether the references were reached.
    pub references: ReferenceMetrics,
    /// The bounds that the plant broke.
    pub violations: Vec<ViolationMetrics>,
    /// How many steps at the end of the loop were left out, since those before took so long.
    pub left_out: usize,
}

impl Rehearsal {
    /// The state and the input of a sample of the trace.
    fn point(&self, i: usize) -> OperatingPoint {
        OperatingPoint { x: self.trace.state(i).to_vec(), u: self.trace.input(i).to_vec() }
    }
}

/// Reads the measurements of some files for steps of an experiment's plant; or says, in words, why
/// they cannot be read.
pub type ReadMeasurements<'a> = dyn Fn(&[PathBuf]) -> Result<Measurements, String> + 'a;

/// Knowledge beside the config.
pub struct Evidence<'a> {
    /// The closed loop with an integrator as the model, if the config has one and says T; or why
    /// it could not be run.
    pub rehearsal: Option<Result<Rehearsal, String>>,
    /// How long the models of the loop take, if the config has one and says T.
    pub cost: Option<Cost>,
    /// The files of `[data]`.
    pub read: &'a ReadMeasurements<'a>,
    /// The budget of work, part of which the closed loop has taken.
    pub work: Work,
    /// Is told what is looked at next, with its place and how many parts there are.
    pub progress: &'a dyn Fn(&str, usize, usize),
}

impl fmt::Debug for Evidence<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Evidence").field("rehearsal", &self.rehearsal).finish_non_exhaustive()
    }
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

/// Examines the plant of a valid config on the training domain, or else within the controller's
/// bounds.
#[must_use]
pub fn check(
    plant: &dyn DynPlant,
    experiment: &Experiment,
    evidence: &Evidence<'_>,
) -> Vec<Finding> {
    let Some((region, name)) = region::of(experiment, plant.dims()) else {
        return vec![
            Finding::warning("", "no [domain] and no [control]: nothing to look at")
                .because("an examination needs to know where the plant is used")
                .change("give [domain], the box that a net is to be trained on"),
        ];
    };
    let metered = Metered::new(plant, experiment, &evidence.work);
    let examinations = match plant.black_box() {
        None => &EXAMINATIONS[..],
        Some(_) => &OF_BLACK_BOXES[..],
    };
    (evidence.progress)("steady states", 0, examinations.len());
    evidence.work.begin();
    let subject = Subject::new((plant, &metered), experiment, (region, name), evidence);
    let mut findings = Vec::new();
    for (i, Examination { topic, examine }) in examinations.iter().enumerate() {
        (evidence.progress)(topic, i + 1, examinations.len());
        evidence.work.begin();
        let found = examine(&subject);
        // Without further rates, what looks broken may only be what was not computed.
        let is_whole = !evidence.work.is_over();
        let is_said = |f: &Finding| f.place == LEFT_OUT;
        if is_whole || found.iter().any(is_said) {
            findings.extend(found);
        } else {
            findings.push(left_out(topic));
        }
    }
    findings
}

/// The place of findings on what was left out.
const LEFT_OUT: &str = "left out";

/// Says that a part of the check would take too much work.
fn left_out(topic: &str) -> Finding {
    Finding::fact(
        LEFT_OUT,
        format!(
            "{topic}: this plant needs more evaluations for that than one check may make; a \
             smaller [domain], fewer states or a shorter T need fewer"
        ),
    )
}

/// Where a value of the references can be held.
struct Held {
    /// The place of the first reference with this value.
    first: usize,
    /// How many references have it.
    count: usize,
    point: HeldPoint,
    /// Where the closed loop keeps the value, if that is away from `point`.
    kept: Option<Kept>,
}

/// A point that the plant is to be at.
struct Operating<'a> {
    name: String,
    point: &'a OperatingPoint,
    /// Whether it is a steady state, and not a point of a moving plant.
    is_steady: bool,
}

/// What is examined.
struct Subject<'a> {
    /// The equation, whose evaluations are counted.
    plant: &'a dyn DynRhs,
    /// The units of work that an evaluation takes.
    units: u64,
    /// The plant with its integrators.
    models: &'a dyn DynPlant,
    experiment: &'a Experiment,
    region: Region,
    /// What the region is called.
    region_name: &'static str,
    /// Where the controller's references can be held, each value once.
    holds: Vec<Held>,
    /// How many further values of references were not looked at.
    other_references: usize,
    /// The steady state in the middle of the region, if there is one.
    centre: Option<OperatingPoint>,
    evidence: &'a Evidence<'a>,
}

impl<'a> Subject<'a> {
    fn new(
        (models, plant): (&'a dyn DynPlant, &'a Metered),
        experiment: &'a Experiment,
        (region, region_name): (Region, &'static str),
        evidence: &'a Evidence<'a>,
    ) -> Self {
        let (holds, centre, other_references) = (Vec::new(), None, 0);
        let mut subject = Self {
            plant,
            units: plant.units(),
            models,
            experiment,
            region,
            region_name,
            holds,
            other_references,
            centre,
            evidence,
        };
        if plant.black_box().is_none() {
            (subject.holds, subject.other_references) = subject.held_references();
            let search = subject.search();
            let centre = search.settle(&subject.region.centre().u).or_else(|| search.rest());
            subject.centre = centre;
        }
        subject
    }

    /// A search for steady states near the start of the loop, or else the middle of the region.
    fn search(&self) -> SteadyStateSearch<'_> {
        self.search_of(self.plant)
    }

    /// The search for another plant with the same states and inputs.
    fn search_of<'s>(&'s self, plant: &'s dyn DynRhs) -> SteadyStateSearch<'s> {
        let search = SteadyStateSearch::new(plant, &self.region, self.experiment.seed);
        match &self.experiment.control {
            Some(control) => {
                let (x, u) = (control.initial_state.clone(), self.region.centre().u);
                search.near(OperatingPoint { x, u })
            }
            None => search,
        }
    }

    /// Where the references can be held, and how many values of them are too many to be looked at.
    fn held_references(&self) -> (Vec<Held>, usize) {
        let Some(control) = &self.experiment.control else { return (Vec::new(), 0) };
        let mut places_of: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
        let (mut holds, mut others): (Vec<Held>, usize) = (Vec::new(), 0);
        for (first, reference) in control.references.iter().enumerate() {
            let bits = reference.value.iter().map(|v| v.to_bits()).collect();
            match places_of.entry(bits) {
                Entry::Occupied(known) => {
                    if let Some(held) = holds.get_mut(*known.get()) {
                        held.count += 1;
                    }
                }
                Entry::Vacant(new) => {
                    new.insert(holds.len() + others);
                    if holds.len() == MOST_REFERENCES || self.evidence.work.is_over() {
                        others += 1;
                        continue;
                    }
                    let Some(point) = self.hold(self.plant, &reference.value) else { break };
                    if self.evidence.work.is_over() {
                        others += 1;
                        continue;
                    }
                    let kept = kept::of(self, first, &point);
                    holds.push(Held { first, count: 1, point, kept });
                }
            }
        }
        (holds, others)
    }

    /// Where a plant can hold this value of the references within the controller's bounds; `None`
    /// where that is no question of states.
    fn hold(&self, plant: &dyn DynRhs, value: &[f64]) -> Option<HeldPoint> {
        let control = self.experiment.control.as_ref()?;
        let nx = self.region.dims.nx;
        let ends = |states: &Option<Vec<f64>>, inputs: &[f64], none: f64| {
            [&states.clone().unwrap_or_else(|| vec![none; nx])[..], inputs].concat()
        };
        let low = ends(&control.state_low, &control.input_low, f64::NEG_INFINITY);
        let high = ends(&control.state_high, &control.input_high, f64::INFINITY);
        let places = self.controlled();
        let held: Vec<_> = places.into_iter().zip(value.iter().copied()).collect();
        (!held.is_empty()).then(|| self.search_of(plant).hold(&held, Some((&low, &high))))
    }

    /// f(x, u).
    fn rhs(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        let mut dx = vec![0.0; x.len()];
        self.plant.rhs(x, u, &[], &mut dx);
        dx
    }

    /// Length T of a step, where the config says it; else 1 s, as a unit of time.
    fn step_s(&self) -> f64 {
        self.experiment.sample_time_s().unwrap_or(1.0)
    }

    /// A time in s, in the config's unit.
    fn time(&self, seconds: f64) -> String {
        TimeUnit::shown(seconds, self.experiment.time_unit)
    }

    /// A rate in 1/s, or a part of one, in the unit of [`Subject::rate_unit`].
    fn rate(&self, value: f64) -> String {
        let unit = self.experiment.time_unit.unwrap_or(TimeUnit::S);
        numbers::rate(value * unit.seconds())
    }

    /// A complex rate, likewise.
    fn complex_rate(&self, re: f64, im: f64) -> String {
        let re = self.rate(re);
        match im {
            0.0 => re,
            im if im < 0.0 => format!("{re} -{}i", self.rate(-im)),
            im => format!("{re} +{}i", self.rate(im)),
        }
    }

    fn rate_unit(&self) -> String {
        format!("1/{}", self.experiment.time_unit.unwrap_or(TimeUnit::S).name())
    }

    /// The points that the plant is to be at: the steady states of the references, where the closed
    /// loop keeps one elsewhere that place, or else the steady state of the middle.
    fn operating_points(&self) -> Vec<Operating<'_>> {
        let mut points: Vec<Operating<'_>> = Vec::new();
        for Held { first: k, point, kept, .. } in &self.holds {
            let (name, point, is_steady) = match (kept, point.steady()) {
                (Some(kept), _) => (kept.name(self), &kept.point, false),
                (None, Some(point)) => {
                    (format!("the steady state of control.references[{k}]"), point, true)
                }
                (None, None) => continue,
            };
            if !points.iter().any(|other| self.region.same(other.point, point)) {
                points.push(Operating { name, point, is_steady });
            }
        }
        if points.is_empty() {
            points.extend(self.centre.iter().map(|point| {
                let name = format!("the steady state of {}", self.region_name);
                Operating { name, point, is_steady: true }
            }));
        }
        points
    }

    /// The operating points that are steady states.
    fn steady_points(&self) -> Vec<(String, &OperatingPoint)> {
        let points = self.operating_points().into_iter().filter(|operating| operating.is_steady);
        points.map(|operating| (operating.name, operating.point)).collect()
    }

    /// The inputs' names.
    fn inputs(&self) -> String {
        let names: Vec<&str> = self.plant.inputs().iter().map(|v| v.name.as_ref()).collect();
        names.join(", ")
    }

    fn state_name(&self, i: usize) -> &str {
        &self.plant.states()[i].name
    }

    /// The states that are to follow the references, by their places; none where outputs are among
    /// what follows, since a reference then does not say what the states are to be.
    fn controlled(&self) -> Vec<usize> {
        let control = self.experiment.control.iter();
        let names = control.flat_map(|control| &control.controlled);
        let place = |name: &String| self.plant.states().iter().position(|s| s.name == *name);
        let places: Option<Vec<usize>> = names.map(place).collect();
        places.unwrap_or_default()
    }

    /// A point in words.
    fn at(&self, point: &OperatingPoint) -> String {
        format!("{}; {}", self.state(&point.x), self.input(&point.u))
    }

    /// Names with values, as a reader needs them; of many states those that are controlled, the
    /// first and the last.
    fn state(&self, x: &[f64]) -> String {
        let names: Vec<&str> = self.plant.states().iter().map(|v| v.name.as_ref()).collect();
        let values = self.without_rounding(x, 0);
        if names.len() <= LISTED {
            return named(names.into_iter(), &values);
        }
        let controlled = self.controlled();
        if groups::are_shown(&names) {
            let single = controlled.iter().filter(|_| controlled.len() <= LISTED);
            let single = single.map(|&i| format!(", {} = {}", names[i], short(values[i])));
            return groups::summary(&names, &values) + &single.collect::<String>();
        }
        let is_shown = |i: &usize| *i == 0 || *i == names.len() - 1 || controlled.contains(i);
        let shown: Vec<usize> = (0..names.len()).filter(is_shown).collect();
        let values: Vec<f64> = shown.iter().map(|&i| values[i]).collect();
        let text = named(shown.iter().map(|&i| names[i]), &values);
        match names.len() - shown.len() {
            0 => text,
            more => format!("{text} (and {more} more states)"),
        }
    }

    /// What is controlled with its values, as a reader needs it.
    fn controlled_values(&self, values: &[f64]) -> String {
        let control = self.experiment.control.iter();
        let names: Vec<&str> =
            control.flat_map(|control| &control.controlled).map(String::as_str).collect();
        if groups::are_shown(&names) {
            return groups::summary(&names, values);
        }
        named(names.into_iter(), values)
    }

    fn input(&self, u: &[f64]) -> String {
        let names = self.plant.inputs().iter().map(|v| v.name.as_ref());
        named(names, &self.without_rounding(u, self.region.dims.nx))
    }

    /// The values of the variables from `first` on, with 0 for values that are 0 up to rounding.
    fn without_rounding(&self, values: &[f64], first: usize) -> Vec<f64> {
        let is_zero = |i: usize, v: f64| v.abs() < 1e-12 * self.region.width(first + i);
        values.iter().enumerate().map(|(i, &v)| if is_zero(i, v) { 0.0 } else { v }).collect()
    }
}

fn without_equation(_: &Subject<'_>) -> Vec<Finding> {
    let text = "the plant is a black box: what needs its equation (steady states, stability, \
                bounds that cannot be held) is not examined";
    vec![Finding::fact("plant", text)]
}

fn dimensions(subject: &Subject<'_>) -> Vec<Finding> {
    let (states, inputs) = (subject.plant.states(), subject.plant.inputs());
    let list = |what: &str, variables: &[Variable]| {
        let plural = if variables.len() == 1 { "" } else { "s" };
        let groups = groups::groups(variables).into_iter();
        let groups = groups.map(|(name, places)| match variables[places.start].unit.as_ref() {
            "" => name,
            unit => format!("{name} ({unit})"),
        });
        let groups: Vec<String> = groups.collect();
        let has_arrays = groups.len() < variables.len();
        let names = match &groups[..] {
            [first, .., last] if groups.len() > LISTED && !has_arrays => {
                format!("{first} to {last}")
            }
            all => all.join(", "),
        };
        format!("{} {what}{plural}: {names}", variables.len())
    };
    let text = format!("{}; {}", list("state", states), list("input", inputs));
    vec![Finding::fact("", text)]
}

#[cfg(test)]
mod tests;
