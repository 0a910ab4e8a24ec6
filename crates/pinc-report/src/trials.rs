//! The trials of a sweep by cells, as `sweep.csv` and `timings.csv` have them.

use pinc_chart::text;
use pinc_config::{CASE, ControlSpec, DRAW, DRAWN, Experiment, ModelKind, SEED, cell_columns};
use pinc_ode::Integrator;
use pinc_record::{
    PredictionTable, RecordError, SweepDir, TrialColumn, TrialMetric, TrialStatus, TrialTable, file,
};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// The trials, with the cells that they make up.
#[derive(Debug)]
pub(crate) struct Trials {
    dir: PathBuf,
    table: TrialTable,
    /// The times of the same trials, row by row.
    timings: Option<TrialTable>,
    /// The columns that tell the cells apart.
    columns: Vec<String>,
    cells: Vec<Cell>,
}

/// A place in the grid, with the rows of its trials.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    /// The values of the columns that tell the cells apart.
    pub(crate) place: Vec<String>,
    /// Rows of trials that ended as they should.
    pub(crate) finished: Vec<usize>,
    pub(crate) failed: Vec<usize>,
    pub(crate) pending: Vec<usize>,
}

impl Cell {
    pub(crate) fn done(&self) -> usize {
        self.finished.len()
    }
}

/// How a metric varies in a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    pub(crate) min: f64,
    pub(crate) q1: f64,
    pub(crate) median: f64,
    pub(crate) q3: f64,
    pub(crate) max: f64,
    /// How many values there are, and how many are not 0.
    pub(crate) counts: [usize; 2],
}

impl Trials {
    /// Reads the tables of the sweep in `dir`; `None` if there is none.
    pub(crate) fn read(dir: &Path, experiment: &Experiment) -> Result<Option<Self>, RecordError> {
        let Some(sweep) = &experiment.sweep else { return Ok(None) };
        let columns = TrialColumn::of_sweep(experiment, sweep, &ModelKind::ALL);
        let Some(table) = TrialTable::read(&dir.join(file::SWEEP), columns)? else {
            return Ok(None);
        };
        let columns = TrialColumn::of_timings(experiment, &ModelKind::ALL);
        let timings = TrialTable::read(&dir.join(file::TIMINGS), columns)?;
        let timings = timings.filter(|timings| timings.len() == table.len());
        let columns = cell_columns(sweep);
        let cells = cells(&table, &columns);
        Ok(Some(Self { dir: dir.to_owned(), table, timings, columns, cells }))
    }

    pub(crate) fn columns(&self) -> &[String] {
        &self.columns
    }

    pub(crate) fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The axes of the grid: the columns other than names of alternatives.
    pub(crate) fn axes(&self) -> Vec<usize> {
        let is_axis = |i: &usize| ![CASE, DRAWN].contains(&self.columns[*i].as_str());
        (0..self.columns.len()).filter(is_axis).collect()
    }

    /// Whether there are trials that differ by draws.
    pub(crate) fn has_draws(&self) -> bool {
        self.table.has(&TrialColumn::Choice(DRAW.to_owned()))
    }

    /// Whether there are cases, each tried with the same draws.
    pub(crate) fn are_of_cases(&self) -> bool {
        self.has_draws() && self.columns.iter().any(|column| column == CASE)
    }

    /// Whether a metric, or a time, is there.
    pub(crate) fn has(&self, metric: TrialMetric) -> bool {
        self.table_of(metric).0.has(&TrialColumn::Metric(metric))
    }

