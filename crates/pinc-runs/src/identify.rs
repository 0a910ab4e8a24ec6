//! `pinc identify`: parameters and initial states from recorded data.

use super::guard::{Ahead, Guard};
use super::{Options, rebuild_report};
use crate::RunError;
use crate::horizon::outputs;
use crate::invocation::invocation;
use pinc_config::{
    Experiment, IdentifiedNet, IdentifiedParameter, IdentifyCriterion, IdentifySpec, ModelKind,
    OutsidePolicy, PlantSpec, Variables, repeated_file,
};
use pinc_identify::{
    Channel, Criterion, Estimate, Identified, IdentifyError, InitialState, Prior, Problem,
    Recording, Side, Start, Starts, Unknown, fitted_steps, identify_from_starts, simulate_held_out,
    weighed_by_residuals,
};
use pinc_net::{PincModel, PincNet};
use pinc_ode::{DynPlant, Model, WithOutputs};
use pinc_record::columns::{not_later, rows, too_few_rows};
use pinc_record::{
    CorrelationMetrics, EstimateMetrics, HeldOutMetrics, IdentificationMetrics,
    InitialStateMetrics, InputCorrelationMetrics, MinimumMetrics, OutsideDomain, ParameterMetrics,
    Provenance, RecordedColumns, RecordedRow, RecordedSteps, ResidualMetrics, ResidualRow,
    ResidualTable, RunDir, StartMetrics, WorkMetrics, file, read_file,
};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Substeps of an integrator of which no config says how many.
const SUBSTEPS: usize = 4;
/// The rows of a file that is held out to which its initial state is fitted.
const VALIDATION_ROWS: usize = 5;

