//! The traces of closed loops, read together: of a long one, the rows that matter for a picture.

use crate::data::OfModel;
use crate::decimation::{Decimation, Sample};
use pinc_config::ControlSpec;
use pinc_record::{
    ControlColumns, ControlReader, ControlRow, FixedReader, RecordError, StepRow, WallTimes,
};

/// What is enlarged if the config names nothing: the first so many steps.
const CLOSE_UP: f64 = 20.0;

/// A closed loop, or a part of it.
#[derive(Clone, Debug)]
pub(crate) struct ControlTrace {
    pub(crate) columns: ControlColumns,
    pub(crate) rows: Vec<ControlRow>,
}

/// The closed loops of a run.
#[derive(Debug, Default)]
pub(crate) struct Traces {
    /// The whole loops, PINC first.
    pub(crate) loops: Vec<OfModel<ControlTrace>>,
    /// The parts that may be enlarged: those that the config names, and last the first steps.
    pub(crate) close_ups: Vec<CloseUp>,
    /// The number of rows from which the longest loop's are taken, if not all are there.
    pub(crate) taken_of: Option<usize>,
}

/// A part of the loops.
#[derive(Debug)]
pub(crate) struct CloseUp {
    /// From when to when, in the report's unit.
    pub(crate) window: (f64, f64),
    /// Its rows, if the loops are too long for their rows to be all there.
    pub(crate) loops: Option<Vec<OfModel<ControlTrace>>>,
}

/// The rows of all loops at one time; a loop may have ended early.
type Rows = Vec<Option<ControlRow>>;

impl Traces {
    /// Reads the traces of loops with steps of `step_s`. Their times are given in a unit of which
    /// `second` make up a second.
    pub(crate) fn read(
        mut readers: Vec<OfModel<ControlReader>>,
        spec: &ControlSpec,
        step_s: Option<f64>,
        second: f64,
    ) -> Result<Self, RecordError> {
        let step = step_s.map(|step_s| step_s * second);
        let mut whole = Decimation::new();
        let mut parts: Vec<Part> =
            spec.close_ups_s.iter().map(|[a, b]| Part::new(a * second, b * second)).collect();
        loop {
            let mut rows: Rows = readers
                .iter_mut()
                .map(|of| of.table.next().transpose())
                .collect::<Result<_, _>>()?;
            rows.iter_mut().flatten().for_each(|row| row.t *= second);
            let Some(t) = rows.iter().flatten().map(|row| row.t).next() else { break };
            if whole.len() == 0 {
                parts.extend(step.map(|step| Part::new(t, t + CLOSE_UP * step)));
            }
            let columns = numbers(&readers, &rows);
            parts.iter_mut().for_each(|part| part.push(t, &rows, &columns));
            whole.push(rows, columns);
        }
        let taken_of = (!whole.is_whole()).then(|| whole.len());
        let close_up = |part: Part| CloseUp {
            window: part.window,
            loops: taken_of.map(|_| split(&readers, part.rows.into_rows())),
        };
        let close_ups = parts.into_iter().map(close_up).collect();
        Ok(Self { close_ups, loops: split(&readers, whole.into_rows()), taken_of })
    }
}

/// A part of the loops being read, with the row before and the row after.
struct Part {
    window: (f64, f64),
    before: Option<(Rows, Vec<f64>)>,
    rows: Decimation<Rows>,
    ended: bool,
}

impl Part {
    fn new(from: f64, to: f64) -> Self {
        Self { window: (from, to), before: None, rows: Decimation::new(), ended: false }
    }

    fn push(&mut self, t: f64, rows: &Rows, columns: &[f64]) {
        if self.ended {
            return;
        }
        let row = (rows.clone(), columns.to_vec());
        if t < self.window.0 {
            self.before = Some(row);
            return;
        }
        for (rows, columns) in self.before.take().into_iter().chain([row]) {
            self.rows.push(rows, columns);
        }
        self.ended = t > self.window.1;
    }
}

/// All drawn numbers of these rows: the numbers of each loop, and the distance between the states
/// of the first two loops.
fn numbers(readers: &[OfModel<ControlReader>], rows: &Rows) -> Vec<f64> {
    let mut numbers = Vec::new();
    for (of, row) in readers.iter().zip(rows) {
        let ControlColumns { states, inputs, controlled, outputs } = of.table.columns();
        let width = states.len() + inputs.len() + controlled.len() + outputs.len();
        match row {
            Some(ControlRow { state, input, reference, output, .. }) => {
                numbers.extend(state.iter().chain(input).chain(reference).chain(output));
            }
            None => numbers.extend(vec![f64::NAN; width]),
        }
    }
    if let [one, two, ..] = &rows[..] {
        let states = readers[0].table.columns().states.len();
        let value = |row: &Option<ControlRow>, i: usize| row.as_ref().map(|row| row.state[i]);
        let apart = |i: usize| Some((value(one, i)? - value(two, i)?).abs());
        numbers.extend((0..states).map(|i| apart(i).unwrap_or(f64::NAN)));
    }
    numbers
}

