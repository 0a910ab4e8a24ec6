//! The grids of Fig. 5, and the sweep over T.

use super::control::effort;
use super::page::{Page, short};
use super::runs::{Run, Runs, Summary};
use super::{DERIVED, PLANTS};
use crate::error::ReportError;
use pinc_config::SEED;
use pinc_record::metric::MSE_GEN;
use pinc_record::{Spread, SummaryRow, TrialColumn, TrialMetric, TrialStatus, TrialTable};
use std::collections::HashMap;

const ERROR: TrialMetric = MSE_GEN.of_net();
const LAYERS: &str = "model.hidden_layers";
const NEURONS: &str = "model.neurons";
const COLLOCATION: &str = "training.collocation_points";
const INITIAL: &str = "training.initial_points";
const STEP: &str = "model.horizon_s";

/// Fig. 5a.
pub(super) fn structure(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Fig. 5a: layers and neurons");
    page.paragraph(
        "log10 of the median `mse_gen` over the seeds, with quartiles and number of seeds. The \
         paper's best is -2.87, at 10 layers of 20, averaged over 10 seeds.",
    );
    for run in runs.of_experiment("van-der-pol-structure") {
        let summary = run.summary(ERROR)?;
        introduce(page, run, "structure");
        grid(page, (run, &summary), (LAYERS, NEURONS), "layers, by neurons");
        page.paragraph(&best(run, &summary)?);
        page.picture(run, "mse", "Map of the validation error over layers and neurons");
    }
    Ok(())
}

/// Fig. 5b.
pub(super) fn points(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Fig. 5b: initial and collocation points");
    page.paragraph(
        "As above, 4 layers of 20. The paper finds 40 initial points too few and N_F/N_t = 4 too \
         small. `ours` has no initial points, since the initial condition holds by construction.",
    );
    for run in runs.of_experiment("van-der-pol-points") {
        let summary = run.summary(ERROR)?;
        introduce(page, run, "points");
        match summary.has(INITIAL) {
            true => {
                grid(page, (run, &summary), (COLLOCATION, INITIAL), "N_F, by N_t");
                page.paragraph(&format!("{DERIVED}\n{}", by_initial_points(&summary)));
            }
            false => grid(page, (run, &summary), (COLLOCATION, ""), "N_F"),
        }
        page.picture(run, "mse", "The validation error over numbers of points");
    }
    Ok(())
}