/// Identifies what `[identify]` of `experiment` asks for in the files `data`, and writes the run
/// directory `dir`: `identify.json`, `residuals.csv`, `identified.toml` and the report. The model
/// is `only`, or else the net of the file `model`, or else RK4. The fit begins at `starts` points, by
/// default at `identify.starts`. Held-out files take no part in the fit; it is simulated on them.
///
/// The data have the columns `t`, the inputs, which hold from a row to the next, and
/// `y_<measured>`, read just before the input changes, of which cells may be empty; other columns
/// are ignored. Rows are whole numbers of steps apart. Before the first row the input is
/// `control.initial_input`, or else the row's own.
///
/// # Errors
///
/// [`RunError`], naming file, line and column of what is wrong with the data.
pub fn identify(
    experiment: &Experiment,
    (data, held_out): (&[PathBuf], &[PathBuf]),
    dir: &Path,
    options: &Options<'_>,
    model: Option<&Path>,
    only: Option<ModelKind>,
    starts: Option<usize>,
) -> Result<IdentificationMetrics, RunError> {
    let (name, command) = (&experiment.name, "identify");
    let missing = || RunError::missing_section(experiment, "identify", command);
    let spec = experiment.identify.as_ref().ok_or_else(missing)?;
    for files in [data, held_out] {
        if let Some(i) = repeated_file(&[], files) {
            let problem = "given twice; expected each file once";
            return Err(RunError::usage(files[i].display(), problem));
        }
    }
    let net = model.map(|path| super::read_matching_model(experiment, path)).transpose()?;
    let net = net.map(|(_, net)| net);
    let kind = match (only, &net) {
        (Some(ModelKind::Pinc), None) => return Err(RunError::no_model_file(name, command)),
        (Some(kind @ (ModelKind::BlackBox | ModelKind::Policy)), _) => {
            let no = format!("`identify` has no model `{kind}`, expected pinc or an integrator");
            return Err(RunError::usage(name, no));
        }
        (Some(kind), _) => kind,
        (None, Some(_)) => ModelKind::Pinc,
        (None, None) => first_integrator(experiment),
    };
    let net = net.as_ref().filter(|_| kind == ModelKind::Pinc);
    let variables = experiment.plant.variables();
    let measured = spec.measurement().names(&variables);
    let parameters = experiment.plant.parameter_names();
    let tables = |files: &[PathBuf]| -> Result<Vec<_>, _> {
        files.iter().map(|path| read(path, &variables, &measured, &parameters)).collect()
    };
    let fitted = tables(data)?;
    let sample_time_s = step_s(experiment, spec, net, &fitted);
    let recorded = |files: &[PathBuf], tables: &[Rows]| -> Result<Vec<_>, _> {
        let files = files.iter().zip(tables);
        let filled = files.map(|(path, table)| {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            let all = RecordedSteps::filled(&name, table, sample_time_s);
            all.map_err(|(line, problem)| RunError::Csv { path: path.clone(), line, problem })
        });
        filled.collect()
    };
    let unseen = recorded(held_out, &tables(held_out)?)?;
    let recorded = recorded(data, &fitted)?;
    let (problem, plant) = problem(experiment, spec, &variables, net)?;
    let rows = spec.validation_rows.unwrap_or(VALIDATION_ROWS);
    let unfit = |file: usize, error: IdentifyError| {
        let problem = format!("held out with identify.validation_rows = {rows}: {error}");
        RunError::usage(held_out[file].display(), problem)
    };
    let steps = unseen.iter().enumerate().map(|(file, of)| {
        fitted_steps(&problem, recording(experiment, of), rows).map_err(|error| unfit(file, error))
    });
    let steps = steps.collect::<Result<Vec<_>, _>>()?;
    let starts = starts.or(spec.starts).unwrap_or_else(|| problem.default_starts());
    let model = || fitted_model(experiment, spec, (kind, net), &*plant, sample_time_s);
    let recordings: Vec<_> = recorded.iter().map(|of| recording(experiment, of)).collect();
    let clock = Instant::now();
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    let finished = spec.finished_starts.unwrap_or(Starts::default().finished);
    let (seed, interrupt) = (experiment.seed, Some(options.interrupt));
    let with = Starts { seed, finished, threads, interrupt };
    let fit = |problem: &Problem, starts: usize| {
        let models = (0..starts).map(|_| model()).collect::<Result<Vec<_>, _>>()?;
        let found = identify_from_starts(models, problem, &recordings, with);
        found.map_err(|error| in_file(error, data))
    };
    let (problem, found) = weighed_by_residuals(problem, &recordings, starts, fit)?;
    let wall_s = clock.elapsed().as_secs_f64();
    let mut of_unseen = Vec::new();
    for (file, (of, steps)) in unseen.iter().zip(steps).enumerate() {
        let (recording, p) = (recording(experiment, of), &found.p);
        let simulated = simulate_held_out(&mut *model()?, &problem, p, recording, rows);
        let simulated = simulated.map_err(|error| unfit(file, error))?;
        let pairs = [&of.y, &simulated].map(|of| &of[steps * measured.len()..]);
        of_unseen.push(HeldOutMetrics::of(of.name.clone(), rows, (&measured, pairs)));
    }
    let policy = experiment.control.as_ref().map(|of| of.outside_domain).unwrap_or_default();
    let outside = net.map(|net| outside(net, policy, &recorded, &found)).transpose()?;
    let mut metrics = IdentificationMetrics {
        nets: spec.nets.iter().map(|net| net.name.clone()).collect(),
        held_out: of_unseen,
        ..metrics(experiment, (kind, &problem), &recorded, &found, wall_s)
    };
    let outside = outside.and_then(|found| found.note()).into_iter();
    metrics.findings.splice(0..0, outside.chain(held(experiment, spec)));
    let mut run_dir = RunDir::open(dir, experiment, std::process::id())?;
    let provenance = Provenance::of(experiment, invocation(options.arguments));
    run_dir.write_provenance(&provenance, false)?;
    run_dir.write(file::RESIDUALS, residuals(&measured, &recorded, &found).to_csv().as_bytes())?;
    let (text, weights) = identified(experiment, &metrics);
    for (name, weights) in weights {
        run_dir.write(&name, weights.as_bytes())?;
    }
    run_dir.write(file::IDENTIFIED, text.as_bytes())?;
    run_dir.write(file::IDENTIFY, metrics.to_json().as_bytes())?;
    run_dir.update(|_| {})?;
    rebuild_report(dir)?;
    Ok(metrics)
}

