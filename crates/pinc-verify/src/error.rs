//! Typed errors.

use pinc_expr::ExpressionError;
use pinc_net::NetError;
use pinc_ode::OdeError;
use thiserror::Error;

/// Why the error of a step cannot be proven.
#[derive(Debug, Error)]
pub enum VerifyError {
    /// The equations cannot be read as a list of operations.
    #[error("the plant's equations cannot be enclosed: {0}")]
    Equations(#[source] ExpressionError),
    /// The net is no model of one step.
    #[error("the net cannot be enclosed: {0}")]
    Net(#[source] NetError),
    /// A black box says nothing of its equation.
    #[error("the plant is a black box: it has no equation to compare the net with")]
    NoEquation,
    /// The net is one of another plant.
    #[error("{what} of the model: {net}; of the plant: {plant}")]
    OtherPlant {
        /// States or inputs.
        what: &'static str,
        /// The net's names.
        net: String,
        /// The plant's.
        plant: String,
    },
    /// There is no integrator to compare a distilled net with.
    #[error("a distilled net is compared with an integrator: {0}")]
    Reference(#[source] OdeError),
    /// None is accurate.
    #[error(
        "the error of a distilled net is its distance from an integrator, and none of RK5 with up to 64 \
         and Rosenbrock with up to 1024 substeps is accurate enough beside this net"
    )]
    NoReference,
    /// There are too many variables.
    #[error(
        "{found} variables (states, inputs and parameters together): a proof over boxes is \
         possible for {MOST} at most",
        MOST = crate::MOST_VARIABLES
    )]
    TooManyVariables {
        /// How many there are.
        found: usize,
    },
    /// A domain's ends.
    #[error("the domain has {found} ranges, expected {expected}: states, inputs and parameters")]
    Domain {
        /// How many ranges there are.
        found: usize,
        /// How many variables there are.
        expected: usize,
    },
}
