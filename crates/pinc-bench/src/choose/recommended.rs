//! The config with the model to use.

use super::NET;
use super::base::Base;
use super::candidate::Candidate;
use super::summary::Found;
use pinc_config::Experiment;

/// The config `own` with the model that was found, of which `base` was tried, and with the reasons
/// as comments.
pub(super) fn config(own: &Experiment, base: &Base, found: &Found<'_>, has_net: bool) -> String {
    let candidate = found.winner.candidate;
    let mut experiment = match candidate {
        Candidate::Integrator { .. } => without_net(own, &base.experiment),
        Candidate::Net { .. } => base.experiment.clone(),
    };
    experiment.name = format!("{}-recommended", own.name);
    (experiment.one_step, experiment.sweep) = (None, None);
    if let (Candidate::Net { shape, source }, Some(model), Some(training)) =
        (candidate, &mut experiment.model, &mut experiment.training)
    {
        (model.hidden_layers, model.neurons) = (shape.layers, shape.neurons);
        training.config.source = source;
        experiment.prediction.clone_from(&own.prediction);
    }
    if let Some(control) = &mut experiment.control {
        control.models = vec![candidate.kind()];
        if let Candidate::Integrator { kind, substeps } = candidate {
            control.set_substeps(kind, substeps);
        }
    }
    let mut comments: Vec<String> = found.sentences();
    comments.push(format!("Written by `pinc choose`; every value is spelled out."));
    if has_net {
        comments.push(format!(
            "The net lies beside this file: `pinc control FILE --model {NET}` trains none."
        ));
    }
    let comments: String = comments.iter().map(|comment| wrapped(comment)).collect();
    format!("{comments}\n{}", experiment.to_toml())
}

/// The config without all that is of a net.
fn without_net(own: &Experiment, base: &Experiment) -> Experiment {
    let mut experiment = own.clone();
    (experiment.model, experiment.training, experiment.validation) = (None, None, None);
    (experiment.data, experiment.prediction) = (None, None);
    if let Some(control) = &mut experiment.control
        && control.stages_s.is_none()
    {
        control.step_s = base.sample_time_s();
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
