//! An estimator in C, around the controller that it tells the state.

use crate::controller::Controller;
use crate::golden;
use crate::template::{Template, array, places, table};
use crate::{ExportError, GeneratedFile};
use pinc_estimate::{
    Augmentation, Augmented, Compensated, Disturbance, Ekf, Estimator, Measured, Tuning, Ukf,
};
use pinc_ode::{Dims, Model};

/// The estimator of a controller: which one, of what, and how it is tuned.
#[derive(Clone, Copy, Debug)]
pub struct Estimation<'a> {
    /// The estimator.
    pub filter: Filter,
    /// What is measured, and where disturbances enter.
    pub augmentation: &'a Augmentation,
    /// What it believes at first, and its trust in model and measurements.
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
    /// Refuses what the generated estimators do not have.
    pub(crate) fn check(&self) -> Result<(), ExportError> {
        let refuse = |feature, instead| Err(ExportError::Feature { feature, instead });
        if !self.augmentation.estimated.is_empty() {
            return refuse("estimated parameters", "disturbances");
        }
        if self.measured().count() != self.augmentation.measured.len() {
            return refuse("measured outputs that are no states", "states in control.measurement");
        }
        Ok(())
    }

    /// The estimator, as the library has it.
    fn library(&self, model: Box<dyn Model>) -> Result<Box<dyn Estimator>, ExportError> {
        let model = Box::new(Augmented::new(model, self.augmentation.clone())?);
        let tuning = self.tuning.clone();
        Ok(match self.filter {
            Filter::Extended => Box::new(Ekf::new(model, tuning)?),
            Filter::Unscented => Box::new(Ukf::new(model, tuning)?),
        })
    }

    /// `model`, as the controller that knows the disturbances has it.
    pub(crate) fn compensated(&self, model: Box<dyn Model>) -> Result<Box<dyn Model>, ExportError> {
        Ok(Box::new(Compensated::new(model, self.augmentation.clone())?))
    }

    /// The states that are measured.
    pub(crate) fn measured(&self) -> impl Iterator<Item = usize> {
        self.augmentation.measured.iter().filter_map(|measured| match measured {
            Measured::State(state) => Some(*state),
            _ => None,
        })
    }

    /// Where each disturbance enters: the inputs, measured states or states.
    fn places(&self, dims: Dims) -> Vec<usize> {
        match &self.augmentation.disturbance {
            Disturbance::Input => (0..dims.nu).collect(),
            Disturbance::Output => self.measured().collect(),
            Disturbance::States(states) => states.clone(),
            _ => Vec::new(),
        }
    }
}

/// Fills what the controller knows of disturbances, if any are estimated.
pub(crate) fn set_disturbances(t: &mut Template, estimation: Option<Estimation<'_>>, dims: Dims) {
    let entries = estimation.map_or_else(Vec::new, |estimation| estimation.places(dims));
    let given = estimation.is_some();
    let Some(estimation) = estimation.filter(|_| !entries.is_empty()) else {
        let none = "/** Number of disturbances that are estimated. */\n#define PINC_NW 0\n";
        let none = if given { none } else { "" };
        t.set("DISTURBANCES", none).set("DISTURBANCE_FIELD", "").set("PLANT", "");
        t.set("STEP", "pinc_@MODEL@_step(").set("LINEARIZE", "pinc_@MODEL@_linearize(");
        return;
    };
    let disturbance = &estimation.augmentation.disturbance;
    let is = |yes: bool| u8::from(yes);
    let defines = format!(
        "/** Number of disturbances that are estimated, and where they enter. */\n\
         #define PINC_NW {}\n\
         #define PINC_DISTURBED_INPUTS {}\n\
         #define PINC_DISTURBED_OUTPUTS {}\n\
         #define PINC_DISTURBED_STATES {}\n",
        entries.len(),
        is(*disturbance == Disturbance::Input),
        is(*disturbance == Disturbance::Output),
        is(matches!(disturbance, Disturbance::States(_))),
    );
    t.set("DISTURBANCES", defines)
        .set(
            "DISTURBANCE_FIELD",
            "    /** The disturbances that the model is taken to have. */\n    \
             PINC_REAL disturbance[PINC_NW];\n",
        )
        .set("PLACES", places("place", &entries))
        .set("PLANT", include_str!("../templates/mpc_disturbed.c"))
        .set("STEP", "pinc_disturbed_step(m, ")
        .set("LINEARIZE", "pinc_disturbed_linearize(m, ");
}

