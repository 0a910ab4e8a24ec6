//! Upper limits of all sizes: with larger values a run would take all memory, or a lifetime.

use super::values::value;
use super::{Checked, Problem};
use crate::{ControlSpec, Experiment};
use pinc_mpc::{QpMethod, Weight};
use pinc_net::optim::OptimizerConfig;
use pinc_ode::{Dims, Integrator};

/// Steps of T that a run or a scenario may have at most.
pub const STEPS: usize = 10_000_000;
/// Points, scenarios and rows that are held in memory.
const POINTS: usize = 1_000_000;
/// Substeps, subintervals and other parts of a step.
pub(super) const PARTS: usize = 10_000;
/// Iterations of a phase or of an optimization.
const ITERATIONS: u64 = 10_000_000;
/// Weights and biases of a net.
const WEIGHTS: usize = 10_000_000;
/// Weights and biases for which an optimizer may hold a full matrix.
const FULL_MATRIX_WEIGHTS: usize = 20_000;
/// Steps of the horizon.
pub const HORIZON: usize = 5000;
/// Numbers in the matrices of a condensed program.
const CONDENSED: usize = 50_000_000;
/// Times of control steps that are held in memory.
const TIMES: usize = 100_000_000;
/// Threads of one program.
pub const THREADS: usize = 1024;
/// A thousand seconds, in us.
const BUDGET_US: f64 = 1e9;
/// Weights of the cost: their products with squares are to be finite.
const COST: f64 = 1e100;

/// Checks all sizes of an experiment.
pub(super) fn sizes(experiment: &Experiment, dims: Dims) -> Checked {
    net(experiment, dims)?;
    training(experiment)?;
    let substeps = experiment.identify.as_ref().and_then(|spec| spec.substeps);
    at_most("identify.substeps", substeps.unwrap_or(1), PARTS)?;
    let net_step_s = experiment.net_step_s();
    if let Some(validation) = &experiment.validation {
        let steps = steps_of(net_step_s, "validation.duration_s", validation.duration_s)?;
        at_most("validation.scenarios", validation.scenarios, POINTS)?;
        at_most("validation.subintervals", validation.subintervals, PARTS)?;
        at_most("validation.one_step_points", validation.one_step_points, POINTS)?;
        let rows = [validation.scenarios, steps, validation.subintervals];
        rows_at_most("validation", "scenarios, steps and subintervals", &rows)?;
    }
    if let Some(prediction) = &experiment.prediction {
        let steps = steps_of(net_step_s, "prediction.duration_s", prediction.duration_s)?;
        at_most("prediction.subintervals", prediction.subintervals, PARTS)?;
        rows_at_most("prediction", "steps and subintervals", &[steps, prediction.subintervals])?;
    }
    if let Some(one_step) = &experiment.one_step {
        at_most("one_step.points", one_step.points, POINTS)?;
        number_at_most("one_step.measure_s", one_step.measure_s, 3600.0)?;
    }
    let Some(control) = &experiment.control else { return Ok(()) };
    let steps = steps_of(experiment.sample_time_s(), "control.duration_s", control.duration_s)?;
    let last = control.references.last().map_or(0.0, |last| last.start_s);
    steps_of(experiment.sample_time_s(), "control.references", last)?;
    at_most("control.repetitions", control.repetitions, POINTS)?;
    let times = steps.saturating_mul(control.repetitions);
    if times > TIMES {
        let found = format!("{} runs of {steps} steps", control.repetitions);
        return value("control.repetitions", found, &format!("{TIMES} steps in all at most"));
    }
    controller(control, dims)
}

fn net(experiment: &Experiment, dims: Dims) -> Checked {
    let Some(model) = &experiment.model else { return Ok(()) };
    at_most("model.hidden_layers", model.hidden_layers, 1000)?;
    at_most("model.neurons", model.neurons, PARTS)?;
    let weights = model.parameters(dims);
    if weights > WEIGHTS {
        let found = format!("a net of {weights} weights and biases");
        return value("model", found, &format!("{WEIGHTS} at most"));
    }
    let phases = experiment.training.iter().flat_map(|training| &training.config.phases);
    for (i, phase) in phases.enumerate() {
        let is_full = matches!(
            phase.optimizer.for_size(weights),
            OptimizerConfig::SelfScaledBroyden(_) | OptimizerConfig::LevenbergMarquardt(_)
        );
        if is_full && weights > FULL_MATRIX_WEIGHTS {
            let key = format!("training.phases[{i}].optimizer");
            let found = format!("a method with a full matrix for {weights} weights and biases");
            let expected = format!("lbfgs or adam for more than {FULL_MATRIX_WEIGHTS}");
            return value(&key, found, &expected);
        }
    }
    Ok(())
}

