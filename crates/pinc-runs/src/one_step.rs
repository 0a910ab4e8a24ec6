//! The stage that looks at one step of each of the controller's models: its error and its cost.

use super::Options;
use super::control::LoopSetup;
use crate::RunError;
use crate::progress::Stage;
use crate::single_step::Steps;
use pinc_config::OneStepSpec;
use pinc_net::Domain;
use pinc_ode::DynPlant;
use pinc_record::{OneStepMetrics, RunDir};

/// Measures the models of `setup` on `domain`, unless that has been done.
pub(crate) fn stage(
    plant: &dyn DynPlant,
    setup: &LoopSetup<'_>,
    (spec, domain): (&OneStepSpec, &Domain),
    options: &Options<'_>,
    run_dir: &mut RunDir,
) -> Result<(), RunError> {
    let done = run_dir.metrics().one_step.iter().map(|of| of.model);
    if done.eq(setup.kinds.iter().copied()) {
        return Ok(());
    }
    let mut progress = Stage::begin(options.verbosity, "one step", setup.kinds.len() as u64);
    let steps = Steps::new(plant, domain, setup.sample_time_s, spec.points, spec.tolerance)?;
    let truth = steps.true_jacobians(plant, setup.sample_time_s)?;
    let mut found = Vec::new();
    for &kind in setup.kinds {
        options.check_interrupt(run_dir.dir())?;
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
    Ok(run_dir.update(|all| all.one_step = found)?)
}
