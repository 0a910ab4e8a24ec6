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

/// The share that is enough.
const ENOUGH: f64 = 0.5;

/// So many steps are looked at where a longer horizon is advised, and a response still moves where it grows
/// by this factor in their second half.
const LOOKED_AT: usize = 400;
const STILL_MOVES: f64 = 1.2;

/// What moves less than this part of the way by then does not get there.
const NEAR_NOTHING: f64 = 0.01;

/// Below this share a movement is rounding.
const UNMOVED: f64 = 1e-9;

/// What counts as a change where the reference does not change: this share of the region.
const CHANGE: f64 = 0.05;

/// A movement that is to be possible.
#[derive(Clone, Copy)]
struct Wanted {
    far: f64,
    /// In words.
    what: &'static str,
}

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
    let poor = shares.filter(|(_, moved, wanted)| is_poor(*moved, wanted.far));
    let worst = poor.min_by(|a, b| (a.1 / a.2.far).total_cmp(&(b.1 / b.2.far)));
    worst
        .map(|(i, moved, wanted)| finding(subject, control, i, (moved, wanted)))
        .into_iter()
        .collect()
}

fn finding(
    subject: &Subject<'_>,
    control: &ControlSpec,
    i: usize,
    (moved, wanted): (f64, Wanted),
) -> Finding {
    let share = moved / wanted.far;
    let horizon = control.horizon_s(subject.step_s());
    let name = &subject.plant.states()[i].name;
    if share < UNMOVED {
        let what = format!("no input moves {name} within the prediction horizon");
        return Finding::warning("control.controlled", what)
            .because("the controller cannot bring it to its reference")
            .change("control other states, or fewer");
    }
    let what = format!(
        "within the prediction horizon, {}, the inputs can move {name} by {} of {}",
        subject.time(horizon),
        short(share),
        wanted.what
    );
    let key = if control.stages_s.is_some() { "control.stages_s" } else { "control.n2" };
    let change = match (steps_to_move(subject, control, i, ENOUGH * wanted.far), &control.stages_s)
    {
        (None, _) => "another T: longer horizons of such steps move it little more".to_owned(),
        (Some(steps), Some(_)) => {
            let needed = subject.time(steps * subject.step_s());
            format!("longer stages, or more, for a horizon of about {needed}")
        }
        (Some(steps), None) => n2_of(steps, format!("n2 of about {steps:.0}, or a longer T")),
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
fn changes(subject: &Subject<'_>, control: &ControlSpec) -> Vec<Wanted> {
    let change = |(k, &i): (usize, &usize)| {
        let mut last = control.initial_state[i];
        let mut largest = 0.0_f64;
        for reference in &control.references {
            largest = largest.max((reference.value[k] - last).abs());
            last = reference.value[k];
        }
        match largest > 0.0 {
            true => Wanted { far: largest, what: "a change of its reference" },
            false => {
                let far = CHANGE * subject.region.width(i);
                Wanted { far, what: "a twentieth of its range" }
            }
        }
    };
    subject.controlled().iter().enumerate().map(change).collect()
}

/// How far one of the inputs, put to one of its bounds, moves a state from a steady state within
/// the horizon.
fn movement(subject: &Subject<'_>, control: &ControlSpec, from: &OperatingPoint, i: usize) -> f64 {
    let stages = control.stages(subject.step_s()).into_iter();
    let stages = || stages.clone().flat_map(|(length, count)| std::iter::repeat_n(length, count));
    let responses = responses(subject, control, from, i, &stages);
    responses.into_iter().flatten().fold(0.0, f64::max)
}

/// After how many steps of T one of the inputs can have moved a state so far from a steady state;
/// `None` where it does not get there.
fn steps_to_move(subject: &Subject<'_>, control: &ControlSpec, i: usize, far: f64) -> Option<f64> {
    let steps = || std::iter::repeat_n(subject.step_s(), LOOKED_AT);
    let mut least: Option<f64> = None;
    for (_, point) in subject.steady_points() {
        for response in responses(subject, control, point, i, &steps) {
            let reached = response.iter().position(|moved| *moved >= far);
            let count = |k: usize| (k + 1) as f64;
            // A slow response goes on as it came.
            let middle = response.get(LOOKED_AT / 2).copied().unwrap_or(f64::NAN);
            let goes_on = |end: &f64| *end > (STILL_MOVES * middle).max(NEAR_NOTHING * far);
            let end = response.last().copied().filter(goes_on);
            let slow = end.map(|end| (count(LOOKED_AT) * far / end).ceil());
            let found = reached.map(count).or(slow);
            least = [least, found].into_iter().flatten().reduce(f64::min);
        }
    }
    least
}

/// How far each of the inputs, put to each of its bounds, has moved a state from a steady state at the ends
/// of these steps: infinitely far where the plant runs away.
fn responses<I: Iterator<Item = f64>>(
    subject: &Subject<'_>,
    control: &ControlSpec,
    from: &OperatingPoint,
    i: usize,
    steps: &dyn Fn() -> I,
) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for j in 0..from.u.len() {
        for bound in [control.input_low[j], control.input_high[j]] {
            let (mut x, mut u) = (from.x.clone(), from.u.clone());
            u[j] = bound;
            let mut truth = Simulator::new(subject.plant, TOLERANCE);
            let mut response = Vec::new();
            for length in steps() {
                if truth.integrate(&mut x, &u, length).is_err() {
                    response.push(f64::INFINITY);
                    break;
                }
                response.push((x[i] - from.x[i]).abs());
            }
            all.push(response);
        }
    }
    all
}