/// The rows of each loop by themselves.
fn split(
    readers: &[OfModel<ControlReader>],
    rows: impl Iterator<Item = Rows>,
) -> Vec<OfModel<ControlTrace>> {
    let empty = |of: &OfModel<ControlReader>| OfModel {
        model: of.model,
        file: of.file.clone(),
        table: ControlTrace { columns: of.table.columns().clone(), rows: Vec::new() },
    };
    let mut loops: Vec<_> = readers.iter().map(empty).collect();
    for row in rows.flat_map(|rows| rows.into_iter().enumerate()) {
        let (place, row) = row;
        loops[place].table.rows.extend(row);
    }
    loops
}

/// The steps of a controller.
#[derive(Debug)]
pub(crate) struct Steps {
    /// The rows, or of many those that matter for a picture.
    pub(crate) rows: Vec<StepRow>,
    /// How many there are.
    pub(crate) count: usize,
    /// How many of them did not converge, and how these ended.
    pub(crate) failed: usize,
    pub(crate) reasons: Vec<String>,
    /// The median time, of many steps over some of them; `None` if there is no time.
    pub(crate) median_us: Option<f64>,
}

impl Steps {
    /// Reads the steps.
    pub(crate) fn read(reader: FixedReader<StepRow>) -> Result<Self, RecordError> {
        let (mut rows, mut times) = (Decimation::new(), Sample::new());
        let (mut failed, mut reasons) = (0, Vec::new());
        for row in reader {
            let row: StepRow = row?;
            if row.solve_us.is_finite() {
                times.push(row.solve_us);
            }
            if !row.converged() {
                failed += 1;
                if !reasons.contains(&row.status) {
                    reasons.push(row.status.clone());
                }
            }
            let iterations = row.sqp_iterations as f64;
            let failure = f64::from(u8::from(!row.converged()));
            let columns = vec![row.solve_us, iterations, row.kkt, failure];
            rows.push(row, columns);
        }
        let (count, times) = (rows.len(), times.into_values());
        let median_us = (!times.is_empty()).then(|| WallTimes::of(times).median);
        Ok(Self { rows: rows.into_rows().collect(), count, failed, reasons, median_us })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::{Experiment, ModelKind};
    use pinc_record::ControlWriter;
    use std::path::Path;

    const ROWS: u32 = 90_001;
    const SPIKE: u32 = 54_321;

    /// A loop of 10 000 steps of 9 rows; at one of them one of the models is off.
    fn write(path: &Path, spike: f64) -> ControlReader {
        let columns = ControlColumns {
            states: vec!["x1".to_owned(), "x2".to_owned()],
            inputs: vec!["u".to_owned()],
            controlled: vec!["x1".to_owned(), "x2".to_owned()],
            outputs: Vec::new(),
        };
        let mut writer = ControlWriter::create(path, &columns).unwrap();
        for i in 0..ROWS {
            let t = 0.5 * f64::from(i) / 9.0;
            let x1 = t.sin() + if i == SPIKE { spike } else { 0.0 };
            let row = ControlRow {
                t,
                state: vec![x1, t.cos()],
                input: vec![f64::from(i / 9 % 7)],
                reference: vec![0.0, 0.0],
                output: Vec::new(),
            };
            writer.push(&row).unwrap();
        }
        writer.finish().unwrap();
        ControlReader::open(path, [2, 1], &columns.controlled).unwrap().unwrap()
    }

    #[test]
    fn a_long_loop_is_thinned_to_rows_with_all_extremes_and_whole_close_ups() {
        let dir = tempfile::tempdir().unwrap();
        let path = Path::new("../../configs/smoke/van-der-pol.toml");
        let set = ["control.duration_s=5000.0", "control.close_ups_s=[[100.0, 110.0]]"];
        let set = set.map(str::to_owned);
        let experiment = Experiment::load(path, &set, &pinc_config::Plants::built_in()).unwrap();
        let of = |model: ModelKind, spike| {
            let file = model.to_string();
            let table = write(&dir.path().join(&file), spike);
            OfModel { model: Some(model), file, table }
        };
        let readers = vec![of(ModelKind::Pinc, 0.0), of(ModelKind::RK4, 1e-3)];
        let traces =
            Traces::read(readers, experiment.control.as_ref().unwrap(), Some(0.5), 1.0).unwrap();
        assert_eq!(traces.taken_of, Some(ROWS as usize));
        let [pinc, rk4] = &traces.loops[..] else { panic!("two loops") };
        assert!(pinc.table.rows.len() < 60_000);
        // Both have rows at the same times.
        let pairs = || pinc.table.rows.iter().zip(&rk4.table.rows);
        assert!(pairs().all(|(a, b)| a.t.total_cmp(&b.t).is_eq()));
        assert_eq!(pinc.table.rows.len(), rk4.table.rows.len());
        // It is no extreme of a state, but one of the difference.
        let apart = pairs().map(|(a, b)| (a.state[0] - b.state[0]).abs()).fold(0.0, f64::max);
        assert!((apart - 1e-3).abs() < 1e-9, "{apart}");
        let [asked, first] = &traces.close_ups[..] else { panic!("two parts") };
        let rows = |part: &CloseUp| part.loops.as_ref().unwrap()[1].table.rows.len();
        // 20 steps each, and a row before and after.
        assert_eq!((asked.window, rows(asked)), ((100.0, 110.0), 20 * 9 + 1 + 2));
        assert_eq!((first.window, rows(first)), ((0.0, 10.0), 20 * 9 + 1 + 1));
    }
}
