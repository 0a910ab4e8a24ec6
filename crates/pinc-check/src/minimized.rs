//! What a search and a tuning minimize.

use crate::{Finding, Subject};
use pinc_record::{TrialMetric, UnknownMetric};

/// Names metrics that the loops do not have.
pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let experiment = subject.experiment;
    let unknown = [TrialMetric::searched(experiment).err(), TrialMetric::tuned(experiment).err()];
    let finding = |problem: UnknownMetric| {
        Finding::error(problem.key, problem.to_string())
            .because("no loop of this config has such a number")
            .change("name one of them")
    };
    unknown.into_iter().flatten().map(finding).collect()
}
