//! The controller of a loop: a model for each length of stage that the horizon has.

use super::control::LoopSetup;
use super::model_error::{ErrorJudge, NetError, SharedLog, correction};
use crate::RunError;
use pinc_config::{
    HorizonPlants, ModelKind, NetErrorSpec, OnError, TubeParts, UncertaintySpec, Variables,
};
use pinc_economic::{IntegratedCost, Quadrature};
use pinc_estimate::{Augmentation, Compensated, SteadyTarget};
use pinc_integer::BranchAndBound;
use pinc_mpc::{Nmpc, NmpcBuilder, NmpcProblem};
use pinc_net::PincModel;
use pinc_ode::{DynPlant, FlowModel, Integrator, Model, WithOutputs};
use pinc_tube::{EllipsoidTube, StageError, TubeModel};

impl LoopSetup<'_> {
    /// The model of a control step.
    ///
    /// # Errors
    ///
    /// [`RunError`] if a net does not suit or the plant has no such integrator.
    pub fn model(&self, kind: ModelKind, plant: &dyn DynPlant) -> Result<Box<dyn Model>, RunError> {
        self.model_for(kind, plant, self.sample_time_s)
    }

    /// The tube of `spec` for a controller of `problem`.
    fn tube(
        &self,
        spec: &UncertaintySpec,
        kind: ModelKind,
        plant: &dyn DynPlant,
        problem: &NmpcProblem,
        augmentation: Option<&Augmentation>,
    ) -> Result<EllipsoidTube, RunError> {
        let (mut model, np) = (self.model(kind, plant)?, problem.parameters.len());
        let uncertain: Vec<usize> = spec.places(plant.parameters()).collect();
        let (mut places, mut more) = (uncertain.clone(), Vec::new());
        if let Some(of) = augmentation {
            // The parameters of the controller's model are disturbances, estimates, and what is known.
            places = (np..np + uncertain.len()).collect();
            more = uncertain.iter().map(|&place| of.parameters[place]).collect();
            let estimated = [&of.estimated[..], &of.known, &uncertain].concat();
            let told = Augmentation { estimated, known: Vec::new(), ..of.clone() };
            model = Box::new(Compensated::new(model, told)?);
        }
        let net = self.net.filter(|_| kind == ModelKind::Pinc);
        let estimated = net.filter(|_| spec.net_error == NetErrorSpec::Estimated(true));
        let error = estimated.map(|net| NetError::new(net, plant, augmentation)).transpose()?;
        Ok(spec.tube(TubeParts {
            sizes: (model.dims().with_parameters(np), problem),
            variables: &Variables::of(plant),
            model: TubeModel { model, more },
            places: &places,
            proven: net.and(self.proven.as_deref()),
            error: error.map(|error| Box::new(error) as Box<dyn StageError>),
        })?)
    }

    /// The model of a stage of `length_s`.
    fn model_for(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
        length_s: f64,
    ) -> Result<Box<dyn Model>, RunError> {
        Ok(match (self.spec.model_of(kind), self.net) {
            (ModelKind::Pinc, Some(net)) => {
                let model = PincModel::at(net, length_s)?;
                match Variables::of(plant).own_outputs().is_empty() {
                    true => Box::new(model),
                    // The net knows the states; what follows from them is the plant's to say.
                    false => Box::new(WithOutputs::new(model, outputs(plant, length_s)?)),
                }
            }
            (ModelKind::Pinc | ModelKind::Policy, _) => {
                unreachable!("the plan trains or reads a net for this loop")
            }
            (ModelKind::BlackBox, _) => match plant.black_box() {
                Some(black_box) => Box::new(FlowModel::new(black_box, length_s)),
                None => unreachable!("the config was checked for it"),
            },
            (ModelKind::Integrator(integrator), _) => {
                let substeps = self.spec.substeps(integrator, length_s, self.sample_time_s);
                plant.model(integrator, length_s, substeps)?
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
        Ok(self.judged_controller(kind, plant)?.0)
    }

    /// The controller, with what its judge sees if `control.error_tolerance` asks for one.
    pub(crate) fn judged_controller(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
    ) -> Result<(Nmpc, Option<SharedLog>), RunError> {
        if kind == ModelKind::Policy {
            return self.policy(plant);
        }
        let (mut problem, mut augmentation) = (self.problem(), None);
        if let Some((estimator, measurement)) = self.sections() {
            let of = self.augmentation(estimator, &measurement, plant);
            problem = NmpcProblem { parameters: self.told_by(estimator, &of), ..problem };
            augmentation = Some(of);
        }
        let augmentation = augmentation.as_ref();
        let mut own = self.builder(kind, plant, problem.clone(), augmentation, None)?;
        if let Some(spec) = &self.spec.uncertainty {
            own = own.tube(Box::new(self.tube(spec, kind, plant, &problem, augmentation)?));
        }
        let net = self.net.filter(|_| kind == ModelKind::Pinc);
        let Some(net) = net.filter(|_| !self.spec.error_tolerance.is_empty()) else {
            return Ok((own.build()?, None));
        };
        let (judge, log) = ErrorJudge::new(self.spec, net, plant, augmentation)?;
        let substitute = match self.spec.on_error {
            OnError::Count => None,
            OnError::Integrator => {
                let kind = ModelKind::Integrator(self.spec.substitute());
                Some(self.builder(kind, plant, problem, augmentation, None)?.build()?)
            }
            OnError::Correct => {
                let correction = correction(plant.states().len(), &problem.parameters);
                let parameters = vec![0.0; plant.states().len() + problem.parameters.len()];
                let problem = NmpcProblem { parameters, ..problem };
                Some(self.builder(kind, plant, problem, augmentation, Some(&correction))?.build()?)
            }
        };
        Ok((own.guard(Box::new(judge), substitute).build()?, Some(log)))
    }

    /// The search for what can be held of the references, if the config asks for it.
    pub(super) fn target(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
    ) -> Result<Option<SteadyTarget>, RunError> {
        let Some((estimator, measurement)) = self.sections().filter(|_| self.spec.target) else {
            return Ok(None);
        };
        let augmentation = self.augmentation(estimator, &measurement, plant);
        let parameters = self.told_by(estimator, &augmentation);
        let problem = NmpcProblem { parameters, ..self.problem() };
        let x = &estimator.initial_estimate;
        let model = Compensated::new(self.model(kind, plant)?, augmentation)?;
        let rest = vec![0.0; plant.inputs().len()];
        let u = self.spec.initial_input.as_deref().unwrap_or(&rest);
        Ok(Some(SteadyTarget::new(&problem, Box::new(model), x, u)?))
    }

    /// A controller with a model for each length of stage, compensated as the augmentations say, the
    /// inner one first.
    fn builder(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
        problem: NmpcProblem,
        inner: Option<&Augmentation>,
        outer: Option<&Augmentation>,
    ) -> Result<NmpcBuilder, RunError> {
        let compensated = |mut model: Box<dyn Model>| -> Result<Box<dyn Model>, RunError> {
            for augmentation in [inner, outer].into_iter().flatten() {
                model = Box::new(Compensated::new(model, augmentation.clone())?);
            }
            Ok(model)
        };
        let (mut builder, mut costs) =
            (Nmpc::builder(problem.clone()).config(self.spec.sqp), Vec::new());
        let HorizonPlants { costed, stretched, stretched_costed } = &self.beside;
        for (length_s, count, stretches) in self.spec.stretched_stages(self.sample_time_s) {
            let (plant, costed) = match (stretches, stretched) {
                (true, Some(stretched)) => (&**stretched, stretched_costed),
                _ => (plant, costed),
            };
            let model = compensated(self.model_for(kind, plant, length_s)?)?;
            builder = builder.stages(model, count);
            if let Some(costed) = costed {
                let model = compensated(self.cost_for(kind, plant, &**costed, length_s)?)?;
                costs.push((model, count));
            }
        }
        let whole = self.spec.integer_places(&Variables::of(plant));
        if !whole.is_empty() {
            let stages = self.spec.stages(self.sample_time_s).into_iter();
            let lengths: Vec<f64> = stages.flat_map(|(s, count)| vec![s; count]).collect();
            let lengths = &lengths[..self.spec.nu];
            let search = BranchAndBound::new(&problem, &whole, self.spec.integer_programs, lengths);
            builder = builder.search(Box::new(search));
        }
        if !costs.is_empty() {
            builder = builder.stage_cost(Box::new(IntegratedCost::new(costs)));
        }
        Ok(builder)
    }

    /// The model of a stage of `length_s` with the time and the cost as states: the integrator does
    /// both, and along other models the cost is a quadrature.
    fn cost_for(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
        costed: &dyn DynPlant,
        length_s: f64,
    ) -> Result<Box<dyn Model>, RunError> {
        if let ModelKind::Integrator(integrator) = kind {
            let substeps = self.spec.substeps(integrator, length_s, self.sample_time_s);
            return Ok(costed.model(integrator, length_s, substeps)?);
        }
        let rate = costed.model(Integrator::Rk4, length_s, 1)?;
        let after = |time_s| self.model_for(kind, plant, time_s);
        Ok(Box::new(Quadrature::new(length_s, after, rate)?))
    }
}

/// A model that has the outputs of `plant`.
pub(crate) fn outputs(plant: &dyn DynPlant, length_s: f64) -> Result<Box<dyn Model>, RunError> {
    Ok(match plant.black_box() {
        Some(black_box) => Box::new(FlowModel::new(black_box, length_s)),
        None => plant.model(Integrator::Rk4, length_s, 1)?,
    })
}
