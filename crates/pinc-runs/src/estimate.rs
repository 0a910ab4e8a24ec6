//! `pinc estimate`: the estimator of a config over recorded data, from CSV to CSV.

use super::chosen::ModelFile;
use super::control::LoopSetup;
use super::feedback;
use super::guard::{Ahead, Guard};
use crate::RunError;
use pinc_config::{Experiment, LoopParameters, ModelKind, Variables};
use pinc_estimate::{Augmentation, Estimator, History};
use pinc_record::columns::{At, rows, too_few_rows, unmeasured};
use pinc_record::{
    EstimatorMetrics, OutsideDomain, RecordedColumns, RecordedRow, check_output, decimals,
    read_file, write_output,
};
use std::borrow::Cow;
use std::fmt;
use std::path::Path;
use std::time::Instant;

/// The result of an estimator over recorded data.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimated {
    /// The number of rows.
    pub rows: usize,
    /// How many corrections and predictions did not end as they should.
    pub failed: usize,
    /// The numbers of the estimator, without errors where the data lack a true state.
    pub estimator: EstimatorMetrics,
    /// The use of the model outside its training domain, if it is a net.
    pub outside_domain: OutsideDomain,
}

impl Estimated {
    /// What there is to say of the model and of the estimator.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        self.outside_domain.note().into_iter().chain(self.estimator.notes(self.rows)).collect()
    }
}

impl fmt::Display for Estimated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, failed, estimator, .. } = self;
        let EstimatorMetrics { nis_mean, nis_expected, nis_steps, estimator_us, .. } = estimator;
        write!(f, "{rows} rows; NIS {nis_mean:.3}")?;
        if nis_steps < rows {
            write!(f, " over the {nis_steps} rows that have one")?;
        }
        write!(f, ", consistent would be {nis_expected:.3}; {:.2} us a step", estimator_us.p50)?;
        if *failed > 0 {
            write!(f, "; {failed} corrections and predictions failed")?;
        }
        for (i, (name, rmse)) in estimator.estimate_rmse.iter().enumerate() {
            let before = if i == 0 { "; RMSE" } else { "," };
            write!(f, "{before} {name} {}", decimals(*rmse, 6))?;
        }
        self.notes().iter().try_for_each(|note| write!(f, "\n{note}"))
    }
}

/// Runs the estimator of `experiment` over the file `data`, and writes its filtered estimates, one
/// row per row of the data, to the file `output`, if there is one. The model is `only`, or the
/// first numerical one of the config; the net of the file `model`, if that is given.
///
/// The data have the columns `t`, in steps of T, the inputs and the known parameters, which hold from
/// a row to the next, and `y_<measured>`, read just before the input changes, whose cells may be
/// empty; other columns are ignored, except the true states. Before the first row the input is
/// `control.initial_input`, or else the row's own.
///
/// # Errors
///
/// [`RunError`], naming file, line and column of what is wrong with the data.
pub fn estimate(
    experiment: &Experiment,
    data: &Path,
    output: Option<&Path>,
    model: Option<&Path>,
    only: Option<ModelKind>,
) -> Result<Estimated, RunError> {
    if let Some(output) = output {
        let config = experiment.source();
        let read = [("--data", data), ("the config", config.as_ref())].into_iter();
        check_output(("--output", output), read.chain(model.map(|model| ("--model", model))))?;
    }
    let mut of = estimator(experiment, model.map(ModelFile::At), only)?;
    let mut constants = experiment.plant.parameter_names();
    constants.retain(|parameter| !of.names.contains(parameter) && !of.known.contains(parameter));
    let Run { t, history, step_us } = of.run((data, &read_file(data)?), &constants)?;
    let ConfigEstimator { names, measured, variables, watch, .. } = of;
    let estimator = feedback::metrics(&history, (&variables.state_names(), &measured), step_us);
    if let Some(output) = output {
        let table = feedback::table(&history, (names, measured), |k| t[k]);
        write_output(output, table.estimates_to_csv().as_bytes())?;
    }
    let ends = history.corrections.iter().map(|c| &c.status).chain(&history.predictions);
    let failed = ends.filter(|status| !status.has_succeeded()).count();
    let outside_domain = watch.map_or_else(Default::default, |(guard, _)| guard.found());
    Ok(Estimated { rows: t.len(), failed, estimator, outside_domain })
}

