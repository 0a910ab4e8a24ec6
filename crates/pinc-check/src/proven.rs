//! Proven errors of one step, where a proof takes little work.

use pinc_config::PlantSpec;
use pinc_net::Domain;
use pinc_verify::{StepError, StepModel};

/// One step of `model` over `sample_time_s` beside the flow of the plant's equation, in which the
/// parameters `varying` are variables.
///
/// # Errors
///
/// The reason, in words, where the step cannot be enclosed.
pub fn step_error(
    plant: &PlantSpec,
    varying: &[&str],
    model: StepModel<'_>,
    sample_time_s: f64,
) -> Result<StepError, String> {
    let black_box = || "the plant is a black box: it has no equation to enclose".to_owned();
    let equations = plant.equations().ok_or_else(black_box)?;
    let inputs = plant.variables().inputs.len();
    let error = StepError::new(&equations, varying, inputs, model, sample_time_s);
    error.map_err(|error| error.to_string())
}

/// Returns a bound of the error of one step of `model` from anywhere in `domain`, of the states in
/// widths of their ranges; `None` if a [small proof](StepError::small_proof) does not give one.
#[must_use]
pub fn proven_error(
    plant: &PlantSpec,
    domain: &Domain,
    model: StepModel<'_>,
    sample_time_s: f64,
    threads: usize,
) -> Option<f64> {
    let varying: Vec<&str> = domain.parameters.iter().map(|range| range.name.as_str()).collect();
    let error = step_error(plant, &varying, model, sample_time_s).ok()?;
    let ends: Vec<[f64; 2]> = domain.ends().map(|(low, high)| [low, high]).collect();
    let bounds = error.small_proof(&ends, threads)?;
    let in_widths = bounds.iter().zip(&ends).map(|(bound, [low, high])| bound / (high - low));
    Some(in_widths.fold(0.0, f64::max))
}