/// Header and source of the estimator. The places of [`set_disturbances`] are filled.
pub(crate) fn feedback_core(
    t: &mut Template,
    estimation: Estimation<'_>,
    dims: Dims,
) -> Vec<GeneratedFile> {
    let Tuning { initial_estimate, initial_sd, process_sd, measurement_sd, low, high } =
        estimation.tuning;
    let squared = |sd: &[f64]| sd.iter().map(|sd| sd * sd).collect::<Vec<_>>();
    let states = estimation.augmentation.disturbance.clone();
    let measured: Vec<usize> = estimation.measured().collect();
    let bounded = !(low.is_empty() && high.is_empty());
    let side = |side: &Vec<f64>, none: f64| match side.is_empty() {
        true => vec![none; initial_estimate.len()],
        false => side.clone(),
    };
    let mut tables = String::from("/* The first estimate, and variances. */\n");
    tables += &array("initial", initial_estimate);
    tables += &array("initial_variance", &squared(initial_sd));
    tables += &array("process_variance", &squared(process_sd));
    tables += &array("noise_variance", &squared(measurement_sd));
    if bounded {
        tables += "/* Bounds on the estimate. */\n";
        tables += &array("low", &side(low, f64::NEG_INFINITY));
        tables += &array("high", &side(high, f64::INFINITY));
    }
    tables += "/* The states that are measured. */\n";
    tables += &places("measured", &measured);
    if matches!(states, Disturbance::States(_)) {
        tables += "/* The states that are disturbed. */\n";
        tables += &places("place", &estimation.places(dims));
    }
    let (title, memory, code) = match estimation.filter {
        Filter::Extended => (
            "an extended Kalman filter",
            include_str!("../templates/ekf_memory.c"),
            include_str!("../templates/ekf.c"),
        ),
        Filter::Unscented => (
            "an unscented Kalman filter",
            include_str!("../templates/ukf_memory.c"),
            include_str!("../templates/ukf.c"),
        ),
    };
    t.set("NM", measured.len())
        .set("NZ", initial_estimate.len())
        .set("HAS_BOUNDS", u8::from(bounded))
        .set("FILTER", title)
        .set("MEMORY", memory)
        .set("KALMAN", code)
        .set("TABLES", tables);
    vec![
        t.file("feedback.h", include_str!("../templates/feedback.h")),
        t.file("feedback.c", include_str!("../templates/feedback.c")),
    ]
}

/// Golden vectors: controller and estimator of the library in closed loop with their own model,
/// which is measured with errors up to the noise's standard deviation. Gives the number of steps.
pub(crate) fn set_selftest(
    t: &mut Template,
    controller: &Controller<'_>,
    estimation: Estimation<'_>,
    steps: usize,
) -> Result<usize, ExportError> {
    let Rows { measured, windows, inputs, estimates } = run(controller, estimation, steps)?;
    let tables = [
        table("y", &measured),
        table("reference", &windows),
        table("u", &inputs),
        table("z", &estimates),
    ];
    t.set("TABLES", tables.concat());
    Ok(inputs.len())
}

fn run(
    controller: &Controller<'_>,
    estimation: Estimation<'_>,
    steps: usize,
) -> Result<Rows, ExportError> {
    let (mut nmpc, mut plant) = (controller.library()?, controller.library_model()?);
    let mut filter = estimation.library(controller.library_model()?)?;
    let Dims { nx, nu, .. } = plant.dims();
    let (delay, reference) = (controller.problem.delay, controller.reference);
    let ends: Vec<_> = estimation.tuning.measurement_sd.iter().map(|sd| (-sd, *sd)).collect();
    let errors = golden::points(&ends);
    let (mut x, mut next) = (controller.initial_state.to_vec(), vec![0.0; nx]);
    let (mut seen, mut unknowns) = (vec![0.0; nx], vec![0.0; filter.dims().nx - nx]);
    let mut acting = vec![0.0; (delay + 1) * nu];
    let mut window = vec![0.0; controller.problem.horizon * reference.outputs()];
    let mut rows = Rows::default();
    for k in 0..steps.min(reference.steps()) {
        if k > 0 {
            filter.predict(&acting[..nu]);
            acting.copy_within(nu.., 0);
        }
        let both = estimation.measured().zip(&errors[k % errors.len()]);
        let measured: Vec<f64> = both.map(|(state, error)| x[state] + error).collect();
        filter.correct(&measured);
        estimation.augmentation.read(filter.estimate(), &mut seen, &mut unknowns);
        nmpc.set_parameters(&unknowns)?;
        reference.preview(k + delay, &mut window);
        let u = nmpc.step(&seen, &window)?.u.to_vec();
        acting[delay * nu..].copy_from_slice(&u);
        plant.step(&x, &acting[..nu], &[], &mut next);
        x.copy_from_slice(&next);
        rows.measured.push(measured);
        rows.windows.push(window.clone());
        rows.inputs.push(u);
        rows.estimates.push(filter.estimate().to_vec());
    }
    Ok(rows)
}
