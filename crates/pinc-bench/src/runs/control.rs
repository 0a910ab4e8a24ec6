//! The closed-loop stage: the plant under the controller, with one model after the other.

use super::Options;
use super::guard::Guard;
use super::with_outputs::WithOutputs;
use crate::BenchError;
use crate::progress::Stage;
use pinc_config::{ControlSpec, Experiment, ModelKind, PlantSpec, Variables};
use pinc_mpc::{ClosedLoop, Nmpc, NmpcProblem, Reference, StepRecord};
use pinc_net::{NetError, PincModel, PincNet};
use pinc_ode::{Dopri5, DynPlant, Model, PiecewiseConstant, Trajectory};
use pinc_record::{
    ControlMetrics, ControlRow, ControlTrace, Metrics, ReferenceMetrics, RunDir, StepRow,
    StepTimes, WallTimes, file, fixed_table,
};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// What the stage works from.
pub(crate) struct LoopSetup<'a> {
    pub(crate) spec: &'a ControlSpec,
    /// Which of the config's models are run.
    pub(crate) kinds: &'a [ModelKind],
    /// The net, where one of them needs it.
    pub(crate) net: Option<&'a PincNet>,
    /// Length T of a step.
    pub(crate) sample_time_s: f64,
}

/// A model for the controller.
type NamedModel = (ModelKind, Box<dyn Model>);

/// Runs the closed loops, unless all have been run. `plant` is the one that the models are of, and
/// also the one in the loop unless the config has another.
pub(crate) fn stage(
    plant: &dyn DynPlant,
    setup: &LoopSetup<'_>,
    options: &Options<'_>,
    run_dir: &mut RunDir,
) -> Result<(), BenchError> {
    let done = run_dir.metrics().control.iter().map(|run| run.model);
    if done.eq(setup.kinds.iter().copied()) {
        return Ok(());
    }
    run_dir.update(|all| all.control.clear())?;
    run_dir.remove_loops()?;
    let real = setup.spec.plant.as_ref().map(PlantSpec::dyn_plant);
    for &kind in setup.kinds {
        let model = (kind, setup.model(kind, plant)?);
        let metrics = run_model(real.as_deref().unwrap_or(plant), setup, model, options, run_dir)?;
        run_dir.update(|all| all.control.push(metrics))?;
    }
    Ok(())
}

fn run_model(
    plant: &dyn DynPlant,
    setup: &LoopSetup<'_>,
    (kind, model): NamedModel,
    options: &Options<'_>,
    run_dir: &RunDir,
) -> Result<ControlMetrics, BenchError> {
    let ControlSpec { sqp, repetitions, budget_us, .. } = setup.spec;
    let mut nmpc = Nmpc::new(setup.problem(plant), model, *sqp)?;
    let name = format!("control {kind}");
    let mut progress = Stage::begin(options.verbosity, &name, *repetitions as u64);
    let mut times = Times::default();
    let mut results = None;
    let mut outside = None;
    for repetition in 0..*repetitions {
        options.check_interrupt(run_dir.dir())?;
        progress.advance(repetition as u64, String::new);
        // Only the first leaves results: the others give the same numbers in other times.
        let mut run = setup.begin(&mut nmpc, plant)?;
        let mut guard = setup.guard(kind);
        let budget = budget_us.map(|us| Duration::from_secs_f64(1e-6 * us));
        let outcome = times.watch(&mut run, budget, guard.as_mut());
        if results.is_none() || outcome.is_err() {
            let name = file::control(kind, setup.kinds.len());
            run_dir.write_trace(&name, || setup.trace(&run, plant).to_csv())?;
            results = Some(Results::of(&run, setup));
            outside = guard.map(Guard::found);
        }
        outcome?;
    }
    let results = results.expect("there is at least one repetition");
    let name = file::steps(kind, setup.kinds.len());
    run_dir.write_trace(&name, || fixed_table(&times.rows(&results)))?;
    progress.end(&format!("{repetitions} runs, IAE {:.4}", results.iae_dense_sum));
    let metrics = results.metrics(kind, times);
    Ok(ControlMetrics { outside_domain: outside, ..metrics })
}

/// An error if more control steps failed in a loop than the config allows.
pub(crate) fn verdict(experiment: &Experiment, metrics: &Metrics) -> Result<(), BenchError> {
    let Some(spec) = &experiment.control else { return Ok(()) };
    #[expect(clippy::cast_precision_loss, reason = "no run has 2^53 steps")]
    let share = |of: &ControlMetrics| of.failed_steps() as f64 / of.steps() as f64;
    match metrics.control.iter().find(|of| share(of) > spec.max_failed_share) {
        None => Ok(()),
        Some(of) => Err(BenchError::FailedSteps {
            model: of.model,
            failed: of.failed_steps(),
            steps: of.steps(),
            allowed: spec.max_failed_share,
        }),
    }
}

