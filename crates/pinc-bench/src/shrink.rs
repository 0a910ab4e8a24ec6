//! `pinc shrink`: a net in place of a config's controller.

use pinc_config::{ControlSpec, Experiment, ModelKind};
use pinc_mpc::{Bounds, Reference};
use pinc_ode::PiecewiseConstant;
use pinc_record::{CsvText, Provenance, RunDir};
use pinc_runs::invocation::invocation;
use pinc_runs::{
    BatchController, ModelFile, Options, PolicyFile, RunError, Target, Verbosity, console,
};
use pinc_shrink::{Judgement, Outcome, Region, ShrinkConfig, ShrinkError, Stage};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// The command in messages.
const COMMAND: &str = "pinc shrink";

/// The table of the judgement.
const TABLE: &str = "shrink.csv";

/// The net, for `control.policy`.
const POLICY: &str = "policy.json";

/// How far beyond the states of the config's loop the net is trained, as a part of their range.
const MARGIN: f64 = 0.2;

/// The longest time for which a loop follows a value, in control steps.
const LONGEST_HOLD: usize = 60;

/// How a controller becomes a net.
#[derive(Clone, Copy, Debug)]
pub struct ShrinkOptions {
    /// Neurons in each of the two hidden layers.
    pub neurons: usize,
    /// Plans to make and train on.
    pub samples: usize,
    /// The most iterations of the training.
    pub iterations: usize,
    /// Closed loops to judge by.
    pub loops: usize,
}

impl Default for ShrinkOptions {
    /// The recommended values.
    fn default() -> Self {
        let ShrinkConfig { neurons, samples, iterations, loops, .. } = ShrinkConfig::default();
        Self { neurons, samples, iterations, loops }
    }
}

/// A net in place of a controller, as `shrink` leaves it; its `Display` is a short table.
#[derive(Clone, Debug)]
pub struct ShrunkController {
    /// Closed loops of the net beside the controller's.
    pub judgement: Judgement,
    /// Where the net and its check are as C; why there is none if they are not.
    pub c: Result<PathBuf, String>,
    weights: usize,
    labels: usize,
}

