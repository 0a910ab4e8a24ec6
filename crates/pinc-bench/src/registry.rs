//! From a `[plant]` section to a concrete plant: the only place that knows them all.

use crate::spec::{FourTanksParameters, FourTanksSpec, PlantSpec};
use pinc_ode::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, Plant, SingleTrackCar,
    TwoLinkArm, VanDerPol, Variable,
};

/// Work that is the same for every plant.
pub(crate) trait PlantTask {
    /// What comes out.
    type Output;

    /// Does it for `plant`.
    fn run<P: Plant + 'static>(self, plant: P) -> Self::Output;
}

impl PlantSpec {
    /// Does `task` for the plant described.
    pub(crate) fn with<T: PlantTask>(&self, task: T) -> T::Output {
        match self {
            Self::VanDerPol(spec) => task.run(VanDerPol { mu: spec.mu }),
            Self::FourTanks(spec) => task.run(four_tanks(spec)),
            Self::OneTank(_) => task.run(OneTank::default()),
            Self::AcetoneColumn(_) => task.run(AcetoneColumn::default()),
            Self::AcetoneStill(_) => task.run(AcetoneStill::default()),
            Self::Expression(equations) => task.run(
                equations.compile().expect("the equations were compiled when the config was read"),
            ),
            Self::HydraulicServo(_) => task.run(HydraulicServo::default()),
            Self::SingleTrackCar(_) => task.run(SingleTrackCar::default()),
            Self::TwoLinkArm(_) => task.run(TwoLinkArm::default()),
        }
    }

    /// The plant's states and inputs.
    pub(crate) fn variables(&self) -> Variables {
        self.with(ReadVariables)
    }
}

fn four_tanks(spec: &FourTanksSpec) -> FourTanks {
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

/// The states and inputs of a plant, in its order.
#[derive(Clone, Debug)]
pub(crate) struct Variables {
    pub(crate) states: Vec<Variable>,
    pub(crate) inputs: Vec<Variable>,
}

impl Variables {
    pub(crate) fn state_names(&self) -> Vec<String> {
        self.states.iter().map(|v| v.name.to_string()).collect()
    }

    pub(crate) fn input_names(&self) -> Vec<String> {
        self.inputs.iter().map(|v| v.name.to_string()).collect()
    }
}

struct ReadVariables;

impl PlantTask for ReadVariables {
    type Output = Variables;

    fn run<P: Plant + 'static>(self, plant: P) -> Variables {
        Variables { states: plant.states().to_vec(), inputs: plant.inputs().to_vec() }
    }
}
