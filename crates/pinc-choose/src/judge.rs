//! Which of the models that were tried are good enough, and which of these is the one to use.

use crate::candidate::Candidate;
use pinc_config::{ControlSpec, OnError};
use pinc_record::{Metrics, decimals};

/// Loops within this factor of the cheapest control step cost the same, for all that a measurement
/// of times says.
pub(crate) const AS_CHEAP: f64 = 1.05;

/// A time is measured over this much of control steps at least, in us.
const MEASURED_US: f64 = 20_000.0;

/// The most often a loop is run for this.
const MOST_REPETITIONS: usize = 100;

/// The result of a model in the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// On the dense trace.
    pub iae: f64,
    /// The largest violation of a bound, as a share of the size of what it bounds.
    pub violation: f64,
    /// The share of control steps that failed.
    pub failed: f64,
    /// The number of control steps.
    pub steps: usize,
    /// The median time of a control step, in us.
    pub p50_us: f64,
    /// The 99th percentile of this.
    pub p99_us: f64,
    /// The root mean square error of one step over the domain, in its widths, where that was looked
    /// at.
    pub rms: Option<f64>,
    /// The largest of these errors.
    pub worst: Option<f64>,
    /// A proven bound of the error of one step over the box where the loop may go, in its widths,
    /// if a proof takes little work.
    pub proven: Option<f64>,
    /// In how many steps the estimated error of the net was beyond `control.error_tolerance`.
    pub beyond: usize,
    /// How long the net was trained, in s.
    pub training_s: Option<f64>,
    /// The most instructions of a control step on a microcontroller, where they were counted.
    pub instructions: Option<u64>,
    /// Why the controller with this model cannot be exported, where it has to be.
    pub unexported: Option<String>,
    /// Why an integrator is unsound in the box where the loop may go, in the words of `pinc check`;
    /// `None` for a sound one and for a net.
    pub unsound: Option<String>,
}

/// A model that was tried.
#[derive(Clone, Debug)]
pub struct Tried {
    /// Which.
    pub candidate: Candidate,
    /// The hash of its training.
    pub net: Option<String>,
    /// How often its loop was run.
    pub repetitions: usize,
    /// Where the results lie, by name.
    pub place: String,
    /// Its score, or the reason why there is none.
    pub result: Result<Score, String>,
}

/// The standard that a model has to meet.
#[derive(Clone, Debug)]
pub struct Standard {
    /// The most exact model.
    pub(crate) exact: Candidate,
    /// Its loop's.
    pub(crate) iae: f64,
    violation: f64,
    /// How much more the IAE may be, relative.
    within: f64,
    /// By how much more a bound may be violated.
    room: f64,
    max_failed: f64,
    /// Whether nothing but a count comes of a net whose estimated error is beyond its tolerance.
    only_counts: bool,
    pub(crate) budget_us: Option<f64>,
}

impl Score {
    /// The score in the metrics of a trial with one model.
    #[must_use]
    pub fn of(metrics: &Metrics) -> Option<Self> {
        let run = metrics.control.first()?;
        let step = metrics.one_step.first();
        let share = |steps: usize| steps as f64 / run.steps().max(1) as f64;
        Some(Self {
            iae: run.iae_dense_sum,
            violation: run.violation_share(),
            failed: share(run.failed_steps()),
            steps: run.steps(),
            p50_us: run.step_us.p50,
            p99_us: run.step_us.p99,
            rms: step.map(|step| step.errors.rms),
            worst: step.map(|step| step.errors.max),
            proven: None,
            beyond: run.model_error.as_ref().map_or(0, |of| of.beyond),
            training_s: metrics.training.as_ref().map(|training| training.wall_s),
            instructions: None,
            unexported: None,
            unsound: None,
        })
    }

    /// How often the loop is to be run, `wanted` times or more, for its time to be worth something.
    pub(crate) fn repetitions(&self, wanted: usize) -> usize {
        let is_enough = |n: &usize| (n * self.steps) as f64 * self.p50_us >= MEASURED_US;
        (wanted..MOST_REPETITIONS).find(is_enough).unwrap_or(wanted.max(MOST_REPETITIONS))
    }

    /// Whether it says anything of a controller.
    pub(crate) fn stands(&self, max_failed: f64) -> bool {
        self.iae.is_finite() && self.failed <= max_failed
    }
}