/// The plant's trajectory in the closed loop of `spec` with RK4 as the model, run once and not
/// recorded.
pub(super) fn rehearse(
    plant: &dyn DynPlant,
    spec: &ControlSpec,
    sample_time_s: f64,
) -> Result<Trajectory, BenchError> {
    let setup = LoopSetup { spec, kinds: &[ModelKind::Rk4], net: None, sample_time_s };
    let model = setup.model(ModelKind::Rk4, plant)?;
    let mut nmpc = Nmpc::new(setup.problem(plant), model, spec.sqp)?;
    let mut run = setup.begin(&mut nmpc, plant)?;
    run.run()?;
    Ok(run.trajectory().clone())
}

impl LoopSetup<'_> {
    /// What watches the net, if that is the model.
    fn guard(&self, kind: ModelKind) -> Option<Guard<'_>> {
        let net = self.net.filter(|_| kind == ModelKind::Pinc);
        net.map(|net| Guard::new(net, self.spec.outside_domain))
    }

    pub(crate) fn model(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
    ) -> Result<Box<dyn Model>, NetError> {
        let (sample_time_s, spec) = (self.sample_time_s, self.spec);
        Ok(match (kind, self.net) {
            (ModelKind::Pinc, Some(net)) => {
                let model = PincModel::new(net)?;
                match Variables::of(plant).own_outputs().is_empty() {
                    true => Box::new(model),
                    // The net knows the states; what follows from them is the plant's to say.
                    false => Box::new(WithOutputs::new(model, plant.rk4(sample_time_s, 1))),
                }
            }
            (ModelKind::Pinc, None) => unreachable!("the plan trains or reads a net for this loop"),
            (ModelKind::Rk4, _) => plant.rk4(sample_time_s, spec.rk4_substeps),
            (ModelKind::Rk5, _) => plant.rk5(sample_time_s, spec.rk5_substeps),
            (ModelKind::Rodas4, _) => plant.rodas4(sample_time_s, spec.rosenbrock_substeps),
        })
    }

    pub(crate) fn problem(&self, plant: &dyn DynPlant) -> NmpcProblem {
        self.spec.problem(&Variables::of(plant), self.sample_time_s)
    }

    /// What is followed, step by step.
    pub(super) fn reference(&self) -> Result<Reference, BenchError> {
        let references = &self.spec.references;
        let starts = references.iter().map(|step| step.start_s).collect();
        let values = references.iter().map(|step| step.value.clone()).collect();
        let signal = PiecewiseConstant::new(starts, values)?;
        let steps = super::steps(self.spec.duration_s, self.sample_time_s);
        Ok(Reference::sample(&signal, steps, self.sample_time_s)?)
    }

    pub(crate) fn begin<'n>(
        &self,
        nmpc: &'n mut Nmpc,
        plant: &dyn DynPlant,
    ) -> Result<ClosedLoop<'n>, BenchError> {
        let (spec, reference) = (self.spec, self.reference()?);
        let truth = Dopri5::shared(plant.to_shared(), spec.plant_tolerance);
        let run = ClosedLoop::new(nmpc, truth, reference, &spec.initial_state)?;
        let run = if spec.preview { run } else { run.without_preview() };
        Ok(match &spec.initial_input {
            Some(input) => run.with_initial_input(input)?,
            None => run,
        })
    }

    /// The dense trace of a loop.
    fn trace(&self, run: &ClosedLoop<'_>, plant: &dyn DynPlant) -> ControlTrace {
        let variables = Variables::of(plant);
        let own = variables.own_outputs();
        let trace = run.trajectory();
        let row = |(i, t): (usize, &f64)| {
            let outputs = if own.is_empty() { Vec::new() } else { run.outputs_at(i) };
            ControlRow {
                t: *t,
                state: trace.state(i).to_vec(),
                input: trace.input(i).to_vec(),
                reference: run.reference_at(i).to_vec(),
                output: own.iter().map(|(place, _)| outputs[*place]).collect(),
            }
        };
        ControlTrace {
            states: variables.state_names(),
            inputs: variables.input_names(),
            controlled: self.spec.controlled.clone(),
            outputs: variables.own_output_names(),
            rows: trace.times().iter().enumerate().map(row).collect(),
        }
    }

    /// How near its reference each controlled quantity stays to count as settled: as the config
    /// says, or a hundredth of its largest error. Rounding of the reference is no error.
    fn settled_within(&self, run: &ClosedLoop<'_>) -> Vec<f64> {
        if let Some(within) = &self.spec.settled_within {
            return within.clone();
        }
        let size = |i: usize| {
            self.spec.references.iter().fold(0.0, |size: f64, step| size.max(step.value[i].abs()))
        };
        let errors = run.largest_errors().into_iter().enumerate();
        errors.map(|(i, error)| (0.01 * error).max(1e-9 * size(i))).collect()
    }

    /// Whether the references were reached.
    fn reached(&self, run: &ClosedLoop<'_>) -> ReferenceMetrics {
        let within = self.settled_within(run);
        let segments = run.segments(&within);
        #[expect(clippy::cast_precision_loss, reason = "no run has 2^53 steps")]
        let seconds = |steps: usize| steps as f64 * self.sample_time_s;
        let offsets = |i: usize| {
            let offsets = segments.iter().map(|segment| segment.offset[i]);
            offsets.map(|offset| offset.is_finite().then_some(offset)).collect()
        };
        let names = || self.spec.controlled.iter().cloned();
        ReferenceMetrics {
            reference_start_s: segments.iter().map(|s| seconds(s.steps.start)).collect(),
            offset: names().enumerate().map(|(i, name)| (name, offsets(i))).collect(),
            settle_s: segments.iter().map(|s| s.settled.map(seconds)).collect(),
            settled_within: names().zip(within).collect(),
        }
    }
}

