#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`run`], [`train`] (or [`train_watched`], which writes no files), [`control`], [`predict`],
//!   [`estimate`], [`identify`], [`certify`], [`check`], [`compare`], [`rebuild_report`];
//! - [`export_net`], [`export_controller`], [`export_plant`]: nets, controllers and plants for other
//!   programs;
//! - [`LiveController`]: a controller for a plant outside the program; [`BatchController`]: a
//!   controller for many states at once;
//! - [`train_shared`], [`run_trial`]: the parts of a sweep.
//!
//! Only this crate and pinc-bench write to the terminal and read a clock.

#![forbid(unsafe_code)]

mod batch;
mod certify;
mod chain;
mod check;
mod chosen;
pub mod clock;
pub mod console;
mod control;
mod data;
mod domain_error;
mod error;
mod estimate;
mod export;
mod feedback;
mod first_plan;
mod found;
mod free_run;
mod guard;
mod horizon;
mod identify;
pub mod invocation;
mod live;
mod live_state;
mod loop_error;
mod model_error;
mod one_step;
mod policy;
mod predict;
pub mod progress;
mod proof;
mod recording;
mod shared_library;
mod single_step;
mod train;
mod train_watched;
mod training_setup;
mod trial;

pub use batch::BatchController;
pub use certify::{Certify, certify, verify_certificate};
pub use check::{check, check_watched};
pub use chosen::ModelFile;
use control::Schedules;
pub use control::{LoopSetup, verdict};
pub use domain_error::proven_net_error;
pub use error::RunError;
pub use estimate::{ConfigEstimator, Estimated, estimate, estimator};
pub use export::{Target, export_controller, export_controller_with, export_net, export_plant};
use first_plan::first_plan;
pub use identify::identify;
pub use live::{Follow, LiveController, LiveStep};
pub use live_state::LiveState;
pub use pinc_check::{Finding, IntegratorBox, Severity, findings_json};
pub use pinc_verify::ErrorEstimate;
pub use policy::PolicyFile;
pub use predict::{error_estimate, predict};
pub use progress::Verbosity;
pub use proof::{Certificate, certificate};
pub use single_step::Steps;
pub use train::Threads;
pub use train_watched::{TrainedNet, TrainingProgress, train_watched};
pub use training_setup::TrainingSetup;
pub use trial::{run_trial, train_shared};

use crate::invocation::invocation;
use pinc_config::{Experiment, LoopParameters, MOST_STEPS, ModelKind, PlantInTheLoop, Variables};
use pinc_net::{PincNet, TrainingTarget};
use pinc_ode::Simulator;
use pinc_record::{
    Metrics, Provenance, RecordError, RunDir, check_page, file, read_file, remove_unfinished,
    write_atomically, write_output,
};
use pinc_report as report;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// The version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// How an experiment is run; nothing here changes its numbers.
#[derive(Debug)]
pub struct Options<'a> {
    /// Resume from what the run directory holds, rather than start afresh.
    pub resume: bool,
    /// How much is shown meanwhile.
    pub verbosity: Verbosity,
    /// Stops the run, in a state that it can be resumed from, once it is true.
    pub interrupt: &'a AtomicBool,
    /// The command line, for the provenance.
    pub arguments: &'a [String],
}

impl Options<'_> {
    /// An error if the run is to stop.
    ///
    /// # Errors
    ///
    /// [`RunError::Interrupted`].
    pub fn check_interrupt(&self, dir: &Path) -> Result<(), RunError> {
        if self.interrupt.load(Ordering::Relaxed) {
            return Err(RunError::Interrupted { dir: dir.to_owned() });
        }
        Ok(())
    }
}

/// The stages that a command asks for.
#[derive(Clone, Debug)]
enum Command {
    Run,
    Train,
    Control { model: Option<PathBuf>, only: Option<ModelKind> },
}

/// Runs the whole experiment, with its results in `dir`.
///
/// # Errors
///
/// [`RunError`]; what was finished before is in `dir`.
pub fn run(experiment: &Experiment, dir: &Path, options: &Options<'_>) -> Result<RunDir, RunError> {
    execute(experiment, dir, options, Command::Run)
}

