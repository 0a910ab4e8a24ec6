//! The plant's own modes at its steady states, against the step T, the horizon and the integrators.

use crate::soundness::modes_at;
use crate::{Finding, Held, LISTED, Operating, Subject, short};
use pinc_analysis::{
    Complex, Growth, OperatingPoint, StabilityFunction, StateSpace, TimeScales, beyond_knee,
};
use pinc_config::{ControlSpec, ModelKind};
use pinc_mpc::QpMethod;
use pinc_net::{Ansatz, TrainingTarget};
use pinc_ode::Integrator;

/// |lambda| T from which a plant is stiff for explicit methods, and how far its modes are apart
/// then.
const STIFF: f64 = 10.0;

/// T from which a controller acts too late, in doubling times of an unstable plant: a deviation
/// is four times as large when it can be answered.
const MOST_DOUBLINGS: f64 = 2.0;

/// Points between two references, and points of the closed loop, at which integrators are examined.
const BETWEEN: u32 = 8;
const POINTS: usize = 200;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let points = subject.operating_points();
    let (mut found, mut doublings) = (Vec::new(), Vec::new());
    if subject.centre.is_none() && !points.iter().any(|operating| operating.is_steady) {
        let what = format!("no steady state was found in {} or near it", subject.region_name);
        findings.push(Finding::fact("", what));
    }
    for Operating { name, point, is_steady } in points {
        let place = format!("{name}, {}", subject.at(point));
        let Some(modes) = modes_at(subject.plant, &subject.region, point) else {
            findings.push(
                Finding::warning(place, "the derivatives are not finite there")
                    .because(
                        "neither stability nor gain can be told, and a controller cannot \
                     stay there",
                    )
                    .change(
                        "guard the argument of sqrt, log and of a division, or move the \
                     reference",
                    ),
            );
            continue;
        };
        findings.push(Finding::fact(place.clone(), format!("modes {}", describe(subject, &modes))));
        findings.extend(unreached(subject, &place, point));
        if is_steady {
            findings.extend(continuum(subject, &place, point));
        }
        if subject.experiment.sample_time_s().is_some() {
            let scales = match beyond_knee(subject.plant, point, &subject.region) {
                Some((i, beside)) => {
                    findings.push(knee(subject, &place, i, &beside));
                    let beyond = modes_at(subject.plant, &subject.region, &beside);
                    TimeScales::of(beyond.as_deref().unwrap_or(&modes))
                }
                None => TimeScales::of(&modes),
            };
            findings.extend(sample_time(subject, &place, &scales));
            doublings.extend(scales.doubling_s);
        }
        found.push((place, modes));
    }
    if subject.experiment.sample_time_s().is_some() {
        findings.extend(growth(subject, &doublings));
        findings.extend(stiff(subject, &found));
        findings.extend(distill(subject, &found));
    }
    if let (Some(control), Some(_)) =
        (&subject.experiment.control, subject.experiment.sample_time_s())
    {
        for integrator in control.models.iter().filter_map(|kind| kind.integrator()) {
            if let Some(stability) = StabilityFunction::of(integrator) {
                let key = format!("control.{}", ControlSpec::substeps_key(integrator));
                let substeps = control.own_substeps(integrator);
                findings.extend(stable_substeps(subject, &stability, &key, substeps));
            }
        }
    }
    findings
}

/// Growing modes that no input acts on.
fn unreached(subject: &Subject<'_>, place: &str, point: &OperatingPoint) -> Option<Finding> {
    // A point that no reference asks for, as a reactor without cells, may be left alone.
    subject.holds.first()?;
    let tangent = StateSpace::tangent(subject.plant, point, &[])?;
    let modes = tangent.scaled(&subject.region.widths()).unreached_growth();
    (!modes.is_empty()).then(|| {
        let what = format!("no input acts on the growing modes {}", describe(subject, &modes));
        Finding::warning(place, what)
            .because("no controller can stop a deviation there from growing")
            .change(
                "an input that acts on it, or a plant without these states if they do not matter",
            )
    })
}

