//! The command line.

use crate::choices::{CertifyArgs, Outside, RunArgs, SetArgs, SweepArgs, To, loopback, model_kind};
use crate::chosen::ChooseArgs;
use crate::options::{arguments, judged, may_begin_afresh, options, verbosity};
use crate::printed::{failure, show, unusable, usage};
use crate::served::Served;
use crate::shrunk::ShrinkArgs;
use crate::summary::summary;
use crate::tuned::TuneArgs;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use pinc_bench::{BenchOptions, OnSlurm, Shard};
use pinc_config::{Experiment, ModelKind, Plants, RunList};
use pinc_record::RunDir;
use pinc_runs::{Options, RunError, Severity, console, verdict};
use std::io::IsTerminal as _;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Physics-informed neural nets inside nonlinear model predictive control.
#[derive(Debug, Parser)]
#[command(name = "pinc", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print errors only.
    #[arg(long, global = true)]
    quiet: bool,
    /// Allow the config's plant to be a program or an FMU, which runs with your rights.
    #[arg(long, global = true)]
    allow_process: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run whole experiments: training, validation, free run, closed loops, report.
    Run {
        /// Config files, or lists of configs (TOML).
        #[arg(required = true, value_name = "CONFIG")]
        configs: Vec<PathBuf>,
        #[command(flatten)]
        sweep: SweepArgs,
        #[command(flatten)]
        run: RunArgs,
    },
    /// Show the progress of a sweep and the time left.
    Status {
        /// Run directory.
        dir: PathBuf,
    },
    /// Merge the shards of a sweep into one directory.
    Merge {
        /// Directories of the shards.
        #[arg(required = true, value_name = "DIR")]
        parts: Vec<PathBuf>,
        /// Directory of the merged sweep.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Only train the net.
    Train {
        /// Config file (TOML).
        config: PathBuf,
        #[command(flatten)]
        run: RunArgs,
    },
    /// Run a trained net freely under given inputs, from CSV to CSV.
    Predict {
        /// Model file (safetensors).
        #[arg(long)]
        model: PathBuf,
        /// Input: columns scenario, t, the inputs, the states.
        #[arg(long)]
        inputs: PathBuf,
        /// Output: the same columns with the predicted states.
        #[arg(long)]
        output: PathBuf,
        /// What to do where the net is evaluated outside its training domain.
        #[arg(long, value_enum, default_value = "report")]
        outside_domain: Outside,
        /// Add a column per state with its estimated error against the plant in `--config`.
        #[arg(long)]
        errors: bool,
        /// Config (TOML) of the plant; by default `config.toml` beside the model.
        #[arg(long, requires = "errors")]
        config: Option<PathBuf>,
    },
    /// Only run the closed loop; train a net first if one is needed and none is given.
    Control {
        /// Config file (TOML).
        config: PathBuf,
        /// Model file (safetensors) to use instead of training a net.
        #[arg(long)]
        model: Option<PathBuf>,
        /// Run only one of the config's models.
        #[arg(long, value_parser = model_kind())]
        only: Option<ModelKind>,
        #[command(flatten)]
        run: RunArgs,
    },
    /// Run the config's estimator over recorded data, from CSV to CSV.
    Estimate {
        /// Config file (TOML).
        config: PathBuf,
        /// Data: columns t, the inputs, and `y_NAME` for each measured quantity.
        #[arg(long)]
        data: PathBuf,
        /// Output: the filtered estimates with their standard deviations.
        #[arg(long)]
        output: Option<PathBuf>,
        /// Model file (safetensors), if the estimator's model is a net.
        #[arg(long)]
        model: Option<PathBuf>,
        /// The estimator's model.
        #[arg(long, value_parser = model_kind())]
        only: Option<ModelKind>,
        #[command(flatten)]
        set: SetArgs,
    },
    /// Identify parameters and initial states from recorded data.
    Identify {
        /// Config file (TOML).
        config: PathBuf,
        /// Data: columns t, the inputs, and `y_NAME` for each measured quantity.
        #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
        data: Vec<PathBuf>,
        /// Held-out data: simulate the fit on them and print its error.
        #[arg(long, num_args = 1.., value_name = "FILE")]
        validate: Vec<PathBuf>,
        /// Directory of the results; by default `runs/NAME-identify` with the experiment's name.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Model file (safetensors), if the fitted model is a net for a family.
        #[arg(long)]
        model: Option<PathBuf>,
        /// The fitted model.
        #[arg(long, value_parser = model_kind())]
        only: Option<ModelKind>,
        /// Number of starting points within the parameters' bounds, including the config's; by
        /// default `identify.starts`.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
        starts: Option<u16>,
        #[command(flatten)]
        set: SetArgs,
    },
    /// Bound the error of one step of a model: at points, or over the whole domain.
    Certify {
        /// Config file (TOML).
        config: PathBuf,
        #[command(flatten)]
        what: CertifyArgs,
        #[command(flatten)]
        run: RunArgs,
    },
    /// Export a trained net, or a config's whole controller, to C, FMU, CasADi or ONNX.
    Export {
        /// Config file (TOML) of the controller; without one the net alone is exported.
        #[arg(required_unless_present = "model")]
        config: Option<PathBuf>,
        /// Model file (safetensors).
        #[arg(long)]
        model: Option<PathBuf>,
        /// The controller's model, instead of the given net or the config's first model.
        #[arg(long, value_parser = model_kind(), requires = "config")]
        only: Option<ModelKind>,
        /// The format.
        #[arg(long, value_enum)]
        to: To,
        /// Directory of the files; by default `exports/NAME-TARGET`.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Prefix of all names; by default the model file's or the experiment's name.
        #[arg(long)]
        name: Option<String>,
        /// Export the config's plant instead of its controller, to test controllers.
        #[arg(long, requires = "config", conflicts_with_all = ["model", "only"])]
        plant: bool,
        /// Write an ONNX file with 64-bit numbers, which some runtimes do not support.
        #[arg(long)]
        double: bool,
        /// Write an FMU of FMI 3.0, with arrays as variables, instead of FMI 2.0.
        #[arg(long)]
        fmi3: bool,
        /// Add a C function for the estimated error of the net's step. A net alone is judged against
        /// the plant of `config.toml` beside the model.
        #[arg(long, conflicts_with = "plant")]
        errors: bool,
        #[command(flatten)]
        set: SetArgs,
    },
    /// Serve the controller as a process: one JSON object per line, from standard input to standard
    /// output.
    Serve {
        /// Config file (TOML).
        config: PathBuf,
        /// Model file (safetensors), if the controller's model is a net.
        #[arg(long)]
        model: Option<PathBuf>,
        /// The controller's model, instead of the config's first.
        #[arg(long, value_parser = model_kind())]
        only: Option<ModelKind>,
        /// Serve clients on a port of this machine, one after the other, instead of standard input;
        /// port 0 takes a free one.
        #[arg(long, value_name = "127.0.0.1:PORT", value_parser = loopback)]
        listen: Option<SocketAddr>,
        #[command(flatten)]
        set: SetArgs,
    },
    /// Choose the model for a config's loop: try integrators and nets of several sizes, and write a
    /// config with the cheapest good one.
    Choose(ChooseArgs),
    /// Tune keys of the controller by the cost of closed loops with drawn plants, as [tune] says.
    Tune(TuneArgs),
    /// Train a net in place of the controller, judge its loops, and write it as C with a check.
    Shrink(ShrinkArgs),
    /// Check a config and examine its plant before anything is trained.
    Check {
        /// Config file (TOML).
        config: PathBuf,
        /// Print the findings as JSON.
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        set: SetArgs,
    },
    /// Rebuild the report of a finished run.
    Report {
        /// Run directory.
        dir: PathBuf,
    },
    /// Compare runs of one plant: configs and numbers against the first run.
    Compare {
        /// Run directories, two or more.
        #[arg(required = true, num_args = 2.., value_name = "DIR")]
        dirs: Vec<PathBuf>,
        /// Write the tables and the overlaid traces to FILE (HTML) instead of printing the tables.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Print the paper's tables beside the results of configs/paper.toml, in Markdown.
    Results {
        /// Directory with the runs.
        dir: PathBuf,
        /// Write the page to FILE instead, and its pictures to a directory beside it.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Time the training kernel, models and controllers on this machine; takes about a minute.
    Bench {
        /// Print JSON instead of tables.
        #[arg(long)]
        json: bool,
        /// Use small sizes and few repetitions; the times then mean little.
        #[arg(long)]
        quick: bool,
        /// Only time the loss and gradient of the Van der Pol net, and write one evaluation to FILE
        /// (safetensors) for comparison with other programs.
        #[arg(long, value_name = "FILE")]
        loss_gradient_file: Option<PathBuf>,
    },
}

/// The command line, where `-1` after an option is its value, for the option to judge.
fn command() -> clap::Command {
    let numbers = |arg: clap::Arg| {
        let takes_values = arg.get_action().takes_values();
        arg.allow_negative_numbers(takes_values)
    };
    Cli::command().mut_subcommands(|command| command.mut_args(numbers))
}

/// The whole program `pinc`, with `plants` besides the built-in ones.
#[must_use]
pub fn program(plants: &Plants) -> ExitCode {
    let matches = command().try_get_matches();
    let cli = match matches.and_then(|of| Cli::from_arg_matches(&of)) {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    tracing_subscriber::fmt()
        .with_max_level(if cli.quiet { tracing::Level::ERROR } else { tracing::Level::WARN })
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
    match execute(&cli, plants) {
        Ok(code) => code,
        Err(error) => failure(&error),
    }
}

fn execute(cli: &Cli, plants: &Plants) -> Result<ExitCode, RunError> {
    let quiet = cli.quiet;
    let plants = &match cli.allow_process {
        true => plants.clone().allowing_processes(),
        false => plants.clone(),
    };
    match &cli.command {
        Command::Run { configs, sweep, run } => run_all(configs, sweep, run, plants, quiet)?,
        Command::Status { dir } => show(quiet, &pinc_bench::status(dir, plants)?.to_string())?,
        Command::Merge { parts, out } => {
            let arguments = arguments();
            let options = options(true, quiet, &arguments);
            show(quiet, &summary(&pinc_bench::merge(parts, out, plants, &options)?))?;
        }
        Command::Train { config, run } => {
            run.one(config, plants, quiet, pinc_runs::train)?;
        }
        Command::Control { config, model, only, run } => {
            run.one(config, plants, quiet, |experiment, dir, options| {
                pinc_runs::control(experiment, dir, options, model.as_deref(), *only)
            })?;
        }
        Command::Predict { model, inputs, output, outside_domain, errors, config } => {
            let judged = judged(*errors, model, config.as_deref(), plants)?;
            let policy = outside_domain.policy();
            let found = pinc_runs::predict(model, inputs, output, policy, judged.as_ref())?;
            if found.outside > 0 && !quiet {
                console::note(&format!("warning: {found}"));
            }
        }
        Command::Export {
            config,
            model,
            only,
            to,
            out,
            name,
            plant,
            double,
            fmi3,
            errors,
            set,
        } => {
            let (to, name, out) = (to.target(*double, *fmi3)?, name.as_deref(), out.as_deref());
            let model = model.as_deref();
            let dir = match (config, model) {
                (Some(config), _) => {
                    let experiment = Experiment::load(config, &set.overrides(), plants)?;
                    if *plant {
                        let dir = pinc_runs::export_plant(&experiment, to, name, out)?;
                        show(quiet, &dir.display().to_string())?;
                        return Ok(ExitCode::SUCCESS);
                    }
                    let to = (to, *errors);
                    pinc_runs::export_controller(&experiment, model, *only, to, name, out)?
                }
                (None, Some(model)) => {
                    set.without_config()?;
                    let judged = judged(*errors, model, None, plants)?;
                    pinc_runs::export_net(model, to, name, out, judged.as_ref())?
                }
                (None, None) => unreachable!("one of them is required"),
            };
            show(quiet, &dir.display().to_string())?;
        }
        Command::Serve { config, model, only, listen, set } => {
            let experiment = Experiment::load(config, &set.overrides(), plants)?;
            let served = Served { model: model.as_deref(), only: *only, listen: *listen };
            served.serve(&experiment, quiet)?;
        }
        Command::Estimate { config, data, output, model, only, set } => {
            let experiment = Experiment::load(config, &set.overrides(), plants)?;
            let (output, model) = (output.as_deref(), model.as_deref());
            let found = pinc_runs::estimate(&experiment, data, output, model, *only)?;
            show(quiet, &found.to_string())?;
        }
        Command::Identify { config, data, validate, out, model, only, starts, set } => {
            let experiment = Experiment::load(config, &set.overrides(), plants)?;
            let named = || Path::new("runs").join(format!("{}-identify", experiment.name));
            let dir = out.clone().unwrap_or_else(named);
            let arguments = arguments();
            let options = options(false, quiet, &arguments);
            let (model, starts) = (model.as_deref(), starts.map(usize::from));
            let files = (&data[..], &validate[..]);
            let found =
                pinc_runs::identify(&experiment, files, &dir, &options, model, *only, starts)?;
            show(quiet, &found.to_string())?;
        }
        Command::Certify { config, what, run } => {
            let experiment = Experiment::load(config, &run.set.overrides(), plants)?;
            let dir = run.directory(&format!("{}-certify", experiment.name), false);
            let arguments = arguments();
            let options = options(run.resume, quiet, &arguments);
            if let Some(model) = what.certified() {
                let found = pinc_runs::verify_certificate(&experiment, model, &options)?;
                show(quiet, &found.to_string())?;
                return Ok(ExitCode::SUCCESS);
            }
            let (model, what) = (what.model(), what.what());
            let found = pinc_runs::certify(&experiment, &dir, &options, model, &what)?;
            show(quiet, &found.to_string())?;
        }
        Command::Choose(args) => args.choose(plants, quiet)?,
        Command::Tune(args) => args.tune(plants, quiet)?,
        Command::Shrink(args) => args.shrink(plants, quiet)?,
        Command::Check { config, json, set } => {
            return check(config, (*json, quiet), &set.overrides(), plants);
        }
        Command::Report { dir } => {
            let path = pinc_runs::rebuild_report(dir)?;
            show(quiet, &path.display().to_string())?;
        }
        Command::Compare { dirs, out: None } => {
            show(quiet, pinc_report::compare(dirs)?.text.trim_end())?;
        }
        Command::Compare { dirs, out: Some(page) } => {
            pinc_runs::compare(dirs, page)?;
            show(quiet, &page.display().to_string())?;
        }
        Command::Results { dir, out: None } => {
            show(quiet, pinc_report::results(dir)?.trim_end())?;
        }
        Command::Results { dir, out: Some(page) } => pinc_report::write_results(dir, page)?,
        Command::Bench { json, quick, loss_gradient_file } => {
            let loss_gradient_file = loss_gradient_file.clone();
            let verbosity = verbosity(quiet);
            let options = BenchOptions { quick: *quick, loss_gradient_file, verbosity };
            let report = pinc_bench::bench(&options)?;
            show(quiet, &if *json { report.to_json() } else { report.to_string() })?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// All configs are read before the first is run, so that a mistake in the last shows at once.
fn run_all(
    configs: &[PathBuf],
    sweep: &SweepArgs,
    run: &RunArgs,
    plants: &Plants,
    quiet: bool,
) -> Result<(), RunError> {
    let mut all = Vec::new();
    for config in configs {
        all.extend(run.load(config, plants, configs.len() > 1)?);
    }
    for (i, (_, dir)) in all.iter().enumerate() {
        if all[..i].iter().any(|(_, other)| other == dir) {
            let problem = "two of the configs have this run directory; expected each once";
            return Err(RunError::usage(dir.display(), problem));
        }
    }
    if sweep.fresh && all.iter().all(|(experiment, _)| experiment.sweep.is_none()) {
        let problem = "discards the results of a sweep, and the config has no section [sweep]";
        return Err(RunError::usage("--fresh", problem));
    }
    if let Some(slurm) = &sweep.on_slurm() {
        return all.iter().try_for_each(|(experiment, dir)| {
            run.on_slurm(experiment, dir, sweep.fresh, slurm, plants, quiet)
        });
    }
    let work = |experiment: &Experiment, dir: &Path, options: &Options<'_>| match (
        &experiment.sweep,
        sweep.shard(),
    ) {
        (None, None) => pinc_runs::run(experiment, dir, options),
        (_, shard) => {
            if !(sweep.fresh || options.resume) {
                may_begin_afresh(experiment, dir)?;
            }
            pinc_bench::sweep(experiment, dir, options, shard.unwrap_or(Shard::WHOLE))
        }
    };
    if let [(experiment, dir)] = &all[..] {
        return run.execute(experiment, dir, quiet, &work);
    }
    let mut failed = 0;
    for (experiment, dir) in &all {
        match run.execute(experiment, dir, quiet, &work) {
            Err(error @ RunError::Interrupted { .. }) => return Err(error),
            Err(error) => {
                failed += 1;
                console::note(&format!("error: {}: {error}", dir.display()));
            }
            Ok(()) => {}
        }
    }
    match failed {
        0 => Ok(()),
        failed => Err(RunError::Failed(format!(
            "{failed} of {} experiments failed; their errors are above",
            all.len()
        ))),
    }
}

fn check(
    config: &Path,
    (json, quiet): (bool, bool),
    sets: &[String],
    plants: &Plants,
) -> Result<ExitCode, RunError> {
    let loaded = Experiment::load(config, sets, plants);
    if let (Err(error), true) = (&loaded, json) {
        console::line(&unusable(config, error))?;
    }
    let experiment = loaded?;
    let findings = pinc_runs::check_watched(&experiment, verbosity(quiet));
    if json {
        console::line(&pinc_runs::findings_json(&findings))?;
    } else {
        let (config, name) = (config.display(), &experiment.name);
        let preset = experiment.preset.name();
        show(quiet, &format!("{config}: a valid config of {name}, preset {preset}"))?;
        for finding in findings.iter().filter(|of| !quiet || of.severity == Severity::Error) {
            console::line(&finding.to_string())?;
        }
    }
    let worst = findings.iter().map(|finding| finding.severity).max();
    Ok(ExitCode::from(u8::from(worst == Some(Severity::Error))))
}

impl RunArgs {
    /// Loads a config and does `work` on it.
    fn one(
        &self,
        config: &Path,
        plants: &Plants,
        quiet: bool,
        work: impl Fn(&Experiment, &Path, &Options<'_>) -> Result<RunDir, RunError>,
    ) -> Result<(), RunError> {
        let experiment = Experiment::load(config, &self.set.overrides(), plants)?;
        let dir = self.directory(&experiment.name, false);
        self.execute(&experiment, &dir, quiet, &work)
    }

    /// The experiments of a file, which is a config or a list of such, with their run directories.
    fn load(
        &self,
        config: &Path,
        plants: &Plants,
        several: bool,
    ) -> Result<Vec<(Experiment, PathBuf)>, RunError> {
        let sets = &self.set.overrides();
        let Some(list) = RunList::load(config)? else {
            let experiment = Experiment::load(config, sets, plants)?;
            let dir = self.directory(&experiment.name, several);
            return Ok(vec![(experiment, dir)]);
        };
        let dir = self.directory(&list.name, several);
        let listed = list.experiments(config, sets, plants)?.into_iter();
        Ok(listed.map(|(experiment, place)| (experiment, dir.join(place))).collect())
    }

    /// Submits a sweep, with what its directory holds unless it is to be thrown away.
    fn on_slurm(
        &self,
        experiment: &Experiment,
        dir: &Path,
        fresh: bool,
        slurm: &OnSlurm,
        plants: &Plants,
        quiet: bool,
    ) -> Result<(), RunError> {
        if fresh {
            pinc_bench::clear(experiment, dir)?;
        }
        let submitted = pinc_bench::submit(experiment, dir, slurm)?;
        show(quiet, &submitted.to_string())?;
        if slurm.wait && submitted.jobs > 0 {
            let arguments = arguments();
            pinc_bench::wait(dir, plants, &options(true, quiet, &arguments))?;
            let merged = pinc_bench::merge(
                &[dir.to_owned()],
                dir,
                plants,
                &options(true, quiet, &arguments),
            )?;
            show(quiet, &summary(&merged))?;
        }
        Ok(())
    }

    /// The directory of the run or list `name`, which may be one of several.
    pub(crate) fn directory(&self, name: &str, several: bool) -> PathBuf {
        match &self.out {
            Some(out) if several => out.join(name),
            Some(out) => out.clone(),
            None => Path::new("runs").join(name),
        }
    }

    fn execute(
        &self,
        experiment: &Experiment,
        dir: &Path,
        quiet: bool,
        work: &impl Fn(&Experiment, &Path, &Options<'_>) -> Result<RunDir, RunError>,
    ) -> Result<(), RunError> {
        let arguments = arguments();
        let options = options(self.resume, quiet, &arguments);
        let run_dir = work(experiment, dir, &options)?;
        show(quiet, &summary(&run_dir))?;
        verdict(experiment, run_dir.metrics())
    }
}
