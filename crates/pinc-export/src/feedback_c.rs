//! An estimator in C, around the controller that it tells the state.

use crate::controller::Controller;
use crate::selftest::{Precision, check_step, difference, in_float, is_unsolved, set_allowed};
use crate::template::{Template, array, constant, places, table};
use crate::{ExportError, GeneratedFile, golden};
use pinc_estimate::{
    Augmentation, Augmented, Disturbance, Ekf, Estimator, Gate, Measured, Mhe, Tuning, Ukf,
};
use pinc_mpc::{Nmpc, ProblemUnits};
use pinc_ode::{Dims, Memory, Model};

/// The estimator of a controller: which one, of what, and how it is tuned.
#[derive(Clone, Copy, Debug)]
pub struct Estimation<'a> {
    /// The estimator.
    pub filter: Filter,
    /// The measured quantities, and where disturbances enter.
    pub augmentation: &'a Augmentation,
    /// Its initial belief, and its trust in model and measurements.
    pub tuning: &'a Tuning,
}

/// The estimators that there are in C.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Filter {
    /// The extended Kalman filter.
    Extended,
    /// The unscented Kalman filter.
    Unscented,
    /// Moving horizon estimation over a window of so many steps.
    MovingHorizon(usize),
}

/// What the self-test is given and is to find, a row per step.
#[derive(Debug, Default)]
struct Rows {
    measured: Vec<Vec<f64>>,
    windows: Vec<Vec<f64>>,
    inputs: Vec<Vec<f64>>,
    estimates: Vec<Vec<f64>>,
}

impl Estimation<'_> {
    /// The estimator, as the library has it.
    fn library(
        &self,
        model: Box<dyn Model>,
        initial_input: &[f64],
    ) -> Result<Box<dyn Estimator>, ExportError> {
        let model = Box::new(Augmented::new(model, self.augmentation.clone())?);
        let tuning = self.tuning.clone();
        let mut estimator: Box<dyn Estimator> = match self.filter {
            Filter::Extended => Box::new(Ekf::new(model, tuning)?),
            Filter::Unscented => Box::new(Ukf::new(model, tuning)?),
            Filter::MovingHorizon(steps) => Box::new(Mhe::new(model, tuning, steps)?),
        };
        estimator.reset_input(initial_input);
        Ok(estimator)
    }

    /// Whether outputs are measured, not states alone.
    pub(crate) fn measures_outputs(&self) -> bool {
        self.augmentation.measured.iter().any(|measured| matches!(measured, Measured::Output(_)))
    }

    /// What is measured, by the places of states, and of outputs behind them.
    pub(crate) fn measured(&self, dims: Dims) -> Result<Vec<usize>, ExportError> {
        let place = |measured: &Measured| match *measured {
            Measured::State(state) => Ok(state),
            Measured::Output(output) => Ok(dims.nx + output),
            _ => Err(ExportError::Feature {
                feature: "measured quantities of this kind",
                instead: "states or outputs",
            }),
        };
        self.augmentation.measured.iter().map(place).collect()
    }

    /// Where each disturbance enters: the inputs, measured quantities or states.
    fn places(&self, dims: Dims) -> Result<Vec<usize>, ExportError> {
        Ok(match &self.augmentation.disturbance {
            Disturbance::Input => (0..dims.nu).collect(),
            Disturbance::Output => self.measured(dims)?,
            Disturbance::States(states) => states.clone(),
            _ => Vec::new(),
        })
    }
}

/// Fills what the controller knows of disturbances and estimated parameters, and how it sees the
/// model: through its disturbances, units and outputs, or as it is.
pub(crate) fn set_unknowns(
    t: &mut Template,
    controller: &Controller<'_>,
    dims: Dims,
) -> Result<(), ExportError> {
    let estimation = controller.estimator;
    let entries = estimation.map_or_else(|| Ok(Vec::new()), |of| of.places(dims))?;
    let open = controller.open();
    let disturbance = estimation.map(|of| &of.augmentation.disturbance);
    let is = |of: &dyn Fn(&Disturbance) -> bool| u8::from(disturbance.is_some_and(of));
    let none = if open.count() == 0 { "#define PINC_NP 0\n" } else { "" };
    let defines = format!(
        "/** Number of disturbances and parameters that are estimated; of disturbances alone,\n \
         * and where they enter. */\n\
         #define PINC_NW {}\n\
         #define PINC_ND {}\n\
         {none}\
         #define PINC_DISTURBED_INPUTS {}\n\
         #define PINC_DISTURBED_OUTPUTS {}\n\
         #define PINC_DISTURBED_STATES {}\n",
        entries.len() + open.count(),
        entries.len(),
        is(&|of| *of == Disturbance::Input),
        is(&|of| *of == Disturbance::Output),
        is(&|of| matches!(of, Disturbance::States(_))),
    );
    let unknowns = entries.len() + open.count();
    let plain = unknowns == 0 && !has_units(&controller.units(dims));
    let plain = plain && !controller.optimizes_outputs() && controller.guard.is_none();
    t.set("UNKNOWNS", if plain && estimation.is_none() { "" } else { &defines });
    t.set("UNKNOWN_FIELD", if unknowns == 0 { "" } else { UNKNOWN_FIELD });
    t.set("INIT_UNKNOWN", if open.count() == 0 { "" } else { INIT_UNKNOWN });
    t.set("PLACES", if entries.is_empty() { String::new() } else { places("place", &entries) });
    let call = |of: &str| match plain {
        true => format!("pinc_@MODEL@_{of}("),
        false => format!("pinc_seen_{of}(m, "),
    };
    t.set("STEP", call("step")).set("LINEARIZE", call("linearize_all"));
    t.set("PLANT", if plain { "" } else { include_str!("../templates/mpc_model.c") });
    Ok(())
}

