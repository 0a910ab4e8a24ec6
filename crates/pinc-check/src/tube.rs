//! The distances by which a tube tightens bounds, and bounds that leave no room.

use crate::numbers::with_unit;
use crate::{Finding, Rehearsal, Subject, estimation::marks};
use pinc_config::{
    ControlSpec, LoopParameters, NetErrorSpec, TubeParts, UncertaintySpec, Variables,
};
use pinc_mpc::NmpcProblem;
use pinc_ode::{DynPlant, Integrator, LinearizationBuffer, Stages, Variable};
use pinc_tube::{AlongPlan, BackOffs, Tube, TubeModel};

/// The section that findings are about.
const SECTION: &str = "control.uncertainty";

/// Plans that are looked at, along the closed loop.
const PLANS: usize = 20;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else { return Vec::new() };
    let (Some(spec), Some(Ok(rehearsal))) = (&control.uncertainty, &subject.evidence.rehearsal)
    else {
        return Vec::new();
    };
    let LoopParameters { names, values, .. } = subject.experiment.loop_parameters();
    let plant = subject.experiment.plant.family(&names);
    let problem = control.problem(&Variables::of(&*plant), subject.step_s());
    let problem = NmpcProblem { parameters: values, ..problem };
    let Some(found) = along_the_loop((control, spec), &*plant, &problem, rehearsal, subject) else {
        return Vec::new();
    };
    let (bounds, unlimited): (Vec<_>, Vec<_>) =
        bounds(&problem, &*plant, &found).into_iter().partition(|bound| bound.by.is_finite());
    let tightened = bounds.iter().filter(|bound| bound.by > 0.0).map(Bound::in_words);
    let tightened: Vec<_> = tightened.collect();
    let left_out = [
        ("the estimator's covariance", spec.estimate),
        ("the net's error", spec.net_error != NetErrorSpec::NONE),
    ]
    .iter()
    .filter_map(|(name, counts)| counts.then_some(*name))
    .collect::<Vec<_>>();
    let mut what = match tightened.is_empty() {
        true => "no bound is tightened by a known distance at the horizon's end".to_owned(),
        false => {
            format!("at the horizon's end bounds are tightened by at most {}", tightened.join(", "))
        }
    };
    if !left_out.is_empty() {
        what.push_str(&format!("; not counted here: {}", left_out.join(", ")));
    }
    let mut findings = vec![Finding::fact(SECTION, what)];
    if !unlimited.is_empty() {
        let names: Vec<_> = unlimited.iter().map(|bound| &*bound.variable.name).collect();
        let what = format!("deviations of {} from a plan have no limit", names.join(", "));
        let finding = Finding::warning(SECTION, what)
            .because("the model has no value for some of what is uncertain, or a number overflows")
            .change("narrow what is uncertain");
        findings.push(finding);
    }
    for bound in bounds.iter().filter(|bound| bound.room <= 0.0) {
        let what = format!(
            "nothing is left between the bounds of {}, which are {} apart and tightened by {}",
            bound.variable.name,
            bound.amount(bound.room + 2.0 * bound.by),
            bound.amount(bound.by)
        );
        let finding = Finding::warning(SECTION, what)
            .because("no plan keeps these bounds, and the plant may break them")
            .change("shorten the horizon, narrow what is uncertain, or lower the probability");
        findings.push(finding);
    }
    findings
}

/// The back-offs of the plans that the closed loop carries out, the largest of each.
fn along_the_loop(
    (control, spec): (&ControlSpec, &UncertaintySpec),
    plant: &dyn DynPlant,
    problem: &NmpcProblem,
    rehearsal: &Rehearsal,
    subject: &Subject<'_>,
) -> Option<BackOffs> {
    let integrator = rehearsal.model.integrator().unwrap_or(Integrator::Rk4);
    let step_s = subject.step_s();
    let substeps = control.substeps(integrator, step_s, step_s);
    let model = || plant.model(integrator, step_s, substeps).ok();
    let (mut along, own) = (model()?, model()?);
    let (dims, stages) = (along.dims(), problem.horizon);
    let parts = TubeParts {
        sizes: (dims, problem),
        variables: &Variables::of(plant),
        model: TubeModel { model: own, more: Vec::new() },
        places: &spec.places(plant.parameters()).collect::<Vec<_>>(),
        proven: None,
        error: None,
    };
    let mut tube = spec.tube(parts).ok()?;
    let marks = marks(rehearsal, step_s);
    let zeros = |size: usize| vec![0.0; size];
    let outputs = problem.output_bounds.as_ref().map_or(0, |_| dims.ny);
    let new = || BackOffs {
        states: zeros(stages * dims.nx),
        inputs: zeros(problem.control_horizon * dims.nu),
        outputs: zeros(stages * outputs),
        starts: Vec::new(),
    };
    let (mut found, mut largest) = (new(), new());
    let mut at = LinearizationBuffer::new(dims, stages);
    let p = problem.parameters.repeat(stages);
    let starts = 0..marks.len();
    for start in starts.step_by(marks.len().div_ceil(PLANS).max(1)) {
        let place = |j: usize| marks[(start + j).min(marks.len() - 1)];
        let trace = &rehearsal.trace;
        let x: Vec<f64> = (0..stages).flat_map(|j| trace.state(place(j)).to_vec()).collect();
        let u: Vec<f64> = (0..stages).flat_map(|j| trace.input(place(j)).to_vec()).collect();
        let plan = Stages { x: &x, u: &u, p: &p };
        along.linearize(plan, at.as_mut());
        tube.write(AlongPlan::new(plan, [&at.a, &at.b], dims, 0), &mut found);
        for (largest, found) in [
            (&mut largest.states, &found.states),
            (&mut largest.inputs, &found.inputs),
            (&mut largest.outputs, &found.outputs),
        ] {
            let known = |by: f64| if by.is_nan() { f64::INFINITY } else { by };
            largest.iter_mut().zip(found).for_each(|(most, by)| *most = most.max(known(*by)));
        }
    }
    Some(largest)
}

/// What is left of a pair of bounds at the horizon's end.
struct Bound<'a> {
    variable: &'a Variable,
    by: f64,
    room: f64,
}

impl Bound<'_> {
    fn amount(&self, size: f64) -> String {
        with_unit(size, &self.variable.unit)
    }

    fn in_words(&self) -> String {
        format!("{} {}", self.variable.name, self.amount(self.by))
    }
}

/// All quantities that have bounds, at the end of the horizon.
fn bounds<'a>(problem: &NmpcProblem, plant: &'a dyn DynPlant, found: &BackOffs) -> Vec<Bound<'a>> {
    let none = pinc_mpc::Bounds::none(0);
    let mut all = Vec::new();
    for (variables, bounds, back_offs) in [
        (plant.states(), &problem.state_bounds, &found.states),
        (plant.inputs(), &problem.input_bounds, &found.inputs),
        (plant.outputs(), problem.output_bounds.as_ref().unwrap_or(&none), &found.outputs),
    ] {
        let last = back_offs.len().saturating_sub(variables.len());
        let sides = bounds.low.iter().zip(&bounds.high).zip(&back_offs[last..]);
        for (variable, ((low, high), &by)) in variables.iter().zip(sides) {
            if low.is_finite() || high.is_finite() {
                all.push(Bound { variable, by, room: high - low - 2.0 * by });
            }
        }
    }
    all
}