/// Only trains the net.
///
/// # Errors
///
/// Like [`run`].
pub fn train(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
) -> Result<RunDir, RunError> {
    execute(experiment, dir, options, Command::Train)
}

/// Only runs the closed loop: with the net of the file `model`, or one trained first if the loop
/// needs one, and with all models of the config or `only` one of them.
///
/// # Errors
///
/// Like [`run`].
pub fn control(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    model: Option<&Path>,
    only: Option<ModelKind>,
) -> Result<RunDir, RunError> {
    let model = model.map(Path::to_owned);
    execute(experiment, dir, options, Command::Control { model, only })
}

/// Rebuilds the report of the run in `dir` and returns its path.
///
/// # Errors
///
/// [`RunError`] if the directory holds no run, or damaged files.
pub fn rebuild_report(dir: &Path) -> Result<PathBuf, RunError> {
    RunDir::expect(dir)?;
    let report = report::build(dir)?;
    write_figures(&dir.join(file::FIGURES), &report.figures)?;
    let path = dir.join(file::REPORT);
    write_atomically(&path, report.html.as_bytes())?;
    Ok(path)
}

/// Compares the runs in `dirs` with the first of them, on an HTML page.
///
/// # Errors
///
/// [`RunError`] if a directory holds no run, the plants differ, or a file is damaged or cannot be written.
pub fn compare(dirs: &[PathBuf], page: &Path) -> Result<(), RunError> {
    let comparison = report::compare(dirs)?;
    dirs.iter().try_for_each(|dir| check_page(("--out", page), dir))?;
    Ok(write_output(page, comparison.html.as_bytes())?)
}

/// Writes the report's pictures, and removes pictures of an earlier report that it no longer has.
fn write_figures(dir: &Path, figures: &[report::FigureFiles]) -> Result<(), RunError> {
    fs::create_dir_all(dir).map_err(RecordError::unwritable(dir))?;
    remove_unfinished(dir)?;
    let file = |name: &str, ending: &str| dir.join(format!("{name}.{ending}"));
    let mut written = Vec::new();
    for figure in figures {
        let (svg, csv) = (file(&figure.name, "svg"), file(&figure.name, "csv"));
        write_atomically(&svg, figure.svg.as_bytes())?;
        write_atomically(&csv, &figure.csv)?;
        written.extend([svg, csv]);
    }
    for entry in fs::read_dir(dir).map_err(RecordError::unreadable(dir))? {
        let path = entry.map_err(RecordError::unreadable(dir))?.path();
        let is_picture = path.extension().is_some_and(|e| e == "svg" || e == "csv");
        if is_picture && !written.contains(&path) {
            fs::remove_file(&path).map_err(RecordError::unwritable(&path))?;
        }
    }
    Ok(())
}

fn execute(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    command: Command,
) -> Result<RunDir, RunError> {
    let plan = Plan::of(experiment, command)?;
    let mut run_dir = RunDir::open(dir, experiment, std::process::id())?;
    plan.remove_stale(&mut run_dir, options.resume)?;
    if options.resume {
        found::forget_damaged(&plan, &mut run_dir)?;
    }
    let is_there = matches!(Provenance::read(dir), Ok(Some(_)));
    if !(options.resume && is_there && plan.is_done(experiment, run_dir.metrics())) {
        run_dir.write_provenance(
            &Provenance::of(experiment, invocation(options.arguments)),
            options.resume,
        )?;
    }
    if options.verbosity == Verbosity::Shown && experiment.plant.is_black_box() {
        warn_of_hidden_memory(experiment);
    }
    Stages { experiment, options, plan: &plan, threads: None, run_dir: &mut run_dir }.run()?;
    rebuild_report(dir)?;
    Ok(run_dir.released())
}

/// Says so if the plant, a black box, remembers more than its states.
fn warn_of_hidden_memory(experiment: &Experiment) {
    let plant = &*experiment.plant.dyn_plant();
    if let Some(finding) = pinc_check::hidden_memory(plant, experiment) {
        console::note(&finding.to_string());
    }
}