/// How long the controller took, in s, for each step of each repetition.
#[derive(Default)]
struct Times(Vec<Vec<f64>>);

impl Times {
    /// Runs the loop to its end, with an eye on the clock.
    fn watch(
        &mut self,
        run: &mut ClosedLoop<'_>,
        budget: Option<Duration>,
        mut guard: Option<&mut Guard<'_>>,
    ) -> Result<(), BenchError> {
        let mut times = Vec::new();
        loop {
            let x = run.state().to_vec();
            let clock = Instant::now();
            let mut expired = || budget.is_some_and(|budget| clock.elapsed() >= budget);
            let control = run.control_within(&mut expired)?;
            let time = clock.elapsed();
            let Some(control) = control else { break };
            times.push(time.as_secs_f64());
            if let Some(guard) = &mut guard {
                guard.look(&x, control.u())?;
            }
            control.advance()?;
        }
        self.0.push(times);
        Ok(())
    }

    /// The rows of `steps.csv`, with each step's median time.
    fn rows(&self, results: &Results) -> Vec<StepRow> {
        let row = |(k, step): (usize, &StepRecord)| {
            let times = self.0.iter().map(|run| 1e6 * run[k]).collect();
            StepRow {
                step: k,
                status: step.status.to_string(),
                sqp_iterations: step.sqp_iterations,
                kkt: step.kkt,
                solve_us: WallTimes::of(times).median,
                violated: step.violated.map_or(String::new(), |constraint| constraint.to_string()),
            }
        };
        results.steps.iter().enumerate().map(row).collect()
    }
}

/// The results of a closed loop, except times.
struct Results {
    steps: Vec<StepRecord>,
    rmse: f64,
    iae: f64,
    rmse_dense: f64,
    iae_dense_sum: f64,
    max_violation: f64,
    references: ReferenceMetrics,
}

impl Results {
    fn of(run: &ClosedLoop<'_>, setup: &LoopSetup<'_>) -> Self {
        let (at_steps, dense) = (run.tracking_at_steps(), run.tracking_dense());
        Self {
            steps: run.steps().to_vec(),
            rmse: at_steps.rmse(),
            iae: at_steps.iae_mean(),
            rmse_dense: dense.rmse(),
            iae_dense_sum: dense.iae_sum(),
            max_violation: run.max_violation(),
            references: setup.reached(run),
        }
    }

    fn metrics(self, model: ModelKind, times: Times) -> ControlMetrics {
        let Self { steps, rmse, iae, rmse_dense, iae_dense_sum, max_violation, references } = self;
        let mut status = BTreeMap::new();
        for step in &steps {
            *status.entry(step.status.to_string()).or_default() += 1;
        }
        #[expect(clippy::cast_precision_loss, reason = "no run has 2^53 iterations")]
        let mean = |sum: usize| sum as f64 / steps.len() as f64;
        ControlMetrics {
            model,
            rmse,
            iae,
            rmse_dense,
            iae_dense_sum,
            wall_s: WallTimes::of(times.0.iter().map(|run| run.iter().sum()).collect()),
            step_us: StepTimes::of(times.0.iter().flatten().map(|s| 1e6 * s).collect()),
            sqp_iterations_mean: mean(steps.iter().map(|step| step.sqp_iterations).sum()),
            kkt_max: steps.iter().map(|step| step.kkt).fold(0.0, f64::max),
            max_violation,
            status,
            references,
            outside_domain: None,
        }
    }
}
