//! The FMU itself: instances of it, and steps of these.

use super::derivatives::{Derivatives, Start};
use super::description::{Description, FmuKind, Place, Version};
use super::equation::Equation;
use super::library::{Binary, Instance};
use super::{FmuError, FmuPlant};
use crate::pool::external;
use pinc_ode::{Dims, Dopri5, Linearization, OdeError};
use std::fmt::{self, Debug};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Local error tolerance of the integration in model exchange.
const TOLERANCE: f64 = 1e-10;

/// An unpacked FMU with the variables of a plant, without instances.
pub(super) struct Simulation {
    pub(super) dims: Dims,
    kind: FmuKind,
    start_s: f64,
    description: Description,
    unpacked: PathBuf,
    /// What is set at the start: the variables, their values, and where among these are states and
    /// inputs.
    references: Vec<u32>,
    values: Vec<f64>,
    starts: Vec<usize>,
    inputs: Vec<usize>,
    /// What is read after a co-simulation: the states.
    states: Reading,
    /// What is read at the start of a step.
    outputs: Reading,
    /// In model exchange, the place of each state in the FMU's vector.
    order: Vec<usize>,
    /// Where they are there and to be used.
    pub(super) derivatives: Option<Arc<Derivatives>>,
    binary: OnceLock<Arc<Binary>>,
}

impl Debug for Simulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Simulation").field("description", &self.description).finish_non_exhaustive()
    }
}

/// Variables that are read, how many numbers they have together, and where among these the quantities
/// are.
struct Reading {
    references: Vec<u32>,
    numbers: usize,
    places: Vec<usize>,
}

impl Reading {
    fn new(description: &Description, of: Vec<Place>) -> Self {
        let (mut references, mut values) = (Vec::new(), Vec::new());
        let read = |place| slot(description, place, &mut references, &mut values);
        let places = of.into_iter().map(read).collect();
        Self { references, numbers: values.len(), places }
    }

    fn read(&self, instance: &mut Instance, to: &mut [f64]) -> Result<(), String> {
        let mut found = vec![0.0; self.numbers];
        instance.get(&self.references, &mut found)?;
        to.iter_mut().zip(&self.places).for_each(|(to, place)| *to = found[*place]);
        Ok(())
    }
}

/// An instance at work.
pub(super) enum Copy {
    ModelExchange(Box<Integrators>),
    CoSimulation(Instance),
}

/// One of f(x, u) alone, and one of its variational equation.
pub(super) struct Integrators {
    equation: Arc<Equation>,
    step: Dopri5,
    variations: Dopri5,
}

impl Simulation {
    /// The FMU that is unpacked in the directory `unpacked`; or what is wrong with it or does not go
    /// with `plant`.
    pub(super) fn new(unpacked: &Path, plant: &FmuPlant) -> Result<Self, FmuError> {
        let text = std::fs::read_to_string(unpacked.join("modelDescription.xml"));
        let text = text.map_err(|_| "it has no modelDescription.xml".to_owned())?;
        let description =
            Description::parse(&text).map_err(|error| format!("modelDescription.xml: {error}"))?;
        let kind = kind(&description, plant.kind)?;
        let places = |names: &[String]| {
            names.iter().map(|name| description.place(name)).collect::<Result<Vec<_>, _>>()
        };
        let named = |names| places(names).map_err(FmuError::at("variables"));
        let [states, input_places, outputs] =
            [named(&plant.states)?, named(&plant.inputs)?, named(&plant.outputs)?];
        let starts = places(&plant.starts).map_err(FmuError::at("start_variables"))?;
        let of_parameter = |(name, _): &(String, f64)| {
            description.place(name).map_err(FmuError::at(format!("parameters.{name}")))
        };
        let parameters =
            plant.parameters.iter().map(of_parameter).collect::<Result<Vec<_>, _>>()?;
        check_distinct(plant, [&states, &input_places])?;
        check_set(&description, plant, [&input_places, &starts, &parameters])?;
        let (mut references, mut values) = (Vec::new(), Vec::new());
        let mut add = |place: Place| slot(&description, place, &mut references, &mut values);
        let starts: Vec<usize> = starts.into_iter().map(&mut add).collect();
        let inputs: Vec<usize> = input_places.iter().copied().map(&mut add).collect();
        let given: Vec<usize> = parameters.into_iter().map(&mut add).collect();
        for (place, (_, value)) in given.into_iter().zip(&plant.parameters) {
            values[place] = *value;
        }
        let order = match kind {
            FmuKind::ModelExchange => order(&description, &states)?,
            FmuKind::CoSimulation => Vec::new(),
        };
        let is_differentiable = kind == FmuKind::ModelExchange && description.is_differentiable;
        let derivatives = (is_differentiable && plant.directional_derivatives).then(|| {
            let numbers = values.len();
            let start =
                Start { references: &references, numbers, states: &starts, inputs: &inputs };
            Arc::new(Derivatives::new(&description, &order, &input_places, start))
        });
        let dims = Dims::new(states.len(), inputs.len()).with_outputs(outputs.len());
        let [states, outputs] = [states, outputs].map(|of| Reading::new(&description, of));
        Ok(Self {
            dims,
            kind,
            start_s: plant.start_s,
            description,
            unpacked: unpacked.to_owned(),
            references,
            values,
            starts,
            inputs,
            states,
            outputs,
            order,
            derivatives,
            binary: OnceLock::new(),
        })
    }

