//! The stage that looks at one step of each of the controller's models: its error and its cost.

use super::Options;
use super::control::Setup;
use crate::BenchError;
use crate::one_step::Steps;
use crate::progress::Stage;
use crate::record::{OneStepMetrics, RunDir};
use crate::spec::OneStepSpec;
use pinc_net::Domain;
use pinc_ode::DynPlant;

/// Measures the models of `setup` on `domain`, unless that has been done.
pub(crate) fn stage(
    plant: &dyn DynPlant,
    setup: &Setup<'_>,
    (spec, domain): (&OneStepSpec, &Domain),
    options: &Options<'_>,
    record: &mut RunDir,
) -> Result<(), BenchError> {
    let done = record.metrics().one_step.iter().map(|of| of.model);
    if done.eq(setup.kinds.iter().copied()) {
        return Ok(());
    }
    let mut progress = Stage::begin(options.verbosity, "one step", setup.kinds.len() as u64);
    let steps = Steps::new(plant, domain, setup.sample_time_s, spec.points, spec.tolerance)?;
    let truth = steps.true_jacobians(plant, setup.sample_time_s);
    let mut found = Vec::new();
    for &kind in setup.kinds {
        options.go_on(record.dir())?;
        progress.advance(found.len() as u64, String::new);
        let mut model = setup.model(kind, plant)?;
        let stages = setup.spec.n2;
        found.push(OneStepMetrics {
            model: kind,
            errors: steps.errors(&truth, &mut *model),
            forward_ns: steps.forward_ns(&mut *model, spec.measure_s),
            forward_jacobian_ns: steps.forward_jacobian_ns(&mut *model, stages, spec.measure_s),
        });
    }
    progress.end("measured");
    record.update(|all| all.one_step = found)
}
