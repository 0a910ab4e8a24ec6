//! `pinc estimate`: the estimator of a config over recorded data, from CSV to CSV.

use super::chosen::ModelFile;
use super::columns::{At, rows, too_few_rows};
use super::control::LoopSetup;
use super::feedback;
use super::recorded::Columns;
use crate::RunError;
use pinc_config::{Experiment, LoopParameters, ModelKind, Variables};
use pinc_estimate::Estimator;
use pinc_record::{EstimateRow, EstimateTable, StepTimes, read_file, write_atomically};
use std::fmt;
use std::path::Path;
use std::time::Instant;

/// The result of an estimator over recorded data.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimated {
    /// The number of rows.
    pub rows: usize,
    /// The mean of the normalized innovations squared.
    pub nis_mean: f64,
    /// Its value for a consistent estimator: how many measurements are used at a time, on average
    /// over the rows that have one.
    pub nis_expected: f64,
    /// How many rows have one.
    pub nis_rows: usize,
    /// How many corrections did not end as they should.
    pub failed: usize,
    /// How many measurements the estimator's gate rejected.
    pub rejected: usize,
    /// How long a prediction with the correction after it takes, the median, in us.
    pub step_us: f64,
    /// The root mean square error of each state, where the data have all true states.
    pub rmse: Vec<(String, f64)>,
}

impl fmt::Display for Estimated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, nis_mean, nis_expected, nis_rows, failed, rejected, step_us, rmse } = self;
        write!(f, "{rows} rows; NIS {nis_mean:.3}")?;
        if nis_rows < rows {
            write!(f, " over the {nis_rows} rows that have one")?;
        }
        write!(f, ", consistent would be {nis_expected:.3}; {step_us:.2} us a step")?;
        if *failed > 0 {
            write!(f, "; {failed} corrections failed")?;
        }
        if *rejected > 0 {
            write!(f, "; {rejected} measurements rejected as too far from what was expected")?;
        }
        for (i, (name, rmse)) in rmse.iter().enumerate() {
            write!(f, "{} {name} {rmse:.6}", if i == 0 { "; RMSE" } else { "," })?;
        }
        Ok(())
    }
}

/// Runs the estimator of `experiment` over the file `data`, and writes its filtered estimates, one
/// row per row of the data, to the file `output`, if there is one. The model is `only`, or the
/// first numerical one of the config; the net of the file `model`, if that is given.
///
/// The data have the columns `t`, in steps of T, the inputs, which hold from a row to the next, and
/// `y_<measured>`, read just before the input changes, whose cells may be empty; other columns are
/// ignored, except the true states. Before the first row the input is `control.initial_input`, or
/// else the row's own.
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
    let model = model.map(ModelFile::At);
    let ConfigEstimator { mut filter, names, measured, variables, sample_time_s, initial_input } =
        estimator(experiment, model, only)?;
    let text = read_file(data)?;
    let initial_input = initial_input.as_deref();
    let found = run((filter.as_mut(), initial_input), &text, &variables, &measured, sample_time_s);
    let at = |(line, problem): At| RunError::Csv { path: data.to_owned(), line, problem };
    let Run { rows, failed, used, step_us, squared } = found.map_err(at)?;
    let table = EstimateTable { names, measured, rows };
    if let Some(output) = output {
        write_atomically(output, table.estimates_to_csv().as_bytes())?;
    }
    let summary = summary(&table, used, squared, &variables);
    Ok(Estimated { failed, step_us: StepTimes::of(step_us).p50, ..summary })
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
    /// The plant's variables.
    pub variables: Variables,
    /// Length T of a step in s.
    pub sample_time_s: f64,
    /// What was applied before the first step, where the config says it.
    pub initial_input: Option<Vec<f64>>,
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
    let LoopParameters { names, values, estimated } = experiment.loop_parameters();
    let plant = experiment.plant.family(&names);
    let setup = LoopSetup {
        net: net.as_ref(),
        parameters: &values,
        estimated: &estimated,
        ..LoopSetup::numerical(spec, sample_time_s, &*plant)
    };
    let variables = Variables::of(&*plant);
    let measurement = spec.measurement.clone().unwrap_or_default();
    let augmentation = setup.augmentation(estimator, &measurement, &*plant);
    let model = setup.model(kind, &*plant)?;
    let filter = feedback::estimator((spec, estimator), &augmentation, model, None)?;
    Ok(ConfigEstimator {
        filter,
        names: estimator.names(&measurement, &variables),
        measured: measurement.names(&variables),
        variables,
        sample_time_s,
        initial_input: spec.initial_input.clone(),
    })
}

