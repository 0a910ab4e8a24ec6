//! What the loops of a candidate cost.

use super::Tried;
use pinc_config::{Candidate, Experiment, TuneSpec};
use pinc_record::{CsvText, Ending, Finished, TrialMetric, decimals};
use pinc_runs::RunError;
use std::cmp::Ordering;
use std::fmt::Write as _;

/// A weighted sum of metrics.
pub(super) struct Cost {
    terms: Vec<Term>,
}

struct Term {
    metric: TrialMetric,
    /// The metric's name without the model's.
    name: String,
    weight: f64,
    /// What the metric is divided by.
    scale: f64,
}

/// What came of a candidate.
#[derive(Clone, Debug, Default)]
pub(super) struct Score {
    /// Loops that failed.
    pub(super) failed: usize,
    /// The cost, the mean over the loops that did not; infinite if all did.
    pub(super) cost: f64,
    /// The means of the metrics over these.
    means: Vec<f64>,
}

impl Score {
    /// First by failures, then by cost.
    pub(super) fn compare(&self, other: &Self) -> Ordering {
        self.failed.cmp(&other.failed).then(self.cost.total_cmp(&other.cost))
    }

    pub(super) fn is_better(&self, other: &Self) -> bool {
        self.compare(other) == Ordering::Less
    }
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let cost = decimals(self.cost, 4);
        match self.failed {
            0 => f.write_str(&cost),
            usize::MAX => write!(f, "all loops failed"),
            1 => write!(f, "{cost} (1 loop failed)"),
            failed => write!(f, "{cost} ({failed} loops failed)"),
        }
    }
}

impl std::fmt::Display for Cost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, Term { name, weight, scale, .. }) in self.terms.iter().enumerate() {
            let separator = if i == 0 { "" } else { " + " };
            write!(f, "{separator}{weight} {name}")?;
            if scale.total_cmp(&1.0).is_ne() {
                write!(f, "/{scale:.4e}")?;
            }
        }
        Ok(())
    }
}

impl Cost {
    /// The cost of `[tune]` for the loops of `base`, which has one model.
    pub(super) fn of(base: &Experiment) -> Result<Self, RunError> {
        let metrics = TrialMetric::tuned(base).map_err(|e| RunError::unknown_metric(base, &e))?;
        let term = |(metric, name, weight)| Term { metric, name, weight, scale: 1.0 };
        Ok(Self { terms: metrics.into_iter().map(term).collect() })
    }

    /// The name of a metric that a loop which did not fail does not have.
    pub(super) fn missing(&self, results: &[Finished]) -> Option<&str> {
        let finished = results.iter().find(|finished| finished.ending == Ending::Done)?;
        let number = |term: &Term| term.metric.number(&finished.metrics);
        let lacks = |term: &&Term| number(term).is_none_or(|number| !number.is_finite());
        self.terms.iter().find(lacks).map(|term| term.name.as_str())
    }

    /// Divides metrics with a unit by their means in these loops.
    pub(super) fn set_scales(&mut self, results: &[Finished]) {
        for Term { metric, scale, .. } in &mut self.terms {
            if metric.has_unit() {
                let values = results.iter().filter_map(|finished| metric.number(&finished.metrics));
                let mean = mean(values.filter(|value| value.is_finite()));
                *scale = if mean > 0.0 { mean } else { 1.0 };
            }
        }
    }

    /// What the loops of a candidate cost; the worst score without any.
    pub(super) fn score(&self, results: &[Finished]) -> Score {
        let values = |finished: &Finished| -> Option<Vec<f64>> {
            let numbers = self.terms.iter().map(|term| term.metric.number(&finished.metrics));
            let numbers: Vec<f64> = numbers.collect::<Option<_>>()?;
            (finished.ending == Ending::Done && numbers.iter().all(|number| number.is_finite()))
                .then_some(numbers)
        };
        let loops: Vec<Vec<f64>> = results.iter().filter_map(values).collect();
        if loops.is_empty() {
            return Score { failed: usize::MAX, cost: f64::INFINITY, means: Vec::new() };
        }
        let column = |i: usize| mean(loops.iter().map(|values| values[i]));
        let means: Vec<f64> = (0..self.terms.len()).map(column).collect();
        let terms = self.terms.iter().zip(&means);
        let cost = terms.map(|(term, mean)| term.weight * mean / term.scale).sum();
        Score { failed: results.len() - loops.len(), cost, means }
    }

