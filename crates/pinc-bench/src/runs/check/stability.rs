//! The plant's own modes at its steady states, against the step T and the horizon.

use super::linear::{Complex, Linear};
use super::{Finding, Subject, short};

/// An explicit Runge-Kutta method of order 4 is stable up to about 2.8 per substep.
const STIFF: f64 = 10.0;

pub(super) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let points = subject.operating_points();
    if points.is_empty() {
        let what = format!("no steady state was found in {} or near it", subject.region.name);
        findings.push(Finding::fact("", what));
    }
    for (name, point) in points {
        let place = format!("{name}, {}; {}", subject.state(&point.x), subject.input(&point.u));
        let Some(linear) = Linear::at(subject, point) else {
            findings.push(
                Finding::warning(place, "the derivatives are not finite there")
                    .because("neither stability nor gain can be told, and a controller cannot stay there")
                    .change("guard the argument of sqrt, log and of a division, or move the reference"),
            );
            continue;
        };
        let modes = linear.eigenvalues();
        let list: Vec<_> = modes.iter().map(describe).collect();
        findings.push(Finding::fact(place.clone(), format!("modes {}", list.join("; "))));
        if subject.experiment.sample_time_s().is_some() {
            findings.extend(against_step(subject, &place, &modes));
        }
    }
    findings
}

fn describe(mode: &Complex) -> String {
    let &(re, im) = mode;
    let frequency = if im == 0.0 { String::new() } else { format!(" {im:+.4}i") };
    // Rounding leaves an integrator's eigenvalue a little off 0.
    let meaning = if re.abs() < 1e-9 * (1.0 + im.abs()) {
        "neither grows nor decays".to_owned()
    } else if re < 0.0 {
        format!("time constant {:.3} s", -1.0 / re)
    } else {
        format!("doubles in {:.3} s", std::f64::consts::LN_2 / re)
    };
    format!("{re:.4}{frequency} 1/s ({meaning})")
}

/// The modes against T and the horizon.
fn against_step(subject: &Subject<'_>, place: &str, modes: &[Complex]) -> Vec<Finding> {
    let step = subject.step_s();
    let sizes = || modes.iter().map(|v| v.0.hypot(v.1));
    let fastest = sizes().fold(0.0, f64::max);
    let slowest = sizes().filter(|rate| *rate > 1e-9 * fastest).fold(f64::INFINITY, f64::min);
    let mut findings = Vec::new();
    if fastest * step > STIFF && fastest > STIFF * slowest {
        let what = format!(
            "stiff: the fastest mode times T is {}, and it is {} times as fast as the slowest",
            short(fastest * step),
            short(fastest / slowest)
        );
        findings.push(
            Finding::warning(place, what)
                .because("explicit RK4 needs many substeps to stay stable, and in a net the fast part is a thin layer at t = 0")
                .change("give RK4 the substeps that are named below, shorten T, or leave the fast state out by its steady state"),
        );
    }
    if slowest * step > 3.0 && slowest.is_finite() {
        let what =
            format!("T = {step} s is {} times the slowest time constant", short(slowest * step));
        findings.push(
            Finding::warning(place, what)
                .because("the plant has settled at the end of a step: the controller sees steady states and cannot shape the way there")
                .change(format!("a sample_time_s of {} s or less", short(1.0 / slowest))),
        );
    }
    if let Some(control) = &subject.experiment.control {
        #[expect(clippy::cast_precision_loss, reason = "a few steps")]
        let horizon = control.n2 as f64 * step;
        if slowest * horizon < 0.1 {
            let what = format!(
                "the prediction horizon, {} s, is {} of the slowest time constant",
                short(horizon),
                short(slowest * horizon)
            );
            findings.push(
                Finding::warning("control.n2", what)
                    .because("the controller sees too little of what its inputs do, and becomes timid or short-sighted")
                    .change(format!("n2 of about {:.0}, or a longer T", (0.5 / (slowest * step)).ceil())),
            );
        }
    }
    findings
}
