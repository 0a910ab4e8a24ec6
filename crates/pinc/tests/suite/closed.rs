//! A closed loop that `pinc control` has run, for other programs to take its steps.

use crate::common::{outcome, pinc};
use pinc_config::{ControlSpec, Experiment, ModelKind, Plants};
use pinc_record::{ControlReader, ControlRow, EstimateTable, StepRow, file, read_fixed_table};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Points of a dense trace per control step.
const POINTS: usize = 9;

/// What the controller was given and gave at each step.
pub(crate) struct Closed {
    pub(crate) states: Vec<Vec<f64>>,
    pub(crate) inputs: Vec<Vec<f64>>,
    pub(crate) steps: Vec<StepRow>,
    /// What an estimator was told and made of it, if there is one.
    pub(crate) estimates: Option<EstimateTable>,
    pub(crate) spec: ControlSpec,
    /// The parameters of the plant in the loop, at first.
    pub(crate) parameters: BTreeMap<String, f64>,
    pub(crate) sample_time_s: f64,
}

impl Closed {
    /// Runs the loop of `config` with one model, in `dir`.
    #[track_caller]
    pub(crate) fn run(dir: &Path, config: &Path, kind: ModelKind, more: &[&str]) -> Self {
        let run = dir.join("run");
        let mut command = pinc(&["control", "--set", "control.repetitions=1", "--quiet", "--only"]);
        command.arg(kind.name()).arg(config).arg("--out").arg(&run).args(more);
        let ended = outcome(&mut command);
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let experiment = Experiment::load(&run.join(file::CONFIG), &[], &Plants::default());
        let experiment = experiment.unwrap();
        let spec = experiment.control.clone().unwrap();
        let path = |name: PathBuf| run.join(name);
        let trace = path(file::control(kind, 1).into());
        let of = experiment.plant.variables();
        let sizes = [of.states.len(), of.inputs.len()];
        let trace = ControlReader::open(&trace, sizes, &spec.controlled).unwrap().unwrap();
        let trace: Vec<ControlRow> = trace.map(Result::unwrap).collect();
        let steps: Vec<StepRow> =
            read_fixed_table(&path(file::steps(kind, 1).into())).unwrap().unwrap();
        let rows = || trace.iter().step_by(POINTS).take(steps.len());
        Self {
            states: rows().map(|row| row.state.clone()).collect(),
            inputs: rows().map(|row| row.input.clone()).collect(),
            estimates: EstimateTable::read(&path(file::estimates(kind, 1).into())).unwrap(),
            parameters: experiment.plant_in_the_loop().parameters(),
            sample_time_s: experiment.sample_time_s().unwrap(),
            steps,
            spec,
        }
    }

    /// What the controller was told in each step: states, or what was measured.
    pub(crate) fn told(&self) -> Vec<Vec<f64>> {
        let measured =
            |table: &EstimateTable| table.rows.iter().map(|row| row.measured.clone()).collect();
        self.estimates.as_ref().map_or_else(|| self.states.clone(), measured)
    }

    /// What was followed in step `k`, with preview: a row per step of the horizon.
    pub(crate) fn reference(&self, k: usize) -> Vec<Vec<f64>> {
        let at = |step: usize| {
            let step = u32::try_from(step.min(self.steps.len() - 1)).unwrap();
            let t = f64::from(step) * self.sample_time_s;
            let mut begun = self.spec.references.iter().filter(|r| r.start_s <= t);
            begun.next_back().unwrap().value.clone()
        };
        (0..self.spec.n2).map(|j| at(k + self.spec.delay_steps + j)).collect()
    }
}
