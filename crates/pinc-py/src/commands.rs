//! What the program does, as functions: each reads its config, works as the command of its name
//! does, and gives what that writes. `python/pinc/_commands.py` makes results of it.

use crate::arrays::whole;
use crate::config::{experiment, plants};
use crate::controller::kind;
use crate::errors::{input, of_run};
use crate::work::Call;
use pinc_bench::{ChooseOptions, ShrinkOptions, Timed};
use pinc_config::{Experiment, ModelKind};
use pinc_export::FmiVersion;
use pinc_runs::{Certify, Target};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};

/// What nearly every command takes.
#[derive(FromPyObject)]
pub(crate) struct Common<'py> {
    config: Bound<'py, PyAny>,
    overrides: Option<Bound<'py, PyAny>>,
    model: Option<PathBuf>,
    only: Option<String>,
    out: Option<PathBuf>,
    resume: bool,
    verbose: bool,
}

impl Common<'_> {
    fn experiment(&self) -> PyResult<Experiment> {
        experiment(&self.config, self.overrides.as_ref())
    }

    fn only(&self) -> PyResult<Option<ModelKind>> {
        self.only.as_deref().map(kind).transpose()
    }

    fn call(&self, function: &str, experiment: &Experiment) -> Call {
        let arguments = [format!("pinc.{function}"), experiment.name.clone()];
        Call { arguments, resume: self.resume, verbose: self.verbose }
    }

    /// The directory of the results: as given, or as the program names it.
    fn directory(&self, experiment: &Experiment, ending: &str) -> PathBuf {
        let named = || Path::new("runs").join(format!("{}{ending}", experiment.name));
        self.out.clone().unwrap_or_else(named)
    }
}

/// Runs a config, with the results in a directory, which is returned.
#[pyfunction]
pub(crate) fn run_into(py: Python<'_>, common: Common<'_>) -> PyResult<PathBuf> {
    let experiment = common.experiment()?;
    if experiment.sweep.is_some() {
        return Err(input(
            "sweep: a config without this section expected; `pinc run` takes sweeps",
        ));
    }
    let dir = common.directory(&experiment, "");
    common.call("run", &experiment).run(py, |options| {
        let done = pinc_runs::run(&experiment, &dir, options)?;
        pinc_runs::verdict(&experiment, done.metrics())
    })?;
    Ok(dir)
}

/// Runs the closed loops of a config only.
#[pyfunction]
pub(crate) fn control_into(py: Python<'_>, common: Common<'_>) -> PyResult<PathBuf> {
    let (experiment, only) = (common.experiment()?, common.only()?);
    let (dir, model) = (common.directory(&experiment, ""), common.model.as_deref());
    common.call("control", &experiment).run(py, |options| {
        let done = pinc_runs::control(&experiment, &dir, options, model, only)?;
        pinc_runs::verdict(&experiment, done.metrics())
    })?;
    Ok(dir)
}

/// Examines a config and its plant; the findings as JSON.
#[pyfunction]
pub(crate) fn findings(py: Python<'_>, common: Common<'_>) -> PyResult<String> {
    let experiment = common.experiment()?;
    common.call("check", &experiment).run(py, |options| {
        let findings = pinc_runs::check_watched(&experiment, options.verbosity);
        Ok(pinc_runs::findings_json(&findings))
    })
}

/// Judges one step of a model; the directory and `certify.json`.
#[pyfunction]
pub(crate) fn certify_into(
    py: Python<'_>,
    common: Common<'_>,
    points: Option<i64>,
    data: Option<PathBuf>,
    run: Option<PathBuf>,
    domain: bool,
    budget_s: Option<f64>,
) -> PyResult<(PathBuf, String)> {
    let (experiment, only) = (common.experiment()?, common.only()?);
    let budget_s = budget_s.map(|given| seconds("budget_s", given)).transpose()?;
    let points = points.map(|given| whole("points", given, 0, 1_000_000)).transpose()?;
    let dir = common.directory(&experiment, "-certify");
    let (model, what) = (common.model.as_deref(), Certify { points, data, run, domain, budget_s });
    let found = common
        .call("certify", &experiment)
        .run(py, |options| pinc_runs::certify(&experiment, &dir, options, (model, only), &what))?;
    Ok((dir, found.to_json()))
}