fn summary(
    table: &EstimateTable,
    used: usize,
    squared: Option<Vec<f64>>,
    variables: &Variables,
) -> Estimated {
    let nis: Vec<f64> = table.rows.iter().map(|row| row.nis).filter(|v| !v.is_nan()).collect();
    #[expect(clippy::cast_precision_loss, reason = "no file has 2^53 rows")]
    let (judged, used, rows) = (nis.len() as f64, used as f64, table.rows.len() as f64);
    let names = variables.state_names().into_iter();
    Estimated {
        rows: table.rows.len(),
        nis_mean: nis.iter().sum::<f64>() / judged,
        nis_expected: used / judged,
        nis_rows: nis.len(),
        failed: 0,
        rejected: table.rows.iter().map(|row| row.rejected).sum(),
        step_us: f64::NAN,
        rmse: squared.map_or_else(Vec::new, |squared| {
            names.zip(squared).map(|(name, sum)| (name, (sum / rows).sqrt())).collect()
        }),
    }
}

/// What was made of a file.
struct Run {
    rows: Vec<EstimateRow>,
    failed: usize,
    /// How many measurements were used in the rows that have a normalized innovation squared.
    used: usize,
    /// How long each row took.
    step_us: Vec<f64>,
    /// The sums of squared errors of the states, if their truth is known.
    squared: Option<Vec<f64>>,
}

fn run(
    (filter, initial_input): (&mut dyn Estimator, Option<&[f64]>),
    text: &[u8],
    variables: &Variables,
    measured: &[String],
    sample_time_s: f64,
) -> Result<Run, At> {
    let (header, rows) = rows(text)?;
    let columns = Columns::find(&header, variables, measured).map_err(|problem| (1, problem))?;
    let mut run = Run { rows: Vec::new(), failed: 0, used: 0, step_us: Vec::new(), squared: None };
    run.squared = columns.states.as_ref().map(|states| vec![0.0; states.len()]);
    let mut before: Option<(f64, Vec<f64>)> = None;
    for row in rows {
        let (line, cells) = row?;
        let row = columns.read(&cells).map_err(|problem| (line, problem))?;
        if let Some((t, _)) = &before
            && (row.t - t - sample_time_s).abs() > 1e-6 * sample_time_s
        {
            let given = format!("{} s after {t} s given", row.t);
            let problem = format!("column `t`: {given}, expected steps of T = {sample_time_s} s");
            return Err((line, problem));
        }
        let clock = Instant::now();
        match &before {
            Some((_, u)) => _ = filter.predict(u),
            None => filter.reset_input(initial_input.unwrap_or(&row.u)),
        }
        let correction = filter.correct(&row.y);
        run.step_us.push(1e6 * clock.elapsed().as_secs_f64());
        run.failed += usize::from(!correction.status.has_succeeded());
        run.used += if correction.nis.is_nan() { 0 } else { correction.measured };
        let (z, n) = (filter.estimate(), filter.dims().nx);
        if let (Some(squared), Some(truth)) = (&mut run.squared, &row.truth) {
            for (sum, (z, x)) in squared.iter_mut().zip(z.iter().zip(truth)) {
                *sum += (z - x).powi(2);
            }
        }
        run.rows.push(EstimateRow {
            t: row.t,
            estimate: z.to_vec(),
            sd: filter.covariance().iter().step_by(n + 1).map(|v| v.sqrt()).collect(),
            measured: row.y,
            innovation: filter.innovation().to_vec(),
            nis: correction.nis,
            nees: f64::NAN,
            rejected: correction.rejected,
        });
        before = Some((row.t, row.u));
    }
    match run.rows.len() {
        0 => Err(too_few_rows(0, 1)),
        _ => Ok(run),
    }
}
