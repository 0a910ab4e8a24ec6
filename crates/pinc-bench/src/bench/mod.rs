//! Measurements of the machine that this runs on: what `pinc bench` prints.
//!
//! - `kernel`: loss and gradient of the batched kernel, against the machine's multiply-add peak;
//! - `model`: one step of a model, alone and with Jacobians, and how accurate it is;
//! - `control`: the closed loops of the shipped configs;
//! - `programs`: the quadratic programs in them.
//!
//! `docs/benchmarks.md` explains each figure.

mod cases;
mod control;
mod exchange;
mod kernel;
mod model;
mod programs;
mod results;
mod table;

pub use results::{BenchReport, FmaPeak, LossGradient, Machine, ModelStep, NmpcTimes, QpTime};

use cases::{Case, Effort};
use pinc_net::Isa;
use pinc_runs::invocation::invocation;
use pinc_runs::progress::Stage;
use pinc_runs::{RunError, Verbosity};
use std::path::PathBuf;

/// The measurements to make, and their length.
#[derive(Clone, Debug)]
pub struct BenchOptions {
    /// Small sizes and few repetitions: everything runs, but the times say little.
    pub quick: bool,
    /// Measure only loss and gradient of the Van der Pol net, and write to this file (safetensors)
    /// all that another program needs to compute the same, with the result.
    pub loss_gradient_file: Option<PathBuf>,
    /// Whether progress is shown.
    pub verbosity: Verbosity,
}

/// Measures this machine.
///
/// # Errors
///
/// [`RunError`] if a file cannot be written, or a net cannot be trained.
pub fn bench(options: &BenchOptions) -> Result<BenchReport, RunError> {
    let effort = Effort::new(options.quick);
    let mut report = BenchReport::begin(options.quick, invocation(&[]));
    let progress = |what: &str, case: Case| {
        let mut stage = Stage::begin(options.verbosity, &format!("{what}, {}", case.name()), 1);
        stage.advance(0, String::new);
        stage
    };
    let mut probes = kernel::Probes::default();
    let file = options.loss_gradient_file.as_deref();
    let (cases, isas) = match file {
        Some(_) => (&Case::ALL[..1], vec![Isa::detect()]),
        None => (&Case::ALL[..], Isa::available()),
    };
    for &case in cases {
        let stage = progress("kernel", case);
        let results = &mut report.loss_gradient;
        let (isas, probes) = (&isas[..], &mut probes);
        kernel::Bench { case, effort: &effort, isas, file, results, probes }.run()?;
        stage.end("done");
    }
    report.fma_peak_gflops = probes.peak();
    if file.is_none() {
        for case in Case::ALL {
            let stage = progress("models and control", case);
            control::run(case, &effort, &mut report)?;
            stage.end("done");
        }
    }
    Ok(report)
}