/// What is done, and with which net.
struct Plan {
    trains: bool,
    runs_free: bool,
    /// The models of the closed loops.
    loops: Vec<ModelKind>,
    /// The content of a model file to use, with its net.
    given: Option<(Vec<u8>, PincNet)>,
}

impl Plan {
    fn of(experiment: &Experiment, command: Command) -> Result<Self, RunError> {
        let missing = |section, command| RunError::missing_section(experiment, section, command);
        let configured = experiment.control.as_ref().map(|c| c.models.clone());
        let mut plan = Self { trains: false, runs_free: false, loops: Vec::new(), given: None };
        let is_net = |kind: &ModelKind| {
            experiment.control.as_ref().is_some_and(|c| c.model_of(*kind) == ModelKind::Pinc)
        };
        match command {
            Command::Run => {
                plan.trains = experiment.training.is_some();
                plan.loops = configured.unwrap_or_default();
                plan.runs_free = plan.trains && experiment.prediction.is_some();
                if !plan.trains && (plan.loops.is_empty() || plan.loops.iter().any(is_net)) {
                    return Err(missing("training", "pinc run"));
                }
            }
            Command::Train => {
                plan.trains = true;
                if experiment.training.is_none() {
                    return Err(missing("training", "pinc train"));
                }
            }
            Command::Control { model, only } => {
                plan.loops = configured.ok_or_else(|| missing("control", "pinc control"))?;
                if let Some(only) = only {
                    if !plan.loops.contains(&only) {
                        return Err(RunError::missing_model(experiment, "--only", only));
                    }
                    plan.loops = vec![only];
                }
                if model.is_some() && !plan.loops.iter().any(is_net) {
                    return Err(RunError::unused_net("pinc control", &plan.loops));
                }
                plan.given =
                    model.map(|path| read_matching_model(experiment, &path)).transpose()?;
                plan.trains = plan.given.is_none() && plan.loops.iter().any(is_net);
                if plan.trains && experiment.training.is_none() {
                    return Err(missing("training", "pinc control without --model"));
                }
            }
        }
        if plan.loops.iter().any(is_net) {
            // Before a training of minutes is in vain.
            proof::check_ahead(experiment, plan.given.as_ref().map(|(_, net)| net))?;
        }
        // The files are read before there is a directory.
        if let Some(spec) = experiment.control.as_ref().filter(|_| !plan.loops.is_empty()) {
            let of_net = plan.given.as_ref().map(|(_, net)| net.sample_time_s());
            let sample_time_s = experiment.sample_time_s().or(of_net);
            let missing = || missing("model", "a closed loop without control.step_s");
            let (sample_time_s, plant) =
                (sample_time_s.ok_or_else(missing)?, &*experiment.plant.dyn_plant());
            first_plan(spec, &Variables::of(plant), sample_time_s)?;
            if plan.loops.contains(&ModelKind::Policy) {
                policy::read((spec, plant), sample_time_s)?;
            }
        }
        if plan.trains {
            TrainingSetup::of(experiment)?.check_files(experiment)?;
        }
        Ok(plan)
    }

    /// Whether all is there that it asks for.
    fn is_done(&self, experiment: &Experiment, metrics: &Metrics) -> bool {
        let loops = self.loops.len();
        let looped = metrics.control.len() == loops
            && (experiment.one_step.is_none() || metrics.one_step.len() == loops);
        (!self.trains || metrics.training.is_some())
            && (!self.runs_free || metrics.prediction.is_some())
            && (self.loops.is_empty() || looped)
    }

