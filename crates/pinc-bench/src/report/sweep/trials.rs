//! The trials of a sweep, as `sweep.csv`, `summary.csv` and `timings.csv` have them.

use super::super::ReportError;
use super::super::table::Table;
use pinc_chart::text;
use std::path::{Path, PathBuf};

/// The trials, with the cells that they make up.
#[derive(Debug)]
pub(in crate::report) struct Trials {
    dir: PathBuf,
    table: Table,
    /// The times of the same trials, row by row.
    timings: Option<Table>,
    /// The columns that tell the cells apart.
    columns: Vec<String>,
    cells: Vec<Cell>,
}

/// A place in the grid, with the rows of its trials.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    /// The values of the columns that tell the cells apart.
    pub(super) place: Vec<String>,
    /// Rows of trials that ended as they should.
    pub(super) finished: Vec<usize>,
    pub(super) failed: Vec<usize>,
    pub(super) pending: Vec<usize>,
}

impl Cell {
    pub(super) fn done(&self) -> usize {
        self.finished.len()
    }
}

/// How a metric varies in a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    pub(super) min: f64,
    pub(super) q1: f64,
    pub(super) median: f64,
    pub(super) q3: f64,
    pub(super) max: f64,
}

impl Trials {
    /// Reads `sweep.csv`, with the columns of cells that `summary.csv` names; `None` if there is no
    /// sweep in `dir`.
    pub(in crate::report) fn read(dir: &Path) -> Result<Option<Self>, ReportError> {
        let Some(table) = Table::read(&dir.join("sweep.csv"))? else { return Ok(None) };
        let columns = match Table::read(&dir.join("summary.csv"))? {
            Some(summary) => {
                let columns = summary.headers().iter().take_while(|h| *h != "metric");
                columns.cloned().collect()
            }
            None => Vec::new(),
        };
        let cells = cells(&table, &columns)?;
        let timings = Table::read(&dir.join("timings.csv"))?.filter(|t| t.len() == table.len());
        Ok(Some(Self { dir: dir.to_owned(), table, timings, columns, cells }))
    }

    pub(super) fn columns(&self) -> &[String] {
        &self.columns
    }

    pub(super) fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The axes of the grid: the columns other than names of alternatives.
    pub(super) fn axes(&self) -> Vec<usize> {
        let is_axis = |i: &usize| !["case", "drawn"].contains(&self.columns[*i].as_str());
        (0..self.columns.len()).filter(is_axis).collect()
    }

    /// Whether there are trials that differ by draws.
    pub(super) fn has_draws(&self) -> bool {
        self.table.has("draw")
    }

    /// Whether a metric, or a time, is there.
    pub(super) fn has(&self, column: &str) -> bool {
        self.table_of(column).has(column)
    }

    /// The table with the column, that of metrics if none has it.
    pub(super) fn table_of(&self, column: &str) -> &Table {
        let timings = self.timings.as_ref().filter(|timings| timings.has(column));
        timings.unwrap_or(&self.table)
    }

    /// Whether no cell has more than one finished trial, so that nothing can be said of a spread.
    pub(super) fn are_alone(&self) -> bool {
        self.cells.iter().all(|cell| cell.done() <= 1)
    }

    /// The numbers of all trials, of those that failed and of those not yet run.
    pub(super) fn counts(&self) -> (usize, usize, usize) {
        let sum = |count: fn(&Cell) -> usize| self.cells.iter().map(count).sum();
        (self.table.len(), sum(|c| c.failed.len()), sum(|c| c.pending.len()))
    }

    /// A metric of a cell's trials, as far as they are numbers.
    pub(super) fn values(&self, cell: &Cell, column: &str) -> Result<Vec<f64>, ReportError> {
        let all = self.table_of(column).numbers(column)?;
        let values = cell.finished.iter().map(|i| all[*i]);
        Ok(values.filter(|v| v.is_finite()).collect())
    }

    /// A word of the first finished trial of a cell.
    pub(super) fn text(&self, cell: &Cell, column: &str) -> Option<&str> {
        let row = *cell.finished.first()?;
        self.table.texts(column).ok()?.get(row).copied()
    }

