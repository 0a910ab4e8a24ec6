//! The one model that a controller outside of a run works with.

use super::guard::Member;
use super::{LoopSetup, Schedules, matching_model, proof};
use crate::RunError;
use pinc_config::{ControlSpec, Experiment, LoopParameters, ModelKind, OutsidePolicy, Variables};
use pinc_mpc::Scenarios;
use pinc_net::PincNet;
use pinc_ode::DynPlant;
use pinc_record::read_file;
use std::borrow::Cow;
use std::path::Path;

/// A trained net for a controller.
#[derive(Clone, Copy, Debug)]
pub enum ModelFile<'a> {
    /// A file.
    At(&'a Path),
    /// The content of a file.
    Content(&'a [u8]),
}

impl ModelFile<'_> {
    /// The content with its net, which has to suit `experiment`.
    pub(super) fn matching(self, experiment: &Experiment) -> Result<(Vec<u8>, PincNet), RunError> {
        match self {
            Self::At(path) => matching_model(experiment, path, read_file(path)?),
            Self::Content(bytes) => matching_model(experiment, Path::new("model"), bytes.to_vec()),
        }
    }
}

/// The controller of a config, with one of its models.
pub(super) struct Chosen<'e> {
    pub(super) spec: &'e ControlSpec,
    pub(super) kind: ModelKind,
    /// The content of the model file with its net, where that is the model.
    pub(super) given: Option<(Vec<u8>, PincNet)>,
    pub(super) sample_time_s: f64,
    /// The plant that the model is of, and the p of the model.
    pub(super) plant: Box<dyn DynPlant>,
    pub(super) parameters: Vec<f64>,
    /// The names of these.
    pub(super) parameter_names: Vec<String>,
    /// The places of those that are estimated.
    pub(super) estimated: Vec<usize>,
    /// The places of those that the controller is told anew.
    known: Vec<usize>,
    /// The places of those that are measured, in the order of the config.
    pub(super) measured: Vec<usize>,
    scenarios: Option<Scenarios>,
    /// What the net of `given` was made of, if it is one of a family with values for its parameters.
    pub(super) member: Option<Member>,
    /// See [`LoopSetup`].
    proven: Option<Vec<f64>>,
    truth: Box<dyn DynPlant>,
    experiment: Cow<'e, Experiment>,
}

