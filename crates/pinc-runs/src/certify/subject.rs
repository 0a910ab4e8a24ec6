//! The model whose step is judged, with the plant that it stands for.

use super::ends;
use super::points::{Judged, read_points};
use crate::batch::first;
use crate::{RunError, read_matching_model};
use pinc_check::step_error;
use pinc_config::{Experiment, ModelKind};
use pinc_net::{Domain, PincModel, PincNet};
use pinc_ode::{DynPlant, Integrator, Model, Simulator, Variable};
use pinc_record::file;
use pinc_verify::{ErrorEstimate, StepError, StepModel};
use std::path::Path;

/// Substeps of an integrator of which no config says how many.
const SUBSTEPS: usize = 4;

/// Local tolerance of the truth where nothing can be enclosed.
const TOLERANCE: f64 = 1e-10;

/// A model of one step.
pub(super) struct Subject {
    pub(super) kind: ModelKind,
    pub(super) sample_time_s: f64,
    pub(super) states: Vec<String>,
    inputs: Vec<String>,
    parameters: Vec<String>,
    /// The ends of states, inputs and parameters.
    pub(super) domain: Vec<[f64; 2]>,
    /// The step to be enclosed, or why it cannot be.
    pub(super) error: Result<StepError, String>,
    /// The content of the model file, and what else the results depend on.
    pub(super) key: Vec<u8>,
    plant: Box<dyn DynPlant>,
    net: Option<PincNet>,
    substeps: usize,
}

impl Subject {
    /// The net in the file `model`, or the integrator `only`.
    pub(super) fn of(
        experiment: &Experiment,
        model: Option<&Path>,
        only: Option<ModelKind>,
    ) -> Result<Self, RunError> {
        let name = &experiment.name;
        let kind = only.unwrap_or(ModelKind::Pinc);
        let given = match (kind, model) {
            (ModelKind::Pinc, None) => return Err(RunError::no_model_file(name, "certify")),
            (ModelKind::Pinc, Some(path)) => Some(read_matching_model(experiment, path)?),
            (_, Some(_)) => return Err(RunError::unused_net("pinc certify", &[kind])),
            (ModelKind::Integrator(method), None) if method.tableau().is_some() => None,
            (ModelKind::Integrator(_) | ModelKind::BlackBox | ModelKind::Policy, None) => {
                let problem = format!(
                    "certify: the model `{}` is not enclosed; expected `pinc`, `rk4` or `rk5`",
                    kind.name()
                );
                return Err(RunError::usage(name, problem));
            }
        };
        let missing = |section| RunError::missing_section(experiment, section, "certify");
        let (bytes, net) = given.unzip();
        let domain = net.as_ref().map(PincNet::domain).or(experiment.domain.as_ref());
        let domain: &Domain = domain.ok_or_else(|| missing("domain"))?;
        let sample_time_s = net.as_ref().map(PincNet::sample_time_s);
        let sample_time_s = sample_time_s.or_else(|| experiment.sample_time_s());
        let sample_time_s = sample_time_s.ok_or_else(|| missing("model"))?;
        let integrator = kind.integrator();
        let of_the_loop = experiment.control.as_ref().zip(integrator);
        let substeps =
            of_the_loop.map_or(SUBSTEPS, |(control, method)| control.own_substeps(method));
        let parameters: Vec<String> =
            domain.parameters.iter().map(|range| range.name.clone()).collect();
        let varying: Vec<&str> = parameters.iter().map(String::as_str).collect();
        let variables = experiment.plant.variables();
        let step = match (&net, integrator.and_then(Integrator::tableau)) {
            (Some(net), _) => StepModel::Net(net),
            (None, Some(tableau)) => StepModel::RungeKutta(tableau, substeps),
            (None, None) => unreachable!("a net is given, or else an explicit method"),
        };
        let inputs = variables.input_names();
        let error = step_error(&experiment.plant, &varying, step, sample_time_s);
        let ends = ends(domain);
        let mut key = bytes.unwrap_or_default();
        key.extend(
            format!("{kind} {substeps} {sample_time_s} {ends:?} {:?}", experiment.plant).bytes(),
        );
        Ok(Self {
            kind,
            sample_time_s,
            states: variables.state_names(),
            inputs,
            domain: ends,
            error,
            key,
            plant: experiment.plant.family(&varying),
            parameters,
            net,
            substeps,
        })
    }

    /// The names of states, inputs and parameters.
    pub(super) fn variables(&self) -> Vec<String> {
        [&self.states[..], &self.inputs, &self.parameters].concat()
    }