/// What a controller with unknowns has besides.
const UNKNOWN_FIELD: &str = "    /** The disturbances, then the parameters, that the model is taken to have. */\n    \
     PINC_REAL unknown[PINC_NW];\n";

/// What sets its parameters up.
const INIT_UNKNOWN: &str = "    pinc_copy(m->unknown + PINC_ND, pinc_parameters, PINC_NP);\n";

/// Whether any unit is not 1.
pub(crate) fn has_units(units: &ProblemUnits) -> bool {
    let ProblemUnits { states, inputs, outputs, cost } = units;
    let mut all = states.iter().chain(inputs).chain(outputs).chain([cost]);
    all.any(|unit| unit.to_bits() != 1.0_f64.to_bits())
}

/// Header and source of the estimator. The places of [`set_unknowns`] are filled.
pub(crate) fn feedback_core(
    t: &mut Template,
    estimation: Estimation<'_>,
    dims: Dims,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let Tuning {
        initial_estimate,
        initial_sd,
        process_sd,
        measurement_sd,
        low,
        high,
        gate,
        range: _,
        parameters: _,
        alpha: _,
    } = estimation.tuning;
    let squared = |sd: &[f64]| sd.iter().map(|sd| sd * sd).collect::<Vec<_>>();
    let states = estimation.augmentation.disturbance.clone();
    let measured = estimation.measured(dims)?;
    let bounded = estimation.tuning.is_bounded();
    let side = |side: &Vec<f64>, none: f64| match side.is_empty() {
        true => vec![none; initial_estimate.len()],
        false => side.clone(),
    };
    let mut tables = String::from("/* The first estimate, and variances. */\n");
    tables += &array("initial", initial_estimate);
    tables += &array("initial_variance", &squared(initial_sd));
    tables += &array("process_variance", &squared(process_sd));
    tables += &array("noise_variance", &squared(measurement_sd));
    tables += "/* Variances that a covariance is widened to when readings were rejected for too long. */\n";
    tables += &array("widened", &Gate::widened(estimation.tuning));
    let most = estimation.tuning.most_variance();
    let ranged = most.iter().any(|most| most.is_finite());
    if ranged {
        tables += "/* The most that a prediction leaves of each variance. */\n";
        tables += &array("most_variance", &most);
    }
    if bounded {
        tables += "/* Bounds on the estimate. */\n";
        tables += &array("low", &side(low, f64::NEG_INFINITY));
        tables += &array("high", &side(high, f64::INFINITY));
    }
    tables += "/* What is measured: states, and behind them outputs. */\n";
    tables += &places("measured", &measured);
    if matches!(states, Disturbance::States(_)) {
        tables += "/* The states that are disturbed. */\n";
        tables += &places("place", &estimation.places(dims)?);
    }
    set_filter(t, estimation, &mut tables);
    t.set("NM", measured.len())
        .set("NZ", initial_estimate.len())
        .set("GATE", format!("PINC_N({})", constant(gate.bound())))
        .set("HAS_BOUNDS", u8::from(bounded))
        .set("HAS_RANGES", u8::from(ranged))
        .set("MEASURES_OUTPUTS", u8::from(estimation.measures_outputs()))
        .set("INCLUDE", if estimation.measures_outputs() { INCLUDE_OUTPUTS } else { "" })
        .set("TABLES", tables);
    Ok(vec![
        t.file("feedback.h", include_str!("../templates/feedback.h")),
        t.file("feedback.c", include_str!("../templates/feedback.c")),
    ])
}

