//! From a `[plant]` section to a concrete plant: the only place that knows them all.

use crate::plants::own;
use crate::spec::{FourTanksParameters, FourTanksSpec, PlantSpec};
use pinc_ode::{DynPlant, Variable};
use pinc_plants::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};

impl PlantSpec {
    /// The plant described.
    pub(crate) fn dyn_plant(&self) -> Box<dyn DynPlant> {
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
                let (name, parameters) = spec.parts().expect("checked when the config was read");
                own(name, parameters).expect("made when the config was read")
            }
            Self::HydraulicServo(_) => HydraulicServo::default().into_dyn(),
            Self::SingleTrackCar(_) => SingleTrackCar::default().into_dyn(),
            Self::TwoLinkArm(_) => TwoLinkArm::default().into_dyn(),
        }
    }

    /// The plant's states and inputs.
    pub(crate) fn variables(&self) -> Variables {
        let system = self.dyn_plant();
        Variables { states: system.states().to_vec(), inputs: system.inputs().to_vec() }
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
