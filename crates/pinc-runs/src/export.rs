//! `pinc export`: nets and controllers for other programs.

use super::chosen::{Chosen, ModelFile};
use super::model_error::tolerances;
use super::proof::{certificate, matching};
use super::shared_library::shared_libraries;
use super::{chainable, parse_model, read_matching_model};
use crate::RunError;
use pinc_config::{
    ControlSpec, DisturbanceSpec, EstimatorKind, EstimatorSpec, Experiment, ModelKind,
    NetErrorSpec, OnError, UncertaintySpec, Variables, sha256,
};
use pinc_estimate::{Augmentation, Tuning};
use pinc_export::{
    Controller, ErrorGuard, ErrorResponse, Estimation, ExportError, ExportedTube, Filter,
    FmiVersion, GeneratedFile, ModelSource, Name, Origin, Precision, RungeKuttaModel, net_to_onnx,
};
use pinc_expr::PlantEquations;
use pinc_mpc::{Nmpc, NmpcProblem};
use pinc_ode::{DynPlant, Integrator};
use pinc_record::{RecordError, read_file, write_atomically};
use pinc_tube::normal_quantile;
use std::fs;
use std::path::{Path, PathBuf};

/// The target of an export of a net or a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// C99 without dependencies.
    C,
    /// C for CasADi's `external`.
    Casadi,
    /// A co-simulation FMU.
    Fmu(FmiVersion),
    /// An ONNX file, with numbers of 32 bits.
    Onnx,
    /// An ONNX file, with numbers of 64 bits.
    OnnxDouble,
}

impl Target {
    fn name(self) -> &'static str {
        match self {
            Self::C => "c",
            Self::Casadi => "casadi",
            Self::Fmu(_) => "fmu",
            Self::Onnx | Self::OnnxDouble => "onnx",
        }
    }
}

/// Exports the net of the file `model` into the directory `out`, by default `exports/`, the name
/// and the target. All names begin with `name`, by default the model file's. With the config that the
/// net is `judged` against, C has a function for the estimated error of a step. Returns the directory.
///
/// # Errors
///
/// [`RunError`] if the file holds no net that can be exported, there is no estimate for the target or
/// the plant, or files cannot be written.
pub fn export_net(
    model: &Path,
    to: Target,
    name: Option<&str>,
    out: Option<&Path>,
    judged: Option<&Experiment>,
) -> Result<PathBuf, RunError> {
    let (bytes, net) = match judged {
        Some(experiment) => read_matching_model(experiment, model)?,
        None => {
            let bytes = read_file(model)?;
            let net = chainable(model, parse_model(model, &bytes)?)?;
            (bytes, net)
        }
    };
    let equations = judged.map(|experiment| estimated(experiment, to)).transpose()?;
    let stem = model.file_stem().unwrap_or_default().to_string_lossy();
    let name = name.map_or_else(|| Ok(Name::nearest(&stem)), Name::new)?;
    let proven = certificate(&net).map(|of| of.to_string());
    let origin = Origin { proven, ..Origin::of_net(&net, crate::VERSION, &sha256(&bytes)) };
    let files = match to {
        Target::C => pinc_export::net_to_c(&net, equations.as_ref(), &name, &origin)?,
        Target::Casadi => pinc_export::net_to_casadi(&net, &name, &origin)?,
        Target::Fmu(version) => {
            vec![fmu(pinc_export::net_to_fmu(&net, &name, &origin, version)?, &name, version)?]
        }
        Target::Onnx => vec![net_to_onnx(&net, &name, &origin, Precision::Single)?],
        Target::OnnxDouble => vec![net_to_onnx(&net, &name, &origin, Precision::Double)?],
    };
    write(&files, to, &name, out)
}

