//! From a `[plant]` section to a concrete plant: the only place that knows them all.

use crate::black_box::{FmuSpec, ProcessSpec};
use crate::plants::Plants;
use crate::{FourTanksParameters, FourTanksSpec, PlantSpec};
use pinc_ode::{Dims, DynPlant, DynRhs, Variable};
use pinc_plants::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};

impl PlantSpec {
    /// Looks a plant of the program's own up among `plants`.
    pub(crate) fn bind(&mut self, plants: &Plants) {
        match self {
            Self::Own(spec) => spec.bind(plants),
            Self::Process(spec) if plants.processes_are_allowed() => spec.bind(),
            Self::Fmu(spec) if plants.processes_are_allowed() => spec.bind(),
            _ => {}
        }
    }

    /// The plant described.
    ///
    /// # Panics
    ///
    /// If the description does not come from an [`Experiment`](crate::Experiment) that was read and
    /// checked, and is unusable.
    #[must_use]
    pub fn dyn_plant(&self) -> Box<dyn DynPlant> {
        match self {
            Self::VanDerPol(spec) => VanDerPol { mu: spec.mu }.into_dyn(),
            Self::FourTanks(spec) => four_tanks(spec).into_dyn(),
            Self::OneTank(_) => OneTank::default().into_dyn(),
            Self::AcetoneColumn(_) => AcetoneColumn::default().into_dyn(),
            Self::AcetoneStill(_) => AcetoneStill::default().into_dyn(),
            Self::Expression(equations) => equations
                .compile()
                .expect("the equations were compiled when the config was read")
                .into_dyn(),
            Self::Own(spec) => {
                let plant = spec.build().expect("it was looked up when the config was read");
                plant.expect("its parameters were checked when the config was read")
            }
            Self::Process(spec) => {
                Box::new(spec.build().expect("it was allowed when the config was read"))
            }
            Self::Fmu(spec) => {
                Box::new(spec.build().expect("it was opened when the config was read"))
            }
            Self::HydraulicServo(_) => HydraulicServo::default().into_dyn(),
            Self::SingleTrackCar(_) => SingleTrackCar::default().into_dyn(),
            Self::TwoLinkArm(_) => TwoLinkArm::default().into_dyn(),
        }
    }

    /// The plant's states, inputs and outputs.
    ///
    /// # Panics
    ///
    /// As for [`PlantSpec::dyn_plant`].
    #[must_use]
    pub fn variables(&self) -> Variables {
        if let Self::Expression(equations) = self
            && let Ok([states, inputs, outputs]) = equations.variables()
        {
            let outputs = if outputs.is_empty() { states.clone() } else { outputs };
            return Variables { states, inputs, outputs };
        }
        if let Self::Process(ProcessSpec { states, inputs, .. })
        | Self::Fmu(FmuSpec { states, inputs, .. }) = self
        {
            let (states, inputs) = (states.clone(), inputs.clone());
            return Variables { outputs: states.clone(), states, inputs };
        }
        Variables::of(&*self.dyn_plant())
    }
}

pub(crate) fn four_tanks(spec: &FourTanksSpec) -> FourTanks {
    let published = match spec.parameters {
        FourTanksParameters::Antonelo => FourTanks::antonelo(),
        FourTanksParameters::JohanssonNonminimum => FourTanks::johansson_nonminimum(),
        FourTanksParameters::JohanssonMinimum => FourTanks::johansson_minimum(),
    };
    FourTanks {
        gamma: spec.gamma.unwrap_or(published.gamma),
        pump: spec.pump.unwrap_or(published.pump),
        ..published
    }
}

/// The states, inputs and outputs of a plant, in its order.
#[derive(Clone, Debug, PartialEq)]
pub struct Variables {
    /// The states.
    pub states: Vec<Variable>,
    /// The inputs.
    pub inputs: Vec<Variable>,
    /// The outputs; of a plant without any of its own, the states.
    pub outputs: Vec<Variable>,
}

impl Variables {
    /// Those of a plant.
    #[must_use]
    pub fn of(plant: &dyn DynRhs) -> Self {
        Self {
            states: plant.states().to_vec(),
            inputs: plant.inputs().to_vec(),
            outputs: plant.outputs().to_vec(),
        }
    }

    /// The names of the states.
    #[must_use]
    pub fn state_names(&self) -> Vec<String> {
        self.states.iter().map(|v| v.name.to_string()).collect()
    }

    /// The outputs that are no states, by their names, each with its place among all outputs.
    #[must_use]
    pub fn own_outputs(&self) -> Vec<(usize, &Variable)> {
        let is_state = |output: &Variable| self.states.iter().any(|s| s.name == output.name);
        self.outputs.iter().enumerate().filter(|(_, output)| !is_state(output)).collect()
    }

    /// Their names.
    #[must_use]
    pub fn own_output_names(&self) -> Vec<String> {
        self.own_outputs().iter().map(|(_, v)| v.name.to_string()).collect()
    }

    /// The names of all outputs.
    #[must_use]
    pub fn output_names(&self) -> Vec<String> {
        self.outputs.iter().map(|v| v.name.to_string()).collect()
    }

    /// The numbers of states, inputs and outputs.
    #[must_use]
    pub fn dims(&self) -> Dims {
        Dims::new(self.states.len(), self.inputs.len()).with_outputs(self.outputs.len())
    }

    /// The names of the inputs.
    #[must_use]
    pub fn input_names(&self) -> Vec<String> {
        self.inputs.iter().map(|v| v.name.to_string()).collect()
    }
}
