//! The experiment whose loop the candidates are tried in.

use pinc_config::{ControlSpec, Experiment, ModelKind, OnError, Plants, UncertaintySpec};
use pinc_net::{Domain, TrainingTarget};
use pinc_ode::DynPlant;
use pinc_runs::{RunError, Steps};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::mem;
use std::path::Path;

/// Why no net is tried where one could be trained on trajectories only, but must not be.
const ONLY_DISTILLED: &str = "no net was tried, since nets of this plant can only be distilled, and \
    such a net goes with no [control.cost] and no stages of other lengths";

/// Points over the domain at which a step is looked at, and how long each of its times is measured.
const ONE_STEP: &str = "[one_step]\npoints = 1024\nmeasure_s = 0.05\n";

/// What the candidates have in common.
#[derive(Debug)]
pub(super) struct Base {
    /// The plant of the models.
    pub(super) plant: Box<dyn DynPlant>,
    /// The config with the sections that trying needs.
    pub(super) experiment: Experiment,
    /// The `error_tolerance` of the loops of nets, with their `on_error` and `uncertainty`.
    pub(super) guard: (BTreeMap<String, f64>, OnError, Option<UncertaintySpec>),
    /// The sources that nets can be trained on; empty if no net can be tried.
    pub(super) sources: Vec<TrainingTarget>,
    /// What cannot be tried or looked at, and why.
    pub(super) notes: Vec<String>,
}

impl Base {
    /// The base of a config, which may name one of `plants`.
    pub(super) fn of(experiment: &Experiment, plants: &Plants) -> Result<Self, RunError> {
        let command = "pinc choose";
        let missing = |section| RunError::missing_section(experiment, section, command);
        let control = experiment.control.as_ref().ok_or_else(|| missing("control"))?;
        let step_s = experiment.sample_time_s().ok_or_else(|| missing("model"))?;
        let mut notes = Vec::new();
        let (mut own, mut guard) = (experiment.clone(), Default::default());
        (own.sweep, own.prediction) = (None, None);
        if let Some(control) = &mut own.control {
            guard = (
                mem::take(&mut control.error_tolerance),
                mem::take(&mut control.on_error),
                control.uncertainty.clone(),
            );
            // Integrators have no error of a net.
            control.uncertainty =
                control.uncertainty.take().and_then(UncertaintySpec::without_net_error);
            // A section that is not there makes no sense of it; each case says its own model.
            control.models = vec![match experiment.plant.is_black_box() {
                true => ModelKind::BlackBox,
                false => ModelKind::RK4,
            }];
        }
        if own.domain.is_none() {
            own.domain = domain_of_bounds(experiment);
        }
        let mut added = String::new();
        let has_equation = !own.plant.is_black_box();
        let is_steppable = own.domain.as_ref().is_some_and(|domain| {
            if !has_equation {
                return true;
            }
            let plant = own.plant.family(&own.varying());
            Steps::new(&*plant, domain, step_s, 64, 1e-10).is_ok()
        });
        if !is_steppable || !has_equation {
            own.one_step = None;
        } else if own.one_step.is_none() {
            added += ONE_STEP;
        }
        let stages = control.stages(step_s);
        let longest = stages.iter().map(|(length_s, _)| *length_s).fold(step_s, f64::max);
        let mut sources = Vec::new();
        match (&own.domain, is_steppable) {
            (None, _) => notes.push(
                "no net was tried and no error of one step measured, since there is neither a \
                 [domain] nor bounds of all states"
                    .to_owned(),
            ),
            (Some(_), false) => notes.push(
                "no net was tried and no error of one step measured, since the plant cannot be \
                 integrated over T from everywhere in the domain"
                    .to_owned(),
            ),
            (Some(domain), true) => {
                let whole = own.model.as_ref().is_none_or(|model| model.time_only.is_none());
                if whole {
                    sources = sources_of(&own, stages.len() == 1 && control.cost.is_none());
                    match sources.is_empty() {
                        false => added += &net_sections(&own, domain, longest),
                        true => notes.push(ONLY_DISTILLED.to_owned()),
                    }
                } else {
                    notes.push(
                        "no net was tried, since model.time_only makes nets for one scenario"
                            .to_owned(),
                    );
                }
            }
        }
        if sources.is_empty() {
            (own.model, own.training, own.validation, own.data) = (None, None, None, None);
            if let Some(control) = &mut own.control {
                control.step_s = Some(step_s);
            }
        }
        // One training for nets of both sources, of which one alone has it.
        let training = own.training.as_mut();
        if training.and_then(|training| training.config.derivatives.take()).is_some() {
            notes.push("nets were trained without training.derivatives".to_owned());
        }
        let text = format!("{}\n{added}", own.to_toml());
        let experiment = Experiment::parse(Path::new("pinc choose"), &text, &[], plants)?;
        let plant = experiment.plant.dyn_plant();
        Ok(Self { plant, experiment, guard, sources, notes })
    }
}