/// The first model of the loop that is an integrator, or else RK4.
fn first_integrator(experiment: &Experiment) -> ModelKind {
    let models = experiment.control.iter().flat_map(|control| &control.models);
    models.copied().find(|kind| kind.integrator().is_some()).unwrap_or(ModelKind::RK4)
}

/// The rows of a file, with their lines.
type Rows = Vec<(u64, RecordedRow)>;

fn read(
    path: &Path,
    variables: &Variables,
    measured: &[String],
    parameters: &[String],
) -> Result<Rows, RunError> {
    let text = read_file(path)?;
    let at = |(line, problem)| RunError::Csv { path: path.to_owned(), line, problem };
    let (header, rows) = rows(&text).map_err(at)?;
    let columns = RecordedColumns::find(&header, variables, measured, (&[], parameters));
    let columns = columns.map_err(|problem| at((1, problem)))?.without_truth();
    let mut all = Rows::new();
    for row in rows {
        let (line, cells) = row.map_err(at)?;
        let row = columns.read(&cells).map_err(|problem| at((line, problem)))?;
        if let Some((_, before)) = all.last()
            && row.t <= before.t
        {
            return Err(at((line, not_later(row.t, before.t))));
        }
        all.push((line, row));
    }
    if all.len() < 2 {
        return Err(at(too_few_rows(all.len(), 2)));
    }
    Ok(all)
}

/// The length of a step: the net's, the config's, or the shortest in the data.
fn step_s(
    experiment: &Experiment,
    spec: &IdentifySpec,
    net: Option<&PincNet>,
    tables: &[Rows],
) -> f64 {
    let steps = tables.iter().flat_map(|rows| rows.windows(2)).map(|w| w[1].1.t - w[0].1.t);
    let known = net.map(PincNet::sample_time_s);
    let known = known.or(spec.step_s).or_else(|| experiment.sample_time_s());
    known.unwrap_or_else(|| steps.fold(f64::INFINITY, f64::min))
}

fn recording<'a>(experiment: &'a Experiment, of: &'a RecordedSteps) -> Recording<'a> {
    let before = experiment.control.as_ref().and_then(|of| of.initial_input.as_deref());
    Recording { name: &of.name, before, u: &of.u, y: &of.y }
}