/// The validation error over T.
pub(super) fn horizon(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Validation error over T");
    page.paragraph(
        "A sweep of the authors' program that is not in the paper: median `mse_gen` with \
         quartiles, in squared state units. A scenario lasts 40 s (four tanks: 300 s) at every T, \
         so the number of steps falls as T grows.",
    );
    for (plant, name) in PLANTS {
        for run in runs.of_experiment(&format!("{plant}-horizon")) {
            let preset = run.preset.name();
            page.paragraph(&format!("{name}, preset `{preset}`; {}.", progress(run)));
            page.commands(&[&format!(
                "pinc run configs/{plant}/horizon.toml --set preset={preset}"
            )]);
            let summary = run.summary(ERROR)?;
            let row = |row: &SummaryRow| {
                let numbers = [row.median, row.q1, row.q3].map(short);
                [vec![summary.choice(row, STEP).to_owned()], numbers.to_vec()].concat()
            };
            let rows: Vec<_> = summary.rows().iter().map(row).collect();
            let number = |quantile: &str| {
                format!("error summary[{STEP}={{T in s}},metric=mse_gen].{quantile}")
            };
            page.made_by(
                &[("effort", vec![effort(run.preset).to_owned(); rows.len()])],
                &format!("- | {}", ["median", "q1", "q3"].map(number).join(" | ")),
            );
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

/// The results by the number of initial points, whatever the number of collocation
/// points, and where there are four of these to one of those.
fn by_initial_points(summary: &Summary) -> String {
    let log = |row: &SummaryRow| row.median.log10();
    let of = |initial: &String| {
        let rows = summary.rows().iter().filter(|row| summary.choice(row, INITIAL) == initial);
        Some(format!("{:.2} for {initial}", Spread::of(rows.map(log).collect())?.quantile(0.5)))
    };
    let by_initial: Vec<String> = values(summary, INITIAL).iter().filter_map(of).collect();
    let points = |row: &SummaryRow, key| summary.choice(row, key).parse().unwrap_or(f64::NAN);
    let is_few = |row: &&SummaryRow| {
        let few: f64 = 4.0 * points(row, INITIAL);
        points(row, COLLOCATION).total_cmp(&few).is_eq() && log(row).is_finite()
    };
    let few = summary.rows().iter().filter(is_few).map(|row| format!("{:.2}", log(row)));
    let few: Vec<String> = few.collect();
    format!(
        "Medians over N_F by N_t: {}. Cells with N_F/N_t = 4: {}.",
        by_initial.join(", "),
        few.join(", ")
    )
}

/// The command of a sweep, and how far the run is.
fn introduce(page: &mut Page, run: &Run, config: &str) {
    let preset = run.preset.name();
    page.commands(&[&format!("pinc run configs/van-der-pol/{config}.toml --set preset={preset}")]);
    page.paragraph(&format!("Preset `{preset}`; {}.", progress(run)));
}

/// A table of the cells, rows by one key and columns by another.
fn grid(
    page: &mut Page,
    (run, summary): (&Run, &Summary),
    (rows, columns): (&str, &str),
    name: &str,
) {
    let mut heads = values(summary, columns);
    let line = |value: &String| {
        let at = |head: &String| {
            let here = |row: &&SummaryRow| {
                summary.choice(row, rows) == value && summary.choice(row, columns) == head
            };
            summary.rows().iter().find(here).map_or_else(|| "-".to_owned(), spread)
        };
        std::iter::once(value.clone()).chain(heads.iter().map(at)).collect()
    };
    let lines: Vec<Vec<String>> = values(summary, rows).iter().map(line).collect();
    if columns.is_empty() {
        heads = vec![ERROR.name()];
    }
    let cell = |head: &String| {
        let column = match columns {
            "" => String::new(),
            key => format!("{key}={head},"),
        };
        let number = |quantile: &str| {
            format!("log log10 summary[{rows}={{{name}}},{column}metric=mse_gen].{quantile}")
        };
        let numbers = ["median", "q1", "q3"].map(number).join("; ");
        format!("{numbers}; summary[{rows}={{{name}}},{column}metric=mse_gen].values")
    };
    let cells: Vec<String> = heads.iter().map(cell).collect();
    if run.metrics.sweep.as_ref().is_some_and(|sweep| sweep.pending() > 0) {
        page.paragraph("<!-- given: the sweep is not complete -->");
    } else {
        let effort = vec![effort(run.preset).to_owned(); lines.len()];
        page.made_by(&[("effort", effort)], &format!("- | {}", cells.join(" | ")));
    }
    let all: Vec<String> = std::iter::once(name.to_owned()).chain(heads).collect();
    page.table(&all, &lines);
}

/// The values of a key, each once, ascending if they are numbers.
fn values(summary: &Summary, key: &str) -> Vec<String> {
    let mut values: Vec<String> = Vec::new();
    for row in summary.rows() {
        let value = summary.choice(row, key);
        if !values.iter().any(|known| known == value) {
            values.push(value.to_owned());
        }
    }
    let number = |value: &String| value.parse::<f64>().unwrap_or(0.0);
    values.sort_by(|a, b| number(a).total_cmp(&number(b)));
    values
}

/// "-2.87 (-3.01 .. -2.70), 10".
fn spread(row: &SummaryRow) -> String {
    let [median, q1, q3] = [row.median, row.q1, row.q3].map(f64::log10);
    match row.values {
        1 => format!("{median:.2}, 1"),
        seeds => format!("{median:.2} ({q1:.2} .. {q3:.2}), {seeds}"),
    }
}

/// Whether 10 layers of 20 are best, as far as there are seeds in which all cells are done.
fn best(run: &Run, summary: &Summary) -> Result<String, ReportError> {
    let rows = summary.rows();
    let (wins, seeds) = wins(&run.trials()?);
    let size = |row: &SummaryRow| [LAYERS, NEURONS].map(|key| summary.choice(row, key).to_owned());
    let least = rows.iter().min_by(|a, b| a.median.total_cmp(&b.median));
    let (Some(best), 1..) = (least, seeds) else {
        return Ok("No seed has all cells yet, so there is no best cell.".to_owned());
    };
    let other = |row: &&SummaryRow| size(row) != size(best) && row.median_low <= best.median_high;
    let name = |row: &SummaryRow| size(row).join(" x ");
    let alike: Vec<String> = rows.iter().filter(other).map(name).collect();
    let alike = if alike.is_empty() { "no other".to_owned() } else { alike.join(", ") };
    Ok(format!(
        "Smallest median: {}. Cells whose median's interval overlaps: {alike}. The paper's 10 x 20 \
         has the smallest error in {wins} of the {seeds} seeds with all cells.",
        name(best),
    ))
}

/// The paper's best cell: layers and neurons.
const PAPERS: [&str; 2] = ["10", "20"];

/// In how many of the seeds that have all cells the paper's has the least error, and how many these
/// are.
fn wins(trials: &TrialTable) -> (usize, usize) {
    let choice = |row, key: &str| trials.cell(row, &TrialColumn::Choice(key.to_owned()));
    let mut seeds: HashMap<&str, Vec<usize>> = HashMap::new();
    for row in 0..trials.len() {
        seeds.entry(choice(row, SEED)).or_default().push(row);
    }
    let is_done =
        |row: &usize| TrialStatus::of(trials.cell(*row, &TrialColumn::Status)) == TrialStatus::Done;
    seeds.retain(|_, rows| rows.iter().all(is_done));
    let error = |row: usize| trials.number(row, ERROR);
    let wins = |rows: &&Vec<usize>| {
        let best = rows.iter().min_by(|a, b| error(**a).total_cmp(&error(**b)));
        best.is_some_and(|best| [LAYERS, NEURONS].map(|key| choice(*best, key)) == PAPERS)
    };
    (seeds.values().filter(wins).count(), seeds.len())
}