/// The states that can be at rest at any value near a steady state, with the same input.
fn continuum(subject: &Subject<'_>, place: &str, point: &OperatingPoint) -> Option<Finding> {
    let tangent = StateSpace::tangent(subject.plant, point, &[])?;
    let free = tangent.scaled(&subject.region.widths()).free_states();
    let names: Vec<_> = free.iter().map(|&i| subject.state_name(i)).collect();
    let named = match &names[..] {
        [] => return None,
        [first, .., last] if names.len() > LISTED => format!("{first} to {last}"),
        names => names.join(", "),
    };
    let what = format!(
        "steady states are a continuum: with this input {named} can be at rest at other values too"
    );
    Some(Finding::fact(place, what))
}

fn describe(subject: &Subject<'_>, modes: &[Complex]) -> String {
    let unit = subject.rate_unit();
    let one = |mode: &Complex| {
        let meaning = match Growth::of(*mode) {
            Growth::Neutral => "neither grows nor decays".to_owned(),
            Growth::Decays { time_constant_s } => {
                format!("time constant {}", subject.time(time_constant_s))
            }
            Growth::Grows { doubling_s } => format!("doubles in {}", subject.time(doubling_s)),
        };
        format!("{} {unit} ({meaning})", subject.complex_rate(mode.re, mode.im))
    };
    if modes.len() <= LISTED {
        return modes.iter().map(one).collect::<Vec<_>>().join("; ");
    }
    let mut sorted: Vec<&Complex> = modes.iter().collect();
    sorted.sort_by(|a, b| b.abs().total_cmp(&a.abs()));
    let growing = modes.iter().filter(|m| matches!(Growth::of(**m), Growth::Grows { .. }));
    let neutral = modes.iter().filter(|m| Growth::of(**m) == Growth::Neutral);
    let mut text = format!(
        "{}: {} grow, {} neither grow nor decay; the fastest {}, the slowest {}",
        modes.len(),
        growing.clone().count(),
        neutral.count(),
        one(sorted[0]),
        one(sorted[sorted.len() - 1])
    );
    if let Some(worst) = growing.max_by(|a, b| a.re.total_cmp(&b.re)) {
        text = format!("{text}, the one that grows fastest {}", one(worst));
    }
    text
}

/// The advice to distil where a net is to learn from the residual of a stiff equation.
fn distill(subject: &Subject<'_>, found: &[(String, Vec<Complex>)]) -> Option<Finding> {
    let training = subject.experiment.training.as_ref()?;
    let is_hard = subject.experiment.model.as_ref()?.ansatz == Ansatz::HardLinear;
    let has_choice = is_hard && subject.experiment.data.is_none();
    if training.config.source != TrainingTarget::Physics || !has_choice {
        return None;
    }
    let step = subject.step_s();
    let fastest = found.iter().map(|(_, modes)| TimeScales::of(modes));
    let fastest = fastest.filter(|scales| is_stiff(scales, step));
    let fastest = fastest.map(|scales| scales.fastest * step).max_by(f64::total_cmp)?;
    let what = format!(
        "a net is trained on the residual of a stiff equation: its fastest mode times T is {}",
        short(fastest)
    );
    Some(
        Finding::warning("training.source", what)
            .because(
                "the residual weighs the fast part most, which is over at once: the training is \
                 slow, needs many more points, and may end with a useless net",
            )
            .change(
                "source = \"integrator\" (distillation: the net learns the states after T from an \
                 integrator)",
            ),
    )
}

/// Whether modes are far apart and fast against T.
fn is_stiff(scales: &TimeScales, step: f64) -> bool {
    let slowest = scales.slowest.unwrap_or(scales.fastest);
    scales.fastest * step > STIFF && scales.fastest > STIFF * slowest
}