    /// Their names with units, where the plant knows them.
    pub(super) fn labels(&self) -> Vec<String> {
        let own = self.plant.states().iter().chain(self.plant.inputs());
        let all = own.chain(self.plant.parameters());
        let label = |variable: &Variable| match &*variable.unit {
            "" => variable.name.to_string(),
            unit => format!("{} ({unit})", variable.name),
        };
        all.map(label).collect()
    }

    /// The points of the loop with this model in a run's directory, with the controller's parameters.
    pub(super) fn along(
        &self,
        experiment: &Experiment,
        run: &Path,
    ) -> Result<Vec<Vec<f64>>, RunError> {
        let np = self.parameters.len();
        let changes = np > 0 && experiment.model_schedule(self.sample_time_s).values.is_some();
        let measured = !experiment.measured_parameters().is_empty();
        let is_estimated = experiment.loop_parameters().estimated.iter().any(|&place| place < np);
        if let Some(key) = first([
            ("control.estimator.parameters", is_estimated),
            ("control.plant_schedule", changes && measured),
            ("control.parameter_schedule", changes && !measured),
        ]) {
            return Err(RunError::with_schedule(&experiment.name, "pinc certify --run", key));
        }
        let [several, one] = [2, 1].map(|loops| run.join(file::control(self.kind, loops)));
        let trace = if several.exists() { several } else { one };
        let mut points = read_points(&trace, &[&self.states[..], &self.inputs].concat())?;
        let member = experiment.model_parameters();
        points.iter_mut().for_each(|point| point.extend(&member));
        Ok(points)
    }

    /// The errors at points: enclosed, or from an accurate integration where that is not possible.
    pub(super) fn judge(
        &self,
        points: &[Vec<f64>],
        threads: usize,
    ) -> Result<Vec<Judged>, RunError> {
        let Ok(error) = &self.error else { return self.integrated(points) };
        let known = |value: f64| value.is_finite().then_some(value);
        let found = error.at_points(points, threads).into_iter().map(|found| Judged {
            bound: found.bound().into_iter().map(known).collect(),
            error: found.error.into_iter().map(known).collect(),
        });
        Ok(found.collect())
    }

    /// How far the first-order estimate is from the error at each point where that is known: the
    /// distance of the two, in widths of the domain, over the error. Empty for other models than nets.
    pub(super) fn estimate_differences(
        &self,
        points: &[Vec<f64>],
        judged: &[Judged],
    ) -> Result<Vec<f64>, RunError> {
        let Some(net) = self.net.as_ref().filter(|_| self.error.is_ok()) else {
            return Ok(Vec::new());
        };
        let n = self.states.len();
        let mut estimate = ErrorEstimate::new(net, &*self.plant)?;
        let mut found = vec![0.0; n];
        let mut differences = Vec::new();
        for (point, judged) in points.iter().zip(judged) {
            let Some(errors) = judged.error.iter().copied().collect::<Option<Vec<f64>>>() else {
                continue;
            };
            let (x, rest) = point.split_at(n);
            let (u, p) = rest.split_at(self.inputs.len());
            estimate.write(x, u, p, &mut found);
            let widths = || self.domain.iter().map(|[low, high]| high - low);
            let norm = |values: &mut dyn Iterator<Item = f64>| {
                values.zip(widths()).map(|(v, width)| (v / width).powi(2)).sum::<f64>().sqrt()
            };
            let off = norm(&mut found.iter().zip(&errors).map(|(found, error)| found - error));
            let size = norm(&mut errors.iter().copied());
            differences.push(if off > 0.0 { off / size } else { 0.0 });
        }
        differences.sort_by(f64::total_cmp);
        Ok(differences)
    }

    fn integrated(&self, points: &[Vec<f64>]) -> Result<Vec<Judged>, RunError> {
        let mut model: Box<dyn Model> = match (&self.net, self.kind.integrator()) {
            (Some(net), _) => Box::new(PincModel::new(net)?),
            (None, Some(method)) => self.plant.model(method, self.sample_time_s, self.substeps)?,
            (None, None) => unreachable!("a net is given, or else an explicit method"),
        };
        let mut truth = Simulator::new(&*self.plant, TOLERANCE);
        let judged = points.iter().map(|point| {
            let (x, rest) = point.split_at(self.states.len());
            let (u, p) = rest.split_at(self.inputs.len());
            let (mut next, mut exact) = (x.to_vec(), x.to_vec());
            model.step(x, u, p, &mut next);
            truth.set_parameters(p);
            let solved = truth.integrate(&mut exact, u, self.sample_time_s).is_ok();
            let error = next.iter().zip(&exact).map(|(y, z)| solved.then_some(y - z));
            Judged { error: error.collect(), bound: vec![None; x.len()] }
        });
        Ok(judged.collect())
    }
}