    /// All candidates, the config as it is written first.
    pub(super) fn table(&self, spec: &TuneSpec, tried: &[Tried]) -> CsvText {
        let names = self.terms.iter().map(|term| term.name.as_str());
        let keys: Vec<&str> = spec.ranges.iter().map(|range| range.key.as_str()).collect();
        let head = ["candidate", "failed", "cost"].into_iter().chain(names).chain(keys.clone());
        let mut table = CsvText::new(head);
        for (i, (values, score)) in tried.iter().enumerate() {
            let failed = match score.failed {
                usize::MAX => "all".to_owned(),
                failed => failed.to_string(),
            };
            let means = (0..self.terms.len()).map(|place| score.means.get(place));
            let means = means.map(|mean| mean.map_or_else(String::new, f64::to_string));
            let values = keys.iter().map(|key| values.get(*key));
            let values = values.map(|v| v.map_or_else(String::new, ToString::to_string));
            let row = [i.to_string(), failed, score.cost.to_string()];
            table.push(row.into_iter().chain(means).chain(values));
        }
        table
    }

    /// The two configs side by side: their values, and their loops that were held out.
    pub(super) fn compared(
        &self,
        spec: &TuneSpec,
        experiment: &Experiment,
        values: &Candidate,
        [written, tuned]: &[Score; 2],
    ) -> String {
        let mut rows = vec![[String::new(), "as written".to_owned(), "tuned".to_owned()]];
        for range in &spec.ranges {
            let before = experiment.value_of(&range.key);
            let before = before.map_or_else(|| "-".to_owned(), |value| value.to_string());
            let now = values.get(&range.key).map_or_else(|| before.clone(), ToString::to_string);
            rows.push([range.key.clone(), before, now]);
        }
        rows.push([
            format!("cost of {} held-out loops", spec.held_out),
            written.to_string(),
            tuned.to_string(),
        ]);
        for (i, term) in self.terms.iter().enumerate() {
            let of =
                |score: &Score| score.means.get(i).map_or_else(String::new, |v| decimals(*v, 4));
            rows.push([format!("  {}", term.name), of(written), of(tuned)]);
        }
        let width = |column: usize| rows.iter().map(|row| row[column].len()).max().unwrap_or(0);
        let (first, second, third) = (width(0), width(1), width(2));
        let mut text = String::new();
        for [name, before, now] in &rows {
            let _ = writeln!(text, "{name:<first$}  {before:>second$}  {now:>third$}");
        }
        text
    }
}