/// Fills what is of one filter alone.
fn set_filter(t: &mut Template, estimation: Estimation<'_>, tables: &mut String) {
    let (ekf_memory, ekf) =
        (include_str!("../templates/ekf_memory.c"), include_str!("../templates/ekf.c"));
    t.set("TYPES", "").set("MORE_STATUSES", "").set("BEGIN", "").set("ESTIMATE", "filter");
    match estimation.filter {
        Filter::Extended => {
            t.set("FILTER", "an extended Kalman filter").set("MEMORY", ekf_memory);
            t.set("KALMAN", ekf);
        }
        Filter::Unscented => {
            let alpha = estimation.tuning.alpha.unwrap_or(Tuning::ALPHA);
            t.set("FILTER", "an unscented Kalman filter");
            t.set("ALPHA_2", constant(alpha * alpha));
            t.set("ALPHA_2_SINGLE", constant((alpha * alpha).max(0.1)));
            t.set("MEMORY", include_str!("../templates/ukf_memory.c"));
            t.set("KALMAN", include_str!("../templates/ukf.c"));
        }
        Filter::MovingHorizon(steps) => {
            let tuning = estimation.tuning;
            let units = Mhe::units(tuning);
            let noises = tuning.process_sd.iter().zip(&units).map(|(sd, unit)| sd / unit);
            *tables += "/* Units of the window's states, and the noises of steps in these. */\n";
            *tables += &array("unit", &units);
            *tables += &array("noise", &noises.collect::<Vec<_>>());
            if tuning.is_bounded() {
                *tables += &array("initial_sd", &tuning.initial_sd);
            }
            t.set("WINDOW", steps).set("ESTIMATE", "horizon");
            t.set("FILTER", "a moving horizon estimator").set("MORE_STATUSES", MHE_STATUSES);
            t.set("TYPES", include_str!("../templates/mhe_types.c"));
            t.set("BEGIN", "    pinc_begin_last(e);\n");
            let memory = include_str!("../templates/mhe_memory.c");
            t.set("MEMORY", [ekf_memory, memory].concat());
            let parts = [
                ekf,
                include_str!("../templates/mhe_program.c"),
                include_str!("../templates/mhe_qp.c"),
                include_str!("../templates/mhe.c"),
            ];
            t.set("KALMAN", parts.join("\n"));
        }
    }
}

/// How the iteration of a moving horizon estimator can end besides.
const MHE_STATUSES: &str = ",
    /** The optimality conditions were not met after all iterations; the estimate is the best one
        found. */
    PINC_ESTIMATE_ITERATION_LIMIT = 4,
    /** The window's problem has no solution within the bounds, or none was found; the estimate is
        the last one that was. */
    PINC_ESTIMATE_QP_FAILED = 5";

/// For sources that call the outputs.
pub(crate) const INCLUDE_OUTPUTS: &str = "#include \"pinc_outputs.h\"\n";

/// Golden vectors: controller and estimator of the library in closed loop with their own model,
/// which is measured with errors up to the noise's standard deviation. Gives the number of steps, and how
/// many of them are unsolved.
pub(crate) fn set_steps(
    t: &mut Template,
    (controller, library): (&Controller<'_>, Nmpc),
    estimation: Estimation<'_>,
    steps: usize,
) -> Result<[usize; 2], ExportError> {
    let mut both = Both::new(controller, library, estimation)?;
    let mut fresh = Vec::new();
    both.nmpc.remember(&mut Memory::save(&mut fresh));
    let rows = run(&mut both, (controller, estimation), steps)?;
    let unsolved = both.unsolved;
    let [double, float] = Precision::both(Some(estimation.filter));
    both.nmpc.remember(&mut Memory::restore(&fresh));
    let mut both = Both::new(controller, both.nmpc, estimation)?;
    let (units, inputs) = (units(controller, estimation, &both), both.nmpc.model().dims().nu);
    let in_double = both.moved(&rows, &units, double)?;
    both.nmpc.remember(&mut Memory::restore(&fresh));
    let nmpc = in_float(controller)?.unwrap_or(both.nmpc);
    let in_float = Both::new(controller, nmpc, estimation)?.moved(&rows, &units, float)?;
    set_allowed(t, Some(estimation.filter), [&in_double, &in_float]);
    let tables = [
        table("y", &rows.measured),
        table("rows", &rows.windows),
        table("u", &rows.inputs),
        table("z", &rows.estimates),
        array("unit_of_u", &units[..inputs]),
        array("unit_of_z", &units[inputs..]),
    ];
    t.set("TABLES", tables.concat());
    Ok([rows.inputs.len(), unsolved])
}

/// The units of inputs and estimates. A disturbance has that of the quantity which it disturbs, where this is
/// a state or an input.
fn units(controller: &Controller<'_>, estimation: Estimation<'_>, both: &Both<'_>) -> Vec<f64> {
    let ProblemUnits { states, inputs, .. } = controller.units(both.nmpc.model().dims());
    let Augmentation { measured, disturbance, .. } = estimation.augmentation;
    let of_measured = |of: &Measured| match *of {
        Measured::State(state) => states[state],
        _ => 1.0,
    };
    let disturbed: Vec<f64> = match disturbance {
        Disturbance::Input => inputs.clone(),
        Disturbance::Output => measured.iter().map(of_measured).collect(),
        Disturbance::States(places) => places.iter().map(|&place| states[place]).collect(),
        _ => Vec::new(),
    };
    let count = inputs.len() + both.filter.dims().nx;
    let mut all = [inputs, states, disturbed].concat();
    // Parameters stay in their own.
    all.resize(count, 1.0);
    all
}

/// Controller and estimator of the library.
struct Both<'a> {
    nmpc: Nmpc,
    filter: Box<dyn Estimator>,
    augmentation: &'a Augmentation,
    /// The inputs under way, the one that acts first in front.
    acting: Vec<f64>,
    has_begun: bool,
    /// See [`is_unsolved`].
    unsolved: usize,
}

