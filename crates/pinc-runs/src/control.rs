//! The closed-loop stage: the plant under the controller, with one model after the other.

use super::feedback::{self, TimedFeedback};
use super::first_plan::first_plan;
use super::guard::{Ahead, Guard};
use super::recording::{Recording, Totals, TraceColumns, write_medians};
use super::{Options, loop_error, model_error};
use crate::RunError;
use crate::progress::Stage;
use pinc_config::{ControlSpec, Experiment, HorizonPlants, ModelKind, Schedule, Variables};
use pinc_estimate::{Augmentation, SteadyTarget};
use pinc_loop::{ClosedLoop, Violation};
use pinc_mpc::{BoundSchedule, Bounded, Nmpc, NmpcProblem, Reference, Scenarios};
use pinc_net::{PincNet, TrainingTarget};
use pinc_ode::{DynPlant, DynRhs, PiecewiseConstant, Simulator};
use pinc_record::{
    ControlColumns, ControlMetrics, CostMetrics, EstimatorMetrics, FirstPlanMetrics, Metrics,
    ReferenceMetrics, RunDir, StepTimes, ViolationMetrics, WallTimes, decimals, file,
};
use std::borrow::Cow;
use std::cell::Cell;
use std::time::{Duration, Instant};

/// A deviation of this share of a reference is rounding, and within the tolerance of the optimization.
const ROUNDING: f64 = 1e-6;

/// The inputs of closed loops.
#[derive(Debug)]
pub struct LoopSetup<'a> {
    /// The section of the config.
    pub(crate) spec: &'a ControlSpec,
    /// Which of the config's models are run.
    pub(crate) kinds: &'a [ModelKind],
    /// The net, where one of them needs it.
    pub(crate) net: Option<&'a PincNet>,
    /// The proven error of a step of the net, where a tube asks for it.
    pub(crate) proven: Option<Vec<f64>>,
    /// Length T of a step.
    pub(crate) sample_time_s: f64,
    /// What the noise of measurements follows from.
    pub(crate) seed: u64,
    /// The p of the models; those that are estimated have their initial estimates.
    pub(crate) parameters: &'a [f64],
    /// The places of those.
    pub(crate) estimated: &'a [usize],
    /// The places of those that the controller is told anew.
    pub(crate) known: &'a [usize],
    /// Other forms of the plant that the models are of.
    pub(crate) beside: HorizonPlants,
    /// What the models' parameters may be.
    pub(crate) scenarios: Option<Scenarios>,
    /// The plant in the loop at first.
    pub(crate) truth: &'a dyn DynRhs,
    /// How the parameters of models and the plant change.
    pub(crate) schedules: Schedules,
}

/// How models and plant in a loop change.
#[derive(Clone, Debug, Default)]
pub(crate) struct Schedules {
    /// The parameters that the models are told.
    pub(crate) model: Schedule,
    /// Whether they are told them in advance.
    pub(crate) preview: bool,
    /// The plants that take the place of the first one, each from a step on, in their order.
    pub(crate) plants: Vec<(usize, Simulator)>,
}

impl Schedules {
    /// Makes the changes that come with `step`.
    fn apply(&self, run: &mut ClosedLoop<'_>, step: usize) -> Result<(), RunError> {
        if let Ok(place) = self.plants.binary_search_by_key(&step, |(from, _)| *from) {
            run.set_plant(self.plants[place].1.clone());
        }
        match (self.preview, self.model.beginning(step)) {
            (false, Some(p)) => Ok(run.set_model_parameters(p)?),
            _ => Ok(()),
        }
    }
}