/// Whether the modes at some point are far apart and fast against T: of all points that where it is
/// worst, and only a fact where RK4 has the substeps that it needs.
fn stiff(subject: &Subject<'_>, found: &[(String, Vec<Complex>)]) -> Option<Finding> {
    let step = subject.step_s();
    let all = found.iter().map(|(place, modes)| (place, modes, TimeScales::of(modes)));
    let stiff = all.filter(|(.., scales)| is_stiff(scales, step));
    let (place, modes, scales) = stiff.max_by(|a, b| a.2.fastest.total_cmp(&b.2.fastest))?;
    let what = format!(
        "stiff: the fastest mode times T is {}, and it is {} times as fast as the slowest",
        short(scales.fastest * step),
        short(scales.fastest / scales.slowest?)
    );
    let control = subject.experiment.control.as_ref();
    let has_enough = |control: &ControlSpec| {
        let rk4 = StabilityFunction::of(Integrator::Rk4);
        let needed = rk4.and_then(|rk4| rk4.stable_substeps(modes, step));
        control.models.contains(&ModelKind::RK4)
            && needed.is_some_and(|n| n <= control.rk4_substeps)
    };
    if control.is_some_and(has_enough) {
        return Some(Finding::fact(place, what));
    }
    Some(
        Finding::warning(place, what)
            .because(
                "explicit RK4 needs many substeps to stay stable, and in a net the fast part \
             is a thin layer at t = 0",
            )
            .change(
                "give RK4 the substeps that are named below, shorten T, or leave the fast \
             state out by its steady state",
            ),
    )
}

/// What is around a point whose linearization holds for that point alone.
fn knee(subject: &Subject<'_>, place: &str, i: usize, beside: &OperatingPoint) -> Finding {
    let name = &subject.plant.states()[i].name;
    let modes = modes_at(subject.plant, &subject.region, beside);
    let modes = modes.map_or_else(String::new, |modes| describe(subject, &modes));
    let at = short(beside.x[i]);
    Finding::fact(
        place,
        format!("a knee in {name}: beyond it, at {name} = {at}, the modes are {modes}"),
    )
}

/// T against what a controller has to react to: growth, or else the slowest motion.
fn sample_time(subject: &Subject<'_>, place: &str, scales: &TimeScales) -> Option<Finding> {
    let step = subject.step_s();
    if let Some(doubling) = scales.doubling_s {
        let what = format!(
            "T = {} is {} times the {} in which a deviation doubles",
            subject.time(step),
            short(step / doubling),
            subject.time(doubling)
        );
        return (step > MOST_DOUBLINGS * doubling).then(|| {
            Finding::warning(place, what)
                .because(
                    "an unstable plant runs away between two inputs: the controller acts too late",
                )
                .change(format!(
                    "a T of {} or less (model.horizon_s or control.step_s)",
                    subject.time(doubling / 5.0)
                ))
        });
    }
    let slowest = scales.slowest?;
    let what = format!(
        "T = {} is {} times the slowest time constant",
        subject.time(step),
        short(slowest * step)
    );
    // What integrates does not settle, however fast the rest is.
    (slowest * step > 3.0 && !scales.is_neutral).then(|| {
        Finding::warning(place, what)
            .because(
                "the plant has settled at the end of a step: the controller sees steady \
             states and cannot shape the way there",
            )
            .change(format!(
                "a T of {} or less (model.horizon_s or control.step_s)",
                subject.time(1.0 / slowest)
            ))
    })
}