/// The problem to fit, and the plant that has its parameters.
fn problem(
    experiment: &Experiment,
    spec: &IdentifySpec,
    variables: &Variables,
    net: Option<&PincNet>,
) -> Result<(Problem, Box<dyn DynPlant>), RunError> {
    let weights = weights(experiment, spec);
    let (names, values) = match net {
        Some(_) => (experiment.varying(), experiment.model_parameters()),
        None => {
            let parameters = spec.parameters.iter().map(|of| (of.name.as_str(), of.initial));
            parameters.chain(weights.iter().map(|of| (of.name.as_str(), of.initial))).unzip()
        }
    };
    let measured = spec.measurement();
    let sd = experiment.measurement_sd(spec, &measured.names(variables));
    let channels = measured.names(variables).into_iter().zip(measured.quantities(variables));
    let channels = channels.enumerate().map(|(i, (name, measured))| Channel {
        name,
        measured,
        sd: sd.as_ref().map(|sd| sd[i]),
        is_estimated: false,
    });
    let mut unknowns = Vec::new();
    for (of, is_weight) in
        spec.parameters.iter().map(|of| (of, false)).chain(weights.iter().map(|of| (of, true)))
    {
        let place = names.iter().position(|name| *name == of.name);
        let not_an_input = || {
            let known = if names.is_empty() { "no parameters" } else { &names.join(", ") };
            let problem = format!(
                "the net does not take `{}` as an input, but {known}; a net of a family \
                 ([domain.parameters]) or --only rk4 can identify it",
                of.name
            );
            RunError::usage("identify", problem)
        };
        // A net knows nothing beyond what it was trained on.
        let range = net.and_then(|_| {
            let ranges = experiment.domain.iter().flat_map(|domain| &domain.parameters);
            ranges.clone().find(|range| range.name == of.name)
        });
        let (low, high) =
            range.map_or((f64::NEG_INFINITY, f64::INFINITY), |range| (range.low, range.high));
        let low = of.low.unwrap_or(f64::NEG_INFINITY).max(low);
        let high = of.high.unwrap_or(f64::INFINITY).min(high);
        unknowns.push(Unknown {
            name: of.name.clone(),
            place: place.ok_or_else(not_an_input)?,
            initial: of.initial.max(low).min(high),
            low,
            high,
            prior: of.sd.map(|sd| Prior { mean: if is_weight { 0.0 } else { of.initial }, sd }),
        });
    }
    let initial_state = match (&spec.initial_state, &spec.fixed_initial_state) {
        (_, Some(state)) => InitialState::Fixed(state.clone()),
        (state, None) => InitialState::Free(state.clone().unwrap_or_default()),
    };
    let problem = Problem {
        channels: channels.collect(),
        parameters: values,
        unknown: unknowns,
        initial_state,
        states: variables.state_names(),
        inputs: variables.input_names(),
        criterion: match spec.criterion {
            None => Criterion::Chosen,
            Some(IdentifyCriterion::Simulation) => Criterion::Simulation,
            Some(IdentifyCriterion::MultipleShooting) => Criterion::MultipleShooting,
            Some(IdentifyCriterion::PredictionError) => Criterion::PredictionError,
            Some(other) => {
                let problem = format!("identify.criterion: {other:?} is not known here");
                return Err(RunError::usage("identify", problem));
            }
        },
    };
    // What is not identified is for integrators what it is for a net.
    let told = experiment.varying().into_iter().map(str::to_owned);
    let told = told.zip(experiment.model_parameters()).collect();
    Ok((problem, experiment.plant.with_parameters(&told).family(&names)))
}

/// The weights of the nets that are identified, as parameters, from where they are on.
fn weights(experiment: &Experiment, spec: &IdentifySpec) -> Vec<IdentifiedParameter> {
    let PlantSpec::Expression(equations) = &experiment.plant else { return Vec::new() };
    let of = |net: &IdentifiedNet| {
        let names = equations.net_weights(&net.name);
        let sd = Some(net.weight_sd);
        let parameter = |name: String| {
            let initial = equations.parameters[&name];
            IdentifiedParameter { name, initial, low: None, high: None, sd }
        };
        names.into_iter().map(parameter).collect::<Vec<_>>()
    };
    spec.nets.iter().flat_map(of).collect()
}

/// The model that is fitted.
fn fitted_model(
    experiment: &Experiment,
    spec: &IdentifySpec,
    (kind, net): (ModelKind, Option<&PincNet>),
    plant: &dyn DynPlant,
    sample_time_s: f64,
) -> Result<Box<dyn Model>, RunError> {
    if let Some(net) = net {
        let model = PincModel::new(net)?;
        return Ok(match Variables::of(plant).own_outputs().is_empty() {
            true => Box::new(model),
            false => Box::new(WithOutputs::new(model, outputs(plant, sample_time_s)?)),
        });
    }
    let Some(integrator) = kind.integrator() else {
        unreachable!("a net is given where it is the model, and a black box is refused")
    };
    let control = experiment.control.as_ref();
    let of_the_loop = control.map(|control| control.own_substeps(integrator));
    let substeps = spec.substeps.or(of_the_loop).unwrap_or(SUBSTEPS);
    Ok(plant.model(integrator, sample_time_s, substeps)?)
}