/// Trains a net in place of the controller of `experiment`, whose model is `only` one or the config's
/// first, or the net in the file `model`; judges its closed loops beside the controller's; and writes
/// the judgement, `shrink.csv`, the net, `policy.json`, and the net with its check as C to `dir`.
///
/// # Errors
///
/// [`RunError`] if the controller has something that a net does not replace, has too few optimal plans,
/// or a file cannot be read or written, as in a directory of another config or one at work in it.
pub fn shrink(
    experiment: &Experiment,
    (model, only): (Option<&Path>, Option<ModelKind>),
    dir: &Path,
    options: &Options<'_>,
    how: ShrinkOptions,
) -> Result<ShrunkController, RunError> {
    let given = model.map(ModelFile::At);
    let mut controller = BatchController::new(experiment, given, only, 0, COMMAND)?;
    let ShrinkOptions { neurons, samples, iterations, loops } = how;
    let (hold, seed) = (hold(&controller), experiment.seed);
    let config = ShrinkConfig { neurons, samples, iterations, loops, hold, seed, threads: 0 };
    let region = region(&mut controller)?;
    let failed = |error| of_shrink(&experiment.name, error);
    pinc_shrink::check_batch(controller.batch_mut()).map_err(failed)?;
    let run_dir = RunDir::open(dir, experiment, std::process::id())?;
    run_dir.write_provenance(&Provenance::of(experiment, invocation(options.arguments)), false)?;
    let mut see = |stage: Stage| {
        if options.check_interrupt(dir).is_err() {
            return ControlFlow::Break(());
        }
        let line = match stage {
            Stage::Labelling(plans) => format!("making {plans} plans"),
            Stage::Training(iteration, loss) if iteration % 500 == 0 => {
                format!("iteration {iteration}: loss {loss:.2e}")
            }
            Stage::Judging(loops) => format!("judging {loops} loops"),
            _ => return ControlFlow::Continue(()),
        };
        if options.verbosity == Verbosity::Shown {
            console::note(&line);
        }
        ControlFlow::Continue(())
    };
    let (batch, plant) = controller.parts();
    let shrunk = pinc_shrink::shrink(batch, plant, &region, &config, &mut see).map_err(failed);
    options.check_interrupt(dir)?;
    let shrunk = shrunk?;
    let to = (Target::C, false);
    let into = (None, Some(dir));
    let exported =
        pinc_runs::export_controller_with(experiment, (model, only), to, into, |of, nmpc, name| {
            Ok(pinc_shrink::policy_to_c(&shrunk.policy, nmpc, of, name)?.into())
        });
    let c = match exported {
        Ok(files) => Ok(files),
        // A full disk is not the controller's fault.
        Err(error @ RunError::Record(_)) => return Err(error),
        Err(refused) => Err(refused.to_string()),
    };
    let file = PolicyFile::new(&controller, shrunk.policy.net().clone());
    run_dir.write(POLICY, file.to_string().as_bytes())?;
    run_dir.write(TABLE, table(&shrunk.judgement).as_bytes())?;
    let (weights, labels) = (shrunk.policy.weights(), shrunk.labels);
    Ok(ShrunkController { judgement: shrunk.judgement, c, weights, labels })
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

impl std::fmt::Display for ShrunkController {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Judgement { loops, nmpc, net, checked, backed, .. } = self.judgement;
        writeln!(
            f,
            "a net of {} weights, trained on {} plans; {loops} loops, references not known in advance:",
            self.weights, self.labels
        )?;
        let backing = ("net, backed", backed);
        for (name, of) in [("controller", nmpc), ("net", net), ("net, checked", checked), backing] {
            writeln!(
                f,
                "{name:<15} {:>9.3} % of the controller's IAE, bounds broken in {} loops, {} of them kept by the controller",
                100.0 * of.iae / nmpc.iae,
                of.broken,
                of.newly_broken
            )?;
        }
        write!(
            f,
            "the check keeps {:.1} % of the net's plans; backed by the controller, that plans {:.1} % of the steps",
            100.0 * checked.kept,
            100.0 * backed.optimized
        )
    }
}