/// The equation by which the error of a net is estimated in an export to `to`.
fn estimated(experiment: &Experiment, to: Target) -> Result<PlantEquations, RunError> {
    let refused = |problem: String| RunError::usage(&experiment.name, problem);
    if to != Target::C {
        return Err(refused(format!("`--errors` needs `--to c`, not `--to {}`", to.name())));
    }
    let problem = "`--errors` needs the plant's equation, and [plant] is a black box";
    experiment.plant.equations().ok_or_else(|| refused(problem.to_owned()))
}

/// Exports the whole controller of `experiment`, with the net of the file `model` or `only` one of
/// the config's models in it; `with_errors` says whether C has a function for the estimated error of
/// the net. All names begin with `name`, by default the experiment's. Returns the directory.
///
/// # Errors
///
/// [`RunError`] if the controller has something that cannot be exported, or files cannot be written.
pub fn export_controller(
    experiment: &Experiment,
    model: Option<&Path>,
    only: Option<ModelKind>,
    to: (Target, bool),
    name: Option<&str>,
    out: Option<&Path>,
) -> Result<PathBuf, RunError> {
    export_controller_with(experiment, (model, only), to, (name, out), |_, _, _| Ok(Vec::new()))
}

/// The same, for C with the files that `beside` makes of the controller and its library.
///
/// # Errors
///
/// Those of [`export_controller`] and of `beside`.
pub fn export_controller_with(
    experiment: &Experiment,
    (model, only): (Option<&Path>, Option<ModelKind>),
    (to, with_errors): (Target, bool),
    (name, out): (Option<&str>, Option<&Path>),
    beside: impl FnOnce(&Controller<'_>, &mut Nmpc, &Name) -> Result<Vec<GeneratedFile>, ExportError>,
) -> Result<PathBuf, RunError> {
    if with_errors {
        estimated(experiment, to)?;
    }
    let chosen = Chosen::of(experiment, model.map(ModelFile::At), only, "pinc export")?;
    if !chosen.measured.is_empty() {
        let key = "control.measured_parameters";
        return Err(RunError::with_schedule(&experiment.name, "pinc export", key));
    }
    let estimating = Estimating::of(&chosen)?;
    let name = name.map_or_else(|| Ok(Name::nearest(&experiment.name)), Name::new)?;
    let plant = experiment.plant.dyn_plant();
    let own = chosen.spec.parameters.iter().map(|(name, value)| (name.as_str(), *value));
    let equations = experiment.plant.equations().map(|equations| equations.with_parameters(own));
    let (setup, estimated) = (chosen.setup(), &chosen.estimated);
    if chosen.spec.stages_s.is_some() {
        let problem = "exported controllers have stages of one length: remove \
                       control.stages_s, or use `pinc serve`";
        return Err(RunError::usage(&experiment.name, problem));
    }
    let spec = chosen.spec;
    let (constant, without) =
        ("constant bounds, or `pinc serve`", "a config without it, or `pinc serve`");
    let of_shrink = "the C that `pinc shrink` writes, or `pinc serve`";
    for (feature, instead, is_there) in [
        ("control.policy", of_shrink, chosen.kind == ModelKind::Policy),
        ("control.first_plan", without, spec.first_plan.is_some()),
        ("control.free_time", without, spec.free_time.is_some()),
        ("control.end_state", without, !spec.end_state.is_empty()),
        ("control.periodic", without, !spec.periodic.is_empty()),
        ("control.integer", without, !spec.integer.is_empty()),
        ("control.target", without, spec.target),
        ("control.cost", "q and r alone, or `pinc serve`", spec.cost.is_some()),
        ("control.bound_schedule", constant, !spec.bound_schedule.is_empty()),
        (
            "control.outside_domain = \"refuse\"",
            "\"report\", or `pinc serve`",
            chosen.refuses_outside(),
        ),
    ]
    .into_iter()
    .chain(unexported(spec))
    {
        if is_there {
            return Err(ExportError::Feature { feature, instead }.into());
        }
    }
    let explicit = chosen.kind.integrator().filter(|method| method.tableau().is_some());
    let integrated = |equations, method| RungeKuttaModel {
        equations,
        parameters: if estimated.is_empty() { &[] } else { &chosen.parameter_names },
        method,
        sample_time_s: chosen.sample_time_s,
        substeps: spec.own_substeps(method),
    };
    let source = match (chosen.net(), &equations, explicit) {
        (Some(net), _, None) => ModelSource::Net(net),
        (_, Some(equations), Some(method)) => {
            ModelSource::RungeKutta(integrated(equations, method))
        }
        _ => {
            return Err(RunError::not_exportable(experiment.plant.name(), chosen.kind));
        }
    };
    let tolerance = tolerances(spec, &*chosen.plant);
    let response = match (spec.on_error, &equations) {
        (OnError::Integrator, Some(equations)) => {
            ErrorResponse::Integrator(integrated(equations, spec.substitute()))
        }
        // Without equations there is no estimate either.
        (OnError::Count | OnError::Integrator, _) => ErrorResponse::Count,
        (OnError::Correct, _) => ErrorResponse::Correct,
    };
    let tube = spec.uncertainty.as_ref().map(|of| exported_tube(of, experiment));
    let judged = chosen.net().is_some() && !spec.error_tolerance.is_empty();
    let mut content = experiment.to_toml().into_bytes();
    content.extend(chosen.given.iter().flat_map(|(bytes, _)| bytes));
    let proven = chosen.net().and_then(|net| Some(matching(experiment, net).ok()?.to_string()));
    let origin = Origin { proven, ..origin(&content, &*plant) };
    let controller = Controller {
        problem: &NmpcProblem {
            parameters: estimating.as_ref().map_or_else(Vec::new, |of| of.unknowns.clone()),
            ..setup.problem()
        },
        config: &chosen.spec.sqp,
        model: source,
        equations: equations.as_ref(),
        estimates_error: with_errors,
        guard: judged.then_some(ErrorGuard { tolerance: &tolerance, response }),
        initial_state: &chosen.spec.initial_state,
        initial_input: chosen.spec.initial_input.as_deref(),
        reference: &setup.reference()?.whole(),
        preview: chosen.spec.preview,
        budget_us: chosen.spec.budget_us,
        estimator: estimating.as_ref().map(Estimating::estimation),
        tube: tube.as_ref(),
    };
    let mut library = setup.controller(chosen.kind, &*chosen.plant)?;
    if let Some(u) = controller.initial_input {
        library.reset_input(u)?;
    }
    let files = match to {
        Target::C => {
            let beside = beside(&controller, &mut library, &name)?;
            pinc_export::controller_to_c(&controller, (library, beside), &name, &origin)
                .map_err(|error| RunError::usage(experiment.source(), error.to_string()))?
        }
        Target::Fmu(version) => {
            let content =
                pinc_export::controller_to_fmu((&controller, library), &name, &origin, version)?;
            vec![fmu(content, &name, version)?]
        }
        Target::Casadi | Target::Onnx | Target::OnnxDouble => {
            let problem = format!(
                "`--to {}` takes a net, by --model FILE without a config; a whole controller needs \
                 `--to c` or `--to fmu`",
                to.name()
            );
            return Err(RunError::usage("export", problem));
        }
    };
    write(&files, to, &name, out)
}

/// What generated controllers lack of a tube, what they have instead, and whether it is there.
fn unexported(spec: &ControlSpec) -> [(&'static str, &'static str, bool); 5] {
    let instead = "process_sd and boxes, or `pinc serve`";
    let has = |of: fn(&UncertaintySpec) -> bool| spec.uncertainty.as_ref().is_some_and(of);
    let bounds_outputs = spec.output_low.is_some() || spec.output_high.is_some();
    let in_outputs = spec.estimator.as_ref().is_some_and(in_outputs);
    [
        ("control.uncertainty.parameters", instead, has(|of| !of.parameters.is_empty())),
        ("control.uncertainty.estimate", instead, has(|of| of.estimate)),
        ("control.uncertainty.net_error", instead, has(|of| of.net_error != NetErrorSpec::NONE)),
        (
            "control.uncertainty.tightenings",
            "1 of them, or `pinc serve`",
            has(|of| of.tightenings > 1),
        ),
        (
            // Their derivatives are the last step's there, and depend on what is estimated since.
            "control.uncertainty with bounds on outputs, and estimated parameters or an output disturbance",
            "bounds on states and inputs, or `pinc serve`",
            spec.uncertainty.is_some() && bounds_outputs && in_outputs,
        ),
    ]
}

/// Whether outputs may depend on what is estimated besides the state.
fn in_outputs(of: &EstimatorSpec) -> bool {
    of.disturbance == DisturbanceSpec::Output || !of.parameters.is_empty()
}

fn exported_tube(spec: &UncertaintySpec, experiment: &Experiment) -> ExportedTube {
    let variables = experiment.plant.variables();
    let limit = |name: &str| spec.boxes.get(name).copied().unwrap_or(0.0);
    ExportedTube {
        quantile: spec.chance().map_or(0.0, normal_quantile),
        process_sd: spec.process_sd.clone(),
        boxes: variables.state_names().iter().map(|name| limit(name)).collect(),
        feedback: spec.feedback(),
        tightens_inputs: spec.tighten_inputs,
    }
}

/// The estimator of a controller that is exported.
struct Estimating {
    filter: Filter,
    augmentation: Augmentation,
    tuning: Tuning,
    /// The disturbances and parameters before there is an estimate.
    unknowns: Vec<f64>,
}

impl Estimating {
    /// The estimator of the config, if it has one.
    fn of(chosen: &Chosen<'_>) -> Result<Option<Self>, RunError> {
        let Some(spec) = &chosen.spec.estimator else { return Ok(None) };
        let filter = match spec.kind {
            EstimatorKind::Ekf => Filter::Extended,
            EstimatorKind::Ukf => Filter::Unscented,
            EstimatorKind::Mhe => Filter::MovingHorizon(spec.window.unwrap_or(1)),
            _ => {
                let feature = "estimator of this kind";
                return Err(ExportError::Feature { feature, instead: "ekf, ukf or mhe" }.into());
            }
        };
        let measurement = chosen.spec.measurement.clone().unwrap_or_default();
        let variables = Variables::of(&*chosen.plant);
        // Parameters that are not estimated are constants of the model.
        let (values, estimated): (&[f64], &[usize]) = match chosen.estimated.is_empty() {
            true => (&[], &[]),
            false => (&chosen.parameters, &chosen.estimated),
        };
        let augmentation = spec.augmentation(&measurement, &variables, (values, estimated, &[]));
        let mut unknowns = vec![0.0; augmentation.unknowns(variables.dims())];
        let first = unknowns.len() - estimated.len();
        let initial = estimated.iter().map(|&place| values[place]);
        unknowns[first..].iter_mut().zip(initial).for_each(|(to, value)| *to = value);
        Ok(Some(Self { filter, augmentation, tuning: spec.tuning(chosen.spec), unknowns }))
    }

    fn estimation(&self) -> Estimation<'_> {
        let Self { filter, augmentation, tuning, .. } = self;
        Estimation { filter: *filter, augmentation, tuning }
    }
}

