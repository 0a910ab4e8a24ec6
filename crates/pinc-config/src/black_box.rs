//! Plants without equations: `[plant.process]` and `[plant.fmu]`.

use crate::PlantSpec;
use pinc_external::{Fmu, FmuError, FmuKind, FmuPlant, Process};
use pinc_ode::{BlackBox, Dims, Flow, Variable};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// A plant that a program simulates, which answers states and inputs with states ([`pinc_external::Process`]).
///
/// ```toml
/// [plant.process]
/// command = ["python3", "plant.py"]
/// states = [{ name = "x1", unit = "m" }, { name = "x2", unit = "m/s" }]
/// inputs = [{ name = "u", unit = "N" }]
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessSpec {
    /// Program and its arguments.
    pub command: Vec<String>,
    /// States, in order.
    pub states: Vec<Variable>,
    /// Inputs, in order.
    pub inputs: Vec<Variable>,
    /// Typical sizes of states and inputs, by name; 1 where none is given.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub nominal: BTreeMap<String, f64>,
    /// Change of a variable for a finite difference, relative to its typical size.
    #[serde(default = "difference_step")]
    pub difference_step: f64,
    /// Longest time for an answer, in s. The first answer includes the start of the program.
    #[serde(default = "time_limit_s")]
    pub time_limit_s: f64,
    /// Known once the config has been read where processes are allowed.
    #[serde(skip)]
    pub(crate) flow: SharedFlow,
}

/// A plant that a file of the Functional Mock-up Interface simulates ([`pinc_external::Fmu`]).
///
/// ```toml
/// [plant.fmu]
/// file = "oscillator.fmu"
/// states = ["x1", "x2"]
/// inputs = ["u"]
/// start_variables = { x1 = "x1_start", x2 = "x2_start" }
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FmuSpec {
    /// Path of the file.
    pub file: PathBuf,
    /// Interface of the file that is used; if absent, model exchange where the file has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<FmuKind>,
    /// States, in order.
    pub states: Vec<Variable>,
    /// Inputs, in order.
    pub inputs: Vec<Variable>,
    /// Outputs, in order: functions of states and inputs that can be controlled, bounded and measured. If
    /// absent, the states are the outputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<Variable>,
    /// Names of states, inputs and outputs in the file where they differ from those here.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub variables: BTreeMap<String, String>,
    /// Names of the variables that set the initial states, where they differ from the states' names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub start_variables: BTreeMap<String, String>,
    /// Initial values of other variables in the file, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// Time at which each step begins, in s.
    #[serde(default)]
    pub start_time_s: f64,
    /// Whether Jacobians are made of the file's directional derivatives where it has them, rather than of
    /// finite differences.
    #[serde(default = "directional_derivatives")]
    pub directional_derivatives: bool,
    /// Typical sizes of states and inputs, by name; 1 where none is given.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub nominal: BTreeMap<String, f64>,
    /// Change of a variable for a finite difference, relative to its typical size.
    #[serde(default = "difference_step")]
    pub difference_step: f64,
    /// Longest time for a step, in s. The first step includes the loading of the binary.
    #[serde(default = "time_limit_s")]
    pub time_limit_s: f64,
    /// Known once the config has been read where processes are allowed, or what is wrong.
    #[serde(skip)]
    pub(crate) flow: SharedFlow,
}

fn directional_derivatives() -> bool {
    true
}

fn difference_step() -> f64 {
    1e-5
}

/// Time enough for programs that take long to start; short of the patience of who waits for a run.
fn time_limit_s() -> f64 {
    60.0
}

/// Checks say what is wrong with a time that is none.
fn time_limit(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

/// What moves a black box, one for all copies of its spec: the programs are started once.
#[derive(Clone, Debug, Default)]
pub(crate) struct SharedFlow(Option<Arc<dyn Flow>>);

/// It follows from the keys beside it.
impl PartialEq for SharedFlow {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl PlantSpec {
    /// Whether the plant has no equation.
    #[must_use]
    pub fn is_black_box(&self) -> bool {
        matches!(self, Self::Process(_) | Self::Fmu(_))
    }

    /// The plant without an equation, if it is one and is allowed.
    pub(crate) fn black_box(&self) -> Option<BlackBox> {
        let (variables, nominal, difference_step, flow) = match self {
            Self::Process(of) => {
                ([&of.states, &of.inputs, &vec![]], &of.nominal, of.difference_step, &of.flow)
            }
            Self::Fmu(of) => {
                ([&of.states, &of.inputs, &of.outputs], &of.nominal, of.difference_step, &of.flow)
            }
            _ => return None,
        };
        let [states, inputs, outputs] = variables.map(Vec::clone);
        let size = |v: &Variable| nominal.get(&*v.name).copied().unwrap_or(1.0);
        let difference_steps =
            states.iter().chain(&inputs).map(|v| difference_step * size(v)).collect();
        Some(BlackBox { states, inputs, outputs, difference_steps, flow: flow.0.clone()? })
    }
}

impl ProcessSpec {
    /// Names the program; it is started when the plant is first asked.
    pub(crate) fn bind(&mut self) {
        let dims = Dims::new(self.states.len(), self.inputs.len());
        let time_limit = time_limit(self.time_limit_s);
        let flow = Process::new(self.command.clone(), dims, time_limit);
        self.flow = SharedFlow(Some(Arc::new(flow)));
    }
}

impl FmuSpec {
    /// Opens the file, or says what is wrong. Its binary is loaded when the plant is first asked.
    pub(crate) fn open(&self) -> Result<Fmu, FmuError> {
        let name = |v: &Variable| self.variables.get(&*v.name).cloned();
        let named = |v: &Variable| name(v).unwrap_or_else(|| v.name.to_string());
        let start = |v: &Variable| self.start_variables.get(&*v.name).cloned();
        let plant = FmuPlant {
            kind: self.kind,
            states: self.states.iter().map(named).collect(),
            starts: self.states.iter().map(|v| start(v).unwrap_or_else(|| named(v))).collect(),
            inputs: self.inputs.iter().map(named).collect(),
            outputs: self.outputs.iter().map(named).collect(),
            parameters: self.parameters.clone().into_iter().collect(),
            start_s: self.start_time_s,
            directional_derivatives: self.directional_derivatives,
            time_limit: time_limit(self.time_limit_s),
        };
        Fmu::open(&self.file, &plant)
    }

    /// Opens the file, if that can be done: checks say what is wrong otherwise.
    pub(crate) fn bind(&mut self) {
        let flow = self.open().ok();
        self.flow = SharedFlow(flow.map(|fmu| -> Arc<dyn Flow> { Arc::new(fmu) }));
    }
}