    fn binary(&self) -> Result<Arc<Binary>, String> {
        if let Some(binary) = self.binary.get() {
            return Ok(binary.clone());
        }
        let path = self.binary_path()?;
        let binary = Arc::new(Binary::load(&path, self.description.version)?);
        Ok(self.binary.get_or_init(|| binary).clone())
    }

    /// The path of the binary for this machine.
    fn binary_path(&self) -> Result<PathBuf, String> {
        let system = std::env::consts::OS.replace("macos", "darwin");
        let folder = match self.description.version {
            Version::Two => format!("{}64", system.replace("windows", "win")),
            Version::Three => format!("{}-{system}", std::env::consts::ARCH),
        };
        let identifier = match self.kind {
            FmuKind::ModelExchange => &self.description.model_exchange,
            FmuKind::CoSimulation => &self.description.co_simulation,
        };
        let name = identifier.as_deref().unwrap_or_default();
        let ending = match std::env::consts::OS {
            "macos" => ".dylib",
            _ => std::env::consts::DLL_SUFFIX,
        };
        let file = format!("binaries/{folder}/{name}{ending}");
        let path = self.unpacked.join(&file);
        path.exists().then_some(path).ok_or_else(|| format!("the FMU has no {file}"))
    }

    /// A new instance.
    pub(super) fn start(&self) -> Result<Copy, OdeError> {
        let resources = self.unpacked.join("resources");
        let token = &self.description.token;
        let instance = self
            .binary()
            .and_then(|binary| Instance::new(&binary, (self.kind, self.start_s), token, &resources))
            .map_err(external)?;
        Ok(match self.kind {
            FmuKind::CoSimulation => Copy::CoSimulation(instance),
            FmuKind::ModelExchange => {
                let (order, starts) = (self.order.clone(), self.starts.clone());
                let equation = Equation::new(instance, order, starts, self.derivatives.clone());
                let variations = Arc::new(equation.variational(self.dims.nu));
                let equation = Arc::new(equation);
                Copy::ModelExchange(Box::new(Integrators {
                    step: Dopri5::shared(equation.clone(), TOLERANCE),
                    variations: Dopri5::shared(variations, TOLERANCE).controlled_by(self.dims.nx),
                    equation,
                }))
            }
        })
    }

    /// The values that a step from `x` under `u` begins with.
    fn begin(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        let mut values = self.values.clone();
        let places = self.starts.iter().chain(&self.inputs);
        for (&place, &value) in places.zip(x.iter().chain(u)) {
            values[place] = value;
        }
        values
    }

    /// Moves `x` on by `t` seconds under the input `u`, so many times without beginning anew in between.
    pub(super) fn step(
        &self,
        copy: &mut Copy,
        x: &mut [f64],
        u: &[f64],
        (t, times): (f64, u32),
    ) -> Result<(), OdeError> {
        let values = self.begin(x, u);
        match copy {
            Copy::ModelExchange(of) => {
                let t = t * f64::from(times);
                self.integrate(&of.equation, &of.step, &values, x, t)
            }
            Copy::CoSimulation(instance) => {
                let mut step = |instance: &mut Instance| {
                    instance.restart(&self.references, &values)?;
                    for k in 0..times {
                        instance.do_step(f64::from(k) * t, t)?;
                    }
                    self.states.read(instance, x)
                };
                step(instance).map_err(external)
            }
        }
    }

    /// Writes the outputs in the state `x` under the input `u`.
    pub(super) fn read(
        &self,
        copy: &mut Copy,
        (x, u): (&[f64], &[f64]),
        y: &mut [f64],
    ) -> Result<(), OdeError> {
        let values = self.begin(x, u);
        let mut read = |instance: &mut Instance| self.outputs.read(instance, y);
        let found = match copy {
            Copy::ModelExchange(of) => {
                let begun = of.equation.begin(&self.references, &values);
                begun.and_then(|()| of.equation.look(read))
            }
            Copy::CoSimulation(instance) => {
                instance.restart(&self.references, &values).and_then(|()| read(instance))
            }
        };
        found.map_err(external)
    }
}