/// Exports the plant of `experiment`, the one in its closed loop, as an FMU on which a controller
/// can be tried. All names begin with `name`, by default the experiment's. Returns the directory.
///
/// # Errors
///
/// [`RunError`] if the plant's equations are not known, or files cannot be written.
pub fn export_plant(
    experiment: &Experiment,
    to: Target,
    name: Option<&str>,
    out: Option<&Path>,
) -> Result<PathBuf, RunError> {
    let command = "pinc export --plant";
    let missing = |section| RunError::missing_section(experiment, section, command);
    let control = experiment.control.as_ref().ok_or_else(|| missing("control"))?;
    let sample_time_s = experiment.sample_time_s().ok_or_else(|| missing("model"))?;
    let spec = control.plant.as_ref().unwrap_or(&experiment.plant);
    let Target::Fmu(version) = to else {
        let problem = format!("`--to {}` takes no plant; `--plant` needs `--to fmu`", to.name());
        return Err(RunError::usage("export", problem));
    };
    for (key, is_there) in [
        ("control.delay_steps", control.delay_steps > 0),
        ("control.loads", !control.loads.is_empty()),
        ("control.plant_schedule", !control.plant_schedule.is_empty()),
    ] {
        if is_there {
            let problem = format!("the FMU of a plant has no {key}; use a config without it");
            return Err(RunError::usage(&experiment.name, problem));
        }
    }
    let unknown = || RunError::not_exportable(spec.name(), ModelKind::RK4);
    let equations = spec.equations().ok_or_else(unknown)?;
    let name = name.map_or_else(|| Ok(Name::nearest(&experiment.name)), Name::new)?;
    let origin = origin(experiment.to_toml().as_bytes(), &*spec.dyn_plant());
    let plant = RungeKuttaModel {
        equations: &equations,
        parameters: &[],
        method: Integrator::Rk4,
        sample_time_s,
        substeps: control.rk4_substeps,
    };
    let at_rest = vec![0.0; origin.inputs.len()];
    let input = control.initial_input.as_ref().unwrap_or(&at_rest);
    let start = [&control.initial_state[..], input];
    if !plant.is_integrable(start)? {
        tracing::warn!(
            "the plant is too stiff for the FMU's co-simulation, which will refuse steps"
        );
    }
    let content = pinc_export::plant_to_fmu(plant, start, &name, &origin, version)?;
    write(&[fmu(content, &name, version)?], to, &name, out)
}

