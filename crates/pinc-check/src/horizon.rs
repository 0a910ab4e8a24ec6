//! Checks that the prediction horizon is long enough: how far the inputs move the controlled states
//! within it.

use crate::{Finding, Subject, short};
use pinc_analysis::OperatingPoint;
use pinc_config::{ControlSpec, MOST_N2};
use pinc_ode::Simulator;

/// Local error tolerance: enough to see how far a state moves.
const TOLERANCE: f64 = 1e-6;

/// The share of a change of the reference that inputs have to be able to make within the horizon.
const LEAST: f64 = 0.1;

/// Below this share a movement is rounding.
const UNMOVED: f64 = 1e-9;

/// What counts as a change where the reference does not change: this share of the region.
const CHANGE: f64 = 0.05;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let control = subject.experiment.control.as_ref();
    let Some(control) = control.filter(|_| subject.experiment.sample_time_s().is_some()) else {
        return Vec::new();
    };
    let points = subject.steady_points();
    let wanted = changes(subject, control);
    let shares = subject.controlled().into_iter().zip(wanted).map(|(i, wanted)| {
        let moved = points.iter().map(|(_, point)| movement(subject, control, point, i));
        (i, moved.fold(f64::NAN, f64::max), wanted)
    });
    // What none of as many inputs moves at all is said where gains are examined.
    let is_said = subject.controlled().len() <= subject.region.dims.nu;
    let is_poor = |moved: f64, wanted: f64| moved < LEAST * wanted && (moved > 0.0 || !is_said);
    let poor = shares.filter(|(_, moved, wanted)| is_poor(*moved, *wanted));
    let worst = poor.min_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)));
    worst
        .map(|(i, moved, wanted)| finding(subject, control, i, moved / wanted))
        .into_iter()
        .collect()
}

fn finding(subject: &Subject<'_>, control: &ControlSpec, i: usize, share: f64) -> Finding {
    let horizon = control.horizon_s(subject.step_s());
    let name = &subject.plant.states()[i].name;
    if share < UNMOVED {
        let what = format!("no input moves {name} within the prediction horizon");
        return Finding::warning("control.controlled", what)
            .because("the controller cannot bring it to its reference")
            .change("control other states, or fewer");
    }
    let what = format!(
        "within the prediction horizon, {}, the inputs can move {name} by {} of a change of its \
         reference",
        subject.time(horizon),
        short(share)
    );
    let (key, change) = match &control.stages_s {
        Some(_) => {
            let needed = subject.time(0.5 / share * horizon);
            ("control.stages_s", format!("longer stages, or more, for a horizon of about {needed}"))
        }
        None => {
            let needed = (0.5 / share * control.n2 as f64).ceil();
            ("control.n2", n2_of(needed, format!("n2 of about {needed:.0}, or a longer T")))
        }
    };
    Finding::warning(key, what)
        .because("the controller sees too little of what its inputs do, and becomes timid")
        .change(change)
}

/// The advice `n2`, to look so many steps ahead, or what is left of it where a config may not.
pub(crate) fn n2_of(needed: f64, n2: String) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a few thousand")]
    let most = MOST_N2 as f64;
    match needed > most {
        true => {
            format!("a T at least {:.1} times as long (n2 is {most} at most)", needed / most + 0.05)
        }
        false => n2,
    }
}

/// The largest change of the reference of each controlled state, from the start of the loop on.
fn changes(subject: &Subject<'_>, control: &ControlSpec) -> Vec<f64> {
    let change = |(k, &i): (usize, &usize)| {
        let mut last = control.initial_state[i];
        let mut largest = 0.0_f64;
        for reference in &control.references {
            largest = largest.max((reference.value[k] - last).abs());
            last = reference.value[k];
        }
        largest.max(CHANGE * subject.region.width(i))
    };
    subject.controlled().iter().enumerate().map(change).collect()
}

/// How far one of the inputs, put to one of its bounds, moves a state from a steady state within
/// the horizon.
fn movement(subject: &Subject<'_>, control: &ControlSpec, from: &OperatingPoint, i: usize) -> f64 {
    let mut largest = 0.0_f64;
    for j in 0..from.u.len() {
        for bound in [control.input_low[j], control.input_high[j]] {
            let (mut x, mut u) = (from.x.clone(), from.u.clone());
            u[j] = bound;
            let mut truth = Simulator::new(subject.plant, TOLERANCE);
            let stages = control.stages(subject.step_s()).into_iter();
            for length in stages.flat_map(|(length, count)| std::iter::repeat_n(length, count)) {
                if truth.integrate(&mut x, &u, length).is_err() {
                    // It ran away.
                    return f64::INFINITY;
                }
                largest = largest.max((x[i] - from.x[i]).abs());
            }
        }
    }
    largest
}
