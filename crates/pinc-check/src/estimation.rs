//! The estimator: whether what is measured tells what is estimated, and whether control with it is
//! free of offset.

use crate::soundness::modes_at;
use crate::{Finding, Operating, Rehearsal, Subject, gate};
use pinc_analysis::{OperatingPoint, UnseenMode, unseen_along, unseen_modes};
use pinc_config::{ControlSpec, DisturbanceSpec, EstimatorSpec, LoopParameters, Variables};
use pinc_estimate::Augmented;
use pinc_ode::{Integrator, LinearizationBuffer, Model, OutputLinearizationBuffer, Stages};

/// The section that findings are about.
const SECTION: &str = "control.estimator";
/// Steps of the closed loop along which measurements are looked at.
const MARKS: usize = 100;
/// Variables that take part in a mode by less than this are not named.
const PART: f64 = 0.01;

/// The estimator of the loop, and what it is for.
#[derive(Clone, Copy)]
pub(crate) struct Estimating<'a> {
    pub(crate) subject: &'a Subject<'a>,
    pub(crate) control: &'a ControlSpec,
    pub(crate) estimator: &'a EstimatorSpec,
}

impl Estimating<'_> {
    /// The estimator's model with this integrator; `None` if there is none.
    pub(crate) fn model(self, integrator: Integrator, substeps: usize) -> Option<Augmented> {
        let Self { subject, control, estimator } = self;
        let variables = Variables::of(subject.plant);
        let measurement = control.measurement.clone().unwrap_or_default();
        let LoopParameters { names, values, estimated, known } =
            subject.experiment.loop_parameters();
        let plant = subject.experiment.plant.family(&names);
        let model = plant.model(integrator, subject.step_s(), substeps).ok()?;
        let parameters = (&values[..], &estimated[..], &known[..]);
        let augmentation = estimator.augmentation(&measurement, &variables, parameters);
        Augmented::new(model, augmentation).ok()
    }
}

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else { return Vec::new() };
    let Some(estimator) = &control.estimator else { return Vec::new() };
    let estimating = Estimating { subject, control, estimator };
    let variables = Variables::of(subject.plant);
    let measurement = control.measurement.clone().unwrap_or_default();
    let measured = measurement.names(&variables);
    let names = estimator.names(&measurement, &variables);
    let what = format!(
        "{}: {} estimated from {}",
        estimator.kind.title(),
        names.join(", "),
        measured.join(", ")
    );
    let mut findings = vec![Finding::fact(SECTION, what)];
    findings.extend(offset(control, estimator, (&variables, &names), &measured));
    if let Some(Ok(rehearsal)) = &subject.evidence.rehearsal {
        let marks = marks(rehearsal, subject.step_s());
        findings.extend(gate::examine(estimating, (rehearsal, &marks)));
    }
    let points = subject.operating_points();
    // A plant that moves on while its references are kept is looked at along its way.
    if !points.is_empty() && points.iter().all(|operating| !operating.is_steady) {
        findings.extend(along_the_loop(estimating, &names));
        return findings;
    }
    for Operating { name: place, point, is_steady } in points {
        if !is_steady {
            continue;
        }
        let found = at_rest(estimating, &names, point);
        let here = found.into_iter().map(|finding| Finding { place: place.clone(), ..finding });
        let here: Vec<_> = here.collect();
        // One point is enough: the others would repeat it.
        if !here.is_empty() {
            findings.extend(here);
            break;
        }
    }
    findings
}

/// The conditions for control without offset that need no point.
fn offset(
    control: &ControlSpec,
    estimator: &EstimatorSpec,
    (variables, names): (&Variables, &[String]),
    measured: &[String],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let states = estimator.process_sd.len();
    let unknowns = names.len() - states;
    let place = format!("{SECTION}.disturbance");
    if unknowns < measured.len() {
        let what = format!(
            "{unknowns} disturbances and parameters are estimated, and {} quantities measured",
            measured.len()
        );
        let finding = Finding::warning(&place, what)
            .because(
                "an offset from the references stays where plant and model differ: there has to \
                 be one disturbance per measured quantity",
            )
            .change(
                "disturbance = \"input\", \"output\" or { states = [..] }, as many as measured",
            );
        findings.push(finding);
    }
    let unseen: Vec<&str> = control
        .controlled
        .iter()
        .filter(|name| !measured.contains(name) && !variables.input_names().contains(name))
        .map(String::as_str)
        .collect();
    if !unseen.is_empty() && unknowns > 0 {
        let what = format!("{} is controlled, but not measured", unseen.join(", "));
        let finding = Finding::warning("control.measurement.measured", what)
            .because(
                "only measured quantities are brought to their references without offset where \
                 plant and model differ",
            )
            .change("measure it, or control what is measured");
        findings.push(finding);
    }
    if estimator.disturbance == DisturbanceSpec::Output {
        findings.extend(bounded_unseen(control, variables, measured));
    }
    findings
}

/// Outputs with bounds that no estimated disturbance is added to.
fn bounded_unseen(
    control: &ControlSpec,
    variables: &Variables,
    measured: &[String],
) -> Option<Finding> {
    let sides = [&control.output_low, &control.output_high];
    let is_bounded =
        |i: usize| sides.iter().any(|side| side.as_ref().is_some_and(|side| side[i].is_finite()));
    let names = variables.own_output_names().into_iter().enumerate();
    let unseen: Vec<_> = names
        .filter(|(i, name)| is_bounded(*i) && !measured.contains(name))
        .map(|(_, name)| name)
        .collect();
    if unseen.is_empty() {
        return None;
    }
    let what = format!("{} has bounds, but is not measured", unseen.join(", "));
    let finding = Finding::warning("control.measurement.measured", what)
        .because("output disturbances correct measured quantities alone: the plant may break them")
        .change("measure it, or take another disturbance");
    Some(finding)
}