/// Runs the closed loops, unless all have been run. `plant` is the one that the models are of.
pub(crate) fn stage(
    plant: &dyn DynPlant,
    setup: &LoopSetup<'_>,
    options: &Options<'_>,
    run_dir: &mut RunDir,
) -> Result<(), RunError> {
    let done = run_dir.metrics().control.iter().map(|run| run.model);
    if done.eq(setup.kinds.iter().copied()) {
        return Ok(());
    }
    let distilled = setup.net.is_some_and(|net| net.source() == TrainingTarget::Integrator);
    run_dir.update(|all| (all.control, all.distilled) = (Vec::new(), distilled))?;
    run_dir.remove_loops()?;
    let mut first_failure = None;
    for &kind in setup.kinds {
        let metrics = match run_model(plant, setup, kind, options, run_dir) {
            // The other models may do better.
            Err(error) if error.is_of_this_run() => {
                first_failure.get_or_insert(error);
                continue;
            }
            outcome => outcome?,
        };
        let models = setup.kinds.len();
        let files = [file::control, file::steps, file::plans].map(|name| name(kind, models));
        run_dir.note(&files.each_ref().map(String::as_str));
        if metrics.estimator.is_some() {
            run_dir.note(&[&file::estimates(kind, models)]);
        }
        if let Some(net) = setup.net.filter(|_| kind == ModelKind::Pinc && run_dir.keeps_traces()) {
            let trace = run_dir.path(&file::control(kind, models));
            loop_error::write(setup, net, plant, &trace, run_dir)?;
            run_dir.note(&[file::MODEL_ERROR]);
        }
        run_dir.update(|all| all.control.push(metrics))?;
    }
    first_failure.map_or(Ok(()), Err)
}

fn run_model(
    plant: &dyn DynPlant,
    setup: &LoopSetup<'_>,
    kind: ModelKind,
    options: &Options<'_>,
    run_dir: &RunDir,
) -> Result<ControlMetrics, RunError> {
    let ControlSpec { repetitions, budget_us, .. } = setup.spec;
    let (mut nmpc, log) = setup.judged_controller(kind, plant)?;
    let name = format!("control {kind}");
    let mut progress = Stage::begin(options.verbosity, &name, *repetitions as u64);
    let mut times = Times::default();
    let mut results = None;
    let (mut outside_domain, mut estimates, mut estimator_us) = (None, None, Vec::new());
    let (names, mut model_error) = (Variables::of(plant).state_names(), None);
    let steps_file = run_dir.path(&file::steps(kind, setup.kinds.len()));
    for repetition in 0..*repetitions {
        options.check_interrupt(run_dir.dir())?;
        progress.advance(repetition as u64, String::new);
        let mut feedback = setup.feedback(kind, plant)?;
        let estimating = feedback.as_ref().map(TimedFeedback::clock);
        let mut run = setup.begin(&mut nmpc)?;
        if let Some(feedback) = &mut feedback {
            run = run.with_observer(feedback);
        }
        let mut guard = setup.guard(kind, plant);
        let budget = Budget {
            time: budget_us.map(|us| Duration::from_secs_f64(1e-6 * us)),
            estimating: estimating.as_deref(),
        };
        // Only the first leaves results: the others give the same numbers in other times.
        if results.is_some() {
            times.watch(&mut run, budget, &mut guard, None, &setup.schedules)?;
            estimator_us.extend(feedback.iter().flat_map(TimedFeedback::step_us));
            continue;
        }
        let trace_file = run_dir.path(&file::control(kind, setup.kinds.len()));
        let plans_file = run_dir.path(&file::plans(kind, setup.kinds.len()));
        let files = run_dir.keeps_traces().then_some([&*trace_file, &*steps_file, &*plans_file]);
        let mut recording = Recording::begin(files, setup.columns())?;
        let recorded = Some(&mut recording);
        let outcome = times.watch(&mut run, budget, &mut guard, recorded, &setup.schedules);
        let totals = recording.finish(&run)?;
        let found = outcome.is_ok().then(|| measured(&run, totals, setup, kind, &times));
        estimates = feedback;
        if let Some(feedback) = &estimates {
            if run_dir.keeps_traces() {
                let name = file::estimates(kind, setup.kinds.len());
                run_dir.write(&name, setup.estimates(feedback.history()).to_csv().as_bytes())?;
            }
            estimator_us.extend(feedback.step_us());
        }
        outcome?;
        results = found;
        outside_domain = guard.map(Guard::found);
        model_error = log.as_ref().map(|log| model_error::read(log, |log| log.metrics(&names)));
    }
    let results = results.expect("there is at least one repetition");
    if *repetitions > 1 && run_dir.keeps_traces() {
        write_medians(&steps_file, |k| times.median_us(k))?;
    }
    let iae = Some(results.iae_dense_sum).filter(|iae| !iae.is_nan());
    let iae = iae.map_or_else(String::new, |iae| format!(", IAE {}", decimals(iae, 4)));
    progress.end(&format!("{repetitions} runs{iae}"));
    let variables = Variables::of(plant);
    let states = variables.state_names();
    let measured = setup.sections().map_or_else(Vec::new, |(_, of)| of.names(&variables));
    let names = (&states[..], &measured[..]);
    let estimator = estimates.map(|of| EstimatorMetrics {
        nearest_held: of.nearest_held(setup.spec),
        targets_not_found: of.target.as_ref().map(SteadyTarget::not_found).filter(|of| *of > 0),
        ..feedback::metrics(of.history(), names, estimator_us)
    });
    let (wall_s, step_us) = (times.of_runs(), times.of_steps());
    Ok(ControlMetrics { wall_s, step_us, outside_domain, model_error, estimator, ..results })
}

