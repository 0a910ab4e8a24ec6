//! The closed loops: Table 1, the break-even of RK4's substeps, Figs. 15 and 16.

use super::page::{Page, short, time};
use super::runs::{Run, Runs};
use super::{DERIVED, PLANTS, line, spread};
use crate::error::ReportError;
use pinc_config::{CASE, DRAWN, ModelKind, Preset};
use pinc_record::metric::{IAE_DENSE_SUM, MSE_GEN, ONE_STEP_MSE, WALL};
use pinc_record::{ControlMetrics, SummaryRow, TrialColumn, TrialMetric};

const PINC_IAE: TrialMetric = IAE_DENSE_SUM.with(ModelKind::Pinc);
const RK4_IAE: TrialMetric = IAE_DENSE_SUM.with(ModelKind::RK4);
const PINC_WALL: TrialMetric = WALL.with(ModelKind::Pinc);
const RK4_WALL: TrialMetric = WALL.with(ModelKind::RK4);

/// Table 1.
pub(super) fn table_1(page: &mut Page, runs: &Runs) {
    page.heading("Table 1: control");
    page.timed(PLANTS.iter().flat_map(|(experiment, _)| runs.of_experiment(experiment)));
    page.commands(&[
        "pinc run configs/{config}/main.toml --set preset={source}",
        "pinc control configs/{config}/control.toml --only rk4 --set preset={source}",
    ]);
    page.paragraph(
        "The paper's table reads RMSE and IAE on the dense trace, with the IAE summed over \
         outputs; the columns without \"dense\" are its printed formulas, at the steps. The time \
         is the controller's, over 10 runs.",
    );
    let heads = [
        "plant",
        "source",
        "model",
        "RMSE dense",
        "IAE dense",
        "RMSE",
        "IAE",
        "time, mean",
        "sd",
        "median",
        "largest KKT residual",
    ];
    let mut rows = vec![
        line(["Van der Pol", "paper", "PINC", "0.15", "123.6", "", "", "3.32 s", "0.15 s", "", ""]),
        line(["Van der Pol", "paper", "RK", "0.15", "122", "", "", "3.41 s", "0.04 s", "", ""]),
        line(["four tanks", "paper", "PINC", "0.811", "876", "", "", "10.85 s", "0.14 s", "", ""]),
        line(["four tanks", "paper", "RK", "0.807", "544", "", "", "14.15 s", "0.13 s", "", ""]),
    ];
    let mut made = vec![["-", "1", "-", "given"]; rows.len()];
    for (experiment, name) in PLANTS {
        for run in runs.of_experiment(experiment) {
            for metrics in &run.metrics.control {
                let source = format!("`{}`", run.preset.name());
                rows.push([vec![name.to_owned(), source], loop_cells(metrics)].concat());
                made.push(match metrics.model {
                    ModelKind::RK4 => [experiment, "2", "rk4", "quick"],
                    other => [experiment, "1", other.name(), effort(run.preset)],
                });
            }
        }
    }
    let list = |k: usize| made.iter().map(|row| row[k].to_owned()).collect();
    let numbers = ["rmse_dense", "iae_dense_sum", "rmse", "iae"];
    let numbers = numbers.map(|number| format!("net {{by}}: control.{{with}}.{number}"));
    page.made_by(
        &[("config", list(0)), ("by", list(1)), ("with", list(2)), ("effort", list(3))],
        &format!(
            "- | - | - | {} | timed | timed | timed | error {{by}}: control.{{with}}.kkt_max",
            numbers.join(" | ")
        ),
    );
    page.table(&heads, &rows);
}

/// Figs. 10, 13 and 14, the loops of Table 1.
pub(super) fn loops(page: &mut Page, runs: &Runs) {
    page.heading("Figs. 10, 13 and 14: the closed loops");
    page.paragraph("The loops of Table 1, with PINC over RK4.");
    for (experiment, name) in PLANTS {
        for run in runs.of_experiment(experiment) {
            for (stem, part) in [
                ("control", "closed loop"),
                ("control-0-160", "closed loop, the first 160 s"),
                ("control-500-1300", "closed loop, 500 s to 1300 s"),
            ] {
                page.picture(run, stem, &format!("{name}: {part}"));
            }
        }
    }
}

/// How long it takes to make the numbers of a preset again: the paper's recipe takes hours.
pub(super) fn effort(preset: Preset) -> &'static str {
    match preset {
        Preset::Ours => "full",
        Preset::AsPrinted | Preset::AsReleased => "long",
    }
}

fn loop_cells(metrics: &ControlMetrics) -> Vec<String> {
    let wall = &metrics.wall_s;
    vec![
        metrics.model.title().to_owned(),
        format!("{:.5}", metrics.rmse_dense),
        format!("{:.3}", metrics.iae_dense_sum),
        format!("{:.5}", metrics.rmse),
        format!("{:.4}", metrics.iae),
        time(wall.mean),
        time(wall.sd),
        time(wall.median),
        format!("{:.1e}", metrics.kkt_max),
    ]
}

