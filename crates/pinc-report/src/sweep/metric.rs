//! The numbers of trials that a sweep's report shows.

use crate::data::Run;
use crate::trials::{Cell, Spread, Trials};
use pinc_chart::text;
use pinc_config::ModelKind;
use pinc_record::TrialMetric;
use pinc_record::metric::{self, Metric as Row};

/// A number of the trials that is worth a picture.
#[derive(Clone, Debug)]
pub(super) struct Metric {
    /// The columns of `sweep.csv` or `timings.csv`, each with what it is of: a model, or nothing if
    /// there is one.
    pub(super) columns: Vec<(TrialMetric, &'static str)>,
    /// Stem of a file.
    pub(super) stem: &'static str,
    pub(super) title: &'static str,
    /// What an axis calls it.
    pub(super) label: String,
    /// How many of the label's units are one of the columns'.
    factor: f64,
    /// Whether its logarithm says more.
    pub(super) log: bool,
}

impl Metric {
    /// One of its columns for a cell's trials, as far as they are numbers, in the label's unit.
    pub(super) fn values(&self, trials: &Trials, cell: &Cell, column: TrialMetric) -> Vec<f64> {
        let values = trials.values(cell, column);
        values.into_iter().map(|value| self.factor * value).collect()
    }

    /// How one of its columns varies in a cell, in the label's unit; `None` without a number.
    pub(super) fn spread(
        &self,
        trials: &Trials,
        cell: &Cell,
        column: TrialMetric,
    ) -> Option<Spread> {
        let Spread { min, q1, median, q3, max, counts } = trials.spread(cell, column)?;
        let [min, q1, median, q3, max] = [min, q1, median, q3, max].map(|v| self.factor * v);
        Some(Spread { min, q1, median, q3, max, counts })
    }

    /// The spreads of a column in all cells that have numbers.
    fn spreads<'a>(
        &'a self,
        trials: &'a Trials,
        column: TrialMetric,
    ) -> impl Iterator<Item = Spread> + 'a {
        trials.cells().iter().filter_map(move |cell| self.spread(trials, cell, column))
    }

    /// Whether some trial has such a number.
    fn is_known(&self, trials: &Trials) -> bool {
        self.columns.iter().any(|(column, _)| self.spreads(trials, *column).next().is_some())
    }

    /// The value that every trial of every cell has in common, in all columns, if there are
    /// several.
    fn constant(&self, trials: &Trials) -> Option<f64> {
        let spreads = self.columns.iter().flat_map(|(column, _)| self.spreads(trials, *column));
        let ends = spreads.map(|spread| (spread.min, spread.max));
        let (low, high) = ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        (trials.counts().0 > 1 && low.total_cmp(&high).is_eq()).then_some(low)
    }

    /// The least number of significant digits, from three on, that tells the cells' different
    /// medians apart.
    pub(super) fn digits(&self, trials: &Trials) -> usize {
        const MOST: usize = 7;
        let spreads = self.columns.iter().flat_map(|(column, _)| self.spreads(trials, *column));
        let mut medians: Vec<f64> = spreads.map(|spread| spread.median).collect();
        medians.sort_by(f64::total_cmp);
        medians.dedup();
        let apart = |digits: &usize| {
            let shown = medians.iter().map(|median| text::significant(*median, *digits));
            let mut shown: Vec<String> = shown.collect();
            shown.dedup();
            shown.len() == medians.len()
        };
        (3..MOST).find(apart).unwrap_or(MOST)
    }
}

/// The metrics that the sweep's tables have.
#[derive(Debug)]
pub(super) struct Selection {
    /// Those that say something about the cells, or the trials of a cell.
    pub(super) varying: Vec<Metric>,
    /// Those that are the same in all trials, and their value, beside others that vary.
    pub(super) constant: Vec<(Metric, f64)>,
}