/// Warns of a plant whose deviations grow so much over the horizon that condensed programs are inaccurate.
/// `doublings` are the times in s in which a deviation doubles at the places that are examined.
fn growth(subject: &Subject<'_>, doublings: &[f64]) -> Option<Finding> {
    let doubling = doublings.iter().copied().min_by(f64::total_cmp)?;
    let horizon = subject.experiment.control.as_ref()?.horizon_s(subject.step_s());
    let growth = (horizon / doubling).exp2();
    (growth > QpMethod::MOST_GROWTH).then(|| {
        let what = format!(
            "a deviation grows by a factor of {} over the horizon of {}",
            short(growth),
            subject.time(horizon)
        );
        Finding::warning("control.n2", what)
            .because(
                "condensed programs are inaccurate then, so exported C and sqp.qp = \"condensed\" may \
                 fail",
            )
            .change("a shorter horizon, or sqp.qp = \"auto\", which solves such programs stage by stage")
    })
}

/// The substeps with which an explicit method is stable at the references, between them, and along
/// the closed loop.
fn stable_substeps(
    subject: &Subject<'_>,
    stability: &StabilityFunction,
    key: &str,
    substeps: usize,
) -> Vec<Finding> {
    let step = subject.step_s();
    let needed = |point: &OperatingPoint| {
        let modes = modes_at(subject.plant, &subject.region, point)?;
        Some(stability.stable_substeps(&modes, step).unwrap_or(usize::MAX))
    };
    let mut findings = Vec::new();
    // Among equal places the last is named: a reference rather than a time.
    let mut along = along_the_loop(subject);
    along.extend(along_references(subject));
    let worst = along.iter().filter_map(|(name, point)| Some((needed(point)?, name, point)));
    if let Some((n, name, point)) = worst.max_by_key(|(n, ..)| *n)
        && n > substeps
    {
        let modes = modes_at(subject.plant, &subject.region, point);
        let fastest = modes.map_or(0.0, |modes| TimeScales::of(&modes).fastest);
        let size = fastest * step / substeps as f64;
        let what = format!(
            "{substeps} substeps are unstable at {name}, {}: the fastest mode times a substep is \
             {}, and \
             stable is up to {} on the real axis",
            subject.state(&point.x),
            short(size),
            short(stability.real_limit())
        );
        findings.push(
            Finding::warning(key, what)
                .because(
                    "errors of the model grow from substep to substep where the plant's \
                 decay: the controller's predictions are wrong and its steps fail",
                )
                .change(if n == usize::MAX {
                    "a shorter T, or the model rosenbrock".to_owned()
                } else {
                    format!(
                        "{key} = {n} or more, or the model rosenbrock",
                        key = key.trim_start_matches("control.")
                    )
                }),
        );
    }
    findings
}

/// Where the closed loop with an integrator goes, as far as that is in the region: with too few
/// substeps it can go anywhere.
fn along_the_loop(subject: &Subject<'_>) -> Vec<(String, OperatingPoint)> {
    let Some(Ok(rehearsal)) = &subject.evidence.rehearsal else { return Vec::new() };
    let trace = &rehearsal.trace;
    let every = trace.len().div_ceil(POINTS);
    let point = |i: usize| {
        let name = format!("t = {} of the closed loop", subject.time(trace.times()[i]));
        (name, rehearsal.point(i))
    };
    let points = (0..trace.len()).step_by(every.max(1)).map(point);
    points.filter(|(_, point)| subject.region.contains(point)).collect()
}

/// The steady states of the references and the ways from one to the next.
fn along_references(subject: &Subject<'_>) -> Vec<(String, OperatingPoint)> {
    let mut points: Vec<(String, OperatingPoint)> = Vec::new();
    for Held { first: k, point, .. } in &subject.holds {
        let Some(point) = point.steady() else { continue };
        if let Some((_, last)) = points.last().cloned() {
            let (from, to) = (last.joined(), point.joined());
            for part in 1..BETWEEN {
                let share = f64::from(part) / f64::from(BETWEEN);
                let way = from.iter().zip(&to).map(|(a, b)| a + share * (b - a)).collect();
                let name = format!("a point on the way to control.references[{k}]");
                points.push((name, subject.region.split(way)));
            }
        }
        points.push((format!("control.references[{k}]"), point.clone()));
    }
    points
}
