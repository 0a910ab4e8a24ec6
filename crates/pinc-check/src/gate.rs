//! The estimator's innovation gate: how wide it is in the units of what is measured, and whether it
//! rejects readings of the rehearsed loop.

use crate::estimation::Estimating;
use crate::numbers::with_unit;
use crate::{Finding, LISTED, Rehearsal, Subject};
use pinc_config::{ControlSpec, Variables};
use pinc_estimate::{Augmented, Ekf, Estimator, Gate, Measured, Tuning};
use pinc_ode::{Dims, Integrator, Model, OutputLinearizationBuffer, Stages};

/// The key that findings are about.
const KEY: &str = "control.estimator.gate";
/// Noise beyond so many standard deviations is rare.
const NOISE_SD: f64 = 3.0;

/// What is measured, with its unit and noise, and what the gate makes of it.
struct Sensor {
    name: String,
    unit: String,
    noise_sd: f64,
    /// How far a reading may be from what is expected, in the first step and in the last.
    width: [f64; 2],
    rejected: Vec<Rejected>,
}

/// A reading that is rejected.
struct Rejected {
    step: usize,
    /// How far it is from what is expected.
    off: f64,
    /// How far it may be.
    width: f64,
}

/// Examines the gate along the steps of the rehearsed loop, of which `marks` are the first samples.
/// The filter is the extended one for all kinds: the gate of moving horizon estimation uses its
/// covariance, and the unscented filter's covariance differs by curvature only.
pub(crate) fn examine(
    of: Estimating<'_>,
    (rehearsal, marks): (&Rehearsal, &[usize]),
) -> Vec<Finding> {
    let Gate::Sd(sd) = of.estimator.tuning(of.control).gate else {
        return vec![Finding::fact(KEY, "no reading is rejected, however wild")];
    };
    let Some(sensors) = judged(of, sd, (rehearsal, marks)) else {
        return Vec::new();
    };
    let mut findings = vec![widths(&sensors)];
    findings
        .extend(sensors.iter().filter_map(|sensor| rejections(of.subject, sensor, marks.len())));
    findings.extend(sensors.iter().filter_map(noise));
    findings
}

/// The sensors after the filter has been told the plant's own readings; `None` if it cannot be.
fn judged(
    of: Estimating<'_>,
    sd: f64,
    (rehearsal, marks): (&Rehearsal, &[usize]),
) -> Option<Vec<Sensor>> {
    let Estimating { subject, control, estimator } = of;
    let variables = Variables::of(subject.plant);
    let integrator = rehearsal.model.integrator().unwrap_or(Integrator::Rk4);
    let substeps = control.own_substeps(integrator);
    let mut model = of.model(integrator, substeps)?;
    let tuning = Tuning { parameters: model.known_values(), ..estimator.tuning(control) };
    let unknowns = tuning.initial_estimate[variables.states.len()..].to_vec();
    let mut sensors = sensors(control, &variables);
    let of_filter = Box::new(of.model(integrator, substeps)?);
    let mut filter = Ekf::new(of_filter, tuning.clone()).ok()?;
    let Dims { nx, nu, ny, .. } = model.dims();
    // A step linearizes the model, and about four derivatives cost as much as the value.
    let units = (integrator.stages() * substeps * (1 + nx / 4)) as u64 * subject.units;
    let mut y = vec![0.0; ny];
    let mut u = of.control.initial_input.clone().unwrap_or_else(|| vec![0.0; nu]);
    filter.reset_input(&u);
    for (step, &mark) in marks.iter().enumerate() {
        let z = [rehearsal.trace.state(mark), &unknowns].concat();
        model.output(&z, &u, &tuning.parameters, &mut y);
        let expected = expectation(&mut model, &filter, &u, &tuning);
        let correction = filter.correct(&y);
        for (i, (sensor, (expected, sd_of))) in sensors.iter_mut().zip(expected).enumerate() {
            let width = sd * sd_of;
            sensor.width[1] = width;
            if step == 0 {
                sensor.width[0] = width;
            }
            if correction.rejected > 0 && filter.innovation()[i].is_nan() {
                sensor.rejected.push(Rejected { step, off: (y[i] - expected).abs(), width });
            }
        }
        // A sample has the input that led to it.
        let next = (mark + 1).min(rehearsal.trace.times().len() - 1);
        u.copy_from_slice(rehearsal.trace.input(next));
        filter.predict(&u);
        if !subject.evidence.work.spend(units) {
            return None;
        }
    }
    let are_known = sensors.iter().all(|sensor| sensor.width.iter().all(|width| width.is_finite()));
    (are_known && !marks.is_empty()).then_some(sensors)
}