impl Base {
    /// How many iterations the phases of a net's training have.
    pub(super) fn iterations(&self) -> Vec<u64> {
        let phases = self.experiment.training.iter().flat_map(|training| &training.config.phases);
        phases.map(|phase| phase.iterations).collect()
    }

    /// How many states the plant has.
    pub(super) fn states(&self) -> usize {
        self.experiment.dims().nx
    }

    /// The loop.
    pub(super) fn control(&self) -> &ControlSpec {
        self.experiment.control.as_ref().expect("the config was looked at for it")
    }
}

/// The box of the controller's bounds, if all states have some.
fn domain_of_bounds(experiment: &Experiment) -> Option<Domain> {
    let control = experiment.control.as_ref()?;
    let (low, high) = (control.state_low.clone()?, control.state_high.clone()?);
    let is_finite = low.iter().chain(&high).all(|bound| bound.is_finite());
    is_finite.then(|| Domain {
        state_low: low,
        state_high: high,
        input_low: control.input_low.clone(),
        input_high: control.input_high.clone(),
        parameters: Vec::new(),
    })
}

/// What nets can be trained on, the best guess first.
fn sources_of(own: &Experiment, one_length: bool) -> Vec<TrainingTarget> {
    use pinc_net::Ansatz::HardLinear;
    let is_hard = own.model.as_ref().is_none_or(|model| model.ansatz == HardLinear);
    let mut sources = Vec::new();
    if is_hard && one_length && own.data.is_none() {
        sources.push(TrainingTarget::Integrator);
    }
    if !own.plant.is_black_box() {
        sources.push(TrainingTarget::Physics);
    }
    sources
}

