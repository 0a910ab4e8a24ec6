//! `pinc predict`: the free run of a trained net under given inputs, from CSV to CSV.

use super::chain::Chain;
use super::guard::Guard;
use crate::{RunError, check_match};
use csv::StringRecord;
use pinc_config::{Experiment, OutsidePolicy};
use pinc_net::{PincNet, TrainingTarget};
use pinc_ode::DynPlant;
use pinc_record::columns::{finite, not_finite, not_later, optional, places, rows, too_far};
use pinc_record::{CsvText, OutsideDomain, check_output, number, read_file, write_output};
use pinc_verify::{ChainedError, ErrorEstimate};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The estimate of the error of one step of `net` as a model of the experiment's plant.
///
/// # Errors
///
/// [`RunError::Usage`] if the net is not one of the experiment's plant and step length, and
/// [`RunError::Verify`] if the plant is a black box, or the net knows one scenario only.
pub fn error_estimate(experiment: &Experiment, net: &PincNet) -> Result<ErrorEstimate, RunError> {
    check_match(experiment, Path::new("model"), net)?;
    Ok(ErrorEstimate::new(net, &*family(experiment, net))?)
}

/// The experiment's plant with the parameters that the net takes.
fn family(experiment: &Experiment, net: &PincNet) -> Box<dyn DynPlant> {
    experiment.plant.family(&net.parameter_names().collect::<Vec<_>>())
}

/// Reads the inputs from the file `inputs`, lets the net of the file `model` run freely, and writes
/// its states to the file `output`.
///
/// The input has the columns `scenario`, `t`, the net's inputs, the parameters that the net takes as inputs, if
/// there are any, and the net's states, in any order. The first row of a scenario gives its initial state; the
/// inputs and parameters of a row hold until the scenario's next; other state cells may be empty. The net is
/// chained every T from the scenario's first row on and asked at the times between. Where the inputs change
/// within an interval of T, the chain is restarted: a new interval begins at that row. The output has the same
/// columns. A distilled net cannot be asked between steps: all rows have to lie on step marks.
///
/// With `judged`, the config whose plant the net stands for, each state has one more column,
/// `<state>_err`: the estimated error of this value, to first order, which the chain carries on.
///
/// Returns how often and how far the net was asked outside its training domain, row by row.
///
/// # Errors
///
/// [`RunError`], naming file, line and column of what is wrong with the input; [`RunError::Failed`] if a state
/// is no number, or the net was asked outside its training domain and `policy` is to refuse that.
pub fn predict(
    model: &Path,
    inputs: &Path,
    output: &Path,
    policy: OutsidePolicy,
    judged: Option<&Experiment>,
) -> Result<OutsideDomain, RunError> {
    let config = judged.map(|experiment| PathBuf::from(experiment.source()));
    let read = [("--model", model), ("--inputs", inputs)].into_iter();
    let read = read.chain(config.iter().map(|config| ("the config", &**config)));
    check_output(("--output", output), read)?;
    let net = match judged {
        Some(experiment) => super::read_matching_model(experiment, model)?.1,
        None => super::chainable(model, super::read_model(model)?)?,
    };
    let mut errors =
        judged.map(|experiment| ChainedError::new(&net, family(experiment, &net))).transpose()?;
    let text = read_file(inputs)?;
    let mut guard = Guard::of_command(&net, policy);
    let table = run(&net, inputs, &text, (&mut guard, errors.as_mut()))?;
    write_output(output, table.as_bytes())?;
    Ok(guard.found())
}

