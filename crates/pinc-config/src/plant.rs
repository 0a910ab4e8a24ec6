//! The `[plant]` section: the only place that knows all built-in plants.

use crate::black_box::{FmuSpec, ProcessSpec};
use crate::plants::{MakePlant, Plants};
use pinc_expr::{Equations, PlantEquations, TimeUnit};
use pinc_plants::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// Which plant, with its parameters.
///
/// ```toml
/// [plant]
/// van-der-pol = { mu = 1.0 }
/// ```
///
/// Or a plant by its equations:
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
    /// The quadruple-tank process of Johansson.
    FourTanks(FourTanksSpec),
    /// One tank with an outlet.
    OneTank(BuiltInSpec),
    /// The still for acetone, methanol and water.
    AcetoneStill(BuiltInSpec),
    /// The distillation column for the same mixture.
    AcetoneColumn(BuiltInSpec),
    /// A plant by its equations, as text.
    Expression(Equations),
    /// A plant in Rust or Python that the program brings along.
    Own(OwnPlantSpec),
    /// A plant that a program simulates.
    Process(ProcessSpec),
    /// A plant that a file of the Functional Mock-up Interface simulates.
    Fmu(FmuSpec),
    /// The electro-hydraulic servo axis.
    HydraulicServo(BuiltInSpec),
    /// The car with slipping tyres.
    SingleTrackCar(BuiltInSpec),
    /// The manipulator with two links.
    TwoLinkArm(BuiltInSpec),
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

    /// The unit of time of the plant's equations, where a config says it; they are in s otherwise.
    #[must_use]
    pub fn time_unit(&self) -> Option<TimeUnit> {
        if let Self::Expression(equations) = self { equations.time_unit } else { None }
    }

    /// The plant's equations; `None` for a plant that another program simulates, and for one of a
    /// program's own that was not found or has unusable parameters.
    #[must_use]
    pub fn equations(&self) -> Option<PlantEquations> {
        let equations = match self {
            Self::VanDerPol(spec) => VanDerPol { mu: spec.mu }.equations(),
            Self::FourTanks(spec) => four_tanks(spec).equations(),
            Self::OneTank(_) => OneTank::default().equations(),
            Self::AcetoneColumn(_) => AcetoneColumn::default().equations(),
            Self::AcetoneStill(_) => AcetoneStill::default().equations(),
            Self::HydraulicServo(_) => HydraulicServo::default().equations(),
            Self::SingleTrackCar(_) => SingleTrackCar::default().equations(),
            Self::TwoLinkArm(_) => TwoLinkArm::default().equations(),
            Self::Expression(equations) => equations.clone().into(),
            Self::Own(spec) => spec.build()?.ok()?,
            Self::Process(_) | Self::Fmu(_) => return None,
        };
        let constants = self.constants().into_iter().flatten();
        Some(equations.with_parameters(constants.map(|(name, value)| (name.as_str(), *value))))
    }

    /// The constants of a built-in plant that have other values than its own.
    pub(crate) fn constants(&self) -> Option<&BTreeMap<String, f64>> {
        match self {
            Self::FourTanks(spec) => Some(&spec.constants),
            Self::OneTank(spec)
            | Self::AcetoneStill(spec)
            | Self::AcetoneColumn(spec)
            | Self::HydraulicServo(spec)
            | Self::SingleTrackCar(spec)
            | Self::TwoLinkArm(spec) => Some(&spec.constants),
            Self::VanDerPol(_)
            | Self::Expression(_)
            | Self::Own(_)
            | Self::Process(_)
            | Self::Fmu(_) => None,
        }
    }

    /// Sets constants of a built-in plant that has such a key.
    pub(crate) fn set_constants(&mut self, values: BTreeMap<String, f64>) {
        match self {
            Self::FourTanks(spec) => spec.constants.extend(values),
            Self::OneTank(spec)
            | Self::AcetoneStill(spec)
            | Self::AcetoneColumn(spec)
            | Self::HydraulicServo(spec)
            | Self::SingleTrackCar(spec)
            | Self::TwoLinkArm(spec) => spec.constants.extend(values),
            Self::VanDerPol(_)
            | Self::Expression(_)
            | Self::Own(_)
            | Self::Process(_)
            | Self::Fmu(_) => {}
        }
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

    /// The plant with other values for some of its keys.
    pub(crate) fn with(&self, values: &BTreeMap<String, f64>) -> Self {
        let mut with = self.clone();
        for table in with.parameters.values_mut() {
            table.extend(values.iter().map(|(name, value)| (name.clone(), Value::Float(*value))));
        }
        with
    }

    /// The plant's equations; `None` if none of its name was found, or the reason why its
    /// parameters are unusable.
    pub(crate) fn build(&self) -> Option<Result<PlantEquations, toml::de::Error>> {
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
    /// Damping mu; 1 in the paper.
    pub mu: f64,
}

/// Parameters of the four tanks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FourTanksSpec {
    /// One of three published sets of parameters.
    pub parameters: FourTanksParameters,
    /// Valve openings gamma1 and gamma2, from 0 to 1, instead of the set's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gamma: Option<[f64; 2]>,
    /// Pump constants k1 and k2 in cm^3/(V s), instead of the set's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pump: Option<[f64; 2]>,
    /// Other values for some of the plant's constants, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, f64>,
}

/// The published parameter sets of the four tanks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FourTanksParameters {
    /// The parameters of the paper's results, from its authors' program.
    Antonelo,
    /// Johansson's nonminimum-phase setting, which the paper's text names.
    JohanssonNonminimum,
    /// Johansson's minimum-phase setting.
    JohanssonMinimum,
}

/// A built-in plant.
///
/// ```toml
/// [plant]
/// hydraulic-servo = { constants = { mass = 900.0 } }
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuiltInSpec {
    /// Other values for some of the plant's constants, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, f64>,
}