/// Identifies parameters; the directory and `identify.json`.
#[pyfunction]
pub(crate) fn identify_into(
    py: Python<'_>,
    common: Common<'_>,
    data: Vec<PathBuf>,
    validate: Vec<PathBuf>,
    starts: Option<i64>,
) -> PyResult<(PathBuf, String)> {
    let (experiment, only) = (common.experiment()?, common.only()?);
    if data.is_empty() {
        return Err(input("data: nothing given, expected a recording, or several"));
    }
    let starts = starts.map(|given| whole("starts", given, 1, 1000)).transpose()?;
    let (dir, model) = (common.directory(&experiment, "-identify"), common.model.as_deref());
    let found = common.call("identify", &experiment).run(py, |options| {
        pinc_runs::identify(&experiment, (&data, &validate), &dir, options, model, only, starts)
    })?;
    Ok((dir, found.to_json()))
}

/// Runs the estimator of a config over recorded data; writes the estimates to `out`.
#[pyfunction]
pub(crate) fn estimate_into<'py>(
    py: Python<'py>,
    common: Common<'_>,
    data: PathBuf,
) -> PyResult<Bound<'py, PyDict>> {
    let (experiment, only) = (common.experiment()?, common.only()?);
    let (model, out) = (common.model.as_deref(), common.out.as_deref());
    let found = common
        .call("estimate", &experiment)
        .run(py, |_| pinc_runs::estimate(&experiment, &data, out, model, only))?;
    let rmse = PyDict::new(py);
    let notes = found.notes();
    let estimator = found.estimator;
    let rejected: usize = estimator.rejected.values().sum();
    for (name, value) in estimator.estimate_rmse {
        rmse.set_item(name, value)?;
    }
    let all = PyDict::new(py);
    all.set_item("nis_mean", estimator.nis_mean)?;
    all.set_item("nis_expected", estimator.nis_expected)?;
    all.set_item("failed", found.failed)?;
    all.set_item("rejected", rejected)?;
    all.set_item("notes", notes)?;
    all.set_item("rmse", rmse)?;
    Ok(all)
}

/// Chooses the model of a config's loop; the directory, the config to use, the report, and words.
#[pyfunction]
pub(crate) fn choose_into(
    py: Python<'_>,
    common: Common<'_>,
    within: f64,
    budget_s: f64,
    target: &str,
) -> PyResult<(PathBuf, PathBuf, PathBuf, String)> {
    let experiment = common.experiment()?;
    let timed = Timed::from_name(target).ok_or_else(|| {
        let known = Timed::ALL.map(Timed::name).join(", ");
        input(format!("target: \"{target}\" given, expected one of {known}"))
    })?;
    if !(within > 0.0 && within <= 1.0) {
        return Err(input(format!("within: {within} given, expected a share, as 0.01")));
    }
    let how = ChooseOptions { within, budget_s: seconds("budget_s", budget_s)?, timed };
    let (dir, plants) = (common.directory(&experiment, "-choose"), plants());
    let choice = common
        .call("choose", &experiment)
        .run(py, |options| pinc_bench::choose(&experiment, &dir, &plants, options, how))?;
    let words = choice.to_string();
    Ok((dir, choice.recommended, choice.report, words))
}

/// Tunes the controller of a config; the directory, the tuned config, the report, the costs of loops
/// that were held out, and words.
#[pyfunction]
pub(crate) fn tune_into(
    py: Python<'_>,
    common: Common<'_>,
) -> PyResult<(PathBuf, PathBuf, PathBuf, [f64; 2], String)> {
    let (experiment, only) = (common.experiment()?, common.only()?);
    let dir = common.directory(&experiment, "-tune");
    let tuned = common
        .call("tune", &experiment)
        .run(py, |options| pinc_bench::tune(&experiment, &dir, options, only))?;
    let words = tuned.to_string();
    Ok((dir, tuned.config, tuned.report, tuned.held_out, words))
}

