//! Checks that the rates of the equation fit the length of a step: a plant written in hours moves
//! 3600 times too fast if it is read in seconds.

use crate::{Finding, Subject, short};
use pinc_config::{PlantSpec, TimeUnit};

/// Points from which the usual rates are taken.
const POINTS: usize = 200;

/// Widths of the region that each state crosses within T at its usual rate, from which the question
/// is asked. Of a plant that a controller can follow the slowest state crosses a part of one.
const MANY: f64 = 20.0;

/// Widths that the fastest state crosses within the whole horizon, below which the question is asked.
const FEW: f64 = 1e-4;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(step_s) = subject.experiment.sample_time_s() else { return Vec::new() };
    let points = subject.region.points(subject.experiment.seed).take(POINTS);
    let rates: Vec<Vec<f64>> = points.map(|point| subject.rhs(&point.x, &point.u)).collect();
    let crossed: Vec<f64> = (0..subject.region.dims.nx)
        .map(|i| {
            let mut sizes: Vec<f64> = rates.iter().map(|rate| rate[i].abs()).collect();
            sizes.sort_by(f64::total_cmp);
            sizes[sizes.len() / 2] * step_s / subject.region.width(i)
        })
        .collect();
    let plant = subject.experiment.plant.time_unit();
    let fastest = crossed.iter().copied().fold(0.0, f64::max);
    let slow = too_slow(subject, fastest, plant.unwrap_or(TimeUnit::S));
    // A state that usually rests says nothing.
    let moving = crossed.into_iter().filter(|widths| *widths > 0.0);
    let slowest = moving.fold(f64::INFINITY, f64::min);
    if !(slowest > MANY && slowest.is_finite()) {
        return slow.into_iter().collect();
    }
    // The unit in which the slowest state would cross less than it may.
    let now = plant.unwrap_or(TimeUnit::S);
    let times = |unit: TimeUnit| unit.seconds() / now.seconds();
    let given = subject.experiment.time_unit.filter(|unit| times(*unit) > 1.0);
    let fits = |unit: &TimeUnit| times(*unit) > 1.0 && slowest / times(*unit) <= MANY;
    let longer = [TimeUnit::Min, TimeUnit::H, TimeUnit::D];
    let Some(unit) = given.or_else(|| longer.into_iter().find(fits)) else { return Vec::new() };
    let what = format!(
        "within T = {} each state moves {} widths of {} or more at its usual rate: are the \
         equation's rates per {} instead of per {}?",
        subject.time(step_s),
        short(slowest),
        subject.region_name,
        unit.name(),
        in_words(now)
    );
    let change = match &subject.experiment.plant {
        PlantSpec::Expression(_) => {
            format!("plant.expression.time_unit = \"{}\", or a shorter T", unit.name())
        }
        _ => format!("divide the right-hand sides by {}, or give a shorter T", times(unit)),
    };
    vec![
        Finding::warning("plant", what)
            .because("steps of the controller fail, and no net learns such a step")
            .change(change),
    ]
}

fn in_words(unit: TimeUnit) -> &'static str {
    if unit == TimeUnit::S { "second" } else { unit.name() }
}

/// A plant that stands still for the controller, whose fastest state crosses `fastest` widths within
/// T.
fn too_slow(subject: &Subject<'_>, fastest: f64, unit: TimeUnit) -> Option<Finding> {
    let control = subject.experiment.control.as_ref()?;
    let step_s = subject.experiment.sample_time_s()?;
    let horizon_s = control.horizon_s(step_s);
    let crossed = fastest * horizon_s / step_s;
    if !(crossed > 0.0 && crossed < FEW) {
        return None;
    }
    let what = format!(
        "within the horizon of {} no state moves more than {} widths of {} at its usual rate: are \
         the equation's rates per {}, and T = {} as long as is meant?",
        subject.time(horizon_s),
        short(crossed),
        subject.region_name,
        in_words(unit),
        subject.time(step_s)
    );
    let because = "the controller sees no effect of its inputs";
    Some(Finding::warning("plant", what).because(because).change("a longer T, or faster rates"))
}