/// Is PINC faster than RK4? The paper says so.
pub(super) fn substeps(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Is PINC faster than RK4?");
    let all = || PLANTS.into_iter().map(|(plant, name)| (plant, name, format!("{plant}-substeps")));
    let found: Vec<&Run> = all()
        .flat_map(|(.., experiment)| runs.of_experiment(&experiment).collect::<Vec<_>>())
        .collect();
    page.timed(found.into_iter());
    page.paragraph(
        "The controller's time in the whole loop, median of 10 runs, by the substeps of RK4. \
         Beyond the break-even RK4 takes longer than the net. The IAE shows what fewer substeps \
         lose. The paper calls PINC faster in its own program.",
    );
    for (plant, name, experiment) in all() {
        for run in runs.of_experiment(&experiment) {
            page.commands(&[
                &format!("pinc run configs/{plant}/substeps.toml"),
                &format!(
                    "pinc control configs/{plant}/control.toml --only rk4 --set \
                     control.rk4_substeps={{substeps of RK4}}"
                ),
            ]);
            let (trials, times) = (run.trials()?, run.timings()?);
            let key = TrialColumn::Choice("control.rk4_substeps".to_owned());
            let mut rows = Vec::new();
            let (mut below, mut even) = ("none".to_owned(), None);
            for trial in 0..trials.len().min(times.len()) {
                let (pinc, rk4) = (times.number(trial, PINC_WALL), times.number(trial, RK4_WALL));
                let substeps = trials.cell(trial, &key).to_owned();
                if rk4 > pinc {
                    even.get_or_insert_with(|| substeps.clone());
                } else {
                    below.clone_from(&substeps);
                }
                rows.push(vec![
                    substeps,
                    time(rk4),
                    time(pinc),
                    format!("{:.4}", trials.number(trial, RK4_IAE)),
                    format!("{:.4}", trials.number(trial, PINC_IAE)),
                ]);
            }
            let even = even.map_or_else(
                || "more than the most tried".to_owned(),
                |substeps| format!("between {below} and {substeps} substeps"),
            );
            page.paragraph(&format!("{name}; break-even: {even}."));
            page.made_by(
                &[],
                "- | timed | timed | 2: control.rk4.iae_dense_sum | \
                 net 1: sweep[control.rk4_substeps={substeps of RK4}].pinc_iae_dense_sum",
            );
            page.table(
                &["substeps of RK4", "RK4", "PINC", "IAE dense, RK4", "IAE dense, PINC"],
                &rows,
            );
            page.picture(run, "time", &format!("{name}: the controller's time by substeps of RK4"));
        }
    }
    Ok(())
}

/// Fig. 15.
pub(super) fn sensitivity(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Fig. 15: sensitivity");
    page.timed(runs.of_experiment("four-tanks-sensitivity"));
    page.paragraph(
        "IAE dense, summed over outputs, over 151 random plants (pump constants +-5 %) and 151 \
         random initial levels (9 cm +-5 %). The models keep the nominal constants. The paper \
         shows histograms of PINC alone.",
    );
    for run in runs.of_experiment("four-tanks-sensitivity") {
        let preset = run.preset.name();
        page.commands(&[&format!(
            "pinc run configs/four-tanks/sensitivity.toml --set preset={preset}"
        )]);
        page.paragraph(&format!("Preset `{preset}`; {}.", controller_time(run)?));
        let mut rows = Vec::new();
        for (model, metric) in [("PINC", PINC_IAE), ("RK4", RK4_IAE)] {
            let summary = run.summary(metric)?;
            for row in summary.rows() {
                let choice = |key| summary.choice(row, key);
                let mut cells = line([choice("model.hidden_layers"), choice(DRAWN), model]);
                cells.extend([row.min, row.q1, row.median, row.q3, row.max].map(short));
                cells.push(row.failed.to_string());
                rows.push(cells);
            }
        }
        let heads = [
            "layers of 20",
            "drawn",
            "model",
            "least",
            "lower quartile",
            "median",
            "upper quartile",
            "most",
            "failed",
        ];
        let number = |quantile: &str| {
            format!(
                "net summary[model.hidden_layers={{layers of 20}},drawn={{drawn}},\
                 metric={{with}}_iae_dense_sum].{quantile}"
            )
        };
        let numbers = ["min", "q1", "median", "q3", "max", "failed"].map(number);
        let with = |row: &Vec<String>| row[2].to_lowercase();
        page.made_by(
            &[
                ("with", rows.iter().map(with).collect()),
                ("effort", vec![effort(run.preset).to_owned(); rows.len()]),
            ],
            &format!("- | - | - | {}", numbers.join(" | ")),
        );
        page.table(&heads, &rows);
        page.paragraph(&format!("{DERIVED}\n{}", compared(run)?));
        page.picture(run, "iae", "Histograms of the IAE");
    }
    Ok(())
}

