//! The model inside the controller, or the net in the controller's place, by name.

use pinc_ode::Integrator;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::fmt;

/// The model inside the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelKind {
    /// The trained net.
    Pinc,
    /// An integrator of the plant's equation.
    Integrator(Integrator),
    /// The plant without an equation itself, with Jacobians by differences.
    BlackBox,
    /// A net in place of the optimization; its plans are checked by another model.
    Policy,
}

const COUNT: usize = 3 + Integrator::ALL.len();

impl ModelKind {
    /// The Runge-Kutta method of order 4.
    pub const RK4: Self = Self::Integrator(Integrator::Rk4);

    /// The Runge-Kutta method of order 5.
    pub const RK5: Self = Self::Integrator(Integrator::Rk5);

    /// The Rosenbrock method.
    pub const ROSENBROCK: Self = Self::Integrator(Integrator::Rosenbrock);

    /// All of them.
    pub const ALL: [Self; COUNT] = {
        let mut all = [Self::Pinc; COUNT];
        let mut i = 0;
        while i < Integrator::ALL.len() {
            all[1 + i] = Self::Integrator(Integrator::ALL[i]);
            i += 1;
        }
        all[COUNT - 2] = Self::BlackBox;
        all[COUNT - 1] = Self::Policy;
        all
    };

    /// The names of all of them.
    pub const NAMES: [&'static str; COUNT] = {
        let mut names = [""; COUNT];
        let mut i = 0;
        while i < COUNT {
            names[i] = Self::ALL[i].name();
            i += 1;
        }
        names
    };

    /// The name in configs and results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pinc => "pinc",
            Self::Integrator(integrator) => integrator.name(),
            Self::BlackBox => "black-box",
            Self::Policy => "policy",
        }
    }

    /// The name in reports.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Pinc => "PINC",
            Self::Integrator(integrator) => integrator.title(),
            Self::BlackBox => "black box",
            Self::Policy => "policy",
        }
    }

    /// The model of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The integrator, if the model is one.
    #[must_use]
    pub const fn integrator(self) -> Option<Integrator> {
        match self {
            Self::Integrator(integrator) => Some(integrator),
            Self::Pinc | Self::BlackBox | Self::Policy => None,
        }
    }

    /// Whether it is a model without a net.
    #[must_use]
    pub const fn is_numerical(self) -> bool {
        matches!(self, Self::Integrator(_) | Self::BlackBox)
    }
}

impl fmt::Display for ModelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for ModelKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for ModelKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| de::Error::unknown_variant(&name, &Self::NAMES))
    }
}
