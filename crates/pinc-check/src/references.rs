//! Checks that each reference is a steady state that the inputs can hold within their bounds.

use crate::groups::groups;
use crate::numbers::apart;
use crate::{Finding, Held, Kept, LEFT_OUT, Subject, short};
use pinc_analysis::{HeldPoint, OperatingPoint};
use pinc_config::ControlSpec;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    if subject.controlled().is_empty() && !control.controlled.is_empty() {
        let is_other = |name: &&String| subject.plant.states().iter().all(|s| s.name != **name);
        let others: Vec<_> =
            control.controlled.iter().filter(is_other).map(String::as_str).collect();
        let what = format!(
            "the steady states of control.references, static gain, transmission zeros and the reach \
             of inputs within the horizon: these need controlled states, and {} is none",
            others.join(", ")
        );
        findings.push(Finding::fact(LEFT_OUT, what));
    }
    for Held { first, count, point, kept } in &subject.holds {
        let (place, reference) =
            (format!("control.references[{first}]"), &control.references[*first]);
        let mut value = subject.controlled_values(&reference.value);
        match count - 1 {
            0 => {}
            1 => value = format!("{value} (and once more)"),
            more => value = format!("{value} (and {more} times more)"),
        }
        if let Some(kept) = kept {
            findings.push(along(subject, place, &value, kept));
            continue;
        }
        let mut finding = match point {
            HeldPoint::Within(point) => {
                let (x, u) = (subject.state(&point.x), subject.input(&point.u));
                Finding::fact(place, format!("{value} is held at {x} by {u}"))
            }
            HeldPoint::Outside(point) => outside(subject, control, &place, &value, point),
            HeldPoint::Nowhere(nearest) => {
                let at = (&*place, &*value);
                nowhere(subject, control, at, &reference.value, nearest.as_ref())
            }
        };
        finding.what.extend(unseen(subject, reference.start_s, control));
        findings.push(finding);
    }
    if subject.other_references > 0 {
        let (looked_at, others) = (subject.holds.len(), subject.other_references);
        let what = format!(
            "steady states were looked for at the first {looked_at} different values, not at the \
             {others} others"
        );
        findings.push(Finding::fact("control.references", what));
    }
    findings
}

/// What is said of a reference that begins when the loop has ended, as in a run that was shortened.
fn unseen(subject: &Subject<'_>, start_s: f64, control: &ControlSpec) -> Option<String> {
    let [start, end] = [start_s, control.duration_s].map(|seconds| subject.time(seconds));
    (start_s >= control.duration_s)
        .then(|| format!("; it begins at {start}: the loop ends at {end}"))
}

/// A reference that the closed loop keeps while other states move on.
fn along(subject: &Subject<'_>, place: String, value: &str, kept: &Kept) -> Finding {
    let Kept { during_s, point, from } = kept;
    let moved = |i: usize| (point.x[i] - from[i]).abs() / subject.region.width(i);
    let most = (0..from.len()).max_by(|&a, &b| moved(a).total_cmp(&moved(b))).unwrap_or(0);
    Finding::fact(
        place,
        format!(
            "{value} is kept by the closed loop from t = {} to {}, at no steady state: {} goes \
             from {} to {}, and at the end {} holds it",
            subject.time(during_s.start),
            subject.time(during_s.end),
            subject.state_name(most),
            short(from[most]),
            short(point.x[most]),
            subject.input(&point.u)
        ),
    )
}

/// The variables of a point outside the controller's bounds.
pub(crate) fn outside(
    subject: &Subject<'_>,
    control: &ControlSpec,
    place: &str,
    value: &str,
    point: &OperatingPoint,
) -> Finding {
    let sides = [
        (subject.plant.states(), &point.x, control.state_low.as_ref(), control.state_high.as_ref()),
        (subject.plant.inputs(), &point.u, Some(&control.input_low), Some(&control.input_high)),
    ];
    let mut needs = Vec::new();
    for (variables, values, low, high) in sides {
        for (_, places) in groups(variables) {
            let over = |i: usize| {
                let low = low.map_or(f64::NEG_INFINITY, |low| low[i]);
                let high = high.map_or(f64::INFINITY, |high| high[i]);
                ((low - values[i]).max(values[i] - high), low, high)
            };
            // For an array, the element that is farthest outside.
            let worst = places.max_by(|&a, &b| over(a).0.total_cmp(&over(b).0));
            let Some((i, (by, low, high))) = worst.map(|i| (i, over(i))) else { continue };
            if by > 0.0 {
                let needed = apart(values[i], if values[i] < low { low } else { high }).0;
                let ends = format!("bounds {} to {}", short(low), short(high));
                needs.push(format!("{} = {needed} ({ends})", variables[i].name));
            }
        }
    }
    let what = format!("{value} cannot be held within bounds: it needs {}", needs.join(", "));
    Finding::warning(place, what)
        .because("the controller will sit at its bounds with an offset, whatever its model")
        .change(
            "move the reference, or widen control.input_low, input_high, state_low or \
         state_high if the plant allows it",
        )
}

pub(crate) fn nowhere(
    subject: &Subject<'_>,
    control: &ControlSpec,
    (place, value): (&str, &str),
    wanted: &[f64],
    nearest: Option<&OperatingPoint>,
) -> Finding {
    let miss = |point: &OperatingPoint| {
        let x = subject.without_rounding(&point.x, 0);
        // Two numbers that differ are shown with the digits in which they do.
        let pairs = subject.controlled().into_iter().zip(wanted).zip(&control.controlled);
        let shown = pairs.map(|((i, wanted), name)| {
            let (found, wanted) = (x[i], *wanted);
            let off = (found - wanted).abs() > 1e-6 * subject.region.width(i);
            let text = if off { apart(found, wanted).0 } else { short(found) };
            format!("{name} = {text}")
        });
        shown.collect::<Vec<_>>().join(", ")
    };
    let nearest = nearest.map_or_else(String::new, |point| {
        format!("; a steady state near it has {} at {}", miss(point), subject.input(&point.u))
    });
    Finding::warning(place, format!("{value} is no steady state, with any input{nearest}"))
        .because(
            "no controller can hold it: there will be an offset, or the input will not come \
         to rest",
        )
        .change("a reference that is a steady state, or fewer controlled states")
}