/// The estimator of a config, with the names of its numbers.
#[derive(Debug)]
pub struct ConfigEstimator {
    /// The estimator; before the first measurement the input is taken for 0.
    pub filter: Box<dyn Estimator>,
    /// What is estimated: the states, disturbances and parameters.
    pub names: Vec<String>,
    /// What is measured.
    pub measured: Vec<String>,
    /// The parameters that are known in each step.
    pub known: Vec<String>,
    /// The plant's variables.
    pub variables: Variables,
    /// Length T of a step in s.
    pub sample_time_s: f64,
    /// What was applied before the first step, where the config says it.
    pub initial_input: Option<Vec<f64>>,
    /// What watches the model, if it is a net, and how that is augmented.
    watch: Option<(Guard<'static>, Augmentation)>,
}

/// The estimator of `experiment`, with the model of [`estimate`].
///
/// # Errors
///
/// [`RunError`] if the config has none, or it cannot be made.
pub fn estimator(
    experiment: &Experiment,
    model: Option<ModelFile<'_>>,
    only: Option<ModelKind>,
) -> Result<ConfigEstimator, RunError> {
    let missing = |section| RunError::missing_section(experiment, section, "estimate");
    let spec = experiment.control.as_ref().ok_or_else(|| missing("control"))?;
    let estimator = spec.estimator.as_ref().ok_or_else(|| missing("control.estimator"))?;
    let net = model.map(|file| file.matching(experiment)).transpose()?;
    let net = net.map(|(_, net)| net);
    let numerical = || spec.models.iter().copied().find(|kind| kind.is_numerical());
    let kind = match (only, &net) {
        (Some(ModelKind::Pinc), None) => return Err(missing("model (a file: --model)")),
        (Some(kind), _) => kind,
        (None, Some(_)) => ModelKind::Pinc,
        (None, None) => numerical().unwrap_or(ModelKind::RK4),
    };
    let sample_time_s = experiment.sample_time_s().ok_or_else(|| missing("model"))?;
    let LoopParameters { names, values, estimated, known } = experiment.loop_parameters();
    let plant = experiment.plant.family(&names);
    let setup = LoopSetup {
        net: net.as_ref(),
        parameters: &values,
        estimated: &estimated,
        known: &known,
        ..LoopSetup::numerical(spec, sample_time_s, &*plant)
    };
    let variables = Variables::of(&*plant);
    let measurement = spec.measurement.clone().unwrap_or_default();
    let augmentation = setup.augmentation(estimator, &measurement, &*plant);
    let model = setup.model(kind, &*plant)?;
    let filter = feedback::estimator((spec, estimator), &augmentation, model, None)?;
    let watch = net.filter(|_| spec.model_of(kind) == ModelKind::Pinc).map(|net| {
        let parts = (Some(augmentation.clone()), Ahead::default());
        (Guard::new(Cow::Owned(net), spec.outside_domain, parts), augmentation)
    });
    Ok(ConfigEstimator {
        filter,
        names: estimator.names(&measurement, &variables),
        measured: measurement.names(&variables),
        known: known.iter().map(|&place| names[place].to_owned()).collect(),
        variables,
        sample_time_s,
        initial_input: spec.initial_input.clone(),
        watch,
    })
}

/// What was made of a file.
#[derive(Default)]
struct Run {
    /// The times of the rows.
    t: Vec<f64>,
    history: History,
    /// How long each row took.
    step_us: Vec<f64>,
}

impl ConfigEstimator {
    /// Runs over the `text` of the file `path`, which may not have a column of any of `constants`.
    fn run(&mut self, (path, text): (&Path, &[u8]), constants: &[String]) -> Result<Run, RunError> {
        let Self { filter, watch, measured, known, variables, .. } = self;
        let (sample_time_s, initial_input) = (self.sample_time_s, self.initial_input.as_deref());
        let at = |(line, problem): At| RunError::Csv { path: path.to_owned(), line, problem };
        let (header, rows) = rows(text).map_err(at)?;
        let columns = RecordedColumns::find(&header, variables, measured, (known, constants));
        let columns = columns.map_err(|problem| at((1, problem)))?;
        let (mut run, mut is_blind) = (Run::default(), true);
        let mut before: Option<(u64, RecordedRow)> = None;
        for row in rows {
            let (line, cells) = row.map_err(at)?;
            let row = columns.read(&cells).map_err(|problem| at((line, problem)))?;
            if let Some((_, RecordedRow { t, .. })) = &before
                && row
                    .steps_since(*t, sample_time_s)
                    .is_none_or(|steps| !(0.5..1.5).contains(&steps))
            {
                let given = format!("{} s after {t} s given", row.t);
                let problem =
                    format!("column `t`: {given}, expected steps of T = {sample_time_s} s");
                return Err(at((line, problem)));
            }
            if let (Some((guard, augmentation)), Some((line, before))) = (&mut *watch, &before) {
                let z = filter.estimate();
                let mut x = z[..variables.state_names().len()].to_vec();
                let mut w = [&z[x.len()..], &before.known].concat();
                augmentation.read(z, &mut x, &mut w);
                let outside =
                    |error| RunError::Failed(format!("{}:{line}: {error}", path.display()));
                guard.look(&x, &before.u, &w).map_err(outside)?;
            }
            let clock = Instant::now();
            match &before {
                Some((_, before)) => run.history.predictions.push(filter.predict(&before.u)),
                None => filter.reset_input(initial_input.unwrap_or(&row.u)),
            }
            filter.set_parameters(&row.known);
            is_blind &= row.y.iter().all(|y| y.is_nan());
            let correction = filter.correct(&row.y);
            run.step_us.push(1e6 * clock.elapsed().as_secs_f64());
            if let Some(truth) = &row.truth {
                let squared = &mut run.history.squared_errors;
                squared.resize(truth.len(), 0.0);
                for (sum, (z, x)) in squared.iter_mut().zip(filter.estimate().iter().zip(truth)) {
                    *sum += (z - x).powi(2);
                }
            }
            run.history.take_note(filter.as_ref(), &row.y, correction);
            run.t.push(row.t);
            before = Some((line, row));
        }
        match run.t.len() {
            0 => Err(at(too_few_rows(0, 1))),
            _ if is_blind => Err(at((1, unmeasured(measured)))),
            _ => Ok(run),
        }
    }
}
