//! The paper's tables and figures beside the results of `configs/paper.toml`, as a page.

mod control;
mod grids;
mod page;
mod runs;

use crate::error::ReportError;
use page::{Copied, Page, short, time};
use pinc_config::CASE;
use pinc_record::metric::FREE_RUN_RMSE;
use pinc_record::{Invocation, RecordError, SummaryRow, read_file, write_atomically};
use runs::{Run, Runs};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The paper's plants, as experiments and pages call them.
const PLANTS: [(&str, &str); 2] = [("van-der-pol", "Van der Pol"), ("four-tanks", "four tanks")];

/// Marks a paragraph whose numbers are computed from a table.
const DERIVED: &str = "<!-- derived: from the table above -->";

/// Every experiment of the paper, in the order of the page's provenance.
const EXPERIMENTS: [&str; 13] = [
    "van-der-pol",
    "four-tanks",
    "van-der-pol-substeps",
    "four-tanks-substeps",
    "van-der-pol-structure",
    "van-der-pol-points",
    "van-der-pol-long-range",
    "four-tanks-sensitivity",
    "four-tanks-worst-case",
    "van-der-pol-horizon",
    "four-tanks-horizon",
    "van-der-pol-deviations",
    "four-tanks-deviations",
];

/// The page, in Markdown and without pictures, from the directory of a list of runs. What has not
/// been run is left out.
///
/// # Errors
///
/// [`ReportError`] if the directory holds no such runs, or a file in it cannot be read.
pub fn results(dir: &Path) -> Result<String, ReportError> {
    let mut page = Page::default();
    fill(&mut page, dir)?;
    Ok(page.into_parts().0)
}

/// Writes the page to a file, and its pictures to the directory beside it that has the file's name
/// without the ending.
///
/// # Errors
///
/// As for [`results`], and if a file cannot be written.
pub fn write_results(dir: &Path, to: &Path) -> Result<(), ReportError> {
    let beside = to.with_extension("");
    let Some(folder) = beside.file_name().filter(|_| beside != to) else {
        return Err(ReportError::PageWithoutEnding { path: to.to_owned() });
    };
    let mut page = Page::with_pictures(folder.to_string_lossy().into_owned());
    fill(&mut page, dir)?;
    let (text, pictures) = page.into_parts();
    fs::create_dir_all(&beside).map_err(RecordError::unwritable(&beside))?;
    for Copied { from, name } in pictures {
        write_atomically(&beside.join(name), &read_file(&from)?)?;
    }
    Ok(write_atomically(to, text.as_bytes())?)
}

fn fill(page: &mut Page, dir: &Path) -> Result<(), ReportError> {
    let runs = Runs::read(dir, &EXPERIMENTS)?;
    page.paragraph("# Results: the paper, regenerated");
    page.paragraph(
        "Every table and figure of the paper that has numbers, beside this project's, made by the \
         two commands below. `as-printed` is the paper's equations and `as-released` its authors' \
         program, both run here with the paper's recipe; `ours` is this project's best. \
         [Deviations](deviations.md) says where they differ; [Measurements](measurements.md) \
         has all other measurements.",
    );
    page.commands(&[
        "pinc run configs/paper.toml --resume",
        "pinc results runs/paper --out docs/results.md",
    ]);
    control::table_1(page, &runs);
    control::loops(page, &runs);
    control::substeps(page, &runs)?;
    grids::structure(page, &runs)?;
    grids::points(page, &runs)?;
    long_range(page, &runs)?;
    nets(page, &runs);
    control::sensitivity(page, &runs)?;
    control::worst_case(page, &runs);
    grids::horizon(page, &runs)?;
    control::deviations(page, &runs)?;
    if !provenance(page, &runs) {
        return Err(ReportError::NoPaperRuns { dir: dir.to_owned() });
    }
    Ok(())
}