impl<'e> Chosen<'e> {
    /// The model that `only` names, or else the net of `model` if one is given, or else the config's first.
    pub(super) fn of(
        experiment: &'e Experiment,
        model: Option<ModelFile<'_>>,
        only: Option<ModelKind>,
        command: &'static str,
    ) -> Result<Self, RunError> {
        let name = &experiment.name;
        let missing = |section| RunError::missing_section(experiment, section, command);
        let spec = experiment.control.as_ref().ok_or_else(|| missing("control"))?;
        if !spec.parameter_schedule.is_empty() {
            let key = "control.parameter_schedule";
            return Err(RunError::with_schedule(name, command, key));
        }
        if spec.parameter_preview {
            let problem = format!(
                "`{command}` does not support control.parameter_preview: remove the key; each \
                 step then holds the parameters that it is given over its horizon"
            );
            return Err(RunError::usage(name, problem));
        }
        let first = spec.models.first().copied().unwrap_or(ModelKind::RK4);
        let kind = only.unwrap_or(if model.is_some() { ModelKind::Pinc } else { first });
        if !spec.models.contains(&kind) {
            let option = only.map_or("--model", |_| "--only");
            return Err(RunError::missing_model(experiment, option, kind));
        }
        let own = spec.model_of(kind);
        if model.is_some() && own != ModelKind::Pinc {
            return Err(RunError::unused_net(command, &[kind]));
        }
        let given = match (own, model) {
            (ModelKind::Pinc, None) => return Err(RunError::no_model_file(name, command)),
            (ModelKind::Pinc, Some(file)) => Some(file.matching(experiment)?),
            _ => None,
        };
        let proven = proof::limits(experiment, given.as_ref().map(|(_, net)| net))?;
        // In a family, a net stands for the member that the config names, unless an estimator or a
        // measurement says which one it is, or it is uncertain; an integrator gets it at each call.
        let LoopParameters { names, mut values, estimated, mut known } =
            experiment.loop_parameters();
        let place = |name: &String| names.iter().position(|known| known == name);
        let measured: Vec<_> = experiment.measured_parameters().iter().filter_map(place).collect();
        // Before the first measurement the controller does not know the plant in the loop.
        let nominal = experiment.plant.parameters();
        for &place in &measured {
            let own = spec.parameters.get(names[place]).or_else(|| nominal.get(names[place]));
            values[place] = own.copied().unwrap_or(values[place]);
        }
        let (mut told, mut member) = (Cow::Borrowed(experiment), None);
        let (given, names, parameters) = match given {
            Some((bytes, net))
                if estimated.is_empty()
                    && measured.is_empty()
                    && !experiment.has_uncertain_parameters() =>
            {
                let own =
                    names.iter().zip(&values).map(|(name, value)| ((*name).to_owned(), *value));
                told = Cow::Owned(experiment.with_parameters(&own.collect()));
                known.clear();
                let own = net.member(&values);
                member = Some(Member { family: net, parameters: values });
                (Some((bytes, own)), Vec::new(), Vec::new())
            }
            given => (given, names, values),
        };
        let of_net = given.as_ref().map(|(_, net)| net.sample_time_s());
        let sample_time_s = experiment.sample_time_s().or(of_net);
        let sample_time_s = sample_time_s.ok_or_else(|| missing("model"))?;
        let plant = told.plant.family(&names);
        let truth = experiment.plant.dyn_plant();
        let parameter_names = names.into_iter().map(str::to_owned).collect();
        Ok(Self {
            spec,
            kind,
            given,
            sample_time_s,
            plant,
            parameters,
            parameter_names,
            estimated,
            known,
            measured,
            scenarios: experiment.scenarios(),
            member,
            proven,
            truth,
            experiment: told,
        })
    }

    /// The net, where that is the model.
    pub(super) fn net(&self) -> Option<&PincNet> {
        self.given.as_ref().map(|(_, net)| net)
    }

    /// Whether the net, where it is the model, is not to be used outside the box of its training.
    pub(super) fn refuses_outside(&self) -> bool {
        self.given.is_some() && self.spec.outside_domain == OutsidePolicy::Refuse
    }

    /// The names of the parameters of the controller's model: with an estimator all unknowns, and what
    /// is known.
    pub(super) fn names_of_parameters(&self) -> Vec<String> {
        let setup = self.setup();
        let Some((spec, of)) = setup.sections() else { return self.parameter_names.clone() };
        let names = spec.names(&of, &Variables::of(&*self.plant));
        let unknowns = names.into_iter().skip(self.plant.states().len());
        unknowns
            .chain(self.known.iter().map(|&place| self.parameter_names[place].clone()))
            .collect()
    }

    /// The places of the measured parameters among these.
    pub(super) fn places_of_measured(&self) -> Vec<usize> {
        let names = self.names_of_parameters();
        let first = names.len() - self.known.len();
        let place = |of| self.known.iter().position(|known| known == of).map(|at| first + at);
        self.measured.iter().filter_map(place).collect()
    }

    /// The names of the model's parameters.
    fn varying(&self) -> Vec<&str> {
        self.parameter_names.iter().map(String::as_str).collect()
    }

    /// What a closed loop with it works from.
    pub(super) fn setup(&self) -> LoopSetup<'_> {
        LoopSetup {
            spec: self.spec,
            kinds: std::slice::from_ref(&self.kind),
            net: self.net(),
            proven: self.proven.clone(),
            sample_time_s: self.sample_time_s,
            seed: 0,
            parameters: &self.parameters,
            estimated: &self.estimated,
            known: &self.known,
            beside: self.experiment.horizon_plants(&self.varying()),
            scenarios: self.scenarios.clone(),
            truth: &*self.truth,
            schedules: Schedules::default(),
        }
    }
}
