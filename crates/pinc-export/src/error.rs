//! Errors of exports.

use pinc_estimate::EstimateError;
use pinc_expr::ExpressionError;
use pinc_mpc::MpcError;
use pinc_net::NetError;
use pinc_ode::OdeError;
use pinc_verify::VerifyError;
use thiserror::Error;

/// An error of this crate.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ExportError {
    /// A name that cannot begin the names in a program.
    #[error(
        "name: `{found}` given, expected a letter, then letters, digits and underscores, at most \
        31 in all, and no word of C"
    )]
    Name {
        /// The name.
        found: String,
    },
    /// A net that is no model.
    #[error(transparent)]
    Net(#[from] NetError),
    /// Equations that are none.
    #[error("the plant's equations: {0}")]
    Equations(Box<ExpressionError>),
    /// An integrator that is no model of the plant.
    #[error("the model: {0}")]
    Integrator(#[from] OdeError),
    /// A controller that is none.
    #[error("the controller: {0}")]
    Controller(#[from] MpcError),
    /// An estimator that is none.
    #[error("the estimator: {0}")]
    Estimator(#[from] EstimateError),
    /// A net whose error cannot be estimated.
    #[error("the estimated error: {0}")]
    Estimate(Box<VerifyError>),
    /// A net of a family of plants by itself.
    #[error(
        "the net takes the parameters {0} as inputs, which no file of a net alone has: C and FMUs of \
         its config's controller fix them, and `Model.casadi` of Python takes them"
    )]
    Family(String),
    /// Two variables of an FMU that would have one name.
    #[error(
        "an FMU has two variables named `{name}`: rename a variable of the plant; `time`, `status`, \
         `estimator_status`, `trust`, `tube` and the plant's names with _start, _ref, _estimate, _q, \
         _r, _low and _high are the FMU's own"
    )]
    SameName {
        /// The name.
        name: String,
    },
    /// Files that do not fit into an archive.
    #[error("the files do not fit into an archive of 4 GB")]
    Archive,
    /// Finite numbers that overflow when they are brought to the form of the export.
    #[error("{what} would not be finite in the export: its numbers are too large")]
    NotFinite {
        /// What has them.
        what: String,
    },
    /// A model without a value in the loop of the self-test.
    #[error(
        "control.initial_state: the self-test begins there, and the model has no finite value a step \
         after t = {t} s, from the state {x:?} with the input {u:?}: begin elsewhere, or guard roots, \
         logarithms and divisions in the plant's equations"
    )]
    NoValue {
        /// The time.
        t: f64,
        /// The state there.
        x: Vec<f64>,
        /// The input there.
        u: Vec<f64>,
    },
    /// Something that generated controllers do not have.
    #[error("the generated controller has no {feature}; use {instead}")]
    Feature {
        /// What it has not.
        feature: &'static str,
        /// What can be used in its place.
        instead: &'static str,
    },
}

/// Refuses numbers that are NaN or infinite; `what` names what has them.
pub(crate) fn finite<'v>(
    what: impl Into<String>,
    values: impl IntoIterator<Item = &'v f64>,
) -> Result<(), ExportError> {
    match values.into_iter().all(|value| value.is_finite()) {
        true => Ok(()),
        false => Err(ExportError::NotFinite { what: what.into() }),
    }
}

impl From<VerifyError> for ExportError {
    fn from(error: VerifyError) -> Self {
        Self::Estimate(Box::new(error))
    }
}

impl From<ExpressionError> for ExportError {
    fn from(error: ExpressionError) -> Self {
        Self::Equations(Box::new(error))
    }
}
