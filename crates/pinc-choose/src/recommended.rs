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
