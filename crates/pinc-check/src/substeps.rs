//! How many substeps of RK4 a step T needs: what a net has to beat.

use crate::{Finding, Subject, short};
use pinc_analysis::OneStepSamples;
use pinc_config::ModelKind;

/// Random points at which integrators are compared; fewer for many states.
const POINTS: usize = 100;

/// The numbers of substeps that are shown.
const SHOWN: [usize; 5] = [1, 2, 4, 8, 16];

/// Where the search for a number of substeps ends.
const MOST: usize = 1024;

/// The errors asked for, in widths of the region.
const WANTED: [f64; 2] = [1e-4, 1e-6];

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(sample_time_s) = subject.experiment.sample_time_s() else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    let (region, seed) = (&subject.region, subject.experiment.seed);
    let points = subject.random_points(POINTS);
    let samples = OneStepSamples::draw(subject.plant, region, seed, points, sample_time_s);
    let missing = samples.missing();
    if missing > 0 {
        let what = format!(
            "the plant breaks off within T from {missing} of {points} random points of {}",
            subject.region_name
        );
        findings.push(
            Finding::warning("domain", what)
                .because(
                    "there the equation has no solution over a step, so that no net can learn one",
                )
                .change("a smaller domain or a shorter T"),
        );
    }
    if samples.is_empty() {
        return findings;
    }
    let shown = SHOWN.map(|n| format!("{n}: {:.1e}", error(subject, &samples, n)));
    findings.push(Finding::fact(
        "",
        format!(
            "rms error of one step of RK4 over {}, in its widths, by substeps: {}",
            subject.region_name,
            shown.join(", ")
        ),
    ));
    findings.extend(needed(subject, sample_time_s, &samples));
    findings
}

fn needed(subject: &Subject<'_>, sample_time_s: f64, samples: &OneStepSamples) -> Vec<Finding> {
    let enough = |wanted: f64| {
        let counts = std::iter::successors(Some(1), |n| (n * 2 <= MOST).then_some(n * 2));
        let mut counts = counts.map(|n| (n, error(subject, samples, n)));
        counts.find(|(_, error)| *error <= wanted).map(|(n, _)| n)
    };
    let found = WANTED.map(enough);
    let text = WANTED.iter().zip(&found).map(|(wanted, n)| match n {
        Some(n) => format!("{wanted:.0e} of the region's width with {n} substeps"),
        None => format!("{wanted:.0e} of it not with {MOST} substeps"),
    });
    let fact = format!(
        "T = {}: RK4 has an rms error of {}",
        subject.time(sample_time_s),
        text.collect::<Vec<_>>().join(", ")
    );
    let mut findings = vec![Finding::fact("", fact)];
    let control = subject.experiment.control.as_ref();
    if let Some(control) = control.filter(|control| control.models.contains(&ModelKind::Rk4)) {
        let error = error(subject, samples, control.rk4_substeps);
        if error > 1e-2 || error.is_nan() {
            let (n, enough) = (
                control.rk4_substeps,
                found[0].map_or_else(|| format!("more than {MOST}"), |n| n.to_string()),
            );
            findings.push(
                Finding::warning(
                    "control.rk4_substeps",
                    format!(
                        "with {n} substeps RK4 is wrong \
                 by {} of the region's width in a step",
                        short(error)
                    ),
                )
                .because(
                    "as a model in the controller it misleads, and a comparison with it \
                     says nothing about the net",
                )
                .change(format!("rk4_substeps = {enough}")),
            );
        }
    }
    findings
}

/// The root of the mean squared error of a step of RK4, in widths of the region.
fn error(subject: &Subject<'_>, samples: &OneStepSamples, substeps: usize) -> f64 {
    let scale: Vec<f64> = (0..subject.region.dims.nx).map(|i| subject.region.width(i)).collect();
    samples.rms_error(&mut *subject.plant.rk4(subject.step_s(), substeps), &scale)
}
