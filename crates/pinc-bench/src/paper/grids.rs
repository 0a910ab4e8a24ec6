//! The grids of Fig. 5, and the sweep over T.

use super::PLANTS;
use super::page::{Page, short};
use super::runs::{Row, Run, Runs, cell, number};
use crate::BenchError;
use crate::record::file;
use crate::sweep::Spread;
use std::collections::HashMap;

const ERROR: &str = "mse_gen";
const LAYERS: &str = "model.hidden_layers";
const NEURONS: &str = "model.neurons";
const COLLOCATION: &str = "training.collocation_points";
const INITIAL: &str = "training.initial_points";
const STEP: &str = "model.sample_time_s";

/// Fig. 5a.
pub(super) fn structure(page: &mut Page, runs: &Runs) -> Result<(), BenchError> {
    page.heading("Fig. 5a: layers and neurons");
    page.commands(&["pinc run configs/van-der-pol/structure.toml --set preset=..."]);
    page.paragraph(
        "log10 of the median `mse_gen` over the seeds, with the quartiles and the number of seeds. The paper's best is \
         -2.87, at 10 layers of 20, as the average of 10 seeds.",
    );
    for run in runs.of_experiment("van-der-pol-structure") {
        let summary = run.summary(ERROR)?;
        page.paragraph(&format!("Preset `{}`; {}.", run.preset.name(), progress(run)));
        grid(page, &summary, (LAYERS, NEURONS), "layers, by neurons");
        page.paragraph(&best(run, &summary)?);
        page.picture(run, "mse", "Map of the validation error over layers and neurons");
    }
    Ok(())
}

/// Fig. 5b.
pub(super) fn points(page: &mut Page, runs: &Runs) -> Result<(), BenchError> {
    page.heading("Fig. 5b: initial and collocation points");
    page.commands(&["pinc run configs/van-der-pol/points.toml --set preset=..."]);
    page.paragraph(
        "As above, 4 layers of 20. The paper finds 40 initial points too few, and N_F/N_t = 4 too little. In `ours` there are \
         no initial points: the initial condition holds by construction.",
    );
    for run in runs.of_experiment("van-der-pol-points") {
        let summary = run.summary(ERROR)?;
        page.paragraph(&format!("Preset `{}`; {}.", run.preset.name(), progress(run)));
        match summary.first().is_some_and(|row| row.contains_key(INITIAL)) {
            true => {
                grid(page, &summary, (COLLOCATION, INITIAL), "N_F, by N_t");
                page.paragraph(&by_initial_points(&summary));
            }
            false => grid(page, &summary, (COLLOCATION, "metric"), "N_F"),
        }
        page.picture(run, "mse", "The validation error over numbers of points");
    }
    Ok(())
}

/// The validation error over T.
pub(super) fn horizon(page: &mut Page, runs: &Runs) -> Result<(), BenchError> {
    page.heading("Validation error over T");
    page.paragraph(
        "A sweep of the authors' program, not in the paper: median `mse_gen` with the quartiles, in the states' units squared. A \
         scenario lasts 40 s (300 s) at every T, so that the number of steps falls as T grows.",
    );
    for (plant, name) in PLANTS {
        for run in runs.of_experiment(&format!("{plant}-horizon")) {
            let preset = run.preset.name();
            page.paragraph(&format!(
                "{name}, preset `{preset}`; {}. `pinc run configs/{plant}/horizon.toml --set preset={preset}`",
                progress(run)
            ));
            let row = |row: &Row| {
                let numbers = ["median", "q1", "q3"].map(|column| short(number(row, column)));
                [vec![cell(row, STEP).to_owned()], numbers.to_vec()].concat()
            };
            let rows: Vec<_> = run.summary(ERROR)?.iter().map(row).collect();
            page.table(&["T in s", "median", "lower quartile", "upper quartile"], &rows);
            page.picture(run, "mse", &format!("{name}: the validation error over T"));
        }
    }
    Ok(())
}

/// "250 of 250 trials".
fn progress(run: &Run) -> String {
    let Some(sweep) = &run.metrics.sweep else { return "unfinished".to_owned() };
    let failed =
        if sweep.failed > 0 { format!(", {} failed", sweep.failed) } else { String::new() };
    format!("{} of {} trials done{failed}", sweep.done, sweep.trials)
}

/// What the cells come to by the number of initial points, whatever the number of collocation points, and where there
/// are four of these to one of those.
fn by_initial_points(summary: &[Row]) -> String {
    let log = |row: &Row| number(row, "median").log10();
    let of = |initial: &String| {
        let rows = summary.iter().filter(|row| cell(row, INITIAL) == initial);
        Some(format!("{:.2} for {initial}", Spread::of(rows.map(log).collect())?.quantile(0.5)))
    };
    let by_initial: Vec<String> = values(summary, INITIAL).iter().filter_map(of).collect();
    let is_few = |row: &&Row| {
        let few = 4.0 * number(row, INITIAL);
        number(row, COLLOCATION).total_cmp(&few).is_eq() && log(row).is_finite()
    };
    let few: Vec<String> =
        summary.iter().filter(is_few).map(|row| format!("{:.2}", log(row))).collect();
    format!(
        "Medians over N_F by N_t: {}. Cells with N_F/N_t = 4: {}.",
        by_initial.join(", "),
        few.join(", ")
    )
}

