//! `pinc shrink`.

use crate::choices::{SetArgs, model_kind};
use crate::printed::show;
use pinc_config::{ControlSpec, Experiment, ModelKind, Plants};
use pinc_export::Name;
use pinc_mpc::{Bounds, Reference};
use pinc_ode::PiecewiseConstant;
use pinc_record::write_atomically;
use pinc_runs::{BatchController, ModelFile, RunError, Target, console};
use pinc_shrink::{Judgement, Outcome, Region, ShrinkConfig, ShrinkError, Shrunk, Stage};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The command in messages.
const COMMAND: &str = "pinc shrink";

/// How far beyond the states of the config's loop the net is trained, as a part of their range.
const MARGIN: f64 = 0.2;

/// The longest time for which a loop follows a value, in control steps.
const LONGEST_HOLD: usize = 60;

#[derive(Debug, clap::Args)]
pub(crate) struct ShrinkArgs {
    /// Config file (TOML).
    config: PathBuf,
    /// Model file (safetensors) of the net that is the controller's model.
    #[arg(long)]
    model: Option<PathBuf>,
    /// The controller's model, instead of the config's first.
    #[arg(long, value_parser = model_kind())]
    only: Option<ModelKind>,
    /// Directory of the results, by default `runs/`, the experiment's name and `-shrink`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Neurons in each of the two hidden layers.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u16).range(1..=200))]
    neurons: u16,
    /// Plans to train on, about.
    #[arg(long, default_value_t = 16_000, value_parser = clap::value_parser!(u32).range(100..))]
    samples: u32,
    /// The most iterations of the training.
    #[arg(long, default_value_t = 2000)]
    iterations: u32,
    /// Closed loops to judge by, with states and references that were not trained on.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
    loops: u32,
    #[command(flatten)]
    set: SetArgs,
}

impl ShrinkArgs {
    /// Makes the net, judges it, and writes the judgement and the C.
    pub(crate) fn shrink(&self, plants: &Plants, quiet: bool) -> Result<(), RunError> {
        let experiment = Experiment::load(&self.config, &self.set.overrides(), plants)?;
        let model = self.model.as_deref();
        let given = model.map(ModelFile::At);
        let mut controller = BatchController::new(&experiment, given, self.only, 0, COMMAND)?;
        let config = ShrinkConfig {
            neurons: usize::from(self.neurons),
            samples: as_usize(self.samples),
            iterations: as_usize(self.iterations),
            loops: as_usize(self.loops),
            hold: hold(&controller),
            seed: experiment.seed,
            threads: 0,
        };
        let region = region(&mut controller)?;
        let mut see = |stage: Stage| {
            let line = match stage {
                Stage::Labelling(plans) => format!("making {plans} plans"),
                Stage::Training(iteration, loss) if iteration % 500 == 0 => {
                    format!("iteration {iteration}: loss {loss:.2e}")
                }
                Stage::Judging(loops) => format!("judging {loops} loops"),
                _ => return,
            };
            if !quiet {
                console::note(&line);
            }
        };
        let (batch, plant) = controller.parts();
        let shrunk = pinc_shrink::shrink(batch, plant, &region, &config, &mut see)
            .map_err(|error| of_shrink(&experiment.name, error))?;
        let named = || Path::new("runs").join(format!("{}-shrink", experiment.name));
        let dir = self.out.clone().unwrap_or_else(named);
        show(quiet, &said(&shrunk))?;
        let export =
            |to| pinc_runs::export_controller(&experiment, model, self.only, to, None, Some(&dir));
        match export((Target::C, false)) {
            Ok(dir) => write_c(&experiment, (self, &mut controller), &shrunk, &dir)?,
            Err(error) => console::note(&format!("no C: {error}")),
        }
        std::fs::create_dir_all(&dir)
            .map_err(|error| RunError::usage(dir.display(), error.to_string()))?;
        write_atomically(&dir.join("shrink.csv"), table(&shrunk.judgement).as_bytes())?;
        show(quiet, &dir.display().to_string())
    }
}

fn as_usize(value: u32) -> usize {
    usize::try_from(value).unwrap_or(usize::MAX)
}

fn of_shrink(name: &str, error: ShrinkError) -> RunError {
    match error {
        ShrinkError::Mpc(error) => error.into(),
        ShrinkError::Net(error) => error.into(),
        other => RunError::usage(name, format!("`{COMMAND}`: {other}")),
    }
}

fn sample_time_s(controller: &BatchController) -> f64 {
    controller.batch().nmpc().model().sample_time_s()
}

