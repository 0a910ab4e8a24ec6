//! The short table at the end of a run.

use pinc_config::ModelKind;
use pinc_record::metric::{self, Metric, Show};
use pinc_record::{Metrics, Rk4Errors, RunDir, file};
use std::fmt::{Display, Write};

/// The metrics of a run, and where its report is, for reading.
#[must_use]
pub(crate) fn summary(run_dir: &RunDir) -> String {
    let mut text = String::new();
    // Writing to a String does not fail.
    let _ = metrics(&mut text, run_dir.metrics());
    let _ = write!(text, "report: {}", run_dir.path(file::REPORT).display());
    text
}

fn metrics(text: &mut String, metrics: &Metrics) -> std::fmt::Result {
    writeln!(text, "{} (preset {})", metrics.experiment, metrics.preset.name())?;
    if let Some(training) = &metrics.training {
        writeln!(
            text,
            "training    {} iterations, {} loss evaluations, {:.1} s: {}",
            training.iterations, training.loss_evaluations, training.wall_s, training.stop_reason
        )?;
        for (name, value) in &training.parameters {
            writeln!(text, "            {name} = {value:.6}, trained with the net")?;
        }
    }
    if let Some(validation) = &metrics.validation {
        writeln!(
            text,
            "validation  mse_gen {:.3e}, all rows normalized {:.3e}, one step in validation.domain \
             {:.3e}",
            validation.mse_gen, validation.mse_all_normalized, validation.one_step_mse
        )?;
    }
    if let Some(of) = metrics.validation.as_ref().and_then(|v| v.domain_error.as_ref()) {
        let place = of.max_at.named(&metrics.states, &metrics.inputs);
        writeln!(
            text,
            "domain      one step in [domain], in widths: sampled rms {:.1e}, p99 {:.1e}; largest found \
             {:.1e} at {place}",
            of.rms, of.p99, of.max
        )?;
        if of.rk4.are_known() {
            let Rk4Errors { one, two, four } = of.rk4;
            writeln!(
                text,
                "            rms of RK4 there: x1 {one:.1e}, x2 {two:.1e}, x4 {four:.1e}"
            )?;
        }
        let proven = of.proven.to_string();
        if !proven.is_empty() {
            writeln!(text, "            {proven}")?;
        }
    }
    if let Some(measured) = metrics.validation.as_ref().and_then(|v| v.measured_mse) {
        writeln!(text, "held out    mse of measured states, normalized {measured:.3e}")?;
    }
    if let Some(prediction) = &metrics.prediction {
        writeln!(
            text,
            "free run    mse at step marks {:.3e}, at all times {:.3e}",
            prediction.mse_marks, prediction.mse_all
        )?;
    }
    let prediction = metrics.prediction.as_ref().and_then(|run| run.outside_domain.as_ref());
    if let Some(found) = prediction.filter(|found| found.outside > 0) {
        writeln!(text, "            {found}")?;
    }
    if let Some(sweep) = &metrics.sweep {
        writeln!(
            text,
            "sweep       {} trials: {} done, {} failed, {} pending{}",
            sweep.trials,
            sweep.done,
            sweep.failed,
            sweep.pending(),
            if sweep.dropped > 0 { format!(", {} dropped", sweep.dropped) } else { String::new() }
        )?;
        if let Some(best) = &sweep.best {
            writeln!(text, "best        {best}: {}", file::BEST)?;
        }
        notes(text, sweep.loop_notes())?;
    }
    if let Some(finding) = metrics.domain_finding() {
        writeln!(text, "warning: {finding}")?;
    }
    if metrics.control.is_empty() {
        return Ok(());
    }
    let row = |cell: &dyn Fn(&Metric, &'static str, Show) -> String| -> String {
        let cells = loop_columns().filter_map(|(of, width)| {
            let (head, show) = of.printed?;
            Some(format!(" {:>width$}", cell(of, head, show)))
        });
        cells.collect()
    };
    writeln!(text, "closed loop {}   status", row(&|_, head, _| head.to_owned()))?;
    for run in &metrics.control {
        let model = match metrics.is_distilled() && run.model == ModelKind::Pinc {
            true => "distilled",
            false => run.model.name(),
        };
        let shown =
            |value: f64, show: Show| if value.is_nan() { "-".to_owned() } else { show(value) };
        let numbers = row(&|of, _, show| shown(of.of_loop(run), show));
        let status: Vec<_> = run.status.iter().map(|(name, n)| format!("{n} {name}")).collect();
        writeln!(text, "  {model:<10}{numbers}   {}", status.join(", "))?;
        let outside = run.outside_domain.as_ref().filter(|found| found.outside > 0);
        let found: [Option<&dyn Display>; 5] = [
            outside.map(|of| of as _),
            run.model_error.as_ref().map(|of| of as _),
            run.tube.as_ref().map(|of| of as _),
            run.cost.as_ref().map(|of| of as _),
            run.start.as_ref().map(|of| of as _),
        ];
        for found in found.into_iter().flatten() {
            writeln!(text, "             {found}")?;
        }
    }
    notes(text, metrics.loop_notes())
}

fn notes(text: &mut String, notes: Vec<String>) -> std::fmt::Result {
    notes.into_iter().try_for_each(|note| writeln!(text, "note: {note}"))
}

/// The metrics in the table of closed loops, and the widths of their columns. The dense trace is
/// first, as in the paper's table.
fn loop_columns() -> impl Iterator<Item = (&'static Metric, usize)> {
    let first = [&metric::RMSE_DENSE, &metric::IAE_DENSE_SUM];
    let others = Metric::rows(metric::LOOP).into_iter().filter(move |of| !first.contains(of));
    first.map(|of| (of, 11)).into_iter().chain(others.map(|of| (of, 9)))
}