fn sensors(control: &ControlSpec, variables: &Variables) -> Vec<Sensor> {
    let measurement = control.measurement.clone().unwrap_or_default();
    let names = measurement.names(variables);
    let outputs = variables.own_outputs();
    let quantities = measurement.quantities(variables);
    let of = |(i, (name, quantity)): (usize, (String, Measured))| Sensor {
        unit: match quantity {
            Measured::State(state) => variables.states[state].unit.to_string(),
            Measured::Output(place) => outputs
                .iter()
                .find(|(own, _)| *own == place)
                .map(|(_, variable)| variable.unit.to_string())
                .unwrap_or_default(),
            _ => String::new(),
        },
        noise_sd: measurement.noise_sd.as_ref().map_or(0.0, |sd| sd[i]),
        name,
        width: [f64::NAN; 2],
        rejected: Vec::new(),
    };
    names.into_iter().zip(quantities).enumerate().map(of).collect()
}

/// What is expected of each measurement, with the standard deviation of its innovation.
fn expectation(model: &mut Augmented, filter: &Ekf, u: &[f64], tuning: &Tuning) -> Vec<(f64, f64)> {
    let mut outputs = OutputLinearizationBuffer::new(model.dims(), 1);
    let at = Stages { x: filter.estimate(), u, p: &tuning.parameters };
    model.linearize_output(at, outputs.as_mut());
    let (nx, OutputLinearizationBuffer { y, c, .. }) = (model.dims().nx, outputs);
    let sd = |(row, noise_sd): (&[f64], &f64)| {
        let columns = filter.covariance().chunks_exact(nx).zip(row);
        let entry = |(p, c): (&[f64], &f64)| c * p.iter().zip(row).map(|(p, c)| p * c).sum::<f64>();
        (columns.map(entry).sum::<f64>() + noise_sd * noise_sd).sqrt()
    };
    y.into_iter().zip(c.chunks_exact(nx).zip(&tuning.measurement_sd).map(sd)).collect()
}

fn widths(sensors: &[Sensor]) -> Finding {
    let list = |place: usize| {
        let of = |sensor: &Sensor| {
            format!("{} by {}", sensor.name, with_unit(sensor.width[place], &sensor.unit))
        };
        let mut all: Vec<String> = sensors.iter().take(LISTED).map(of).collect();
        if sensors.len() > LISTED {
            all.push(format!("and so on for {} more", sensors.len() - LISTED));
        }
        all.join(", ")
    };
    let what = format!(
        "a reading that is further than this from what is expected is rejected: {} in the first step \
         of the rehearsed loop, {} in its last",
        list(0),
        list(1)
    );
    Finding::fact(KEY, what)
}

/// Readings of the rehearsed loop, which has no noise, that are rejected.
fn rejections(subject: &Subject<'_>, sensor: &Sensor, steps: usize) -> Option<Finding> {
    let Sensor { name, unit, rejected, .. } = sensor;
    let first = rejected.first()?;
    let time = subject.time(first.step as f64 * subject.step_s());
    let what = format!(
        "{} of {steps} readings of {name} in the rehearsed loop, which has no noise, are rejected: \
         that at {time} is {} from what is expected, where {} are allowed",
        rejected.len(),
        with_unit(first.off, unit),
        with_unit(first.width, unit),
    );
    let change = match first.step {
        0 => "raise initial_sd, correct initial_estimate, or widen the gate",
        _ => "raise process_sd or disturbance_sd, or widen the gate",
    };
    let why = "the estimator is surer of its estimate than it is right, and its gate takes what a \
               sound sensor says for a fault";
    Some(Finding::warning(KEY, what).because(why).change(change))
}

/// Noise that is often beyond the gate.
fn noise(sensor: &Sensor) -> Option<Finding> {
    let Sensor { name, unit, noise_sd, width: [_, width], .. } = sensor;
    (NOISE_SD * noise_sd > *width).then(|| {
        let what = format!(
            "the noise of {name} has a standard deviation of {}, and a reading may be {} from what is \
             expected",
            with_unit(*noise_sd, unit),
            with_unit(*width, unit)
        );
        let why = "ordinary noise is rejected as a fault";
        let change = "measurement_sd as large as noise_sd, or a wider gate";
        Finding::warning(KEY, what).because(why).change(change)
    })
}
