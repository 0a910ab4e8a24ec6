//! The controller of a loop: a model for each length of stage that the horizon has.

use super::control::LoopSetup;
use crate::RunError;
use pinc_config::{ModelKind, Variables};
use pinc_estimate::Compensated;
use pinc_mpc::{Nmpc, NmpcProblem};
use pinc_net::{NetError, PincModel};
use pinc_ode::{DynPlant, FlowModel, Integrator, Model, WithOutputs};

impl LoopSetup<'_> {
    /// The model of a control step.
    ///
    /// # Errors
    ///
    /// [`NetError`] if a net does not suit.
    pub fn model(&self, kind: ModelKind, plant: &dyn DynPlant) -> Result<Box<dyn Model>, NetError> {
        self.model_for(kind, plant, self.sample_time_s)
    }

    /// The model of a stage of `length_s`.
    fn model_for(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
        length_s: f64,
    ) -> Result<Box<dyn Model>, NetError> {
        Ok(match (kind, self.net) {
            (ModelKind::Pinc, Some(net)) => {
                let model = PincModel::at(net, length_s)?;
                match Variables::of(plant).own_outputs().is_empty() {
                    true => Box::new(model),
                    // The net knows the states; what follows from them is the plant's to say.
                    false => {
                        Box::new(WithOutputs::new(model, plant.model(Integrator::Rk4, length_s, 1)))
                    }
                }
            }
            (ModelKind::Pinc, None) => unreachable!("the plan trains or reads a net for this loop"),
            (ModelKind::BlackBox, _) => match plant.black_box() {
                Some(black_box) => Box::new(FlowModel::new(black_box, length_s)),
                None => unreachable!("the config was checked for it"),
            },
            (ModelKind::Integrator(integrator), _) => {
                let substeps = self.spec.substeps(integrator, length_s, self.sample_time_s);
                plant.model(integrator, length_s, substeps)
            }
        })
    }

    /// The controller: where there is an estimator, the disturbances and parameters that this
    /// estimates are parameters of its models.
    pub(crate) fn controller(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
    ) -> Result<Nmpc, RunError> {
        let (mut problem, mut augmentation) = (self.problem(), None);
        if let Some((estimator, measurement)) = self.sections() {
            let unknown =
                estimator.tuning(self.spec).initial_estimate.split_off(plant.states().len());
            problem = NmpcProblem { parameters: unknown, ..problem };
            augmentation = Some(self.augmentation(estimator, &measurement, plant));
        }
        let mut builder = Nmpc::builder(problem).config(self.spec.sqp);
        for (length_s, count) in self.spec.stages(self.sample_time_s) {
            let model = self.model_for(kind, plant, length_s)?;
            let model = match &augmentation {
                Some(augmentation) => Box::new(Compensated::new(model, augmentation.clone())?),
                None => model,
            };
            builder = builder.stages(model, count);
        }
        Ok(builder.build()?)
    }
}