/// Whether a finished run did what it was for.
///
/// # Errors
///
/// [`RunError::Failed`] if more control steps failed in a loop than the config allows.
pub fn verdict(experiment: &Experiment, metrics: &Metrics) -> Result<(), RunError> {
    let Some(spec) = &experiment.control else { return Ok(()) };
    let share = |of: &ControlMetrics| of.failed_steps() as f64 / of.steps() as f64;
    match metrics.control.iter().find(|of| share(of) > spec.max_failed_share) {
        None => Ok(()),
        Some(of) => Err(RunError::Failed(format!(
            "the loop with {} failed: {} of {} control steps failed, more than \
             control.max_failed_share = {} allows; the results are kept",
            of.model,
            of.failed_steps(),
            of.steps(),
            spec.max_failed_share
        ))),
    }
}

impl<'a> LoopSetup<'a> {
    /// With an integrator as the model of the plant in the loop.
    #[must_use]
    pub fn numerical(spec: &'a ControlSpec, sample_time_s: f64, plant: &'a dyn DynPlant) -> Self {
        let kinds = &[ModelKind::RK4];
        Self {
            spec,
            kinds,
            net: None,
            proven: None,
            sample_time_s,
            seed: 0,
            parameters: &[],
            estimated: &[],
            known: &[],
            beside: HorizonPlants::default(),
            scenarios: None,
            truth: plant,
            schedules: Schedules::default(),
        }
    }
}