/// Puts a net in place of the controller of a config; the directory, words, and why there is no C if
/// there is none.
#[pyfunction]
pub(crate) fn shrink_into(
    py: Python<'_>,
    common: Common<'_>,
    neurons: Option<i64>,
    samples: Option<i64>,
    iterations: Option<i64>,
    loops: Option<i64>,
) -> PyResult<(PathBuf, String, Option<String>)> {
    let usual = ShrinkOptions::default();
    let count = |name: &str, given: Option<i64>, usual: usize, [least, most]: [usize; 2]| {
        given.map_or(Ok(usual), |given| whole(name, given, least, most))
    };
    let how = ShrinkOptions {
        neurons: count("neurons", neurons, usual.neurons, [1, 200])?,
        samples: count("samples", samples, usual.samples, [100, 10_000_000])?,
        iterations: count("iterations", iterations, usual.iterations, [0, 10_000_000])?,
        loops: count("loops", loops, usual.loops, [1, 10_000_000])?,
    };
    let (experiment, only) = (common.experiment()?, common.only()?);
    let (dir, model) = (common.directory(&experiment, "-shrink"), common.model.as_deref());
    let shrunk = common
        .call("shrink", &experiment)
        .run(py, |options| pinc_bench::shrink(&experiment, (model, only), &dir, options, how))?;
    let words = shrunk.to_string();
    Ok((dir, words, shrunk.c.err()))
}

/// Exports the controller of a config; the directory of the files.
#[pyfunction]
pub(crate) fn export_controller(
    py: Python<'_>,
    common: Common<'_>,
    to: &str,
    name: Option<&str>,
    errors: bool,
) -> PyResult<PathBuf> {
    let (experiment, only) = (common.experiment()?, common.only()?);
    let (to, model, out) = ((target(to)?, errors), common.model.as_deref(), common.out.as_deref());
    let written =
        py.detach(|| pinc_runs::export_controller(&experiment, model, only, to, name, out));
    written.map_err(|error| of_run(&error))
}

/// Exports the plant of a config; the directory of the files.
#[pyfunction]
pub(crate) fn export_plant(
    py: Python<'_>,
    common: Common<'_>,
    to: &str,
    name: Option<&str>,
) -> PyResult<PathBuf> {
    let (experiment, to, out) = (common.experiment()?, target(to)?, common.out.as_deref());
    let written = py.detach(|| pinc_runs::export_plant(&experiment, to, name, out));
    written.map_err(|error| of_run(&error))
}

/// Exports the net of a file; the directory of the files.
#[pyfunction]
pub(crate) fn export_net(
    py: Python<'_>,
    model: PathBuf,
    to: &str,
    name: Option<&str>,
    out: Option<PathBuf>,
    judged: Option<Bound<'_, PyAny>>,
) -> PyResult<PathBuf> {
    let judged = judged.map(|config| experiment(&config, None)).transpose()?;
    let (to, out) = (target(to)?, out.as_deref());
    let written = py.detach(|| pinc_runs::export_net(&model, to, name, out, judged.as_ref()));
    written.map_err(|error| of_run(&error))
}

/// The target of this name.
fn target(name: &str) -> PyResult<Target> {
    let known = [
        ("c", Target::C),
        ("casadi", Target::Casadi),
        ("fmu", Target::Fmu(FmiVersion::Two)),
        ("fmu3", Target::Fmu(FmiVersion::Three)),
        ("onnx", Target::Onnx),
        ("onnx-double", Target::OnnxDouble),
    ];
    let found = known.iter().find(|(known, _)| *known == name);
    found.map(|(_, target)| *target).ok_or_else(|| {
        let names = known.map(|(name, _)| name).join(", ");
        input(format!("to: {name:?} given, expected one of {names}"))
    })
}

fn seconds(name: &str, given: f64) -> PyResult<f64> {
    match given > 0.0 && given.is_finite() {
        true => Ok(given),
        false => Err(input(format!("{name}: {given} given, expected a positive time in s"))),
    }
}