/// Figs. 6 and 7.
fn long_range(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Figs. 6 and 7: long range");
    page.paragraph(
        "RMSE over 10 s against the truth. A PINN is trained for one initial state, one input and \
         its T, and then asked beyond T. The PINC net is trained once, for T = 0.5 s and any state \
         and input, and chained. In the paper too only the PINN for T = 10 s is slightly below \
         PINC.",
    );
    for run in runs.of_experiment("van-der-pol-long-range") {
        let preset = run.preset.name();
        page.paragraph(&format!("Preset `{preset}`."));
        page.commands(&[&format!(
            "pinc run configs/van-der-pol/long-range.toml --set preset={preset}"
        )]);
        let summary = run.summary(FREE_RUN_RMSE.of_net())?;
        let row = |row| vec![summary.choice(row, CASE).to_owned(), short(row.median)];
        let rows: Vec<Vec<String>> = summary.rows().iter().map(row).collect();
        page.made_by(
            &[("effort", vec![control::effort(run.preset).to_owned(); rows.len()])],
            "- | error summary[case={net},metric=free_run_rmse].median",
        );
        page.table(&["net", "RMSE over 10 s"], &rows);
        page.picture(run, "free-runs", "PINNs and PINC over 10 s against the truth");
        page.picture(run, "free-run-rmse", "RMSE over 10 s");
    }
    Ok(())
}

/// Figs. 8, 9 and 12: the final nets.
fn nets(page: &mut Page, runs: &Runs) {
    page.heading("Figs. 8, 9 and 12: the final nets");
    page.timed(PLANTS.iter().flat_map(|(experiment, _)| runs.of_experiment(experiment)));
    page.commands(&["pinc run configs/{config}/main.toml --set preset={net}"]);
    let mut made = vec![["-", "given"]; 2];
    let mut rows = vec![
        line(["Van der Pol", "the authors' program", "9.8 h", "1.6e-4", "4.96e-5", ""]),
        line(["four tanks", "the authors' program", "32.5 h", "3.6e-2", "", ""]),
    ];
    for (experiment, name) in PLANTS {
        for Run { preset, metrics, .. } in runs.of_experiment(experiment) {
            let (Some(training), Some(validation)) = (&metrics.training, &metrics.validation)
            else {
                continue;
            };
            let free = metrics.prediction.as_ref().map_or(f64::NAN, |free| free.mse_all.sqrt());
            rows.push(vec![
                name.to_owned(),
                format!("`{}`", preset.name()),
                time(training.wall_s),
                short(validation.mse_gen),
                short(validation.mse_all_normalized),
                short(free),
            ]);
            made.push([experiment, control::effort(*preset)]);
        }
    }
    let list = |k: usize| made.iter().map(|row| row[k].to_owned()).collect();
    page.made_by(
        &[("config", list(0)), ("effort", list(1))],
        "- | - | timed | error validation.mse_gen | error validation.mse_all_normalized | \
         error root prediction.mse_all",
    );
    page.table(
        &[
            "plant",
            "net",
            "training",
            "`mse_gen`",
            "mse, all rows, normalized",
            "RMSE of the free run",
        ],
        &rows,
    );
    for (experiment, name) in PLANTS {
        for run in runs.of_experiment(experiment) {
            page.picture(run, "training", &format!("{name}: the training"));
            page.picture(run, "prediction", &format!("{name}: free run"));
        }
    }
}

/// What the runs were made with. Says whether there are any.
fn provenance(page: &mut Page, runs: &Runs) -> bool {
    let mut machines = BTreeSet::new();
    let mut rows = Vec::new();
    for experiment in EXPERIMENTS {
        for Run { preset, provenance, .. } in runs.of_experiment(experiment) {
            for invocation in provenance.invocations() {
                let Invocation { cpu, cores, os, rustc, .. } = invocation;
                machines.insert(format!("{cpu}, {cores} cores, {os}, {rustc}"));
                rows.push(vec![
                    experiment.to_owned(),
                    format!("`{}`", preset.name()),
                    invocation.source(),
                    invocation.started.clone(),
                ]);
            }
        }
    }
    page.heading("Provenance");
    for machine in machines {
        page.paragraph(&machine);
    }
    page.paragraph("<!-- given: where and when the runs were made -->");
    page.table(&["experiment", "preset", "commit", "started or resumed"], &rows);
    !rows.is_empty()
}

fn line<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

/// "3.55e-8 (3.10e-8 .. 4.02e-8)".
fn spread(row: &SummaryRow) -> String {
    let [median, least, most] = [row.median, row.min, row.max].map(short);
    match least == most {
        true => median,
        false => format!("{median} ({least} .. {most})"),
    }
}