impl LoopSetup<'_> {
    /// What the model has besides the net: an augmentation, and branches or intervals of parameters.
    pub(crate) fn unknowns(&self, plant: &dyn DynPlant) -> (Option<Augmentation>, Ahead) {
        let augmentation = self.sections().map(|(of, by)| self.augmentation(of, &by, plant));
        let ahead = match (&self.scenarios, &self.spec.uncertainty) {
            (Some(Scenarios { parameters, values, .. }), _) => {
                Ahead { places: parameters.clone(), values: values.clone() }
            }
            (None, Some(of)) if !of.parameters.is_empty() => Ahead {
                places: of.places(plant.parameters()).collect(),
                values: [0, 1].map(|end| of.parameters.values().map(|of| of[end]).collect()).into(),
            },
            (None, _) => Ahead::default(),
        };
        (augmentation, ahead)
    }

    /// What watches the net, if that is the model.
    fn guard(&self, kind: ModelKind, plant: &dyn DynPlant) -> Option<Guard<'_>> {
        let net = self.net.filter(|_| self.spec.model_of(kind) == ModelKind::Pinc)?;
        Some(Guard::new(Cow::Borrowed(net), self.spec.outside_domain, self.unknowns(plant)))
    }

    /// The control problem.
    #[must_use]
    pub fn problem(&self) -> NmpcProblem {
        let problem = self.spec.problem(&Variables::of(self.truth), self.sample_time_s);
        let (parameters, scenarios) = (self.parameters.to_vec(), self.scenarios.clone());
        NmpcProblem { parameters, scenarios, ..problem }
    }

    /// What is followed, step by step.
    pub(super) fn reference(&self) -> Result<Reference, RunError> {
        let references = &self.spec.references;
        let steps = pinc_config::steps(self.spec.duration_s, self.sample_time_s);
        if self.spec.controlled.is_empty() {
            return Ok(Reference::none(steps));
        }
        let starts = references.iter().map(|step| step.start_s).collect();
        let values = references.iter().map(|step| step.value.clone()).collect();
        let signal = PiecewiseConstant::new(starts, values)?;
        Ok(Reference::sample(&signal, steps, self.sample_time_s)?)
    }

    /// How the bounds change, if they do.
    pub(super) fn bounds(&self) -> Result<Option<BoundSchedule>, RunError> {
        let variables = Variables::of(self.truth);
        Ok(self.spec.bound_schedule(&self.problem(), &variables, self.sample_time_s)?)
    }

    /// The loop at its beginning.
    ///
    /// # Errors
    ///
    /// [`RunError`] if the parts do not fit together.
    pub fn begin<'n>(&self, nmpc: &'n mut Nmpc) -> Result<ClosedLoop<'n>, RunError> {
        let (spec, reference) = (self.spec, self.reference()?);
        let truth = Simulator::new(self.truth, spec.plant_tolerance);
        let run = ClosedLoop::new(nmpc, truth, reference, &spec.initial_state)?;
        let run = if spec.preview { run } else { run.without_preview() };
        let run = match self.bounds()? {
            Some(bounds) => run.with_bounds(bounds),
            None => run,
        };
        let known = self.schedules.model.values.clone().filter(|_| self.schedules.preview);
        let run = match known {
            Some(parameters) => run.with_known_parameters(parameters),
            None => run,
        };
        let run = match &spec.initial_input {
            Some(input) => run.with_initial_input(input)?,
            None => run,
        };
        Ok(match first_plan(self.spec, &Variables::of(self.truth), self.sample_time_s)? {
            Some(inputs) => run.with_first_plan(&inputs)?,
            None => run,
        })
    }

    /// The columns of the loop's trace.
    fn columns(&self) -> TraceColumns {
        let variables = Variables::of(self.truth);
        TraceColumns {
            columns: ControlColumns {
                states: variables.state_names(),
                inputs: variables.input_names(),
                controlled: self.spec.controlled.clone(),
                outputs: variables.own_output_names(),
            },
            outputs: variables.own_outputs().iter().map(|(place, _)| *place).collect(),
            widths: self.spec.input_widths(),
            step_s: self.sample_time_s,
            delay: self.spec.delay_steps,
        }
    }

    /// How near its reference each controlled quantity stays to count as settled: as the config
    /// says, or a hundredth of its largest error, but not so near that rounding decides.
    fn settled_within(&self, run: &ClosedLoop<'_>) -> Vec<f64> {
        if let Some(within) = &self.spec.settled_within {
            return within.clone();
        }
        let band = |(i, error): (usize, f64)| {
            let sizes = self.spec.references.iter().map(|step| step.value[i].abs());
            (0.01 * error).max(ROUNDING * sizes.fold(0.0, f64::max))
        };
        run.largest_errors().into_iter().enumerate().map(band).collect()
    }

    /// The bounds that the plant broke.
    pub(super) fn violations(&self, run: &ClosedLoop<'_>) -> Vec<ViolationMetrics> {
        let named = |violation: &Violation| {
            let (variable, from_step) = match violation.of {
                Bounded::State(i) => (&self.truth.states()[i], 1),
                Bounded::Input(i) => (&self.truth.inputs()[i], 1),
                Bounded::Output(i) => (&self.truth.outputs()[i], self.spec.n1),
            };
            ViolationMetrics::new(violation, &variable.name, &variable.unit, from_step)
        };
        run.violations().map(named).collect()
    }

    /// Whether the references of what has a weight were reached.
    pub(super) fn reached(&self, run: &ClosedLoop<'_>) -> ReferenceMetrics {
        let (within, weights) = (self.settled_within(run), self.problem().weights);
        let judged =
            |(i, most): (usize, &f64)| if weights.tracks(i) { *most } else { f64::INFINITY };
        let segments = run.segments(&within.iter().enumerate().map(judged).collect::<Vec<_>>());
        let seconds = |steps: usize| steps as f64 * self.sample_time_s;
        let offsets = |i: usize| {
            let offsets = segments.iter().map(|segment| segment.offset[i]);
            offsets.map(|o| (weights.tracks(i) && o.is_finite()).then_some(o)).collect()
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

/// The time that the controller and its estimator have for a step.
#[derive(Clone, Copy)]
struct Budget<'a> {
    time: Option<Duration>,
    /// How long the estimator took last, which is not the controller's time.
    estimating: Option<&'a Cell<Duration>>,
}

/// How long the controller took, in s.
#[derive(Default)]
struct Times {
    /// Each step of each repetition: of the first, then of the second, ..
    steps: Vec<f64>,
    /// The sum of each repetition.
    runs: Vec<f64>,
}

impl Times {
    /// Runs the loop to its end, with an eye on the clock.
    fn watch(
        &mut self,
        run: &mut ClosedLoop<'_>,
        budget: Budget<'_>,
        guard: &mut Option<Guard<'_>>,
        mut recording: Option<&mut Recording>,
        schedules: &Schedules,
    ) -> Result<(), RunError> {
        let mut sum = 0.0;
        for step in 0.. {
            schedules.apply(run, step)?;
            let clock = Instant::now();
            let mut expired = || budget.time.is_some_and(|budget| clock.elapsed() >= budget);
            let control = run.control_within(&mut expired)?;
            let estimating = budget.estimating.map_or(Duration::ZERO, Cell::get);
            let time = clock.elapsed().saturating_sub(estimating).as_secs_f64();
            let Some(control) = control else { break };
            self.steps.push(time);
            sum += time;
            if let Some(recording) = &mut recording {
                recording.controlled(&control, 1e6 * time)?;
            }
            if let Some(guard) = guard {
                let [x, u, p] = [control.seen(), control.u(), control.parameters()];
                guard.look_along(control.plan(), x, u, p)?;
            }
            let advanced = control.advance();
            if let Some(recording) = &mut recording {
                recording.advanced(run)?;
            }
            advanced?;
        }
        self.runs.push(sum);
        Ok(())
    }

    /// The statistics of the repetitions.
    fn of_runs(&self) -> WallTimes {
        WallTimes::of(self.runs.clone())
    }

    /// The statistics of all steps.
    fn of_steps(&self) -> StepTimes {
        StepTimes::of(self.steps.iter().map(|time| 1e6 * time).collect())
    }

    /// The median over the repetitions of step `k`, in us.
    fn median_us(&self, k: usize) -> f64 {
        let steps = self.steps.len() / self.runs.len();
        WallTimes::of(self.steps[k..].iter().step_by(steps).map(|s| 1e6 * s).collect()).median
    }
}

/// The results of a closed loop, with the times so far.
fn measured(
    run: &ClosedLoop<'_>,
    totals: Totals,
    setup: &LoopSetup<'_>,
    model: ModelKind,
    times: &Times,
) -> ControlMetrics {
    let (at_steps, dense) = (run.tracking_at_steps(), run.tracking_dense());
    let violations = setup.violations(run);
    let largest = violations.iter().max_by(|a, b| a.amount.total_cmp(&b.amount));
    ControlMetrics {
        model,
        rmse: at_steps.rmse(),
        iae: at_steps.iae_mean(),
        rmse_dense: dense.rmse(),
        // Nothing is tracked well, or badly, where nothing has a reference.
        iae_dense_sum: if setup.spec.controlled.is_empty() { f64::NAN } else { dense.iae_sum() },
        input_travel: totals.input_travel,
        wall_s: times.of_runs(),
        step_us: times.of_steps(),
        sqp_iterations_mean: totals.sqp_iterations_mean(),
        kkt_max: totals.kkt_max,
        max_violation: run.max_violation(),
        max_violation_of: largest.cloned(),
        violations,
        cost: setup.spec.cost.as_ref().and(totals.first_cost).map(|first_plan| CostMetrics {
            first_plan,
            curvature_dropped: totals.curvature_dropped,
        }),
        status: totals.status,
        start: totals.start.map(|best| FirstPlanMetrics { starts: setup.spec.sqp.starts, best }),
        tube: totals.tube,
        references: setup.reached(run),
        outside_domain: None,
        model_error: None,
        estimator: None,
    }
}
