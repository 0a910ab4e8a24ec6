//! The config with the model to use.

use crate::advice::Advice;
use crate::candidate::{Candidate, LONGER};
use pinc_config::{Experiment, OnError};

impl Advice<'_> {
    /// The config `own` with the model to use, and with the reasons as comments. `base` is what was
    /// tried; `net` names the file beside the config that holds the net, if it is one.
    #[must_use]
    pub fn config(&self, own: &Experiment, base: &Experiment, net: Option<&str>) -> String {
        let candidate = self.winner().candidate;
        let mut experiment = match candidate {
            Candidate::Integrator { .. } | Candidate::BlackBox => without_net(own, base),
            Candidate::Net { .. } => base.clone(),
        };
        experiment.name = format!("{}-recommended", own.name);
        (experiment.one_step, experiment.sweep) = (None, None);
        if let (Candidate::Net { shape, source, longer }, Some(model), Some(training)) =
            (candidate, &mut experiment.model, &mut experiment.training)
        {
            (model.hidden_layers, model.neurons) = (shape.layers, shape.neurons);
            training.config.source = source;
            if longer {
                training.config.phases.iter_mut().for_each(|phase| phase.iterations *= LONGER);
            }
            experiment.prediction.clone_from(&own.prediction);
        }
        if let Some(control) = &mut experiment.control {
            control.models = vec![candidate.kind()];
            if let Candidate::Integrator { integrator, substeps } = candidate {
                control.set_substeps(integrator, substeps);
            }
        }
        let mut comments: Vec<String> = self.sentences();
        comments.push("Written by `pinc choose`; every value is spelled out.".to_owned());
        if let Some(net) = net {
            comments.push(format!(
                "The net lies beside this file: `pinc control FILE --model {net}` trains none."
            ));
        }
        let comments: String = comments.iter().map(|comment| wrapped(comment)).collect();
        format!("{comments}\n{}", experiment.to_toml())
    }
}

/// The config without all that is of a net.
fn without_net(own: &Experiment, base: &Experiment) -> Experiment {
    let mut experiment = own.clone();
    (experiment.model, experiment.training, experiment.validation) = (None, None, None);
    (experiment.data, experiment.prediction) = (None, None);
    if let Some(control) = &mut experiment.control {
        control.error_tolerance.clear();
        control.on_error = OnError::Count;
        if control.stages_s.is_none() {
            control.step_s = base.sample_time_s();
        }
    }
    experiment
}

/// Text as lines of comment.
fn wrapped(text: &str) -> String {
    let (mut lines, mut line) = (String::new(), String::from("#"));
    for word in text.split_whitespace() {
        if line.len() + 1 + word.len() > 98 {
            lines += &line;
            lines.push('\n');
            line = String::from("#");
        }
        line.push(' ');
        line += word;
    }
    lines + &line + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidate::shapes;
    use crate::judge::tests::score;
    use crate::search::{Search, SearchResult};
    use crate::{Score, Tried};
    use pinc_config::{ModelKind, Plants};
    use pinc_net::TrainingTarget;
    use pinc_ode::Integrator;
    use std::path::Path;

    /// The config of the oscillator, with these values.
    fn oscillator(sets: &[&str]) -> Experiment {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/van-der-pol.toml");
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        Experiment::load(path.as_ref(), &sets, &Plants::built_in()).unwrap()
    }

    /// The config that is recommended where this model, cheaper than RK4, is as good, as text and
    /// as it is read.
    fn recommended(
        candidate: Candidate,
        own: &Experiment,
        net: Option<&str>,
    ) -> (String, Experiment) {
        let tried = |candidate, score: Score| Tried {
            candidate,
            net: None,
            repetitions: 1,
            place: String::new(),
            result: Ok(score),
        };
        let exact = Candidate::Integrator { integrator: Integrator::Rk4, substeps: 16 };
        let all =
            vec![tried(exact, score(100.0, 50.0, 1e-9)), tried(candidate, score(100.0, 5.0, 1e-3))];
        let control = own.control.as_ref().unwrap();
        let search = Search { control, sources: &[], states: 2, within: 0.01, has_equation: true };
        let found = SearchResult { tried: all, ..SearchResult::default() };
        let text = Advice::of(&search, &found, &[]).unwrap().config(own, own, net);
        let read = Experiment::parse(Path::new("best.toml"), &text, &[], &Plants::built_in());
        (text, read.unwrap())
    }

    /// A net keeps its training, with the size, source and iterations that won.
    #[test]
    fn a_config_with_a_net_trains_the_same_one() {
        let own = oscillator(&[]);
        let source = TrainingTarget::Integrator;
        let net = |longer| Candidate::Net { shape: shapes(2)[3], source, longer };
        let iterations = |of: &Experiment| -> Vec<u64> {
            let phases = &of.training.as_ref().unwrap().config.phases;
            phases.iter().map(|phase| phase.iterations).collect()
        };
        let (text, best) = recommended(net(false), &own, Some("net.json"));
        assert_eq!(best.name, format!("{}-recommended", own.name));
        let model = best.model.as_ref().unwrap();
        assert_eq!((model.hidden_layers, model.neurons), (3, 24));
        assert_eq!(best.training.as_ref().unwrap().config.source, source);
        assert_eq!(best.control.as_ref().unwrap().models, [ModelKind::Pinc]);
        assert_eq!(iterations(&best), iterations(&own));
        assert!(text.contains("`pinc control FILE --model net.json` trains none."), "{text}");
        let (text, longer) = recommended(net(true), &own, None);
        let twice: Vec<u64> = iterations(&own).iter().map(|count| 2 * count).collect();
        assert_eq!(iterations(&longer), twice);
        assert!(!text.contains("The net lies beside"), "{text}");
    }

    /// Without a net nothing is left of one, and the loop has its step by itself: the net's.
    #[test]
    fn a_config_with_an_integrator_has_nothing_of_a_net() {
        let rk5 = Candidate::Integrator { integrator: Integrator::Rk5, substeps: 3 };
        let own =
            oscillator(&["control.error_tolerance={ x1 = 0.1 }", "control.on_error=integrator"]);
        let (_, best) = recommended(rk5, &own, None);
        assert!(best.model.is_none() && best.training.is_none() && best.validation.is_none());
        let control = best.control.unwrap();
        assert_eq!(control.models, [ModelKind::Integrator(Integrator::Rk5)]);
        assert_eq!((control.step_s, control.rk5_substeps), (own.sample_time_s(), 3));
        assert!(control.error_tolerance.is_empty() && control.on_error == OnError::Count);
    }

    /// A line has 98 characters at most: `#` and words, each after a space.
    #[test]
    fn comments_are_wrapped() {
        let with = |last: &str| wrapped(&format!("{}{last}", "word ".repeat(18)));
        assert_eq!(with("sixish"), format!("#{} sixish\n", " word".repeat(18)));
        assert_eq!(with("sevenis"), format!("#{}\n# sevenis\n", " word".repeat(18)));
    }
}