impl<'a> Both<'a> {
    fn new(
        controller: &Controller<'_>,
        nmpc: Nmpc,
        estimation: Estimation<'a>,
    ) -> Result<Self, ExportError> {
        let model = controller.library_model()?;
        let first = controller.first_input(model.dims());
        let filter = estimation.library(model, &first)?;
        let acting = first.repeat(controller.problem.delay + 1);
        let augmentation = estimation.augmentation;
        Ok(Self { nmpc, filter, augmentation, acting, has_begun: false, unsolved: 0 })
    }

    /// The input chosen after a measurement.
    fn step(&mut self, y: &[f64], window: &[f64]) -> Result<Vec<f64>, ExportError> {
        let Dims { nx, nu, .. } = self.nmpc.model().dims();
        if self.has_begun {
            self.filter.predict(&self.acting[..nu]);
            self.acting.copy_within(nu.., 0);
        }
        self.has_begun = true;
        self.filter.correct(y);
        let (mut x, mut unknowns) = (vec![0.0; nx], vec![0.0; self.filter.dims().nx - nx]);
        self.augmentation.read(self.filter.estimate(), &mut x, &mut unknowns);
        self.nmpc.set_parameters(&unknowns)?;
        let step = self.nmpc.step(&x, window)?;
        self.unsolved += usize::from(is_unsolved(step.status));
        let u = step.u.to_vec();
        let last = self.acting.len() - nu;
        self.acting[last..].copy_from_slice(&u);
        Ok(u)
    }

    /// How far inputs and estimates of each step move if what is measured is off by rounding.
    fn moved(
        &mut self,
        rows: &Rows,
        units: &[f64],
        precision: Precision,
    ) -> Result<Vec<f64>, ExportError> {
        let mut moved = Vec::new();
        for (k, (y, window)) in rows.measured.iter().zip(&rows.windows).enumerate() {
            let u = self.step(&precision.round(k, y), window)?;
            let expected = rows.inputs[k].iter().chain(&rows.estimates[k]);
            moved.push(difference(u.iter().chain(self.filter.estimate()), expected, units));
        }
        Ok(moved)
    }
}

fn run(
    both: &mut Both<'_>,
    (controller, estimation): (&Controller<'_>, Estimation<'_>),
    steps: usize,
) -> Result<Rows, ExportError> {
    let mut plant = controller.library_model()?;
    let Dims { nx, nu, ny, .. } = plant.dims();
    let measured_at = estimation.measured(plant.dims())?;
    let p = &estimation.augmentation.parameters;
    let mut outputs = vec![0.0; ny];
    let reference = controller.reference;
    let ends: Vec<_> = estimation.tuning.measurement_sd.iter().map(|sd| (-sd, *sd)).collect();
    let errors = golden::points(&ends);
    let (mut x, mut next) = (controller.initial_state.to_vec(), vec![0.0; nx]);
    let mut window = vec![0.0; controller.problem.horizon * reference.outputs()];
    let mut rows = Rows::default();
    for k in 0..steps.min(reference.steps()) {
        if estimation.measures_outputs() {
            plant.output(&x, &both.acting[..nu], p, &mut outputs);
        }
        let noisy = measured_at.iter().zip(&errors[k % errors.len()]);
        let value = |at: usize| if at < nx { x[at] } else { outputs[at - nx] };
        let measured: Vec<f64> = noisy.map(|(&at, error)| value(at) + error).collect();
        controller.window(k, &mut window);
        let u = both.step(&measured, &window)?;
        plant.step(&x, &both.acting[..nu], p, &mut next);
        let acting = &both.acting[..nu];
        check_step(controller, (k, &x, acting), next.iter().chain(both.filter.estimate()))?;
        x.copy_from_slice(&next);
        rows.measured.push(measured);
        rows.windows.push(window.clone());
        rows.inputs.push(u);
        rows.estimates.push(both.filter.estimate().to_vec());
    }
    Ok(rows)
}