/// What there is to say of the parameters that a loop is told anew, which a fit takes for constant.
fn held(experiment: &Experiment, spec: &IdentifySpec) -> Vec<String> {
    let schedule = experiment.control.iter().flat_map(|control| &control.parameter_schedule);
    let told = schedule.flat_map(|step| step.values.keys()).chain(experiment.measured_parameters());
    let mut told: BTreeSet<&str> = told.map(String::as_str).collect();
    spec.parameters.iter().for_each(|of| _ = told.remove(of.name.as_str()));
    let all = experiment.varying().into_iter().zip(experiment.model_parameters());
    let said = all.filter(|(name, _)| told.contains(name)).map(|(name, value)| {
        format!("{name} is {value} in all rows: if it changes, make it an input of the plant")
    });
    said.collect()
}

/// How often and how far the fit uses `net` outside its training domain, step by step.
fn outside(
    net: &PincNet,
    policy: OutsidePolicy,
    recorded: &[RecordedSteps],
    found: &Identified,
) -> Result<OutsideDomain, RunError> {
    let mut guard = Guard::new(Cow::Borrowed(net), policy, (None, Ahead::default()));
    let [nx, nu] = [net.state_names(), net.input_names()].map(<[_]>::len);
    for (of, x) in recorded.iter().zip(&found.states) {
        // No step begins in the last row.
        for k in 1..of.t.len() {
            let (x, u) = (&x[(k - 1) * nx..k * nx], &of.u[(k - 1) * nu..k * nu]);
            let refused = |error| RunError::Failed(format!("{}: {error}", of.name));
            guard.look(x, u, &found.p).map_err(refused)?;
        }
    }
    Ok(guard.found())
}

/// An error with the file that it is about.
fn in_file(error: IdentifyError, data: &[PathBuf]) -> RunError {
    match &error {
        IdentifyError::NotFinite { recording } | IdentifyError::TooShort { recording, .. } => {
            RunError::IdentifyFile { path: data[*recording].clone(), source: error }
        }
        IdentifyError::Interrupted => RunError::Failed(error.to_string()),
        _ => RunError::Identify(error),
    }
}