impl Standard {
    /// The standard set by a black box itself, or by the most exact integrator among those whose
    /// loops stand, a sound one if there is one; none if no loop stands.
    pub(crate) fn of(tried: &[Tried], spec: &ControlSpec, within: f64) -> Option<Self> {
        let max_failed = spec.max_failed_share;
        let loops = tried.iter().filter_map(|tried| {
            let substeps = match tried.candidate {
                Candidate::Integrator { substeps, .. } => substeps,
                Candidate::BlackBox => 1,
                Candidate::Net { .. } => return None,
            };
            let score = tried.result.as_ref().ok().filter(|score| score.stands(max_failed))?;
            let error = score.rms.filter(|rms| rms.is_finite()).unwrap_or(f64::INFINITY);
            Some(((score.unsound.is_some(), error), substeps, tried.candidate, score))
        });
        let exactest = loops.min_by(|a, b| {
            let (a_key, b_key) = (a.0, b.0);
            a_key.0.cmp(&b_key.0).then(a_key.1.total_cmp(&b_key.1)).then(b.1.cmp(&a.1))
        });
        exactest.map(|(_, _, exact, score)| Self {
            exact,
            iae: score.iae,
            violation: score.violation,
            within,
            room: within,
            max_failed,
            only_counts: spec.on_error == OnError::Count,
            budget_us: spec.budget_us,
        })
    }

    /// Where a model falls short, apart from its time; empty if it is good.
    pub(crate) fn shortfall(&self, score: &Score) -> Option<String> {
        if score.unsound.is_some() {
            return score.unsound.clone();
        }
        if let Some(reason) = &score.unexported {
            return Some(reason.clone());
        }
        if score.failed > self.max_failed {
            return Some(format!("{:.0} % of its steps fail", 100.0 * score.failed));
        }
        if !score.iae.is_finite() {
            return Some("its loop leaves the finite numbers".to_owned());
        }
        if self.only_counts && score.beyond > 0 {
            let Score { beyond, steps, .. } = score;
            return Some(format!("beyond control.error_tolerance in {beyond} of {steps} steps"));
        }
        if score.iae > (1.0 + self.within) * self.iae {
            let more = 100.0 * (score.iae / self.iae - 1.0);
            return Some(format!("IAE {} % more", decimals(more, 2)));
        }
        let violated = score.violation - self.violation;
        (violated > self.room)
            .then(|| format!("violates a bound by {violated:.1e} of its range more"))
    }

    pub(crate) fn is_good(&self, score: &Score) -> bool {
        self.shortfall(score).is_none()
    }

    /// Whether it falls short by at most as much again as is allowed.
    pub(crate) fn is_nearly_good(&self, score: &Score) -> bool {
        let twice = Self { within: 2.0 * self.within, room: 2.0 * self.room, ..self.clone() };
        !self.is_good(score) && twice.is_good(score)
    }

    /// Whether its steps end in time, where there is a limit.
    pub(crate) fn is_in_time(&self, score: &Score) -> bool {
        self.budget_us.is_none_or(|budget| score.p99_us <= budget)
    }