    /// How a metric, or a time, varies in a cell; `None` without a number.
    pub(super) fn spread(&self, cell: &Cell, column: &str) -> Option<Spread> {
        let spread = crate::sweep::Spread::of(self.values(cell, column).ok()?)?;
        let [min, q1, median, q3, max] =
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| spread.quantile(part));
        Some(Spread { min, q1, median, q3, max })
    }

    /// What a cell is called: its alternatives, and its places on the axes.
    pub(super) fn name(&self, cell: &Cell) -> String {
        let word = |(column, value): (&String, &String)| match column.as_str() {
            "case" | "drawn" => value.clone(),
            key => format!("{} {}", short(key), shown(value)),
        };
        let words: Vec<String> = self.columns.iter().zip(&cell.place).map(word).collect();
        if words.is_empty() { "all trials".to_owned() } else { words.join(", ") }
    }

    /// The free run of a case's first finished trial, if it was kept.
    pub(super) fn free_run(&self, case: &str) -> Result<Option<Table>, ReportError> {
        let Some(column) = self.columns.iter().position(|c| c == "case") else { return Ok(None) };
        let mut cells = self.cells.iter().filter(|cell| cell.place[column] == case);
        let Some(row) = cells.find_map(|cell| cell.finished.first()) else { return Ok(None) };
        let trial = self.table.texts("trial")?[*row];
        Table::read(&self.dir.join("trials").join(trial).join("prediction.csv"))
    }

    /// The trials that failed: their names, their places and what went wrong.
    pub(super) fn failures(&self) -> Result<Vec<Vec<String>>, ReportError> {
        let (names, errors) = (self.table.texts("trial")?, self.table.texts("error")?);
        let seeds = self.table.texts("seed")?;
        let row = |cell: &Cell, i: usize| {
            let what = format!("{}, seed {}", self.name(cell), seeds[i]);
            vec![names[i].to_owned(), what, errors[i].to_owned()]
        };
        let failed = self.cells.iter().flat_map(|cell| cell.failed.iter().map(move |i| (cell, *i)));
        Ok(failed.map(|(cell, i)| row(cell, i)).collect())
    }

    /// The different values of a column of the cells, numbers in their order.
    pub(super) fn values_of(&self, column: usize) -> Vec<String> {
        let mut values: Vec<String> = Vec::new();
        for cell in &self.cells {
            if !values.contains(&cell.place[column]) {
                values.push(cell.place[column].clone());
            }
        }
        let numbers: Result<Vec<f64>, _> = values.iter().map(|v| v.parse()).collect();
        if let Ok(numbers) = numbers {
            let mut pairs: Vec<_> = numbers.into_iter().zip(values).collect();
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            return pairs.into_iter().map(|pair| pair.1).collect();
        }
        values
    }
}

fn cells(table: &Table, columns: &[String]) -> Result<Vec<Cell>, ReportError> {
    let places = columns.iter().map(|column| table.texts(column));
    let places = places.collect::<Result<Vec<_>, _>>()?;
    let statuses = table.texts("status")?;
    let mut cells: Vec<Cell> = Vec::new();
    for (row, status) in statuses.into_iter().enumerate() {
        let place: Vec<String> = places.iter().map(|column| column[row].to_owned()).collect();
        let known = cells.iter().position(|cell| cell.place == place);
        let index = known.unwrap_or_else(|| {
            let (finished, failed, pending) = (Vec::new(), Vec::new(), Vec::new());
            cells.push(Cell { place, finished, failed, pending });
            cells.len() - 1
        });
        let cell = &mut cells[index];
        match status {
            "done" => cell.finished.push(row),
            "pending" => cell.pending.push(row),
            _ => cell.failed.push(row),
        }
    }
    Ok(cells)
}

/// What a key of the config is called on an axis.
pub(super) fn short(key: &str) -> String {
    match key {
        "model.hidden_layers" => "hidden layers".to_owned(),
        "model.neurons" => "neurons per layer".to_owned(),
        "model.sample_time_s" => "horizon T (s)".to_owned(),
        "training.collocation_points" => "collocation points N_f".to_owned(),
        "training.initial_points" => "initial points N_t".to_owned(),
        "control.n2" => "steps of the horizon, N2".to_owned(),
        "control.rk4_substeps" => "substeps of RK4".to_owned(),
        "control.rk5_substeps" => "substeps of RK5".to_owned(),
        "control.rosenbrock_substeps" => "substeps of the Rosenbrock method".to_owned(),
        key => key.rsplit('.').next().unwrap_or(key).replace('_', " "),
    }
}

/// A value of an axis as a reader likes it.
pub(super) fn shown(value: &str) -> String {
    value.parse().map_or_else(|_| value.to_owned(), |number| text::number(number, 6))
}
