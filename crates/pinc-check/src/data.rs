//! The measurements of `[data]`: whether they can be read, and lie where the net is trained.

use crate::{Finding, Subject};
use std::path::PathBuf;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(spec) = &subject.experiment.data else {
        return Vec::new();
    };
    let mut findings = of_files(subject, "data.files", &spec.files);
    if spec.held_out.is_empty() && spec.parameters.is_empty() {
        findings.push(
            Finding::warning("data.held_out", "no measurements are held out")
                .because(
                    "the best net is then chosen by its error against the equation, which \
                 the measurements are there to correct",
                )
                .change("measurements that are not among data.files"),
        );
    } else {
        findings.extend(of_files(subject, "data.held_out", &spec.held_out));
    }
    findings
}

fn of_files(subject: &Subject<'_>, key: &str, files: &[PathBuf]) -> Vec<Finding> {
    let measured = match (subject.evidence.read)(files) {
        Ok(measured) => measured,
        Err(error) => {
            return vec![
                Finding::error(key, error)
                    .because("the training cannot begin without it")
                    .change("the file"),
            ];
        }
    };
    let what =
        format!("{} measured values at {} points (t, y0, u)", measured.values(), measured.len());
    let mut findings = vec![Finding::fact(key, what)];
    let points = measured.points();
    let region = &subject.region;
    let is_outside = |k: &usize| {
        let at = [points.state(*k), points.input(*k)].concat();
        at.iter().enumerate().any(|(i, v)| *v < region.low[i] || *v > region.high[i])
    };
    let outside = (0..measured.len()).filter(is_outside).count();
    if outside > 0 {
        let of = measured.len();
        findings.push(
            Finding::warning(
                key,
                format!("{outside} of {of} points lie outside {}", subject.region_name),
            )
            .because("the equation is not asked for there, so that these measurements stand alone")
            .change("a larger domain, or fewer measurements"),
        );
    }
    findings
}