    /// Removes those results of earlier runs that do not belong to what is made now.
    fn remove_stale(&self, run_dir: &mut RunDir, resume: bool) -> Result<(), RunError> {
        let same_net = match &self.given {
            Some((bytes, _)) => fs::read(run_dir.path(file::MODEL)).is_ok_and(|old| old == *bytes),
            None => !self.trains || resume,
        };
        if !same_net {
            run_dir.update(|metrics| {
                (metrics.training, metrics.validation, metrics.prediction) = (None, None, None);
            })?;
            let of_net = [file::CHECKPOINT, file::TRAINING, file::MODEL, file::DOMAIN_ERROR];
            for name in of_net.into_iter().chain([file::PREDICTION]) {
                run_dir.remove(name)?;
            }
        }
        if !same_net || (!resume && !self.loops.is_empty()) {
            run_dir.update(|metrics| (metrics.control, metrics.one_step) = (vec![], vec![]))?;
            run_dir.remove_loops()?;
        }
        if let Some((bytes, _)) = &self.given {
            run_dir.write(file::MODEL, bytes)?;
        }
        Ok(run_dir.remove(file::REPORT)?)
    }
}

/// The stages of a plan, one after the other.
struct Stages<'a> {
    experiment: &'a Experiment,
    options: &'a Options<'a>,
    plan: &'a Plan,
    /// The training's threads, if not what the config says.
    threads: Option<&'a Threads<'a>>,
    run_dir: &'a mut RunDir,
}

impl Stages<'_> {
    fn run(self) -> Result<(), RunError> {
        let Self { experiment, options, plan, threads, run_dir } = self;
        let varying = experiment.varying();
        let plant = &*experiment.plant.family(&varying);
        let trained = match &experiment.training {
            Some(_) if plan.trains => {
                Some(train::stage(plant, experiment, options, threads, run_dir)?)
            }
            _ => None,
        };
        let net = trained.as_ref().or(plan.given.as_ref().map(|(_, net)| net));
        options.check_interrupt(run_dir.dir())?;
        // A plant whose parameters were trained with the net is the one that was found.
        let found = run_dir.metrics().training.as_ref().map(|t| &t.parameters);
        let found = found.filter(|found| !found.is_empty());
        let found = found.map(|found| experiment.with_parameters(found));
        let experiment = found.as_ref().unwrap_or(experiment);
        if let (Some(net), Some(spec), true) = (net, &experiment.prediction, plan.runs_free)
            && run_dir.metrics().prediction.is_none()
        {
            // Free runs are of the nominal plant.
            let nominal = experiment.plant.parameters();
            let p: Vec<f64> = net.parameter_names().map(|name| nominal[name]).collect();
            let plant = &*experiment.plant.dyn_plant();
            free_run::stage(plant, net, (spec, &p), experiment.seed, run_dir)?;
        }
        if let Some(spec) = &experiment.control
            && !plan.loops.is_empty()
        {
            let sample_time_s =
                experiment.sample_time_s().or_else(|| net.map(PincNet::sample_time_s));
            let sample_time_s = sample_time_s.expect("the plan was checked for it");
            let plants = experiment.plants_in_the_loop(sample_time_s);
            let (first, later) = plants.split_first().expect("a loop has a plant at first");
            let later = later.iter().map(|PlantInTheLoop { from_step, plant }| {
                (*from_step, Simulator::new(&**plant, spec.plant_tolerance))
            });
            let schedules = Schedules {
                model: experiment.model_schedule(sample_time_s),
                preview: spec.parameter_preview,
                plants: later.collect(),
            };
            let LoopParameters { names, values, estimated, known } = experiment.loop_parameters();
            let modelled = &*experiment.plant.family(&names);
            let setup = LoopSetup {
                spec,
                kinds: &plan.loops,
                net,
                proven: proof::limits(experiment, net)?,
                sample_time_s,
                seed: experiment.noise_seed(),
                parameters: &values,
                estimated: &estimated,
                known: &known,
                beside: experiment.horizon_plants(&names),
                scenarios: experiment.scenarios(),
                truth: &*first.plant,
                schedules,
            };
            control::stage(modelled, &setup, options, run_dir)?;
            if let (Some(spec), Some(domain)) = (&experiment.one_step, &experiment.domain) {
                one_step::stage(plant, &setup, (spec, domain), options, run_dir)?;
            }
        }
        Ok(())
    }
}

