//! How many substeps of RK4 a step T needs: what a net has to beat.

use super::{Finding, Subject, short};
use pinc_ode::Dopri5;

/// Random points at which integrators are compared.
const POINTS: usize = 100;

/// Local error tolerance of the truth.
const TOLERANCE: f64 = 1e-12;

/// The numbers of substeps that are shown.
const SHOWN: [usize; 5] = [1, 2, 4, 8, 16];

/// Where the search for a number of substeps ends.
const MOST: usize = 1024;

/// The errors asked for, in widths of the region.
const WANTED: [f64; 2] = [1e-4, 1e-6];

pub(super) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(sample_time_s) = subject.experiment.sample_time_s() else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    let samples = Samples::draw(subject, sample_time_s);
    let missing = POINTS - samples.0.len();
    if missing > 0 {
        let what = format!(
            "the plant breaks off within T from {missing} of {POINTS} random points of {}",
            subject.region.name
        );
        findings.push(
            Finding::warning("domain", what)
                .because(
                    "there the equation has no solution over a step, so that no net can learn one",
                )
                .change("a smaller domain or a shorter sample_time_s"),
        );
    }
    if samples.0.is_empty() {
        return findings;
    }
    let shown =
        SHOWN.map(|n| format!("{n}: {:.1e}", samples.error(subject, sample_time_s, n, false)));
    findings.push(Finding::fact(
        "",
        format!("rms error of one step of RK4 by substeps: {}", shown.join(", ")),
    ));
    findings.extend(needed(subject, sample_time_s, &samples));
    findings
}

fn needed(subject: &Subject<'_>, sample_time_s: f64, samples: &Samples) -> Vec<Finding> {
    let enough = |wanted: f64| {
        let counts = std::iter::successors(Some(1), |n| (n * 2 <= MOST).then_some(n * 2));
        let mut counts = counts.map(|n| (n, samples.error(subject, sample_time_s, n, true)));
        counts.find(|(_, error)| *error <= wanted).map(|(n, _)| n)
    };
    let found = WANTED.map(enough);
    let text = WANTED.iter().zip(&found).map(|(wanted, n)| match n {
        Some(n) => format!("{wanted:.0e} of the region's width with {n} substeps"),
        None => format!("{wanted:.0e} of it not with {MOST} substeps"),
    });
    let fact = format!(
        "T = {} s: RK4 has an rms error of {}",
        short(sample_time_s),
        text.collect::<Vec<_>>().join(", ")
    );
    let mut findings = vec![Finding::fact("", fact)];
    if let Some(control) = &subject.experiment.control {
        let error = samples.error(subject, sample_time_s, control.rk4_substeps, true);
        if error > 1e-2 || error.is_nan() {
            let (n, enough) = (
                control.rk4_substeps,
                found[0].map_or_else(|| format!("more than {MOST}"), |n| n.to_string()),
            );
            findings.push(
                Finding::warning("control.rk4_substeps", format!("with {n} substeps RK4 is wrong by {} of the region's width in a step", short(error)))
                    .because("as a model in the controller it misleads, and a comparison with it says nothing about the net")
                    .change(format!("rk4_substeps = {enough}")),
            );
        }
    }
    findings
}

/// Points x, u and the true state after T.
struct Samples(Vec<(Vec<f64>, Vec<f64>, Vec<f64>)>);

impl Samples {
    fn draw(subject: &Subject<'_>, sample_time_s: f64) -> Self {
        let points = subject.region.points(subject.experiment.seed).take(POINTS);
        let mut truth = Dopri5::shared(subject.plant.to_shared(), TOLERANCE);
        let samples = points.filter_map(|point| {
            let mut end = point.x.clone();
            truth.integrate(&mut end, &point.u, sample_time_s).ok()?;
            Some((point.x, point.u, end))
        });
        Self(samples.collect())
    }

    /// The root of the mean squared error of a step, in the states' units or in widths of the region.
    fn error(
        &self,
        subject: &Subject<'_>,
        sample_time_s: f64,
        substeps: usize,
        in_widths: bool,
    ) -> f64 {
        let mut model = subject.plant.rk4(sample_time_s, substeps);
        let n = subject.region.dims.nx;
        let scale: Vec<f64> =
            (0..n).map(|i| if in_widths { subject.region.width(i) } else { 1.0 }).collect();
        let mut next = vec![0.0; n];
        let (mut predicted, mut truth) = (Vec::new(), Vec::new());
        for (x, u, end) in &self.0 {
            model.step(x, u, &[], &mut next);
            predicted.extend_from_slice(&next);
            truth.extend_from_slice(end);
        }
        pinc_ode::metrics::mean_squared_error(&predicted, &truth, &scale).sqrt()
    }
}
