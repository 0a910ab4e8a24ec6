//! The `[plant]` section.

use crate::black_box::{FmuSpec, ProcessSpec};
use crate::plants::{MakePlant, Plants};
use pinc_expr::Equations;
use pinc_ode::DynPlant;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml::Table;

/// Which plant, with its parameters.
///
/// ```toml
/// [plant]
/// van-der-pol = { mu = 1.0 }
/// ```
///
/// or a plant by its equations:
///
/// ```toml
/// [plant.expression]
/// states = [{ name = "x1", unit = "m" }, { name = "x2", unit = "m/s" }]
/// inputs = [{ name = "u", unit = "N" }]
/// parameters = { mu = 1.0 }
/// derivatives = { x1 = "x2", x2 = "mu*(1 - x1^2)*x2 - x1 + u" }
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum PlantSpec {
    /// The Van der Pol oscillator.
    VanDerPol(VanDerPolSpec),
    /// The quadruple-tank process.
    FourTanks(FourTanksSpec),
    /// One tank.
    OneTank(OneTankSpec),
    /// The still for acetone, methanol and water.
    AcetoneStill(AcetoneStillSpec),
    /// The distillation column for the same mixture.
    AcetoneColumn(AcetoneColumnSpec),
    /// A plant whose equations stand in the config.
    Expression(Equations),
    /// A plant that the program adds to these.
    Own(OwnPlantSpec),
    /// A plant that a program simulates.
    Process(ProcessSpec),
    /// A plant that an FMU simulates.
    Fmu(FmuSpec),
    /// The electro-hydraulic servo axis.
    HydraulicServo(HydraulicServoSpec),
    /// The car with slipping tyres.
    SingleTrackCar(SingleTrackCarSpec),
    /// The manipulator with two links.
    TwoLinkArm(TwoLinkArmSpec),
}

impl PlantSpec {
    /// The plant's key in the config.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::VanDerPol(_) => "van-der-pol",
            Self::FourTanks(_) => "four-tanks",
            Self::OneTank(_) => "one-tank",
            Self::AcetoneStill(_) => "acetone-still",
            Self::AcetoneColumn(_) => "acetone-column",
            Self::Expression(_) => "expression",
            Self::Own(_) => "own",
            Self::Process(_) => "process",
            Self::Fmu(_) => "fmu",
            Self::HydraulicServo(_) => "hydraulic-servo",
            Self::SingleTrackCar(_) => "single-track-car",
            Self::TwoLinkArm(_) => "two-link-arm",
        }
    }
}

/// A plant of the program's own ([`Plants`]): its name, with its parameters.
///
/// ```toml
/// [plant.own.pendulum]
/// mass = 1.0
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(transparent)]
pub struct OwnPlantSpec {
    parameters: BTreeMap<String, Table>,
    /// Known once the config has been read with the [`Plants`] that it names one of.
    #[serde(skip)]
    make: Option<MakePlant>,
}

impl OwnPlantSpec {
    /// Name and parameters, if there is exactly one plant.
    pub(crate) fn parts(&self) -> Option<(&str, &Table)> {
        let mut plants = self.parameters.iter();
        let (name, parameters) = plants.next()?;
        plants.next().is_none().then_some((name, parameters))
    }

    /// Looks the plant up among `plants`.
    pub(crate) fn bind(&mut self, plants: &Plants) {
        self.make = self.parts().and_then(|(name, _)| plants.get(name));
    }

    /// The plant; `None` if none of its name was found, or the reason why its parameters are
    /// unusable.
    pub(crate) fn build(&self) -> Option<Result<Box<dyn DynPlant>, toml::de::Error>> {
        let (_, parameters) = self.parts()?;
        Some((self.make?)(parameters.clone()))
    }
}

/// Two are equal if configs write them alike.
impl PartialEq for OwnPlantSpec {
    fn eq(&self, other: &Self) -> bool {
        self.parameters == other.parameters
    }
}

/// Parameters of the Van der Pol oscillator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VanDerPolSpec {
    /// The damping; 1 in the paper.
    pub mu: f64,
}

/// Parameters of the four tanks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FourTanksSpec {
    /// One of three published sets.
    pub parameters: FourTanksParameters,
    /// Valve openings gamma1, gamma2 instead of the set's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gamma: Option<[f64; 2]>,
    /// Pump constants k1, k2 in cm^3/(V s) instead of the set's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pump: Option<[f64; 2]>,
}

/// The published parameter sets of the four tanks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FourTanksParameters {
    /// Those of the paper's results, from its authors' program.
    Antonelo,
    /// Johansson's nonminimum-phase setting, which the paper's text names.
    JohanssonNonminimum,
    /// Johansson's minimum-phase setting.
    JohanssonMinimum,
}

/// The one tank has no parameters to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OneTankSpec {}

/// The still has no parameters to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcetoneStillSpec {}

/// The column has no parameters to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcetoneColumnSpec {}

/// The servo axis has no parameters to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HydraulicServoSpec {}

/// The car has no parameters to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SingleTrackCarSpec {}

/// The manipulator has no parameters to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TwoLinkArmSpec {}