impl Selection {
    pub(super) fn of(run: &Run, trials: &Trials) -> Self {
        let (mut varying, mut constant) = (Vec::new(), Vec::new());
        let all = metrics(run, trials).into_iter().chain(time(trials));
        let (known, unknown): (Vec<_>, Vec<_>) = all.partition(|metric| metric.is_known(trials));
        // Loops without a net have no error of one; without any numbers the report says so.
        for metric in if known.is_empty() { unknown } else { known } {
            match metric.constant(trials) {
                Some(value) => constant.push((metric, value)),
                None => varying.push(metric),
            }
        }
        if varying.is_empty() {
            varying = constant.drain(..).map(|(metric, _)| metric).collect();
        }
        Self { varying, constant }
    }

    /// " The same in every trial: validation MSE (cm²) 1.24·10⁻⁶."; nothing if there is no such
    /// metric.
    pub(super) fn sentence(&self) -> String {
        let shown = |(metric, value): &(Metric, f64)| {
            format!("{} {}", metric.label, text::significant(*value, 3))
        };
        let shown: Vec<String> = self.constant.iter().map(shown).collect();
        match shown.is_empty() {
            true => String::new(),
            false => format!(" The same in every trial: {}.", text::listed(&shown)),
        }
    }
}

/// The metrics that the sweep's table has, and that differ among the trials of one cell if these
/// are draws.
fn metrics(run: &Run, trials: &Trials) -> Vec<Metric> {
    let pictured = |metric: &'static Row, stem: &'static str, title: &'static str, log: bool| {
        let columns = if metric.is_of_models() {
            of_models(trials, metric)
        } else {
            vec![(metric.of_net(), "")]
        };
        Metric { columns, stem, title, label: run.label_of(metric), factor: 1.0, log }
    };
    let mse = "Validation error";
    let all = [
        // As the picture of a training calls it.
        Metric {
            label: run.label_in_all_states_unit("validation MSE", "²"),
            ..pictured(&metric::MSE_GEN, "mse", mse, true)
        },
        pictured(&metric::FREE_RUN_RMSE, "free-run-rmse", "Error of the free run", true),
        pictured(
            &metric::IAE_DENSE_SUM,
            "iae",
            "Closed loop: integral of the absolute error",
            false,
        ),
        pictured(&metric::RMSE_DENSE, "rmse", "Closed loop: root mean square error", false),
    ];
    // What cases are told apart by, beside how well they follow, and why plants are drawn.
    let offset = pictured(&metric::OFFSET_MAX, "offset", "Closed loop: offset at rest", false);
    let (title, stem) = ("Closed loop: violation of bounds", "violation");
    let violation = pictured(&metric::MAX_VIOLATION, stem, title, false);
    let of_cases = trials.are_of_cases().then_some(offset);
    let of_cases = of_cases.into_iter().chain(trials.has_draws().then_some(violation));
    let is_worth = |metric: &Metric, column: TrialMetric| {
        let varies = || metric.spreads(trials, column).any(|spread| spread.max > spread.min);
        trials.has(column) && (!trials.has_draws() || trials.are_of_cases() || varies())
    };
    let present = |metric: Metric| {
        let columns = metric.columns.iter().filter(|(column, _)| is_worth(&metric, *column));
        let columns: Vec<_> = columns.copied().collect();
        (!columns.is_empty()).then_some(Metric { columns, ..metric })
    };
    all.into_iter().chain(of_cases).filter_map(present).collect()
}

/// The time of the controller, where a sweep has one axis and so shows what it depends on.
fn time(trials: &Trials) -> Option<Metric> {
    let metric = Metric {
        columns: of_models(trials, &metric::WALL),
        stem: "time",
        title: "Closed loop: the controller's time",
        label: "controller's time in the whole loop (ms)".to_owned(),
        factor: 1e3,
        log: true,
    };
    let shown = trials.axes().len() == 1 && !trials.has_draws() && !metric.columns.is_empty();
    shown.then_some(metric)
}

/// The columns of each model's metric that the sweep's tables have, and the models' names.
fn of_models(trials: &Trials, metric: &'static Row) -> Vec<(TrialMetric, &'static str)> {
    let columns = ModelKind::ALL.map(|model| (metric.with(model), model.title())).into_iter();
    columns.filter(|(column, _)| trials.has(*column)).collect()
}