/// The judgement as a table.
fn table(judgement: &Judgement) -> CsvText {
    let heads = ["driver", "loops", "iae", "broken", "newly_broken", "kept", "optimized"];
    let mut table = CsvText::new(heads);
    let Judgement { loops, nmpc, net, checked, backed, .. } = *judgement;
    for (name, of) in [("controller", nmpc), ("net", net), ("checked", checked), ("backed", backed)]
    {
        let Outcome { iae, broken, newly_broken, kept, optimized, .. } = of;
        let counts = [loops, broken, newly_broken].map(|count| count.to_string());
        let [loops, broken, newly_broken] = counts;
        table.push([
            name.to_owned(),
            loops,
            iae.to_string(),
            broken,
            newly_broken,
            kept.to_string(),
            optimized.to_string(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::Plants;

    /// The controller of a tank in steps of 5 s, with some values set.
    fn controller(sets: &[&str]) -> BatchController {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/rk4-only.toml");
        let sets: Vec<String> =
            ["control.step_s=5.0"].iter().chain(sets).map(|&set| set.to_owned()).collect();
        let experiment = Experiment::load(path.as_ref(), &sets, &Plants::built_in()).unwrap();
        BatchController::new(&experiment, None, None, 1, COMMAND).unwrap()
    }

    const TWO: &str = "control.references=[{ start_s = 0.0, value = [9.0] }, \
                       { start_s = 120.0, value = [7.5] }]";

    /// References are held as long as the shortest of the config is, from the last one to the end of
    /// the loop too, and between 10 and 60 steps.
    #[test]
    fn references_are_held_as_long_as_the_shortest() {
        for (sets, steps) in [
            (&[TWO][..], 16),
            (&[TWO, "control.duration_s=180.0"], 12),
            (&[TWO, "control.duration_s=150.0"], 10),
            (&[TWO, "control.duration_s=400.0"], 24),
            (&[], 40),
            (&["control.duration_s=400.0"], 60),
        ] {
            assert_eq!(hold(&controller(sets)), steps, "{sets:?}");
        }
    }

    /// The net is trained where the loop goes and a fifth of that further, within the bounds: a loop
    /// that rises from 5 to 5 + w is met from 5 - 0.2 w to 5 + 1.2 w.
    #[test]
    fn the_region_is_that_of_the_loop_and_a_margin() {
        let found = region(&mut controller(&[TWO])).unwrap();
        let (low, high) = (found.states.low[0], found.states.high[0]);
        let width = (5.0 - low) / 0.2;
        assert!((high - (5.0 + 1.2 * width)).abs() < 1e-9, "{low} {high}");
        assert!((3.9..4.3).contains(&width), "{width}");
        assert_eq!(
            (&found.references.low[..], &found.references.high[..]),
            (&[7.5][..], &[9.0][..])
        );
        // Within the bounds, but for where the loop itself goes.
        let bounds = ["control.state_low=[4.9]", "control.state_high=[9.3]"];
        let found = region(&mut controller(&[TWO, bounds[0], bounds[1]])).unwrap();
        assert!((found.states.low[0] - 4.9).abs() < 1e-12, "{:?}", found.states);
        assert!((found.states.high[0] - 9.3).abs() < 1e-12, "{:?}", found.states);
        let found = region(&mut controller(&[TWO, "control.state_low=[5.5]"])).unwrap();
        assert!((found.states.low[0] - 5.0).abs() < 1e-12, "{:?}", found.states);
    }

    fn outcome(iae: f64, broken: usize, newly_broken: usize, kept: f64, optimized: f64) -> Outcome {
        let mut outcome = Outcome::default();
        (outcome.iae, outcome.broken, outcome.newly_broken) = (iae, broken, newly_broken);
        (outcome.kept, outcome.optimized) = (kept, optimized);
        outcome
    }

    fn judgement() -> Judgement {
        let mut judgement = Judgement::default();
        judgement.loops = 16;
        judgement.nmpc = outcome(8.0, 1, 0, 0.0, 1.0);
        judgement.net = outcome(10.0, 5, 4, 1.0, 0.0);
        judgement.checked = outcome(9.0, 3, 2, 0.875, 0.0);
        judgement.backed = outcome(8.5, 2, 1, 0.75, 0.25);
        judgement
    }

    /// Each driver's errors are in percent of the controller's, beside its own counts.
    #[test]
    fn drivers_are_compared_with_the_controller() {
        let (c, weights, labels) = (Err(String::new()), 81, 500);
        let said = ShrunkController { judgement: judgement(), c, weights, labels }.to_string();
        let head = "a net of 81 weights, trained on 500 plans; 16 loops, ";
        assert!(said.starts_with(head), "{said}");
        let rows = [
            ("controller", "100.000", 1, 0),
            ("net", "125.000", 5, 4),
            ("net, checked", "112.500", 3, 2),
            ("net, backed", "106.250", 2, 1),
        ];
        for ((name, percent, broken, newly), line) in rows.into_iter().zip(said.lines().skip(1)) {
            let counts = format!("bounds broken in {broken} loops, {newly} of them kept");
            assert!(line.starts_with(&format!("{name:<15} ")), "{line}");
            assert!(line.contains(&format!(" {percent} %")) && line.contains(&counts), "{line}");
        }
        let last = said.lines().last().unwrap();
        assert!(last.contains("keeps 87.5 % of the net's plans"), "{last}");
        assert!(last.ends_with("that plans 25.0 % of the steps"), "{last}");
    }

    #[test]
    fn the_table_has_a_row_for_each_driver() {
        let text = String::from_utf8(table(&judgement()).as_bytes().to_vec()).unwrap();
        let expected = "driver,loops,iae,broken,newly_broken,kept,optimized\n\
                        controller,16,8,1,0,0,1\nnet,16,10,5,4,1,0\nchecked,16,9,3,2,0.875,0\n\
                        backed,16,8.5,2,1,0.75,0.25\n";
        assert_eq!(text, expected);
    }
}