/// The conditions at a steady state.
fn at_rest(of: Estimating<'_>, names: &[String], point: &OperatingPoint) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let Some(mode) = unseen(of, point).into_iter().next() {
        findings.push(undetectable(&mode, names));
    }
    let modes = modes_at(of.subject.plant, &of.subject.region, point);
    let unstable = modes.is_some_and(|modes| modes.iter().any(|value| value.re > 0.0));
    if unstable && of.estimator.disturbance == DisturbanceSpec::Output {
        let what = "output disturbances with an unstable steady state";
        findings.push(
            Finding::warning(SECTION, what)
                .because(
                    "an estimator that takes every error for one of the sensors may diverge \
                     together with the plant",
                )
                .change("disturbance = \"input\" or { states = [..] }"),
        );
    }
    findings
}

/// What cannot be told apart along the rehearsed loop.
fn along_the_loop(of: Estimating<'_>, names: &[String]) -> Vec<Finding> {
    let Some(Ok(rehearsal)) = &of.subject.evidence.rehearsal else { return Vec::new() };
    let marks = marks(rehearsal, of.subject.step_s());
    let at = |&i: &usize| linearized(of, &rehearsal.point(i));
    let steps: Vec<(Vec<f64>, Vec<f64>)> = marks.iter().map_while(at).collect();
    let Some(unseen) = unseen_along(&steps, names.len()) else {
        let what = format!(
            "what is measured tells all of them that do not decay, along {} steps of the closed loop",
            steps.len()
        );
        return vec![Finding::fact(SECTION, what)];
    };
    vec![Finding { place: "along the closed loop".to_owned(), ..undetectable(&unseen, names) }]
}

/// The places of the first samples of steps in the trace of a rehearsal.
pub(crate) fn marks(rehearsal: &Rehearsal, step_s: f64) -> Vec<usize> {
    let mut marks: Vec<usize> = Vec::new();
    for (i, t) in rehearsal.trace.times().iter().enumerate() {
        let due = marks.len() as f64 * step_s;
        if *t >= due - 1e-6 * step_s && marks.len() < MARKS {
            marks.push(i);
        }
    }
    marks
}

/// The modes of the estimator's model that it cannot see, at a steady state.
fn unseen(of: Estimating<'_>, point: &OperatingPoint) -> Vec<UnseenMode> {
    let Some((a, c)) = linearized(of, point) else { return Vec::new() };
    let states = a.len().isqrt();
    unseen_modes(&a, &c, states)
}

/// A and C of the estimator's model at a point, in sizes that the tuning says; `None` if there is no
/// such model.
fn linearized(of: Estimating<'_>, point: &OperatingPoint) -> Option<(Vec<f64>, Vec<f64>)> {
    // An unstable step of RK4 would hide what the plant shows.
    let substeps = of.control.rk4_substeps;
    let model = of.model(Integrator::Rosenbrock, substeps);
    let mut model = model.or_else(|| of.model(Integrator::Rk4, substeps))?;
    let tuning = of.estimator.tuning(of.control);
    let unknowns = &tuning.initial_estimate[point.x.len()..];
    let z = [&point.x[..], unknowns].concat();
    let nx = model.dims().nx;
    let mut at = LinearizationBuffer::new(model.dims(), 1);
    let known = model.known_values();
    let here = Stages { x: &z, u: &point.u, p: &known };
    model.linearize(here, at.as_mut());
    let mut outputs = OutputLinearizationBuffer::new(model.dims(), 1);
    model.linearize_output(here, outputs.as_mut());
    // In sizes that the tuning says: of the states, of the disturbances, of the noise.
    let size = |sd: f64| if sd > 0.0 { sd } else { 1.0 };
    let sizes: Vec<f64> = tuning.initial_sd.iter().map(|sd| size(*sd)).collect();
    for (i, entry) in at.a.iter_mut().enumerate() {
        *entry *= sizes[i % nx] / sizes[i / nx];
    }
    for (i, entry) in outputs.c.iter_mut().enumerate() {
        *entry *= sizes[i % nx] / tuning.measurement_sd[i / nx];
    }
    Some((at.a, outputs.c))
}

fn undetectable(mode: &UnseenMode, names: &[String]) -> Finding {
    let part = names.iter().zip(&mode.direction).filter(|(_, part)| **part > PART);
    let part: Vec<&str> = part.map(|(name, _)| name.as_str()).collect();
    let what = format!(
        "what is measured does not tell {} apart: rank {} of {}",
        part.join(", "),
        mode.rank,
        names.len()
    );
    let is_constant = (mode.eigenvalue.re - 1.0).abs() < 1e-3 && mode.eigenvalue.im.abs() < 1e-3;
    let why = if is_constant {
        "constant values of these have the same measurements: the estimates wind up along them \
         where the plant differs from the model in another way than is assumed"
    } else {
        "these move, without decaying, in a way that no measurement shows: their estimates diverge"
    };
    Finding::warning(SECTION, what)
        .because(why)
        .change("measure something else or more, or let the disturbance enter elsewhere")
}