/// A table of the cells, rows by one key and columns by another.
fn grid(page: &mut Page, summary: &[Row], (rows, columns): (&str, &str), name: &str) {
    let heads = values(summary, columns);
    let line = |value: &String| {
        let at = |head: &String| {
            let here = |row: &&Row| cell(row, rows) == value && cell(row, columns) == head;
            summary.iter().find(here).map_or_else(|| "-".to_owned(), spread)
        };
        std::iter::once(value.clone()).chain(heads.iter().map(at)).collect()
    };
    let lines: Vec<Vec<String>> = values(summary, rows).iter().map(line).collect();
    let all: Vec<String> = std::iter::once(name.to_owned()).chain(heads.iter().cloned()).collect();
    page.table(&all, &lines);
}

/// The values of a column, each once, ascending if they are numbers.
fn values(summary: &[Row], column: &str) -> Vec<String> {
    let mut values: Vec<String> = Vec::new();
    for row in summary {
        let value = cell(row, column);
        if !values.iter().any(|known| known == value) {
            values.push(value.to_owned());
        }
    }
    let key = |value: &String| value.parse::<f64>().unwrap_or(0.0);
    values.sort_by(|a, b| key(a).total_cmp(&key(b)));
    values
}

/// "-2.87 (-3.01 .. -2.70), 10".
fn spread(row: &Row) -> String {
    let [median, q1, q3] = ["median", "q1", "q3"].map(|column| number(row, column).log10());
    match cell(row, "values") {
        "1" => format!("{median:.2}, 1"),
        seeds => format!("{median:.2} ({q1:.2} .. {q3:.2}), {seeds}"),
    }
}

/// Whether 10 layers of 20 are best, as far as there are seeds in which all cells are done.
fn best(run: &Run, summary: &[Row]) -> Result<String, BenchError> {
    let trials = run.table(file::SWEEP)?;
    let by_median = |a: &&Row, b: &&Row| number(a, "median").total_cmp(&number(b, "median"));
    let (wins, seeds) = wins(&trials);
    let papers = summary.iter().find(|row| size(row) == PAPERS);
    let (Some(best), Some(papers), 1..) = (summary.iter().min_by(by_median), papers, seeds) else {
        return Ok(
            "There is no seed yet in which all cells are done: nothing is said of the best."
                .to_owned(),
        );
    };
    let interval = |row: &Row| {
        let [low, high] = ["median_low", "median_high"].map(|c| number(row, c).log10());
        let confidence = 100.0 * number(row, "confidence");
        format!(
            "{:.2}, interval {low:.2} .. {high:.2} ({confidence:.0} %)",
            number(row, "median").log10()
        )
    };
    let high = number(best, "median_high");
    let other = |row: &&Row| size(row) != size(best) && number(row, "median_low") <= high;
    let name = |row: &Row| format!("{} x {}", size(row).0, size(row).1);
    let alike: Vec<String> = summary.iter().filter(other).map(name).collect();
    let alike = if alike.is_empty() { "no other".to_owned() } else { alike.join(", ") };
    Ok(format!(
        "Least median: {}, {}. Intervals of the median that overlap it: {alike}. The paper's 10 x 20: {}; it has the least error \
         of all cells in {wins} of the {seeds} seeds in which all are done.",
        name(best),
        interval(best),
        interval(papers),
    ))
}

/// The paper's best cell.
const PAPERS: (&str, &str) = ("10", "20");

/// Layers and neurons.
fn size(row: &Row) -> (&str, &str) {
    (cell(row, LAYERS), cell(row, NEURONS))
}

/// In how many of the seeds that have all cells the paper's has the least error, and how many these
/// are.
fn wins(trials: &[Row]) -> (usize, usize) {
    let mut seeds: HashMap<&str, Vec<&Row>> = HashMap::new();
    for trial in trials {
        seeds.entry(cell(trial, "seed")).or_default().push(trial);
    }
    seeds.retain(|_, trials| trials.iter().all(|trial| cell(trial, "status") == "done"));
    let least = |trials: &Vec<&Row>| {
        let best = trials.iter().min_by(|a, b| number(a, ERROR).total_cmp(&number(b, ERROR)));
        best.is_some_and(|best| size(best) == PAPERS)
    };
    (seeds.values().filter(|trials| least(trials)).count(), seeds.len())
}