/// The net in a model file.
///
/// # Errors
///
/// [`RunError`] if the file cannot be read or is none.
pub fn read_model(path: &Path) -> Result<PincNet, RunError> {
    let bytes = read_file(path)?;
    parse_model(path, &bytes)
}

fn parse_model(path: &Path, bytes: &[u8]) -> Result<PincNet, RunError> {
    let model = |source| RunError::Model { path: path.to_owned(), source };
    PincNet::from_bytes(bytes).map_err(model)
}

/// The net of the file `path`, unless it knows one scenario only.
fn chainable(path: &Path, net: PincNet) -> Result<PincNet, RunError> {
    match net.time_only() {
        None => Ok(net),
        Some(_) => Err(RunError::usage(
            path.display(),
            "a conventional PINN, for one initial state and input: it can neither be chained nor \
             control",
        )),
    }
}

/// A model file and its net, which has to be one of the experiment's plant and step length.
fn read_matching_model(
    experiment: &Experiment,
    path: &Path,
) -> Result<(Vec<u8>, PincNet), RunError> {
    matching_model(experiment, path, read_file(path)?)
}

/// Like [`read_matching_model`], from the `bytes` of the file `path`.
fn matching_model(
    experiment: &Experiment,
    path: &Path,
    bytes: Vec<u8>,
) -> Result<(Vec<u8>, PincNet), RunError> {
    let net = chainable(path, parse_model(path, &bytes)?)?;
    check_match(experiment, path, &net)?;
    Ok((bytes, net))
}

/// Checks that `net`, of the file `path`, is one of the experiment's plant and step length.
fn check_match(experiment: &Experiment, path: &Path, net: &PincNet) -> Result<(), RunError> {
    let variables = experiment.plant.variables();
    let names = |names: &[String]| names.join(", ");
    let parameters: Vec<_> = net.parameter_names().map(str::to_owned).collect();
    if experiment.trains_parameters() {
        let problem = "[plant] has the parameters that its training began with: give those found \
                       (`training.parameters` in metrics.json) there, and remove data.parameters";
        return Err(RunError::usage(path.display(), problem));
    }
    let mut compared = vec![
        ("states", names(net.state_names()), names(&variables.state_names())),
        ("inputs", names(net.input_names()), names(&variables.input_names())),
        ("parameters", names(&parameters), experiment.varying().join(", ")),
    ];
    let found = || format!("{} s", net.sample_time_s());
    if let Some(step_s) = experiment.net_step_s() {
        compared.push(("step length T", found(), format!("{step_s} s")));
    } else if let (Some(control), Some(step_s)) = (&experiment.control, experiment.sample_time_s())
    {
        let stages = control.stages(step_s).into_iter();
        let longest = stages.map(|(length_s, _)| length_s).fold(0.0, f64::max);
        if net.sample_time_s() < longest {
            let expected = format!("{longest} s at least, the longest of control.stages_s");
            compared.push(("step length T", found(), expected));
        }
    }
    if let (None, Some(control)) = (experiment.sample_time_s(), &experiment.control) {
        let least = control.duration_s / MOST_STEPS as f64;
        if net.sample_time_s() < least {
            let found = format!("{} s", net.sample_time_s());
            let expected = format!("{least} s at least, for {MOST_STEPS} steps at most");
            compared.push(("step length T", found, expected));
        }
        if let Err((key, problem)) = experiment.check_step_marks(net.sample_time_s()) {
            let expected = format!("one that fits `{key}` ({problem})");
            compared.push(("step length T", found(), expected));
        }
    }
    let mut loops = experiment.control.iter().filter(|of| of.models.contains(&ModelKind::Pinc));
    if net.source() == TrainingTarget::Integrator && loops.any(|of| of.cost.is_some()) {
        let expected = "physics with [control.cost]: a distilled net knows one length only";
        compared.push(("training.source", "integrator".to_owned(), expected.to_owned()));
    }
    for (what, found, expected) in compared {
        if found != expected {
            let problem = format!("{what} of the model: {found}; of the config: {expected}");
            return Err(RunError::usage(path.display(), problem));
        }
    }
    Ok(())
}