fn training(experiment: &Experiment) -> Checked {
    let Some(training) = &experiment.training else { return Ok(()) };
    at_most("training.threads", training.effort.threads, THREADS)?;
    let config = &training.config;
    at_most("training.collocation_points", config.collocation_points, POINTS)?;
    at_most("training.initial_points", config.initial_points, POINTS)?;
    for (i, phase) in config.phases.iter().enumerate() {
        let key = format!("training.phases[{i}].iterations");
        if phase.iterations > ITERATIONS {
            return value(&key, phase.iterations, &format!("{ITERATIONS} at most"));
        }
        if let OptimizerConfig::Lbfgs(lbfgs) = &phase.optimizer {
            at_most(&format!("training.phases[{i}].optimizer.lbfgs.memory"), lbfgs.memory, 1000)?;
        }
    }
    let Some(growth) = &config.growth else { return Ok(()) };
    at_most("training.growth.max_points", growth.max_points, POINTS)?;
    at_most("training.growth.fresh_points", growth.fresh_points, POINTS)?;
    at_most("training.growth.factor", growth.factor, 1000)
}

fn controller(spec: &ControlSpec, dims: Dims) -> Checked {
    at_most("control.n2", spec.n2, HORIZON)?;
    at_most("control.sqp.max_iterations", spec.sqp.max_iterations, 1_000_000)?;
    at_most("control.sqp.starts", spec.sqp.starts, 10_000)?;
    for integrator in Integrator::ALL {
        let key = format!("control.{}", ControlSpec::substeps_key(integrator));
        at_most(&key, spec.own_substeps(integrator), PARTS)?;
    }
    at_most("control.close_ups_s", spec.close_ups_s.len(), 100)?;
    at_most("control.input_differences", spec.input_differences.len(), PARTS)?;
    if let Some(budget_us) = spec.budget_us {
        number_at_most("control.budget_us", budget_us, BUDGET_US)?;
    }
    let condensed = [spec.n2, dims.nx + dims.nu, spec.nu, dims.nu];
    if spec.sqp.qp == QpMethod::Condensed && product(&condensed) > CONDENSED {
        let expected = "\"auto\" or \"riccati\" for so long a horizon of so many states and inputs";
        return value("control.sqp.qp", "\"condensed\"", expected);
    }
    weights("control.q", &spec.q)?;
    weights("control.r", &spec.r)?;
    spec.q_terminal.as_ref().map_or(Ok(()), |terminal| weights("control.q_terminal", terminal))?;
    let differences = spec.input_differences.iter().enumerate();
    for (i, difference) in differences {
        weights(&format!("control.input_differences[{i}].weight"), &difference.weight)?;
    }
    Ok(())
}

fn weights(key: &str, weight: &Weight) -> Checked {
    let large = |entry: &f64| entry.abs() > COST;
    let rows: &[Vec<f64>] = match weight {
        Weight::Diagonal(diagonal) => std::slice::from_ref(diagonal),
        Weight::Full(rows) => rows,
    };
    match rows.iter().flatten().copied().find(large) {
        Some(entry) => value(key, format!("{entry:e}"), &format!("weights up to {COST:e}")),
        None => Ok(()),
    }
}

/// The steps of a duration, if they are not too many.
fn steps_of(
    sample_time_s: Option<f64>,
    key: &str,
    duration_s: f64,
) -> Result<usize, (String, Problem)> {
    // A T that is not positive is reported under its own key.
    let Some(sample_time_s) = sample_time_s.filter(|length_s| *length_s > 0.0) else {
        return Ok(1);
    };
    let steps = (duration_s / sample_time_s).round();
    if steps > STEPS as f64 {
        let expected = format!("{STEPS} steps of T = {sample_time_s} s at most");
        value(key, format!("{duration_s:?}"), &expected)?;
    }
    #[expect(clippy::cast_possible_truncation, reason = "checked above")]
    Ok(steps as usize)
}

fn at_most(key: &str, found: usize, most: usize) -> Checked {
    if found <= most { Ok(()) } else { value(key, found, &format!("{most} at most")) }
}

fn number_at_most(key: &str, found: f64, most: f64) -> Checked {
    if found <= most {
        Ok(())
    } else {
        value(key, format!("{found:e}"), &format!("{most} at most"))
    }
}

/// Checks how many rows a table held in memory has.
fn rows_at_most(key: &str, of: &str, factors: &[usize]) -> Checked {
    let rows = product(factors);
    if rows <= STEPS {
        return Ok(());
    }
    value(key, format!("{rows} rows"), &format!("{STEPS} at most, the product of {of}"))
}

fn product(factors: &[usize]) -> usize {
    factors.iter().fold(1, |product, factor| product.saturating_mul(*factor))
}
