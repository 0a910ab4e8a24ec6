//! Plants that a program adds to the built-in ones.

use pinc_expr::PlantEquations;
use pinc_ode::Plant;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::{Table, Value};

/// Makes a plant of the registered type from its parameters.
pub(crate) type MakePlant = fn(Table) -> Result<PlantEquations, toml::de::Error>;

/// Plants written in Rust, outside this workspace, by the names they have in configs. Whoever reads
/// a config says which plants it may name.
///
/// ```
/// use pinc_ad::Scalar;
/// use pinc_config::{Experiment, Plants};
/// use pinc_ode::{Plant, Variable};
///
/// /// x' = rate (u - x).
/// #[derive(Clone, Debug, serde::Deserialize)]
/// #[serde(deny_unknown_fields)]
/// struct Lag {
///     rate: f64,
/// }
///
/// impl Plant for Lag {
///     fn states(&self) -> &[Variable] {
///         static STATES: [Variable; 1] = [Variable::new("x", "")];
///         &STATES
///     }
///     fn inputs(&self) -> &[Variable] {
///         static INPUTS: [Variable; 1] = [Variable::new("u", "")];
///         &INPUTS
///     }
///     #[inline(always)]
///     fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
///         dx[0] = (u[0] - x[0]) * self.rate;
///     }
/// }
///
/// let plants = Plants::built_in().with::<Lag>("lag");
/// let text = "name = 'l'\npreset = 'ours'\nseed = 0\n[plant.own.lag]\nrate = 2.0";
/// assert!(Experiment::parse("lag.toml".as_ref(), text, &[], &plants).is_ok());
/// assert!(Experiment::parse("lag.toml".as_ref(), text, &[], &Plants::built_in()).is_err());
/// ```
#[derive(Clone, Debug, Default)]
pub struct Plants {
    own: Arc<BTreeMap<&'static str, MakePlant>>,
    processes: bool,
}

impl Plants {
    /// The built-in plants alone.
    #[must_use]
    pub fn built_in() -> Self {
        Self::default()
    }

    /// Adds `P`, which configs have as `[plant.own.<name>]`, with the fields of `P` as its keys.
    #[must_use]
    pub fn with<P: Plant + DeserializeOwned>(mut self, name: &'static str) -> Self {
        Arc::make_mut(&mut self.own).insert(name, |parameters| {
            let plant: P = Value::Table(parameters).try_into()?;
            Ok(PlantEquations::traced(plant))
        });
        self
    }

    /// Allows configs to name programs that simulate their plants
    /// ([`ProcessSpec`](crate::ProcessSpec)), which are then started with the rights of this one.
    #[must_use]
    pub fn allowing_processes(self) -> Self {
        Self { processes: true, ..self }
    }

    pub(crate) fn processes_are_allowed(&self) -> bool {
        self.processes
    }

    /// The names of the added plants, in alphabetical order.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        self.own.keys().copied().collect()
    }

    /// What makes the added plant `name`.
    pub(crate) fn get(&self, name: &str) -> Option<MakePlant> {
        self.own.get(name).copied()
    }
}

/// Two registers are equal if they know the same names.
impl PartialEq for Plants {
    fn eq(&self, other: &Self) -> bool {
        self.own.keys().eq(other.own.keys())
    }
}
