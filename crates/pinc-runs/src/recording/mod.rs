//! The record of a closed loop while it runs: its files, written as it goes, and totals.

use crate::RunError;
use pinc_loop::{ClosedLoop, Control, StepRecord};
use pinc_record::{
    ControlColumns, ControlRow, ControlWriter, FixedReader, FixedWriter, Pair, PairRow,
    RecordError, StatePairs, StepRow, TubeMetrics, write_atomically,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The columns of a trace.
pub(super) struct TraceColumns {
    pub(super) columns: ControlColumns,
    /// The places among the plant's outputs of those that are no states.
    pub(super) outputs: Vec<usize>,
    /// The widths of the inputs' bounds.
    pub(super) widths: Vec<f64>,
    /// Length of a step in s, and how many steps after the measurement a plan begins.
    pub(super) step_s: f64,
    pub(super) delay: usize,
}

/// Totals over the steps of a controller.
#[derive(Default)]
pub(super) struct Totals {
    /// How many steps ended with which status.
    pub(super) status: BTreeMap<String, usize>,
    /// The largest KKT residual.
    pub(super) kkt_max: f64,
    sqp_iterations: usize,
    /// How far the inputs moved from step to step, in widths of their bounds.
    pub(super) input_travel: f64,
    /// The input of the last step; empty before the first.
    before: Vec<f64>,
    /// In how many steps negative curvature was dropped.
    pub(super) curvature_dropped: usize,
    /// The cost of the first plan.
    pub(super) first_cost: Option<f64>,
    /// From which start the plan of the first step was found that tried several.
    pub(super) start: Option<usize>,
    /// What became of a tube.
    pub(super) tube: Option<TubeMetrics>,
}

impl Totals {
    fn add(&mut self, step: &StepRecord) {
        *self.status.entry(step.status.to_string()).or_default() += 1;
        self.kkt_max = self.kkt_max.max(step.kkt);
        self.sqp_iterations += step.sqp_iterations;
        self.curvature_dropped += usize::from(step.curvature_dropped);
        self.first_cost.get_or_insert(step.cost);
        self.start = self.start.or(step.start);
        if let Some(fits) = step.in_tube {
            self.tube.get_or_insert_default().add(fits);
        }
    }

    fn add_input(&mut self, u: &[f64], widths: &[f64]) {
        let moves = u.iter().zip(&self.before).zip(widths);
        self.input_travel +=
            moves.map(|((u, before), width)| (u - before).abs() / width).sum::<f64>();
        self.before.clear();
        self.before.extend_from_slice(u);
    }

    /// SQP iterations per step.
    pub(super) fn sqp_iterations_mean(&self) -> f64 {
        let steps: usize = self.status.values().sum();
        self.sqp_iterations as f64 / steps as f64
    }
}

/// Writes the dense trace and the steps of a loop, if the run keeps them, and sums up the steps.
pub(super) struct Recording {
    trace: Option<ControlWriter>,
    steps: Option<FixedWriter<StepRow>>,
    /// The places among the plant's outputs of those that are no states.
    outputs: Vec<usize>,
    widths: Vec<f64>,
    totals: Totals,
    step: usize,
    plans: Option<Plans>,
}

/// What plans expect that do not overlap, with a row without numbers after each.
struct Plans {
    path: PathBuf,
    table: StatePairs,
    step_s: f64,
    delay: usize,
    /// The step at which the next one begins.
    next: usize,
}

impl Plans {
    fn see(&mut self, control: &Control<'_, '_>, step: usize) {
        let Some(stages) = control.expected().filter(|_| step == self.next) else { return };
        self.next += stages.len() + 2;
        let unknown = vec![f64::NAN; control.seen().len()];
        let first = if self.delay == 0 { control.seen().to_vec() } else { unknown.clone() };
        let both = |values: Vec<f64>| [[values.clone(), values]];
        let rows = both(first).into_iter().chain(stages).chain(both(unknown));
        for (j, values) in rows.enumerate() {
            let t = (step + self.delay + j) as f64 * self.step_s;
            self.table.rows.push(PairRow { t, values });
        }
    }

    /// Writes the file if there are any.
    fn finish(self) -> Result<(), RecordError> {
        match self.table.rows.is_empty() {
            true => Ok(()),
            false => write_atomically(&self.path, self.table.to_csv().as_bytes()),
        }
    }
}

impl Recording {
    /// Begins the files of the trace, of the steps and of the plans.
    pub(super) fn begin(
        files: Option<[&Path; 3]>,
        TraceColumns { columns, outputs, widths, step_s, delay }: TraceColumns,
    ) -> Result<Self, RunError> {
        let trace = files.map(|[trace, ..]| ControlWriter::create(trace, &columns));
        let steps = files.map(|[_, steps, _]| FixedWriter::create(steps));
        let plans = files.map(|[.., path]| Plans {
            path: path.to_owned(),
            table: StatePairs { of: Pair::Range, states: columns.states.clone(), rows: Vec::new() },
            step_s,
            delay,
            next: 0,
        });
        let totals = Totals::default();
        let (trace, steps) = (trace.transpose()?, steps.transpose()?);
        Ok(Self { trace, steps, outputs, widths, totals, step: 0, plans })
    }

    /// Adds what the controller did, in how many us.
    pub(super) fn controlled(
        &mut self,
        control: &Control<'_, '_>,
        us: f64,
    ) -> Result<(), RunError> {
        let step = control.record();
        self.totals.add(step);
        self.totals.add_input(control.u(), &self.widths);
        if let Some(steps) = &mut self.steps {
            steps.push(&StepRow {
                step: self.step,
                status: step.status.to_string(),
                sqp_iterations: step.sqp_iterations,
                linearized: step.work.linearized,
                factorizations: step.work.factorizations,
                active_changes: step.work.changes,
                kkt: step.kkt,
                solve_us: us,
                violated: step.violated.map_or(String::new(), |constraint| constraint.to_string()),
            })?;
        }
        if let Some(plans) = &mut self.plans {
            plans.see(control, self.step);
        }
        self.step += 1;
        Ok(())
    }

    /// Adds what the plant did. The end of a step is written with the next one's input, or at the
    /// end of the loop.
    pub(super) fn advanced(&mut self, run: &ClosedLoop<'_>) -> Result<(), RunError> {
        let last = run.last_step().len().saturating_sub(1);
        Ok(self.push_samples(run, 0..last)?)
    }

    /// Puts the files at their places: whole, or as far as the loop went.
    pub(super) fn finish(mut self, run: &ClosedLoop<'_>) -> Result<Totals, RunError> {
        let samples = run.last_step().len();
        if samples > 0 {
            self.push_samples(run, samples - 1..samples)?;
        }
        self.trace.map(ControlWriter::finish).transpose()?;
        self.steps.map(FixedWriter::finish).transpose()?;
        self.plans.map(Plans::finish).transpose()?;
        Ok(self.totals)
    }

    fn push_samples(
        &mut self,
        run: &ClosedLoop<'_>,
        samples: std::ops::Range<usize>,
    ) -> Result<(), RecordError> {
        let Some(trace) = &mut self.trace else { return Ok(()) };
        let step = run.last_step();
        for i in samples {
            let outputs = if self.outputs.is_empty() { vec![] } else { run.outputs_at(i) };
            trace.push(&ControlRow {
                t: step.times()[i],
                state: step.state(i).to_vec(),
                input: step.input(i).to_vec(),
                reference: run.reference_at(i).to_vec(),
                output: self.outputs.iter().map(|place| outputs[*place]).collect(),
            })?;
        }
        Ok(())
    }
}

/// Writes the file of steps once more, with other times.
pub(super) fn write_medians(path: &Path, us: impl Fn(usize) -> f64) -> Result<(), RunError> {
    let Some(rows) = FixedReader::<StepRow>::open(path)? else { return Ok(()) };
    let mut writer = FixedWriter::create(path)?;
    for row in rows {
        let row = row?;
        writer.push(&StepRow { solve_us: us(row.step), ..row })?;
    }
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests;