/// For how many steps loops follow a value: as long as the config's shortest, within limits.
fn hold(controller: &BatchController) -> usize {
    let spec = controller.spec();
    let starts = spec.references.iter().map(|step| step.start_s);
    let ends: Vec<f64> = starts.chain([spec.duration_s]).collect();
    let shortest = ends.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    pinc_config::steps(shortest.min(spec.duration_s), sample_time_s(controller))
        .clamp(10, LONGEST_HOLD)
}

/// The states of the config's loop with a margin, within their bounds, and its references.
fn region(controller: &mut BatchController) -> Result<Region, RunError> {
    let (spec, u_before) = (controller.spec().clone(), controller.initial_input());
    let reference = reference(&spec, sample_time_s(controller))?;
    let traces = controller.loops(&spec.initial_state, &[reference], &u_before)?;
    let n = spec.initial_state.len();
    let problem = controller.batch().nmpc().problem();
    let mut states = range(traces[0].states.chunks_exact(n), n);
    for i in 0..n {
        let margin = MARGIN * (states.high[i] - states.low[i]);
        let (low, high) = (problem.state_bounds.low[i], problem.state_bounds.high[i]);
        states.low[i] = (states.low[i] - margin).max(low).min(states.low[i]);
        states.high[i] = (states.high[i] + margin).min(high).max(states.high[i]);
    }
    let values = spec.references.iter().map(|step| &step.value[..]);
    Ok(Region { states, references: range(values, problem.tracked.len()), u_before })
}

fn reference(spec: &ControlSpec, sample_time_s: f64) -> Result<Reference, RunError> {
    let steps = pinc_config::steps(spec.duration_s, sample_time_s);
    if spec.references.is_empty() {
        return Ok(Reference::none(steps));
    }
    let starts = spec.references.iter().map(|step| step.start_s).collect();
    let values = spec.references.iter().map(|step| step.value.clone()).collect();
    Ok(Reference::sample(&PiecewiseConstant::new(starts, values)?, steps, sample_time_s)?)
}

/// The least and largest of each column.
fn range<'a>(rows: impl Iterator<Item = &'a [f64]>, width: usize) -> Bounds {
    let mut range = Bounds::new(vec![f64::INFINITY; width], vec![f64::NEG_INFINITY; width]);
    for row in rows {
        for (i, value) in row.iter().enumerate() {
            range.low[i] = range.low[i].min(*value);
            range.high[i] = range.high[i].max(*value);
        }
    }
    range
}

/// Writes the policy beside the exported controller, whose model it uses.
fn write_c(
    experiment: &Experiment,
    (args, controller): (&ShrinkArgs, &mut BatchController),
    shrunk: &Shrunk,
    dir: &Path,
) -> Result<(), RunError> {
    let first = controller.spec().models.first().copied().unwrap_or(ModelKind::RK4);
    let kind = args.only.unwrap_or(if args.model.is_some() { ModelKind::Pinc } else { first });
    let model = kind.integrator().map_or("net", |method| method.name());
    let name = Name::nearest(&experiment.name);
    let (batch, _) = controller.parts();
    let files = batch
        .each(1, |nmpc, _| pinc_shrink::policy_to_c(&shrunk.policy, nmpc, name.as_str(), model));
    for (text, ending) in files.iter().flatten().zip(["h", "c"]) {
        let path = dir.join(format!("{}_policy.{ending}", name.as_str()));
        write_atomically(&path, text.as_bytes())?;
    }
    Ok(())
}

/// What was found, in words.
fn said(shrunk: &Shrunk) -> String {
    let Judgement { loops, nmpc, net, checked, .. } = shrunk.judgement;
    let line = |name: &str, of: Outcome| {
        format!(
            "{name:<15} {:>9.3} % of the controller's IAE, bounds broken in {} loops, {} of them kept by the controller\n",
            100.0 * of.iae / nmpc.iae,
            of.broken,
            of.newly_broken
        )
    };
    let mut text = format!(
        "a net of {} weights, trained on {} plans; {loops} loops, references not known in advance:\n",
        shrunk.policy.weights(),
        shrunk.labels
    );
    text += &line("controller", nmpc);
    text += &line("net", net);
    text += &line("net, checked", checked);
    let _ = write!(text, "the check keeps {:.1} % of the net's plans", 100.0 * checked.kept);
    text
}

/// The same as a table.
fn table(judgement: &Judgement) -> String {
    let mut text = "driver,loops,iae,broken,newly_broken,kept\n".to_owned();
    let Judgement { loops, nmpc, net, checked, .. } = *judgement;
    for (name, of) in [("controller", nmpc), ("net", net), ("checked", checked)] {
        let Outcome { iae, broken, newly_broken, kept, .. } = of;
        let _ = writeln!(text, "{name},{loops},{iae},{broken},{newly_broken},{kept}");
    }
    text
}
