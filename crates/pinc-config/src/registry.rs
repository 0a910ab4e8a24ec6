//! From a `[plant]` section to a concrete plant: the only place that knows them all.

use crate::plants::Plants;
use crate::{FourTanksParameters, FourTanksSpec, PlantSpec};
use pinc_ode::{DynPlant, Variable};
use pinc_plants::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};

impl PlantSpec {
    /// Looks a plant of the program's own up among `plants`.
    pub(crate) fn bind(&mut self, plants: &Plants) {
        if let Self::Own(spec) = self {
            spec.bind(plants);
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
            Self::VanDerPol(spec) => Box::new(VanDerPol { mu: spec.mu }),
            Self::FourTanks(spec) => Box::new(four_tanks(spec)),
            Self::OneTank(_) => Box::new(OneTank::default()),
            Self::AcetoneColumn(_) => Box::new(AcetoneColumn::default()),
            Self::AcetoneStill(_) => Box::new(AcetoneStill::default()),
            Self::Expression(equations) => Box::new(
                equations.compile().expect("the equations were compiled when the config was read"),
            ),
            Self::Own(spec) => {
                let plant = spec.build().expect("it was looked up when the config was read");
                plant.expect("its parameters were checked when the config was read")
            }
            Self::HydraulicServo(_) => Box::new(HydraulicServo::default()),
            Self::SingleTrackCar(_) => Box::new(SingleTrackCar::default()),
            Self::TwoLinkArm(_) => Box::new(TwoLinkArm::default()),
        }
    }

    /// The plant's states and inputs.
    ///
    /// # Panics
    ///
    /// As for [`PlantSpec::dyn_plant`].
    #[must_use]
    pub fn variables(&self) -> Variables {
        let plant = self.dyn_plant();
        Variables { states: plant.states().to_vec(), inputs: plant.inputs().to_vec() }
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
#[derive(Clone, Debug, PartialEq)]
pub struct Variables {
    /// The states.
    pub states: Vec<Variable>,
    /// The inputs.
    pub inputs: Vec<Variable>,
}

impl Variables {
    /// The names of the states.
    #[must_use]
    pub fn state_names(&self) -> Vec<String> {
        self.states.iter().map(|v| v.name.to_string()).collect()
    }

    /// The names of the inputs.
    #[must_use]
    pub fn input_names(&self) -> Vec<String> {
        self.inputs.iter().map(|v| v.name.to_string()).collect()
    }
}
