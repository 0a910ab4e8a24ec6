//! What arguments of the command line can be chosen from.

use crate::Target;
use pinc_config::{ModelKind, OutsidePolicy};
use pinc_export::FmiVersion;

/// What to do where a net is evaluated outside its training domain.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Outside {
    /// Continue, and report how often and how far.
    Report,
    /// End there.
    Refuse,
}

impl Outside {
    pub(crate) fn policy(self) -> OutsidePolicy {
        match self {
            Self::Report => OutsidePolicy::Report,
            Self::Refuse => OutsidePolicy::Refuse,
        }
    }
}

/// The model inside the controller.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Only {
    /// The trained net.
    Pinc,
    /// The Runge-Kutta method of order 4.
    Rk4,
    /// The Runge-Kutta method of order 5.
    Rk5,
    /// The Rosenbrock method.
    #[value(name = "rosenbrock")]
    Rodas4,
}

impl Only {
    pub(crate) fn kind(self) -> ModelKind {
        match self {
            Self::Pinc => ModelKind::Pinc,
            Self::Rk4 => ModelKind::Rk4,
            Self::Rk5 => ModelKind::Rk5,
            Self::Rodas4 => ModelKind::Rodas4,
        }
    }
}

/// What a net is exported to.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum To {
    /// C99 without dependencies.
    C,
    /// C for CasADi's `external`, with exact Jacobian and Hessian.
    Casadi,
    /// A co-simulation FMU, with its sources.
    Fmu,
    /// An ONNX file.
    Onnx,
}

impl To {
    pub(crate) fn target(self, double: bool, fmi3: bool) -> Target {
        match self {
            Self::C => Target::C,
            Self::Casadi => Target::Casadi,
            Self::Fmu if fmi3 => Target::Fmu(FmiVersion::Three),
            Self::Fmu => Target::Fmu(FmiVersion::Two),
            Self::Onnx if double => Target::OnnxDouble,
            Self::Onnx => Target::Onnx,
        }
    }
}