impl Simulation {
    /// Moves `x`, with what else `integrator` integrates, from where these values begin.
    fn integrate(
        &self,
        equation: &Equation,
        integrator: &Dopri5,
        values: &[f64],
        x: &mut [f64],
        t: f64,
    ) -> Result<(), OdeError> {
        equation.begin(&self.references, values).map_err(external)?;
        // A fresh one has adapted no step size yet: the same bits on any number of threads.
        let integrated = integrator.clone().integrate(x, &[], t);
        equation.failure().map_or(integrated, |failure| Err(external(failure)))
    }

    /// The step from one point with its Jacobians, by the variational equation.
    pub(super) fn differentiate(
        &self,
        of: &Integrators,
        (x, u): (&[f64], &[f64]),
        t: f64,
        out: Linearization<'_>,
    ) -> Result<(), OdeError> {
        let Dims { nx, nu, .. } = self.dims;
        let mut all = vec![0.0; nx * (1 + nx + nu)];
        let (state, columns) = all.split_at_mut(nx);
        state.copy_from_slice(x);
        for i in 0..nx {
            columns[i * nx + i] = 1.0;
        }
        self.integrate(&of.equation, &of.variations, &self.begin(x, u), &mut all, t)?;
        let (state, columns) = all.split_at(nx);
        out.next.copy_from_slice(state);
        for (j, column) in columns.chunks_exact(nx).enumerate() {
            let (to, width, j) = match j.checked_sub(nx) {
                None => (&mut *out.a, nx, j),
                Some(j) => (&mut *out.b, nu, j),
            };
            column.iter().enumerate().for_each(|(i, slope)| to[i * width + j] = *slope);
        }
        Ok(())
    }
}

/// Checks that states and inputs are different variables.
fn check_distinct(plant: &FmuPlant, [states, inputs]: [&[Place]; 2]) -> Result<(), FmuError> {
    let places: Vec<&Place> = states.iter().chain(inputs).collect();
    for (i, name) in plant.states.iter().chain(&plant.inputs).enumerate() {
        if places[..i].contains(&places[i]) {
            let problem = format!("`{name}` is two of the plant's states and inputs");
            return Err(FmuError::at("variables")(problem));
        }
    }
    Ok(())
}

/// Checks that what is set can be set, and is set once: inputs, starts and parameters.
fn check_set(
    description: &Description,
    plant: &FmuPlant,
    places: [&[Place]; 3],
) -> Result<(), FmuError> {
    let mut set: Vec<Place> = Vec::new();
    let keyed = |key: &'static str| move |name| (key.to_owned(), name);
    let of_starts = plant.starts.iter().map(keyed("start_variables"));
    let parameters = plant.parameters.iter().map(|(name, _)| (format!("parameters.{name}"), name));
    let names = plant.inputs.iter().map(keyed("inputs")).chain(of_starts).chain(parameters);
    for ((key, name), &place) in names.zip(places.into_iter().flatten()) {
        if set.contains(&place) {
            let problem = format!("`{name}` is set already, as an input, a start or a parameter");
            return Err(FmuError::at(key)(problem));
        }
        if description.is_calculated(place.reference) {
            let problem = format!("`{name}` is calculated, so that it cannot be set");
            return Err(FmuError::at(key)(problem));
        }
        set.push(place);
    }
    Ok(())
}

/// The interface that is asked for, or the first that there is.
fn kind(description: &Description, asked: Option<FmuKind>) -> Result<FmuKind, String> {
    let has = |kind: &FmuKind| match kind {
        FmuKind::ModelExchange => description.model_exchange.is_some(),
        FmuKind::CoSimulation => description.co_simulation.is_some(),
    };
    let kinds = match asked {
        Some(kind) => vec![kind],
        None => vec![FmuKind::ModelExchange, FmuKind::CoSimulation],
    };
    let found = kinds.into_iter().find(has);
    found.ok_or_else(|| "it has not the interface that is asked for".to_owned())
}

/// Where a place is among the values of some variables, to which its variable is added if it is not
/// among them, with its start values.
pub(super) fn slot(
    description: &Description,
    place: Place,
    references: &mut Vec<u32>,
    values: &mut Vec<f64>,
) -> usize {
    let mut first = 0;
    for &reference in references.iter() {
        if reference == place.reference {
            return first + place.element;
        }
        first += description.start(reference).len();
    }
    references.push(place.reference);
    values.extend(description.start(place.reference));
    first + place.element
}

/// The place of each of the plant's states in the FMU's vector of them.
fn order(description: &Description, states: &[Place]) -> Result<Vec<usize>, String> {
    let of_fmu = &description.states;
    let place = |state| of_fmu.iter().position(|other| other == state);
    let found: Option<Vec<usize>> = states.iter().map(place).collect();
    found.filter(|order| order.len() == of_fmu.len()).ok_or_else(|| {
        format!("model exchange needs all continuous states, of which there are {}", of_fmu.len())
    })
}
