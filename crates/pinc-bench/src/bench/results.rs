//! The measurements as data: the JSON of `pinc bench --json`.

use pinc_net::Isa;
use pinc_record::{Invocation, StepTimes};
use serde::Serialize;

/// All measurements of a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchReport {
    /// The machine of the measurements.
    pub machine: Machine,
    /// Whether sizes and repetitions were small: the times then say little.
    pub quick: bool,
    /// The machine's peak.
    pub fma_peak_gflops: FmaPeak,
    /// Loss and gradient of the batched kernel.
    pub loss_gradient: Vec<LossGradient>,
    /// One step of a model.
    pub model_step: Vec<ModelStep>,
    /// One quadratic program of the controller.
    pub qp: Vec<QpTime>,
    /// The controller in closed loop.
    pub nmpc: Vec<NmpcTimes>,
}

impl BenchReport {
    /// A report with no measurements yet.
    pub(super) fn begin(quick: bool, invocation: Invocation) -> Self {
        Self {
            machine: Machine::of(invocation),
            quick,
            fma_peak_gflops: FmaPeak { f64_1: 0.0, f64_all: 0.0 },
            loss_gradient: Vec::new(),
            model_step: Vec::new(),
            qp: Vec::new(),
            nmpc: Vec::new(),
        }
    }

    /// The report as JSON.
    ///
    /// # Panics
    ///
    /// Never: numbers, texts and lists have a form in JSON.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers, texts and lists have a form in JSON")
    }
}

/// The machine and the build.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Machine {
    /// Name of the processor.
    pub cpu: String,
    /// Threads that it runs at once.
    pub cores: usize,
    /// Instruction sets that it has, of those that the kernel knows, the fastest first.
    pub isa: Vec<String>,
    /// Operating system.
    pub os: String,
    /// Target triple.
    pub target: String,
    /// Version of the compiler.
    pub rustc: String,
    /// Whether it was built with optimization for releases or as a development build.
    pub profile: String,
    /// Version of pinc.
    pub version: String,
    /// Commit of the source, if it was built from a git repository.
    pub git_commit: Option<String>,
    /// Whether the source differed from the commit.
    pub git_dirty: Option<bool>,
}

impl Machine {
    pub(super) fn of(invocation: Invocation) -> Self {
        Self {
            cpu: invocation.cpu,
            cores: invocation.cores,
            isa: Isa::available().iter().map(ToString::to_string).collect(),
            os: invocation.os,
            target: invocation.target,
            rustc: invocation.rustc,
            profile: invocation.profile,
            version: invocation.version,
            git_commit: invocation.git_commit,
            git_dirty: invocation.git_dirty,
        }
    }
}

/// Fused multiply-adds on registers alone, two operations each, in 10^9 per second: the median of
/// the probes between the kernel's repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FmaPeak {
    /// One thread, f64.
    pub f64_1: f64,
    /// All threads, f64.
    pub f64_all: f64,
}

/// Loss and gradient of the PINC loss in the weights of the net.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LossGradient {
    /// The plant.
    pub plant: &'static str,
    /// Hidden layers and neurons, as `4x20`.
    pub layers: String,
    /// Collocation points and initial conditions together.
    pub points: usize,
    /// Initial conditions among them.
    pub initial_points: usize,
    /// Kind of number.
    pub precision: &'static str,
    /// Threads.
    pub threads: usize,
    /// Instruction set.
    pub isa: String,
    /// Median time of an evaluation.
    pub ms: f64,
    /// Operations of the matrix products, in 10^9 per second.
    pub gflops: f64,
    /// `gflops` relative to the multiply-add probe with as many threads in the machine's best
    /// instruction set, measured in turns with the evaluations.
    pub fraction_of_peak: f64,
    /// How many evaluations the median is of.
    pub repetitions: usize,
}

/// One step of a model over T.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelStep {
    /// The plant.
    pub plant: &'static str,
    /// `pinc` or `rk4`.
    pub model: &'static str,
    /// Hidden layers and neurons of a net.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layers: Option<String>,
    /// Substeps of the Runge-Kutta method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps: Option<usize>,
    /// Whether the equation is interpreted text and not compiled.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub as_text: bool,
    /// How long a net was trained, in s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trained_s: Option<f64>,
    /// Median time of a step.
    pub forward_ns: f64,
    /// Median time of a step with both Jacobians.
    pub forward_jacobian_ns: f64,
    /// Root mean square over all states and over points that fill the domain, of the error after
    /// one step, in the states' units.
    pub one_step_rms: f64,
}

/// One quadratic program, warm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QpTime {
    /// The plant.
    pub plant: &'static str,
    /// The solver.
    pub solver: String,
    /// Time of one, with the checks around it: see `note`.
    pub us: f64,
    /// How it was measured.
    pub note: &'static str,
}

/// The controller in closed loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NmpcTimes {
    /// The plant.
    pub plant: &'static str,
    /// The model in the controller: `pinc` or `rk4`.
    pub model: &'static str,
    /// Largest KKT residual that counts as converged.
    pub kkt_tol: f64,
    /// Time of the controller in a step.
    pub step_us: StepTimes,
    /// SQP iterations (quadratic programs) per step.
    pub sqp_iterations_mean: f64,
    /// Part of the steps that converged to `kkt_tol`.
    pub converged: f64,
    /// The method for the quadratic programs.
    pub qp_solver: String,
}