/// The mean of numbers; 0 of none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::Plants;
    use pinc_record::Metrics;
    use serde_json::json;
    use std::path::Path;

    /// A loop with RK4, which is tuned.
    fn base() -> Experiment {
        let config = Path::new("../../configs/smoke/rk4-only.toml");
        let set = ["control.models=[\"rk4\"]".to_owned()];
        let spec = r#"
            ranges = [{ key = "control.r.0", low = 0.1, high = 10.0 }]
            cost = { iae_dense_sum = 1.5, input_travel = 0.25 }
        "#;
        let mut base = Experiment::load(config, &set, &Plants::built_in()).unwrap();
        base.tune = Some(toml::from_str(spec).unwrap());
        base
    }

    /// A loop with this IAE and travel of the inputs.
    fn finished(iae: f64, travel: f64) -> Finished {
        let metrics: Metrics = serde_json::from_value(json!({
            "experiment": "e", "preset": "ours", "variables": {},
            "control": [{
                "model": "rk4", "rmse": 0.0, "iae": 0.0, "rmse_dense": 0.0, "iae_dense_sum": iae,
                "input_travel": travel, "kkt_max": 0.0, "sqp_iterations_mean": 1.0,
                "max_violation": 0.0, "status": { "converged": 10 },
                "wall_s": { "median": 0.0, "mean": 0.0, "sd": 0.0, "runs": 1 },
                "step_us": { "p50": 1.0, "p99": 1.0, "max": 1.0 }
            }]
        }))
        .unwrap();
        Finished { ending: Ending::Done, metrics }
    }

    #[test]
    fn a_cost_is_the_weighted_sum_of_the_means_over_the_loops_that_did_not_fail() {
        let base = base();
        let mut cost = Cost::of(&base).unwrap();
        // What has a unit is measured by its mean here, 3; the travel has none.
        cost.set_scales(&[finished(2.0, 5.0), finished(4.0, 7.0)]);
        let fine = [finished(6.0, 8.0), finished(12.0, 4.0)];
        let score = cost.score(&fine);
        assert!((score.cost - (1.5 * 9.0 / 3.0 + 0.25 * 6.0)).abs() < 1e-12, "{}", score.cost);
        assert_eq!(score.failed, 0);
        let [one, two] = fine;
        let ending = Ending::Failed { error: String::new() };
        let score = cost.score(&[one, Finished { ending, ..finished(0.0, 0.0) }, two]);
        assert!((score.cost - 6.0).abs() < 1e-12, "{}", score.cost);
        assert_eq!(score.to_string(), "6.0000 (1 loop failed)");
    }

    #[test]
    fn a_candidate_with_fewer_failures_is_better_whatever_it_costs() {
        let score = |failed: usize, cost: f64| Score { failed, cost, means: Vec::new() };
        assert!(score(0, 9.0).is_better(&score(1, 1.0)));
        assert!(!score(1, 1.0).is_better(&score(0, 9.0)));
        assert!(score(1, 1.0).is_better(&score(1, 9.0)));
    }

    /// A mean of 0 cannot be divided by, and loops without a number do not count.
    #[test]
    fn what_is_zero_or_unknown_is_measured_in_its_own_unit() {
        let mut cost = Cost::of(&base()).unwrap();
        cost.set_scales(&[finished(0.0, 5.0), finished(f64::NAN, 5.0)]);
        let score = cost.score(&[finished(2.0, 4.0)]);
        assert!((score.cost - (1.5 * 2.0 + 0.25 * 4.0)).abs() < 1e-12, "{}", score.cost);
        cost.set_scales(&[finished(8.0, 5.0), finished(f64::NAN, 5.0)]);
        let score = cost.score(&[finished(2.0, 4.0), finished(f64::NAN, 4.0)]);
        assert!((score.cost - (1.5 * 2.0 / 8.0 + 0.25 * 4.0)).abs() < 1e-12, "{}", score.cost);
        assert_eq!(score.failed, 1);
        let said = cost.to_string();
        assert_eq!(said, "1.5 iae_dense_sum/8.0000e0 + 0.25 input_travel");
        // Where all failed, nothing is as bad.
        let none = cost.score(&[finished(f64::NAN, 4.0)]);
        assert_eq!((none.failed, none.to_string().as_str()), (usize::MAX, "all loops failed"));
        assert!(score.is_better(&none) && !none.is_better(&score) && !none.is_better(&none));
    }

    /// The first loop that ended well says what is missing, not one that failed before.
    #[test]
    fn a_number_that_loops_do_not_have_is_named() {
        let cost = Cost::of(&base()).unwrap();
        let ending = Ending::Failed { error: String::new() };
        let failed = Finished { ending, ..finished(f64::NAN, f64::NAN) };
        assert_eq!(cost.missing(&[failed.clone(), finished(1.0, 2.0)]), None);
        assert_eq!(cost.missing(&[failed.clone(), finished(1.0, f64::NAN)]), Some("input_travel"));
        assert_eq!(cost.missing(&[finished(f64::NAN, 2.0)]), Some("iae_dense_sum"));
        assert_eq!(cost.missing(&[failed]), None);
    }

    /// Each candidate has a row with its failures, its cost, the mean of each term and its values;
    /// the comparison has the keys with both values, and the terms of both scores.
    #[test]
    fn candidates_are_listed_with_their_means_and_values() {
        let base = base();
        let spec = base.tune.clone().unwrap();
        let mut cost = Cost::of(&base).unwrap();
        cost.set_scales(&[finished(2.0, 5.0)]);
        let written = cost.score(&[finished(2.0, 8.0)]);
        let tuned = cost.score(&[finished(1.0, 4.0)]);
        let none = cost.score(&[]);
        let values: Candidate = [("control.r.0".to_owned(), 0.5.into())].into_iter().collect();
        let tried =
            [(Candidate::new(), written.clone()), (values.clone(), tuned.clone()), (values, none)];
        let table = cost.table(&spec, &tried);
        let text = String::from_utf8(table.as_bytes().to_vec()).unwrap();
        let expected = "candidate,failed,cost,iae_dense_sum,input_travel,control.r.0\n\
                        0,0,3.5,2,8,\n1,0,1.75,1,4,0.5\n2,all,inf,,,0.5\n";
        assert_eq!(text, expected);
        let (values, _) = &tried[1];
        let compared = cost.compared(&spec, &base, values, &[written, tuned]);
        let rows: Vec<Vec<&str>> =
            compared.lines().map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(rows[0], ["as", "written", "tuned"]);
        assert_eq!(rows[1], ["control.r.0", "1.0", "0.5"]);
        assert_eq!(rows[2][rows[2].len() - 2..], ["3.5000", "1.7500"]);
        assert_eq!(rows[3], ["iae_dense_sum", "2.0000", "1.0000"]);
        assert_eq!(rows[4], ["input_travel", "8.0000", "4.0000"]);
    }
}