/// Where the export of something with this content, and the variables of `plant`, comes from.
fn origin(content: &[u8], plant: &dyn DynPlant) -> Origin {
    let variables = Variables::of(plant);
    Origin {
        version: crate::VERSION.to_owned(),
        hash: sha256(content),
        states: variables.states,
        inputs: variables.inputs,
        outputs: variables.outputs,
        proven: None,
    }
}

/// The FMU of this content, with binaries for this machine and others that it has compilers for.
fn fmu(
    mut content: Vec<GeneratedFile>,
    name: &Name,
    version: FmiVersion,
) -> Result<GeneratedFile, RunError> {
    content.extend(shared_libraries(&content, name, version)?);
    let bytes = pinc_export::archive(&content)?;
    Ok(GeneratedFile { path: format!("{}.fmu", name.as_str()), bytes })
}

fn write(
    files: &[GeneratedFile],
    to: Target,
    name: &Name,
    out: Option<&Path>,
) -> Result<PathBuf, RunError> {
    let default = || Path::new("exports").join(format!("{}-{}", name.as_str(), to.name()));
    let dir = out.map_or_else(default, Path::to_owned);
    // Where an earlier export of the name is, its files are replaced; a user's own are not.
    let is_own = |file: &&GeneratedFile| {
        let rest = file.path.strip_prefix(name.as_str());
        rest.is_some_and(|rest| rest.starts_with(['_', '.']))
    };
    if !files.iter().filter(is_own).any(|file| dir.join(&file.path).exists())
        && let Some(other) =
            files.iter().map(|file| dir.join(&file.path)).find(|path| path.exists())
    {
        let problem = format!(
            "the export would replace this file, which is not of an earlier export of {}; choose \
             another directory with --out",
            name.as_str()
        );
        return Err(RunError::usage(other.display(), problem));
    }
    for file in files {
        let path = dir.join(&file.path);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(RecordError::unwritable(parent))?;
        }
        write_atomically(&path, &file.bytes)?;
    }
    Ok(dir)
}
