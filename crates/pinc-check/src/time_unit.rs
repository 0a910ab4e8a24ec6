//! Whether the rates of the equation are per second: a plant written in hours moves 3600 times too
//! fast.

use crate::{Finding, Subject, short};
use pinc_config::TimeUnit;

/// Points from which the usual rates are taken.
const POINTS: usize = 200;

/// Widths of the region that each state crosses within T at its usual rate, from which the question
/// is asked. Of a plant that a controller can follow the slowest state crosses a part of one.
const MANY: f64 = 20.0;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(step_s) = subject.experiment.sample_time_s() else { return Vec::new() };
    let points = subject.region.points(subject.experiment.seed).take(POINTS);
    let rates: Vec<Vec<f64>> = points.map(|point| subject.rhs(&point.x, &point.u)).collect();
    let crossed = (0..subject.region.dims.nx).map(|i| {
        let mut sizes: Vec<f64> = rates.iter().map(|rate| rate[i].abs()).collect();
        sizes.sort_by(f64::total_cmp);
        sizes[sizes.len() / 2] * step_s / subject.region.width(i)
    });
    // A state that usually rests says nothing.
    let slowest = crossed.filter(|widths| *widths > 0.0).fold(f64::INFINITY, f64::min);
    if !(slowest > MANY && slowest.is_finite()) {
        return Vec::new();
    }
    // The unit in which the slowest state would cross less than it may.
    let given = subject.experiment.time_unit.filter(|unit| unit.seconds() > 1.0);
    let fits = |unit: &TimeUnit| slowest / unit.seconds() <= MANY;
    let unit = given.or_else(|| [TimeUnit::Min, TimeUnit::H].into_iter().find(fits));
    let Some(unit) = unit else { return Vec::new() };
    let what = format!(
        "within T = {} each state moves {} widths of {} or more at its usual rate: are the \
         equation's rates per {} instead of per second?",
        subject.time(step_s),
        short(slowest),
        subject.region_name,
        unit.name()
    );
    vec![
        Finding::warning("plant", what)
            .because(
                "rates are per second whatever time_unit is, which only says in what unit times \
                 are shown: steps of the controller fail, and no net learns such a step",
            )
            .change(format!(
                "divide the right-hand sides by {}, or give a shorter T",
                unit.seconds()
            )),
    ]
}