/// The output for the text of the file `path`.
fn run(
    net: &PincNet,
    path: &Path,
    text: &[u8],
    (guard, mut errors): (&mut Guard<'_>, Option<&mut ChainedError>),
) -> Result<CsvText, RunError> {
    let at = |(line, problem)| RunError::Csv { path: path.to_owned(), line, problem };
    let (header, rows) = rows(text).map_err(at)?;
    let columns = Columns::find(net, &header).map_err(|problem| at((1, problem)))?;
    let estimates =
        errors.iter().flat_map(|_| net.state_names().iter().map(|s| format!("{s}_err")));
    let mut table = CsvText::new(header.iter().map(str::to_owned).chain(estimates));
    let mut chains: HashMap<String, Chain> = HashMap::new();
    for row in rows {
        let (line, cells) = row.map_err(at)?;
        let row = columns.read(&cells).map_err(|problem| at((line, problem)))?;
        let state = match chains.get_mut(row.scenario) {
            Some(chain) => continue_chain(net, chain, &row, errors.as_deref_mut()),
            None => begin_chain(net, &mut chains, &columns, &row, errors.is_some()),
        };
        let both = state.map_err(|problem| at((line, problem)))?;
        let (state, error) = both.split_at(net.state_names().len());
        if let Some(i) = state.iter().position(|value| !value.is_finite()) {
            return Err(RunError::Failed(format!(
                "{}:{line}: the net's {} is {} at this row; the inputs or the initial state are \
                 too large for it, or the net is damaged",
                path.display(),
                net.state_names()[i],
                state[i]
            )));
        }
        let (u, p) = row.inputs.split_at(net.input_names().len());
        let outside = |error| RunError::Failed(format!("{}:{line}: {error}", path.display()));
        guard.look(state, u, p).map_err(outside)?;
        table
            .push(columns.write(&cells, state).into_iter().chain(error.iter().map(|e| number(*e))));
    }
    Ok(table)
}

/// The initial state of a chain, with its error if that is followed.
fn begin_chain(
    net: &PincNet,
    chains: &mut HashMap<String, Chain>,
    columns: &Columns,
    row: &InputRow<'_>,
    with_error: bool,
) -> Result<Vec<f64>, String> {
    let state = row
        .states
        .iter()
        .zip(&columns.states)
        .map(|(value, (_, name))| value.ok_or_else(|| not_finite("", name)));
    let mut state = state.collect::<Result<Vec<_>, _>>()?;
    // The initial state is given.
    state.resize(if with_error { 2 * state.len() } else { state.len() }, 0.0);
    let chain = Chain::new(net.sample_time_s(), row.t, &state, &row.inputs);
    chains.insert(row.scenario.to_owned(), chain);
    Ok(state)
}

/// The state that a chain has come to, with its error if that is followed.
fn continue_chain(
    net: &PincNet,
    chain: &mut Chain,
    row: &InputRow<'_>,
    mut errors: Option<&mut ChainedError>,
) -> Result<Vec<f64>, String> {
    let previous = chain.time();
    if row.t <= previous {
        return Err(not_later(row.t, previous));
    }
    if !chain.reaches(row.t) {
        return Err(too_far(row.t));
    }
    let mut step = |t, both: &[f64], held: &[f64]| {
        let (u, p) = held.split_at(net.input_names().len());
        let (y0, error) = both.split_at(net.state_names().len());
        let mut next = net.evaluate(t, y0, u, p);
        if let Some(errors) = errors.as_deref_mut() {
            next.extend(errors.step(net, t, [y0, u, p], error));
        }
        next
    };
    let sample = chain.advance(&mut step, row.t, &row.inputs);
    if net.source() == TrainingTarget::Integrator && !sample.mark {
        return Err(format!(
            "column `t`: {} s lies between steps of {} s, of which a net distilled from an \
             integrator knows nothing; expected times on step marks",
            row.t,
            net.sample_time_s()
        ));
    }
    Ok(sample.state)
}

/// Where in a row the columns are, with their names.
struct Columns {
    scenario: usize,
    t: usize,
    /// The columns of the inputs and the parameters.
    inputs: Vec<(usize, String)>,
    states: Vec<(usize, String)>,
}

/// One row; a state cell may be empty.
struct InputRow<'a> {
    scenario: &'a str,
    t: f64,
    /// The inputs, then the parameters.
    inputs: Vec<f64>,
    states: Vec<Option<f64>>,
}

impl Columns {
    fn find(net: &PincNet, header: &StringRecord) -> Result<Self, String> {
        let fixed = ["scenario".to_owned(), "t".to_owned()];
        let mut held = net.input_names().to_vec();
        held.extend(net.parameter_names().map(str::to_owned));
        let names = [&fixed[..], &held, net.state_names()].concat();
        let mut named = places(header, &names)?.into_iter().zip(names);
        let (scenario, t) = (named.next().map_or(0, |c| c.0), named.next().map_or(0, |c| c.0));
        let inputs = named.by_ref().take(held.len()).collect();
        Ok(Self { scenario, t, inputs, states: named.collect() })
    }

    fn read<'a>(&self, cells: &'a StringRecord) -> Result<InputRow<'a>, String> {
        let states = self.states.iter().map(|(place, name)| optional(&cells[*place], name));
        let inputs = self.inputs.iter().map(|(place, name)| finite(&cells[*place], name));
        Ok(InputRow {
            scenario: &cells[self.scenario],
            t: finite(&cells[self.t], "t")?,
            inputs: inputs.collect::<Result<_, _>>()?,
            states: states.collect::<Result<_, _>>()?,
        })
    }

    /// The row `cells` with `state` in its state columns.
    fn write(&self, cells: &StringRecord, state: &[f64]) -> Vec<String> {
        let mut cells: Vec<String> = cells.iter().map(str::to_owned).collect();
        for ((place, _), value) in self.states.iter().zip(state) {
            cells[*place] = number(*value);
        }
        cells
    }
}
