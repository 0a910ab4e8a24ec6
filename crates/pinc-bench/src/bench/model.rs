//! One step of a model: its time alone and with Jacobians, and its error.

use super::cases::{Case, Effort};
use super::results::ModelStep;
use pinc_net::{Domain, PincModel, PincNet};
use pinc_ode::{DynPlant, Integrator, Model};
use pinc_runs::{RunError, Steps};

/// Substeps of the Runge-Kutta method that are measured.
const SUBSTEPS: [usize; 5] = [1, 4, 5, 10, 50];

/// Tolerance of the truth.
const TOLERANCE: f64 = 1e-12;

/// A net, with how long it was trained.
pub(super) struct Trained {
    pub(super) net: PincNet,
    pub(super) seconds: f64,
}

/// Measures the models of a plant: Runge-Kutta by substeps, then `nets`, then Runge-Kutta on the
/// same plant as text, if there is one.
pub(super) fn run(
    case: Case,
    (plant, text): (&dyn DynPlant, Option<&dyn DynPlant>),
    domain: &Domain,
    nets: &[&Trained],
    effort: &Effort,
) -> Result<Vec<ModelStep>, RunError> {
    let sample_time_s = nets[0].net.sample_time_s();
    let steps = Steps::new(plant, domain, sample_time_s, effort.one_step_points, TOLERANCE)?;
    let row = |model: &mut dyn Model| ModelStep {
        plant: case.name(),
        model: "rk4",
        layers: None,
        substeps: None,
        as_text: false,
        trained_s: None,
        forward_ns: steps.forward_ns(model, effort.model_s),
        forward_jacobian_ns: steps.forward_jacobian_ns(model, 1, effort.model_s),
        one_step_rms: steps.rms_in_units(model),
    };
    let mut rows = Vec::new();
    for substeps in SUBSTEPS {
        let row = row(&mut *plant.model(Integrator::Rk4, sample_time_s, substeps)?);
        rows.push(ModelStep { substeps: Some(substeps), ..row });
    }
    for Trained { net, seconds } in nets {
        let row = row(&mut PincModel::new(net)?);
        let (layers, trained_s) = (Some(super::kernel::size(net)), Some(*seconds));
        rows.push(ModelStep { model: "pinc", layers, trained_s, ..row });
    }
    for (substeps, text) in SUBSTEPS.into_iter().flat_map(|n| text.map(|text| (n, text))) {
        let row = row(&mut *text.model(Integrator::Rk4, sample_time_s, substeps)?);
        rows.push(ModelStep { substeps: Some(substeps), as_text: true, ..row });
    }
    Ok(rows)
}
