//! Plants that a program adds to the built-in ones.

use pinc_ode::{DynPlant, Plant};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use toml::{Table, Value};

/// The program's own plants. They are the same in the whole program, because configs are read in many
/// places: by commands, by the trials of a sweep, by reports.
static INSTALLED: OnceLock<Plants> = OnceLock::new();

/// A plant of the type registered, from its parameters.
type Make = fn(Table) -> Result<Box<dyn DynPlant>, toml::de::Error>;

/// Plants written in Rust, outside this crate, by the names they have in configs.
///
/// ```
/// use pinc_ad::Scalar;
/// use pinc_bench::{Experiment, Plants};
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
/// Plants::new().with::<Lag>("lag").install();
/// let text = "name = 'l'\npreset = 'ours'\nseed = 0\n[plant.own.lag]\nrate = 2.0";
/// assert!(Experiment::parse("lag.toml".as_ref(), text, &[]).is_ok());
/// ```
#[derive(Clone, Debug, Default)]
pub struct Plants {
    makers: BTreeMap<&'static str, Make>,
}

impl Plants {
    /// No plants but the built-in ones.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// And `P`, which configs have as `[plant.own.<name>]`, with the fields of `P` as its keys.
    #[must_use]
    pub fn with<P: Plant + DeserializeOwned>(mut self, name: &'static str) -> Self {
        self.makers.insert(name, |parameters| {
            let plant: P = Value::Table(parameters).try_into()?;
            Ok(Box::new(plant))
        });
        self
    }

    /// Makes them known to all configs read from now on. [`program`](crate::program) does it by itself.
    ///
    /// # Panics
    ///
    /// If the program has installed plants before.
    pub fn install(self) {
        assert!(INSTALLED.set(self).is_ok(), "plants are installed once");
    }
}

/// Why a plant of the program's own cannot be made.
#[derive(Debug)]
pub(crate) enum OwnPlantProblem {
    /// The program knows these.
    Unknown(Vec<&'static str>),
    /// Its parameters are not what its type asks for.
    Parameters(String),
}

/// The program's own plant `name`.
pub(crate) fn own(name: &str, parameters: &Table) -> Result<Box<dyn DynPlant>, OwnPlantProblem> {
    let makers = INSTALLED.get().map(|plants| &plants.makers);
    let Some(make) = makers.and_then(|makers| makers.get(name)) else {
        let known = makers.into_iter().flat_map(|makers| makers.keys().copied());
        return Err(OwnPlantProblem::Unknown(known.collect()));
    };
    make(parameters.clone())
        .map_err(|error| OwnPlantProblem::Parameters(error.message().to_owned()))
}