/// How much more the IAE is with PINC, by the cells' medians.
fn compared(run: &Run) -> Result<String, ReportError> {
    let [pinc, rk4] = [run.summary(PINC_IAE)?, run.summary(RK4_IAE)?];
    let cells = pinc.rows().iter().zip(rk4.rows());
    let ratios = cells.map(|(pinc, rk4)| pinc.median / rk4.median);
    let mut ratios: Vec<f64> = ratios.filter(|ratio| ratio.is_finite()).collect();
    ratios.sort_by(f64::total_cmp);
    Ok(match ratios[..] {
        [] => "No cell is done with both models.".to_owned(),
        [one] => format!("The median with PINC is {one:.2} times the median with RK4."),
        [least, .., most] => {
            format!("The medians with PINC are {least:.2} to {most:.2} times the medians with RK4.")
        }
    })
}

/// "The controller worked 3.2 s with PINC and 2.1 s with RK4 in all 604 loops".
fn controller_time(run: &Run) -> Result<String, ReportError> {
    let times = run.timings()?;
    let all = |metric| (0..times.len()).map(|row| times.number(row, metric)).collect::<Vec<f64>>();
    let sum = |metric| all(metric).into_iter().filter(|t| t.is_finite()).sum();
    let (pinc, rk4): (f64, f64) = (sum(PINC_WALL), sum(RK4_WALL));
    Ok(format!(
        "the controller's time in all {} loops: {} with PINC, {} with RK4",
        times.len(),
        time(pinc),
        time(rk4)
    ))
}

/// Fig. 16.
pub(super) fn worst_case(page: &mut Page, runs: &Runs) {
    page.heading("Fig. 16: the worst case");
    page.commands(&["pinc run configs/four-tanks/worst-case.toml --set preset={source}"]);
    let mut rows = vec![line(["paper", "PINC", "1022"])];
    let mut made = vec![["-", "given"]];
    for run in runs.of_experiment("four-tanks-worst-case") {
        for metrics in &run.metrics.control {
            rows.push(vec![
                format!("`{}`", run.preset.name()),
                metrics.model.title().to_owned(),
                format!("{:.2}", metrics.iae_dense_sum),
            ]);
            made.push([metrics.model.name(), effort(run.preset)]);
        }
    }
    let list = |k: usize| made.iter().map(|row| row[k].to_owned()).collect();
    page.made_by(
        &[("with", list(0)), ("effort", list(1))],
        "- | - | net control.{with}.iae_dense_sum",
    );
    page.table(&["source", "model", "IAE dense"], &rows);
    for run in runs.of_experiment("four-tanks-worst-case") {
        page.picture(run, "control", "Closed loop in the worst case");
    }
}

/// What the contradictions between paper and program change.
pub(super) fn deviations(page: &mut Page, runs: &Runs) -> Result<(), ReportError> {
    page.heading("Deviations, one at a time");
    page.paragraph(
        "Each case is preset `ours` with one choice of the paper or of its authors' program, as \
         listed in [Deviations](deviations.md). Medians of 3 seeds, with minimum and maximum if \
         these differ.",
    );
    for (plant, name) in PLANTS {
        for run in runs.of_experiment(&format!("{plant}-deviations")) {
            let errors = run.summary(MSE_GEN.of_net())?;
            let others = [
                run.summary(ONE_STEP_MSE.of_net())?,
                run.summary(PINC_IAE)?,
                run.summary(RK4_IAE)?,
            ];
            page.paragraph(&format!("{name}:"));
            page.commands(&[&format!("pinc run configs/{plant}/deviations.toml")]);
            let line = |row: &SummaryRow| {
                let case = errors.choice(row, CASE);
                let of_case = |row: Option<&SummaryRow>| row.map_or_else(|| "-".to_owned(), spread);
                let spreads = others.iter().map(|other| of_case(other.case(case)));
                [case.to_owned(), spread(row)].into_iter().chain(spreads).collect()
            };
            let rows: Vec<_> = errors.rows().iter().map(line).collect();
            let heads =
                ["case", "`mse_gen`", "mse of one step", "IAE dense, PINC", "IAE dense, RK4"];
            let spread = |(rule, metric): (&str, &str)| {
                let of = |q| format!("{rule} summary[case={{case}},metric={metric}].{q}");
                ["median", "min", "max"].map(of).join("; ")
            };
            let metrics = [
                ("error", "mse_gen"),
                ("error", "one_step_mse"),
                ("net", "pinc_iae_dense_sum"),
                ("net", "rk4_iae_dense_sum"),
            ];
            page.made_by(&[], &format!("- | {}", metrics.map(spread).join(" | ")));
            page.table(&heads, &rows);
        }
    }
    Ok(())
}