    /// The name of the file with a metric or a time.
    pub(crate) fn file_of(&self, metric: TrialMetric) -> &'static str {
        self.table_of(metric).1
    }

    /// The table with the metric, or the table of results if none has it, and the name of its file.
    fn table_of(&self, metric: TrialMetric) -> (&TrialTable, &'static str) {
        let has = |timings: &&TrialTable| timings.has(&TrialColumn::Metric(metric));
        match self.timings.as_ref().filter(has) {
            Some(timings) => (timings, file::TIMINGS),
            None => (&self.table, file::SWEEP),
        }
    }

    /// Whether no cell has more than one finished trial, so that nothing can be said of a spread.
    pub(crate) fn are_alone(&self) -> bool {
        self.cells.iter().all(|cell| cell.done() <= 1)
    }

    /// What a cell has in one of the columns that tell cells apart.
    pub(crate) fn place<'a>(&self, cell: &'a Cell, column: &str) -> Option<&'a str> {
        let place = self.columns.iter().position(|known| known == column)?;
        cell.place.get(place).map(String::as_str)
    }

    /// What a trial has for a key.
    pub(crate) fn choice(&self, row: usize, key: &str) -> &str {
        self.table.cell(row, &TrialColumn::Choice(key.to_owned()))
    }

    /// The numbers of all trials, of those that failed and of those not yet run.
    pub(crate) fn counts(&self) -> (usize, usize, usize) {
        let sum = |count: fn(&Cell) -> usize| self.cells.iter().map(count).sum();
        (self.table.len(), sum(|c| c.failed.len()), sum(|c| c.pending.len()))
    }

    /// A metric of a cell's trials, as far as they are finite.
    pub(crate) fn values(&self, cell: &Cell, metric: TrialMetric) -> Vec<f64> {
        let (table, _) = self.table_of(metric);
        let values = cell.finished.iter().map(|&row| table.number(row, metric));
        values.filter(|v| v.is_finite()).collect()
    }

    /// The text of a metric of a cell's first finished trial.
    pub(crate) fn text(&self, cell: &Cell, metric: TrialMetric) -> Option<&str> {
        let row = *cell.finished.first()?;
        Some(self.table.cell(row, &TrialColumn::Metric(metric)))
    }

    /// How a metric, or a time, varies in a cell; `None` without a number.
    pub(crate) fn spread(&self, cell: &Cell, metric: TrialMetric) -> Option<Spread> {
        let spread = pinc_record::Spread::of(self.values(cell, metric))?;
        let [min, q1, median, q3, max] =
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| spread.quantile(part));
        let counts = [spread.count(), spread.nonzero()];
        Some(Spread { min, q1, median, q3, max, counts })
    }

    /// What a cell is called: its alternatives, and its places on the axes.
    pub(crate) fn name(&self, cell: &Cell) -> String {
        let name = |(column, value): (&String, &String)| match column.as_str() {
            CASE | DRAWN => value.clone(),
            key => format!("{} {}", short(key), shown(value)),
        };
        let names: Vec<String> = self.columns.iter().zip(&cell.place).map(name).collect();
        if names.is_empty() { "all trials".to_owned() } else { names.join(", ") }
    }

    /// The free run of a case's first finished trial, if it was kept.
    pub(crate) fn free_run(&self, case: &str) -> Result<Option<PredictionTable>, RecordError> {
        let Some(column) = self.columns.iter().position(|c| c == CASE) else { return Ok(None) };
        let mut cells = self.cells.iter().filter(|cell| cell.place[column] == case);
        let Some(row) = cells.find_map(|cell| cell.finished.first()) else { return Ok(None) };
        let trial = self.table.cell(*row, &TrialColumn::Trial);
        PredictionTable::read(&SweepDir::of(&self.dir).trial(trial).join(file::PREDICTION))
    }

    /// The trials that failed: their names, their places and what went wrong.
    pub(crate) fn failures(&self) -> Vec<Vec<String>> {
        let seed = TrialColumn::Choice(SEED.to_owned());
        let row = |cell: &Cell, i: usize| {
            let what = format!("{}, seed {}", self.name(cell), self.table.cell(i, &seed));
            let [name, error] = [TrialColumn::Trial, TrialColumn::Error]
                .map(|column| self.table.cell(i, &column).to_owned());
            vec![name, what, error]
        };
        let failed = self.cells.iter().flat_map(|cell| cell.failed.iter().map(move |i| (cell, *i)));
        failed.map(|(cell, i)| row(cell, i)).collect()
    }

    /// The different values of a column of the cells, numbers in their order.
    pub(crate) fn values_of(&self, column: usize) -> Vec<String> {
        let mut known = HashSet::new();
        let all = self.cells.iter().map(|cell| &cell.place[column]);
        let values: Vec<String> = all.filter(|value| known.insert(*value)).cloned().collect();
        let numbers: Result<Vec<f64>, _> = values.iter().map(|v| v.parse()).collect();
        if let Ok(numbers) = numbers {
            let mut pairs: Vec<_> = numbers.into_iter().zip(values).collect();
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            return pairs.into_iter().map(|pair| pair.1).collect();
        }
        values
    }
}

fn cells(table: &TrialTable, columns: &[String]) -> Vec<Cell> {
    let choices: Vec<TrialColumn> = columns.iter().cloned().map(TrialColumn::Choice).collect();
    let mut cells: Vec<Cell> = Vec::new();
    let mut known = HashMap::new();
    for row in 0..table.len() {
        let place = choices.iter().map(|choice| table.cell(row, choice).to_owned());
        let place: Vec<String> = place.collect();
        let index = *known.entry(place).or_insert_with_key(|place| {
            let (finished, failed, pending) = (Vec::new(), Vec::new(), Vec::new());
            cells.push(Cell { place: place.clone(), finished, failed, pending });
            cells.len() - 1
        });
        let cell = &mut cells[index];
        match TrialStatus::of(table.cell(row, &TrialColumn::Status)) {
            TrialStatus::Done => cell.finished.push(row),
            TrialStatus::Pending => cell.pending.push(row),
            TrialStatus::Failed => cell.failed.push(row),
            TrialStatus::Dropped => {}
        }
    }
    cells
}

/// What a key of the config is called on an axis.
pub(crate) fn short(key: &str) -> String {
    match key {
        "model.hidden_layers" => "hidden layers".to_owned(),
        "model.neurons" => "neurons per layer".to_owned(),
        "model.horizon_s" => "step T (s)".to_owned(),
        "training.collocation_points" => "collocation points N_f".to_owned(),
        "training.initial_points" => "initial points N_t".to_owned(),
        "control.n2" => "steps of the horizon, N2".to_owned(),
        key => {
            let of = |method: Integrator| ControlSpec::substeps_key(method);
            let is_of = |method: &Integrator| key.strip_prefix("control.") == Some(&of(*method));
            if let Some(method) = Integrator::ALL.into_iter().find(is_of) {
                return format!("substeps of {}", method.title());
            }
            // An entry of a list is named after the list.
            let is_place = |part: &&str| part.bytes().all(|b| b.is_ascii_digit());
            let name = key.rsplit('.').find(|part| !is_place(part)).unwrap_or(key);
            let place = key.rsplit('.').take_while(is_place);
            std::iter::once(name).chain(place).collect::<Vec<_>>().join(" ").replace('_', " ")
        }
    }
}

/// A value of an axis as a reader likes it.
pub(crate) fn shown(value: &str) -> String {
    value.parse().map_or_else(|_| value.to_owned(), |number| text::number(number, 6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_without_a_name_of_their_own_are_called_by_their_last_words() {
        assert_eq!(short("control.sqp.max_iterations"), "max iterations");
        assert_eq!(short("control.measurement.noise_sd.0"), "noise sd 0");
        assert_eq!(short("training.phases.0.iterations"), "iterations");
        assert_eq!(short("plant.mu2"), "mu2");
    }
}
