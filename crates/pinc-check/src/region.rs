//! The box that is examined.

use pinc_analysis::Region;
use pinc_config::Experiment;
use pinc_ode::Dims;

/// The box and what it is called: the training domain, or else the controller's bounds. A state
/// without bounds has the range of the start and the references, or 1 about the start.
pub(crate) fn of(experiment: &Experiment, dims: Dims) -> Option<(Region, &'static str)> {
    if let Some(domain) = &experiment.domain {
        let low = [&domain.state_low[..], &domain.input_low].concat();
        let high = [&domain.state_high[..], &domain.input_high].concat();
        return Some((Region::new(dims, low, high), "the training domain"));
    }
    let control = experiment.control.as_ref()?;
    let variables = experiment.plant.variables().state_names();
    let (mut low, mut high) = (control.initial_state.clone(), control.initial_state.clone());
    for reference in &control.references {
        for (name, &value) in control.controlled.iter().zip(&reference.value) {
            if let Some(i) = variables.iter().position(|state| state == name) {
                (low[i], high[i]) = (low[i].min(value), high[i].max(value));
            }
        }
    }
    for (low, high) in low.iter_mut().zip(&mut high).filter(|(low, high)| low >= high) {
        (*low, *high) = (*low - 0.5, *high + 0.5);
    }
    for (ends, bounds) in [(&mut low, &control.state_low), (&mut high, &control.state_high)] {
        let finite = ends.iter_mut().zip(bounds.iter().flatten()).filter(|(_, b)| b.is_finite());
        finite.for_each(|(end, bound)| *end = *bound);
    }
    low.extend(&control.input_low);
    high.extend(&control.input_high);
    Some((Region::new(dims, low, high), "the controller's bounds"))
}
