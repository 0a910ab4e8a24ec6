//! `pinc predict`: the free run of a trained net under given inputs, from CSV to CSV.

use super::chain::Chain;
use crate::BenchError;
use crate::error::CsvProblem;
use crate::record::{Table, number, write_atomically};
use csv::StringRecord;
use pinc_net::PincNet;
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Reads the inputs from the file `inputs`, lets the net of the file `model` run freely, and writes
/// its states to the file `output`.
///
/// The input has the columns `scenario`, `t`, the net's inputs, the net's states, in any order. The
/// first row of a scenario gives its initial state; the inputs of a row hold until the scenario's
/// next; other state cells may be empty. The net is chained every T from the scenario's first row
/// on and asked at the times between. Where the inputs change within an interval of T, the chain is
/// restarted: a new interval begins at that row. The output has the same columns.
///
/// # Errors
///
/// [`BenchError`], naming file, line and column of what is wrong with the input.
pub fn predict(model: &Path, inputs: &Path, output: &Path) -> Result<(), BenchError> {
    let net = super::chainable(model, super::read_model(model)?)?;
    let text = fs::read(inputs).map_err(BenchError::unreadable(inputs))?;
    let table = run(&net, &text).map_err(|(line, problem)| BenchError::Csv {
        path: inputs.to_owned(),
        line,
        problem,
    })?;
    write_atomically(output, table.as_bytes())
}

/// The output for an input file's text; an error comes with its line.
fn run(net: &PincNet, text: &[u8]) -> Result<Table, (u64, CsvProblem)> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
    let header = reader.headers().map_err(syntax)?.clone();
    let columns = Columns::find(net, &header).map_err(|problem| (1, problem))?;
    let mut table = Table::new(&header);
    let mut chains: HashMap<String, Chain> = HashMap::new();
    for record in reader.into_records() {
        let record = record.map_err(syntax)?;
        let line = record.position().map_or(0, csv::Position::line);
        let row = columns.read(&record).map_err(|problem| (line, problem))?;
        let state = match chains.get_mut(row.scenario) {
            Some(chain) => continue_chain(net, chain, &row),
            None => begin_chain(net, &mut chains, &columns, &row),
        };
        let state = state.map_err(|problem| (line, problem))?;
        table.push(&columns.write(&record, &state));
    }
    Ok(table)
}

fn begin_chain(
    net: &PincNet,
    chains: &mut HashMap<String, Chain>,
    columns: &Columns,
    row: &Row<'_>,
) -> Result<Vec<f64>, CsvProblem> {
    let state = row.states.iter().zip(&columns.states).map(|(value, (_, name))| {
        value.ok_or_else(|| CsvProblem::Cell { column: name.clone(), found: String::new() })
    });
    let state = state.collect::<Result<Vec<_>, _>>()?;
    let chain = Chain::new(net.horizon_s(), row.t, &state, &row.inputs);
    chains.insert(row.scenario.to_owned(), chain);
    Ok(state)
}

fn continue_chain(net: &PincNet, chain: &mut Chain, row: &Row<'_>) -> Result<Vec<f64>, CsvProblem> {
    let previous = chain.time();
    if row.t <= previous {
        return Err(CsvProblem::Time { t: row.t, previous });
    }
    if !chain.reaches(row.t) {
        return Err(CsvProblem::Gap { t: row.t });
    }
    let sample = chain.advance(&|t, y0, u| net.evaluate(t, y0, u), row.t, &row.inputs);
    Ok(sample.state)
}

fn syntax(error: csv::Error) -> (u64, CsvProblem) {
    let line = error.position().map_or(1, csv::Position::line);
    (line, CsvProblem::Syntax(error))
}

/// Where in a row the columns are, with their names.
struct Columns {
    scenario: usize,
    t: usize,
    inputs: Vec<(usize, String)>,
    states: Vec<(usize, String)>,
}

/// One row; a state cell may be empty.
struct Row<'a> {
    scenario: &'a str,
    t: f64,
    inputs: Vec<f64>,
    states: Vec<Option<f64>>,
}

impl Columns {
    fn find(net: &PincNet, header: &StringRecord) -> Result<Self, CsvProblem> {
        let fixed = ["scenario".to_owned(), "t".to_owned()];
        let names = fixed.iter().chain(net.input_names()).chain(net.state_names());
        let expected = || names.clone().cloned().collect::<Vec<_>>().join(",");
        for (i, column) in header.iter().enumerate() {
            let known = names.clone().any(|name| name == column);
            if !known || header.iter().take(i).any(|before| before == column) {
                let column = column.to_owned();
                return Err(CsvProblem::UnexpectedColumn { column, expected: expected() });
            }
        }
        let place = |name: &String| {
            let missing =
                || CsvProblem::MissingColumn { column: name.clone(), expected: expected() };
            header.iter().position(|column| column == name).ok_or_else(missing)
        };
        let places = |names: &[String]| {
            let named = names.iter().map(|name| Ok((place(name)?, name.clone())));
            named.collect::<Result<Vec<_>, CsvProblem>>()
        };
        Ok(Self {
            scenario: place(&fixed[0])?,
            t: place(&fixed[1])?,
            inputs: places(net.input_names())?,
            states: places(net.state_names())?,
        })
    }

    fn read<'a>(&self, record: &'a StringRecord) -> Result<Row<'a>, CsvProblem> {
        let states = self.states.iter().map(|(place, name)| match &record[*place] {
            "" => Ok(None),
            cell => finite(cell, name).map(Some),
        });
        let inputs = self.inputs.iter().map(|(place, name)| finite(&record[*place], name));
        Ok(Row {
            scenario: &record[self.scenario],
            t: finite(&record[self.t], "t")?,
            inputs: inputs.collect::<Result<_, _>>()?,
            states: states.collect::<Result<_, _>>()?,
        })
    }

    /// The cells of `record` with `state` in its state columns.
    fn write(&self, record: &StringRecord, state: &[f64]) -> Vec<String> {
        let mut cells: Vec<String> = record.iter().map(quoted).collect();
        for ((place, _), value) in self.states.iter().zip(state) {
            cells[*place] = number(*value);
        }
        cells
    }
}

fn finite(cell: &str, column: &str) -> Result<f64, CsvProblem> {
    match cell.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(CsvProblem::Cell { column: column.to_owned(), found: cell.to_owned() }),
    }
}

/// A cell as it has to be written: a scenario's name may hold commas and quotes.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}