/// The sections of a training that the config lacks. The scenarios of the validation begin in the
/// inner half of the domain, with the inner half of the inputs.
fn net_sections(own: &Experiment, domain: &Domain, longest_s: f64) -> String {
    let mut text = String::new();
    // Writing to a String does not fail.
    if own.model.is_none() {
        let _ =
            write!(text, "[model]\nhorizon_s = {longest_s:?}\nhidden_layers = 2\nneurons = 16\n");
    }
    if own.training.is_none() {
        text += "[training]\n";
        if own.plant.is_black_box() {
            text += "source = \"integrator\"\n";
        }
    }
    if own.validation.is_none() {
        let length_s = own.model.as_ref().map_or(longest_s, |model| model.sample_time_s);
        let inner = |low: &[f64], high: &[f64], part: f64| {
            let ends = low.iter().zip(high);
            ends.map(|(low, high)| low + part * (high - low)).collect::<Vec<_>>()
        };
        let _ =
            write!(text, "[validation]\nduration_s = {:?}\n[validation.domain]\n", 10.0 * length_s);
        for (end, part) in [("low", 0.25), ("high", 0.75)] {
            let states = inner(&domain.state_low, &domain.state_high, part);
            let inputs = inner(&domain.input_low, &domain.input_high, part);
            let _ = write!(text, "state_{end} = {states:?}\ninput_{end} = {inputs:?}\n");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is chosen from a shipped config with these values.
    fn base(config: &str, sets: &[&str]) -> Base {
        let plants = Plants::built_in();
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/smoke").join(config);
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        let experiment = Experiment::load(&path, &sets, &plants).unwrap();
        Base::of(&experiment, &plants).unwrap()
    }

    const BOUNDS: [&str; 2] = ["control.state_low=[2.0]", "control.state_high=[20.0]"];

    /// Without a domain the bounds are one, if all of them are finite; a net and its validation come
    /// with it, the latter in the middle half of the box.
    #[test]
    fn bounds_of_all_states_are_a_domain() {
        let of = base("rk4-only.toml", &BOUNDS);
        let domain = of.experiment.domain.as_ref().unwrap();
        assert_eq!((&domain.state_low[..], &domain.state_high[..]), (&[2.0][..], &[20.0][..]));
        assert_eq!((&domain.input_low[..], &domain.input_high[..]), (&[0.5][..], &[4.45][..]));
        let model = of.experiment.model.as_ref().unwrap();
        assert!((model.sample_time_s - 10.0).abs() < 1e-12);
        let validation = of.experiment.validation.as_ref().unwrap();
        assert!((validation.duration_s - 100.0).abs() < 1e-12);
        assert_eq!(validation.domain.state_low, [6.5]);
        assert_eq!(validation.domain.state_high, [15.5]);
        assert_eq!(validation.domain.input_low, [0.5 + 0.25 * 3.95]);
        assert_eq!(of.sources, [TrainingTarget::Integrator, TrainingTarget::Physics]);
        assert_eq!(of.notes, [""; 0]);
        assert_eq!(of.experiment.one_step.as_ref().unwrap().points, 1024);
        assert_eq!((of.states(), of.control().models.len()), (1, 1));

        for sets in [&[BOUNDS[0]][..], &["control.state_low=[-inf]", BOUNDS[1]]] {
            let of = base("rk4-only.toml", sets);
            assert!(of.experiment.domain.is_none() && of.experiment.one_step.is_none());
            assert_eq!(of.sources, []);
            assert!(of.notes[0].ends_with("neither a [domain] nor bounds of all states"));
            assert!(of.experiment.model.is_none());
            assert_eq!(of.control().step_s, Some(10.0));
        }
    }

    /// A net has one length of steps, and is trained over the longest stage; of stages of several
    /// lengths none is distilled.
    #[test]
    fn a_net_covers_the_longest_stage() {
        let stages = "control.stages_s=[10.0, 10.0, 20.0, 20.0, 20.0]";
        let of = base("rk4-only.toml", &[BOUNDS[0], BOUNDS[1], stages]);
        let model = of.experiment.model.as_ref().unwrap();
        assert!((model.sample_time_s - 20.0).abs() < 1e-12, "{model:?}");
        assert_eq!(of.sources, [TrainingTarget::Physics]);
    }

    /// The config's own domain, net and training are taken as they are; what guards its net is kept
    /// for the nets that are tried.
    #[test]
    fn sections_of_the_config_are_kept() {
        let of = base("one-tank.toml", &["control.error_tolerance={ h = 0.5 }"]);
        let domain = of.experiment.domain.as_ref().unwrap();
        assert_eq!(domain.state_high, [20.0]);
        assert_eq!(of.experiment.validation.as_ref().unwrap().domain.state_low, [4.0]);
        assert_eq!(of.iterations(), [150]);
        assert_eq!(of.guard.0.get("h"), Some(&0.5));
        assert!(of.control().error_tolerance.is_empty());
        assert!(of.experiment.prediction.is_none() && of.experiment.sweep.is_none());
        assert_eq!(of.control().models, [ModelKind::RK4]);
        // A net for one scenario is no model of all.
        let own = "model.ansatz=\"direct\"";
        let of = base("one-tank.toml", &[own]);
        assert_eq!(of.sources, [TrainingTarget::Physics]);
    }

    /// The integral of a cost needs states between the ends of steps, which a distilled net lacks.
    #[test]
    fn distilled_nets_are_not_tried_with_a_cost() {
        let text = r#"
            name = "lag"
            preset = "ours"
            seed = 1
            [plant.expression]
            states = ["x"]
            inputs = ["u"]
            derivatives = { x = "u - x" }
            [control]
            models = ["rk4"]
            step_s = 0.5
            duration_s = 2.0
            initial_state = [0.0]
            controlled = ["x"]
            q = [1.0]
            r = [0.1]
            state_low = [-1.0]
            state_high = [1.0]
            input_low = [-1.0]
            input_high = [1.0]
            references = [{ start_s = 0.0, value = [0.5] }]
        "#;
        let plants = Plants::built_in();
        let sources = |sets: &[String]| {
            let experiment = Experiment::parse(Path::new("lag.toml"), text, sets, &plants).unwrap();
            Base::of(&experiment, &plants).unwrap().sources
        };
        assert_eq!(sources(&[]), [TrainingTarget::Integrator, TrainingTarget::Physics]);
        let cost = "control.cost.stage=\"x^2\"".to_owned();
        assert_eq!(sources(&[cost]), [TrainingTarget::Physics]);
    }
}