    /// The good models, the cheapest first; those that end in time before others.
    pub(crate) fn ranking<'a>(&self, tried: &'a [Tried]) -> Vec<(&'a Tried, &'a Score)> {
        let scored = tried.iter().filter_map(|tried| Some((tried, tried.result.as_ref().ok()?)));
        let mut good: Vec<_> = scored.filter(|(_, score)| self.is_good(score)).collect();
        good.sort_by(|(_, a), (_, b)| {
            let late = |score: &Score| !self.is_in_time(score);
            late(a).cmp(&late(b)).then(a.p50_us.total_cmp(&b.p50_us))
        });
        good
    }

    /// The model to use: of those that cost as little as the cheapest, one without a training rather
    /// than a net, and then the most exact one.
    pub(crate) fn winner<'a>(&self, tried: &'a [Tried]) -> Option<(&'a Tried, &'a Score)> {
        let ranking = self.ranking(tried);
        let (_, cheapest) = ranking.first()?;
        let (most, in_time) = (AS_CHEAP * cheapest.p50_us, self.is_in_time(cheapest));
        let as_cheap = ranking
            .iter()
            .filter(|(_, score)| score.p50_us <= most && self.is_in_time(score) == in_time);
        let order = |(tried, score): &(&Tried, &Score)| {
            (tried.candidate.is_net(), score.rms.unwrap_or(f64::INFINITY))
        };
        as_cheap
            .min_by(|a, b| {
                let (a, b) = (order(a), order(b));
                a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
            })
            .copied()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::candidate::shapes;
    use pinc_net::TrainingTarget;
    use pinc_ode::Integrator;

    /// A score with these numbers and no flaws.
    pub(crate) fn score(iae: f64, p50_us: f64, rms: f64) -> Score {
        Score {
            iae,
            violation: 0.0,
            failed: 0.0,
            steps: 100,
            p50_us,
            p99_us: 2.0 * p50_us,
            rms: Some(rms),
            worst: None,
            proven: None,
            beyond: 0,
            training_s: None,
            instructions: None,
            unexported: None,
            unsound: None,
        }
    }

    fn tried(candidate: Candidate, iae: f64, p50_us: f64, rms: f64) -> Tried {
        let result = Ok(score(iae, p50_us, rms));
        Tried { candidate, net: None, repetitions: 1, place: String::new(), result }
    }

    fn rk4(substeps: usize, iae: f64, p50_us: f64, rms: f64) -> Tried {
        tried(Candidate::Integrator { integrator: Integrator::Rk4, substeps }, iae, p50_us, rms)
    }

    fn net(iae: f64, p50_us: f64) -> Tried {
        let source = TrainingTarget::Integrator;
        tried(Candidate::Net { shape: shapes(2)[1], source, longer: false }, iae, p50_us, 1e-5)
    }

    fn standard(all: &[Tried], budget_us: Option<f64>) -> Standard {
        let Candidate::Integrator { .. } = all[0].candidate else { panic!("an integrator first") };
        let Ok(score) = &all[0].result else { panic!("a score") };
        Standard {
            exact: all[0].candidate,
            iae: score.iae,
            violation: 0.0,
            within: 0.01,
            room: 0.1,
            max_failed: 0.05,
            only_counts: true,
            budget_us,
        }
    }

    #[test]
    fn the_cheapest_good_model_wins_and_a_net_only_if_it_is_cheaper_by_more_than_noise() {
        let name = |all: &[Tried], budget: Option<f64>| {
            standard(all, budget).winner(all).map(|(tried, _)| tried.candidate.to_string())
        };
        let exact = rk4(16, 100.0, 50.0, 1e-9);
        let all = [exact.clone(), rk4(2, 100.5, 10.0, 1e-3), net(100.2, 9.6)];
        assert_eq!(name(&all, None).as_deref(), Some("RK4 x2"));
        let all = [exact.clone(), rk4(2, 100.5, 10.0, 1e-3), net(100.2, 5.0)];
        assert_eq!(name(&all, None).as_deref(), Some("distilled 2x16"));
        let all = [exact.clone(), rk4(1, 101.5, 1.0, 1e-1), rk4(4, 100.0, 12.0, 1e-5)];
        assert_eq!(name(&all, None).as_deref(), Some("RK4 x4"));
        // At equal cost, the more exact one.
        let all = [exact.clone(), rk4(2, 100.5, 10.0, 1e-3), rk4(3, 100.0, 10.4, 1e-4)];
        assert_eq!(name(&all, None).as_deref(), Some("RK4 x3"));
        // 15 % is more than measurements differ by: the net wins, and the cheaper integrator.
        let all = [exact.clone(), rk4(2, 100.5, 10.0, 1e-3), net(100.2, 8.5)];
        assert_eq!(name(&all, None).as_deref(), Some("distilled 2x16"));
        let all = [exact.clone(), rk4(2, 100.5, 10.0, 1e-3), rk4(3, 100.0, 11.5, 1e-4)];
        assert_eq!(name(&all, None).as_deref(), Some("RK4 x2"));
        // A cheaper one whose slowest steps are late is none.
        let mut late = rk4(2, 100.0, 10.0, 1e-3);
        if let Ok(score) = &mut late.result {
            score.p99_us = 300.0;
        }
        let all = [exact.clone(), late];
        assert_eq!(name(&all, Some(150.0)).as_deref(), Some("RK4 x16"));
        assert_eq!(name(&all, Some(1.0)).as_deref(), Some("RK4 x2"));
        // Nor is one that cannot be exported where C is timed.
        let mut unexported = rk4(2, 100.0, 10.0, 1e-3);
        if let Ok(score) = &mut unexported.result {
            score.unexported = Some("control.end_state cannot be exported".to_owned());
        }
        assert_eq!(name(&[exact, unexported], None).as_deref(), Some("RK4 x16"));
    }

    #[test]
    fn an_unsound_integrator_neither_wins_nor_sets_the_standard() {
        let unsound = |mut tried: Tried| {
            if let Ok(score) = &mut tried.result {
                score.unsound = Some("unstable at 46 of 200 random points".to_owned());
            }
            tried
        };
        let spec: ControlSpec = toml::from_str(crate::search::SPEC).unwrap();
        // The cheapest has the best IAE and, at the points that were looked at, the best steps.
        let all = [unsound(rk4(2, 100.0, 5.0, 1e-9)), rk4(4, 100.2, 9.0, 1e-5)];
        let standard = Standard::of(&all, &spec, 0.01).unwrap();
        assert_eq!((standard.exact.to_string(), standard.iae), ("RK4 x4".to_owned(), 100.2));
        assert_eq!(standard.winner(&all).unwrap().0.candidate.to_string(), "RK4 x4");
        let all = [unsound(rk4(2, 100.0, 5.0, 1e-9))];
        assert!(Standard::of(&all, &spec, 0.01).unwrap().winner(&all).is_none());
    }

    /// Of two integrators whose steps are as exact, the one with more substeps sets the standard.
    #[test]
    fn more_substeps_are_more_exact() {
        let spec: ControlSpec = toml::from_str(crate::search::SPEC).unwrap();
        let all = [rk4(2, 100.0, 5.0, 1e-9), rk4(8, 100.2, 9.0, 1e-9), rk4(4, 100.1, 7.0, 1e-9)];
        let standard = Standard::of(&all, &spec, 0.01).unwrap();
        assert_eq!((standard.exact.to_string(), standard.iae), ("RK4 x8".to_owned(), 100.2));
    }

    #[test]
    fn short_loops_are_run_more_often() {
        let repetitions = |p50_us: f64, wanted| score(100.0, p50_us, 1e-3).repetitions(wanted);
        assert_eq!(repetitions(10.0, 4), 20);
        assert_eq!(repetitions(1000.0, 4), 4);
        assert_eq!(repetitions(0.001, 4), 100);
        assert_eq!(repetitions(0.001, 300), 300);
    }

    #[test]
    fn shortfalls_are_reported() {
        let all = [rk4(16, 100.0, 50.0, 1e-9)];
        let standard = standard(&all, None);
        let Ok(score) = &all[0].result else { panic!("a score") };
        let with = |change: &dyn Fn(&mut Score)| {
            let mut score = score.clone();
            change(&mut score);
            standard.shortfall(&score).unwrap_or_default()
        };
        assert_eq!(with(&|_| ()), "");
        assert_eq!(with(&|score| score.iae = 103.0), "IAE 3.00 % more");
        // Of a tolerance of a thousandth of a percent, say.
        let small = Standard { within: 1e-5, ..standard.clone() };
        let nearly = Score { iae: 100.00497, ..score.clone() };
        assert_eq!(small.shortfall(&nearly).unwrap(), "IAE 4.97e-3 % more");
        assert_eq!(with(&|score| score.iae = f64::NAN), "its loop leaves the finite numbers");
        assert_eq!(with(&|score| score.failed = 0.2), "20 % of its steps fail");
        assert_eq!(
            with(&|score| score.violation = 0.5),
            "violates a bound by 5.0e-1 of its range more"
        );
        let beyond = "beyond control.error_tolerance in 3 of 100 steps";
        assert_eq!(with(&|score| score.beyond = 3), beyond);
        // An integrator made these steps, or the net's predictions were corrected.
        let helped = Standard { only_counts: false, ..standard.clone() };
        assert!(helped.is_good(&Score { beyond: 3, ..score.clone() }));
        assert_eq!(with(&|score| score.iae = 90.0), "");
        let unsound = |score: &mut Score| score.unsound = Some("unstable at 46 of 200".to_owned());
        assert_eq!(with(&unsound), "unstable at 46 of 200");
        let nearly = |iae: f64| standard.is_nearly_good(&Score { iae, ..score.clone() });
        assert!(!nearly(100.9) && nearly(101.1) && nearly(101.9) && !nearly(102.1));
    }
}