fn metrics(
    experiment: &Experiment,
    (kind, problem): (ModelKind, &Problem),
    recorded: &[RecordedSteps],
    found: &Identified,
    wall_s: f64,
) -> IdentificationMetrics {
    let estimate =
        |of: &Estimate| EstimateMetrics { value: of.value, half_width_95: of.half_width };
    let finite = |bound: f64| Some(bound).filter(|bound| bound.is_finite());
    let parameters = found.parameters.iter().zip(&problem.unknown).map(|(of, unknown)| {
        let at_bound = of.at_bound.map(|side| if side == Side::Low { "low" } else { "high" });
        let parameter = ParameterMetrics {
            estimate: estimate(of),
            initial: unknown.initial,
            low: finite(unknown.low),
            high: finite(unknown.high),
            at_bound: at_bound.map(str::to_owned),
        };
        (of.name.clone(), parameter)
    });
    let states = recorded.iter().zip(&found.initial_states).map(|(of, states)| {
        let states = problem.states.iter().cloned().zip(states.iter().map(estimate));
        InitialStateMetrics { file: of.name.clone(), states: states.collect() }
    });
    let residuals = found.channels.iter().map(|of| {
        let (measurements, rms, correlation) = (of.measurements, of.rms, of.correlation);
        let inputs = problem.inputs.iter().zip(&of.inputs).map(|(name, of)| {
            let (correlation, lag, chance) = (of.correlation, of.lag, finite(of.chance));
            (name.clone(), InputCorrelationMetrics { correlation, lag, chance })
        });
        let inputs = inputs.collect();
        (of.name.clone(), ResidualMetrics { measurements, rms, correlation, inputs })
    });
    let names: Vec<String> = found.estimates().map(|of| of.name.clone()).collect();
    let matrix = found.correlation.chunks(names.len().max(1));
    IdentificationMetrics {
        experiment: experiment.name.clone(),
        model: kind.name().to_owned(),
        parameters: parameters.collect(),
        gains: found.gains.iter().map(|of| (of.name.clone(), estimate(of))).collect(),
        cost: found.cost,
        outputs: found.channels.iter().map(|of| of.name.clone()).collect(),
        measurement_sd: problem.channels.iter().map(|of| of.sd.unwrap_or(1.0)).collect(),
        initial_states: states.collect(),
        status: found.status.to_string(),
        starts: found.starts.iter().map(|start| start_metrics(problem, start)).collect(),
        minima: MinimumMetrics::of(
            found.starts.iter().filter(|of| of.status.is_some()).map(|of| of.cost),
        ),
        nets: Vec::new(),
        held_out: Vec::new(),
        method: match problem.criterion {
            Criterion::PredictionError => format!("{} of predictions", found.method.name()),
            _ => found.method.name().to_owned(),
        },
        reason: found.method.to_string(),
        measurements: found.measurements,
        degrees_of_freedom: found.degrees_of_freedom,
        residuals: residuals.collect(),
        correlation: CorrelationMetrics {
            matrix: matrix.map(|row| row.iter().map(|c| finite(*c)).collect()).collect(),
            names,
        },
        singular_values: found.singular_values.clone(),
        findings: found.findings.iter().map(ToString::to_string).collect(),
        work: WorkMetrics {
            iterations: found.work.iterations,
            steps: found.work.steps,
            linearized: found.work.linearized,
            wall_s,
        },
    }
}

fn start_metrics(problem: &Problem, start: &Start) -> StartMetrics {
    let names = problem.unknown.iter().map(|unknown| unknown.name.clone());
    StartMetrics {
        cost: Some(start.cost).filter(|cost| cost.is_finite()),
        parameters: names.zip(start.parameters.iter().copied()).collect(),
        status: match start.status {
            Some(status) => status.to_string(),
            None => StartMetrics::SET_ASIDE.to_owned(),
        },
    }
}

fn residuals(measured: &[String], recorded: &[RecordedSteps], found: &Identified) -> ResidualTable {
    let mut rows = Vec::new();
    for (number, (of, fitted)) in recorded.iter().zip(&found.fitted).enumerate() {
        let cut = of.y.chunks(measured.len()).zip(fitted.chunks(measured.len())).zip(&of.t);
        rows.extend(cut.map(|((y, fitted), t)| ResidualRow {
            file: number + 1,
            t: *t,
            measured: y.to_vec(),
            fitted: fitted.to_vec(),
        }));
    }
    ResidualTable { measured: measured.to_vec(), rows }
}

/// The config with the identified plant, and files with the weights of its nets.
fn identified(
    experiment: &Experiment,
    metrics: &IdentificationMetrics,
) -> (String, Vec<(String, String)>) {
    let values: BTreeMap<String, f64> =
        metrics.parameters.iter().map(|(name, of)| (name.clone(), of.estimate.value)).collect();
    let mut text = format!("# {} with the plant that was identified:\n", experiment.name);
    for (name, of) in metrics.parameters.iter().filter(|(name, _)| metrics.net_of(name).is_none()) {
        // Writing to a String does not fail.
        let _ = match of.estimate.half_width_95 {
            Some(width) => writeln!(text, "# {name} = {} +- {width:.2e}", of.estimate.value),
            None => writeln!(text, "# {name} = {}, without an interval", of.estimate.value),
        };
    }
    let (config, weights) = experiment.with_parameters(&values).to_toml_with_weights_beside();
    (format!("{text}\n{config}"), weights)
}
