//! From a config to an experiment and back: presets, merging, overrides, files.

use crate::common::{parse, read, repository};
use pinc_config::{Experiment, Plants, Preset};
use pinc_mpc::Weight;
use pinc_ode::Integrator;
use std::path::PathBuf;

/// The smoke config of the Van der Pol oscillator, as text.
fn smoke() -> String {
    read("configs/smoke/van-der-pol.toml")
}

/// Every config that is shipped.
fn shipped() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for dir in std::fs::read_dir(repository("configs")).unwrap() {
        let dir = dir.unwrap().path();
        if dir.is_dir() {
            let files = std::fs::read_dir(dir).unwrap().map(|file| file.unwrap().path());
            found.extend(files.filter(|path| path.extension().is_some_and(|e| e == "toml")));
        }
    }
    assert!(found.len() >= 8, "{found:?}");
    found
}

#[test]
fn every_shipped_config_is_valid_in_every_preset_and_survives_being_written_out() {
    for path in shipped() {
        for preset in ["ours", "as-printed", "as-released"] {
            let sets = [format!("preset={preset}")];
            let experiment = Experiment::load(&path, &sets, &Plants::built_in())
                .unwrap_or_else(|error| panic!("{}, {preset}: {error}", path.display()));
            assert_eq!(experiment.preset.name(), preset);
            let text = experiment.to_toml();
            let again = parse(&text, &[]).unwrap();
            assert_eq!(again, experiment);
            assert_eq!(again.to_toml(), text);
            assert_eq!(again.fingerprint(), experiment.fingerprint());
        }
    }
}

#[test]
fn the_config_in_the_readme_is_valid() {
    let readme = read("README.md");
    let (_, rest) = readme.split_once("```toml\n").unwrap();
    let (config, _) = rest.split_once("```").unwrap();
    let experiment = parse(config, &[]).unwrap();
    assert!(experiment.training.is_some() && experiment.control.is_some());
}

#[test]
fn no_two_shipped_configs_share_a_name() {
    let mut names: Vec<_> = shipped()
        .iter()
        .map(|path| Experiment::load(path, &[], &Plants::built_in()).unwrap().name)
        .collect();
    names.sort();
    let count = names.len();
    names.dedup();
    assert_eq!(names.len(), count);
}

/// A config with two values in each layer that the next one overrides one of.
const LAYERED: &str = r#"
name = "layered"
preset = "ours"
seed = 1

[plant]
one-tank = {}

[control]
models = ["rk4"]
step_s = 10.0
duration_s = 100.0
initial_state = [5.0]
controlled = ["h"]
q = [1.0]
r = [2.0]
input_low = [0.5]
input_high = [4.45]
references = [{ start_s = 0.0, value = [9.0] }]
rk4_substeps = 7

[presets.as-released.control]
q = [3.0]
rk4_substeps = 8
"#;

#[test]
fn later_layers_win() {
    let control = |sets: &[&str]| {
        let control = parse(LAYERED, sets).unwrap().control.unwrap();
        let [Weight::Diagonal(q), Weight::Diagonal(r)] = [control.q, control.r] else {
            panic!("the file gives diagonals");
        };
        (control.n2, control.rk4_substeps, q[0], r[0])
    };
    // n2 is the built-in default's; the file replaces the default of rk4_substeps, which is 4.
    assert_eq!(control(&[]), (5, 7, 1.0, 2.0));
    // Only the chosen preset's table in the file counts.
    assert_eq!(control(&["preset=as-printed"]), (5, 7, 1.0, 2.0));
    assert_eq!(control(&["preset=as-released"]), (5, 8, 3.0, 2.0));
    // A --set has the last word, the later of two the very last.
    let sets = ["preset=\"as-released\"", "control.rk4_substeps=9", "control.q=[4.0]"];
    assert_eq!(control(&sets), (5, 9, 4.0, 2.0));
    assert_eq!(control(&["control.r=[5.0]", "control.r=[6.0]"]), (5, 7, 1.0, 6.0));
}

/// Of a preset that is not chosen, too, and where the file has it.
#[test]
fn mistakes_in_the_keys_of_a_preset_are_refused() {
    for (right, wrong, expected) in [
        ("q = [3.0]", "q = [-3.0]", "test.toml:23: `presets.as-released.control.q[0]`: -3"),
        ("q = [3.0]", "q = [3.0, 4.0]", "test.toml:23: `presets.as-released.control.q`: 2 values"),
        (
            "rk4_substeps = 8",
            "rk4_substep = 8",
            "`presets.as-released.control.rk4_substep`: unknown",
        ),
        ("as-released.control", "as-released.controll", "`presets.as-released.controll`: unknown"),
    ] {
        let text = LAYERED.replacen(right, wrong, 1);
        for sets in [&[][..], &["control.rk4_substeps=9"], &["preset=as-released"]] {
            let error = parse(&text, sets).unwrap_err().to_string();
            assert!(error.contains(expected), "{sets:?}: {error}");
        }
    }
    // This preset has no plan with such bounds, but nobody asked for it.
    let text =
        LAYERED.replacen("q = [3.0]", "n2 = 3", 1).replacen("r = [2.0]", "r = [2.0]\nnu = 5", 1);
    assert!(parse(&text, &["preset=as-released"]).is_err());
    assert!(parse(&text, &[]).is_ok());
}

#[test]
fn presets_differ_where_they_should() {
    let profile = |preset| {
        let set = format!("preset={preset}");
        let control = parse(LAYERED, &[&set]).unwrap().control.unwrap();
        format!("{:?}", control.weights_profile)
    };
    assert_eq!(profile("ours"), "Uniform");
    assert_eq!(profile("as-printed"), "Uniform");
    assert_eq!(profile("as-released"), "Cumulative");

    let ansatz = |preset| {
        let set = format!("preset={preset}");
        format!("{:?}", parse(&smoke(), &[&set]).unwrap().model.unwrap().ansatz)
    };
    assert_eq!(ansatz("ours"), "HardLinear");
    assert_eq!(ansatz("as-printed"), "Direct");
    assert_eq!(ansatz("as-released"), "Direct");
}

#[test]
fn sections_that_are_not_mentioned_are_absent() {
    let experiment = parse(LAYERED, &[]).unwrap();
    assert!(experiment.model.is_none() && experiment.training.is_none());
    assert!(experiment.validation.is_none() && experiment.prediction.is_none());
    assert_eq!(experiment.sample_time_s(), Some(10.0));
}

#[test]
fn overrides_are_toml_or_bare_words() {
    let experiment = parse(
        &smoke(),
        &[
            "seed=12",
            "preset=as-printed",
            "name=another-name",
            "control.references.1.value=[-0.25, 0.0]",
            "training.phases.1.iterations=3",
            "training.time_limit_s=1.5",
            "plant={ van-der-pol = { mu = 2.0 } }",
        ],
    )
    .unwrap();
    assert_eq!((experiment.seed, experiment.name.as_str()), (12, "another-name"));
    assert_eq!(experiment.preset, Preset::AsPrinted);
    assert_eq!(experiment.control.unwrap().references[1].value, [-0.25, 0.0]);
    let training = experiment.training.unwrap();
    assert_eq!(training.config.phases[1].iterations, 3);
    assert_eq!(training.effort.time_limit_s, Some(1.5));
    assert_eq!(format!("{:?}", experiment.plant), "VanDerPol(VanDerPolSpec { mu: 2.0 })");
}

/// As in a sweep and a tuning.
#[test]
fn a_key_of_the_plant_in_the_loop_changes_a_copy_of_the_configs_plant() {
    let path = repository("configs/gallery/cart-pole.toml");
    let set = "control.plant.expression.parameters.cart_mass=1.5".to_owned();
    let experiment = Experiment::load(&path, &[set], &Plants::built_in()).unwrap();
    let (own, real) = (&experiment.plant, experiment.plant_in_the_loop());
    let mut expected = own.parameters();
    assert_ne!(expected.insert("cart_mass".into(), 1.5), Some(1.5));
    assert_eq!(real.parameters(), expected);
    assert_eq!(real.variables(), own.variables());
}

#[test]
fn fingerprints_tell_configs_apart() {
    let fingerprint = |sets: &[&str]| parse(LAYERED, sets).unwrap().fingerprint();
    assert_eq!(fingerprint(&[]), fingerprint(&["control.rk4_substeps=7"]));
    assert_ne!(fingerprint(&[]), fingerprint(&["seed=2"]));
    assert_ne!(fingerprint(&[]), fingerprint(&["control.q=[1.0000000000000002]"]));
}

#[test]
fn the_default_optimizer_is_chosen_by_the_size_of_the_net_and_written_out() {
    let path = repository("configs/van-der-pol/main.toml");
    let optimizer = |layers: usize, neurons: usize| {
        let sets = [format!("model.hidden_layers={layers}"), format!("model.neurons={neurons}")];
        let experiment = Experiment::load(&path, &sets, &Plants::built_in()).unwrap();
        let table: toml::Table = experiment.to_toml().parse().unwrap();
        let optimizer = &table["training"]["phases"][0]["optimizer"];
        optimizer.as_table().unwrap().keys().cloned().collect::<Vec<_>>()
    };
    // Inputs t, x1, x2, u and two outputs: with 3 layers of 61 there are
    // 5 * 61 + 2 * 62 * 61 + 62 * 2 = 7993 weights and biases, with 62 there are 8248.
    assert_eq!(optimizer(4, 20), ["self-scaled-broyden"]);
    assert_eq!(optimizer(3, 61), ["self-scaled-broyden"]);
    assert_eq!(optimizer(3, 62), ["lbfgs"]);
}

/// The cost of the authors' program on inputs ul, u0, .., u4, as the shipped config has it.
#[test]
fn differences_of_inputs_are_a_weight_of_their_sequence() {
    let path = repository("configs/van-der-pol/control.toml");
    let load = |preset: &str| {
        let sets = [format!("preset={preset}")];
        let experiment = Experiment::load(&path, &sets, &Plants::built_in()).unwrap();
        let control = experiment.control.as_ref().unwrap();
        control.problem(&experiment.plant.variables(), 0.5).weights
    };
    assert_eq!(load("ours").input_sequence, None);
    let weights = load("as-released");
    let Some(Weight::Full(w)) = weights.input_sequence else { panic!("{weights:?}") };
    for u in [[0.3, -0.2, 0.7, 0.1, -0.9, 0.4], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]] {
        let [ul, u0, u1, .., u4] = u;
        let square = |v: f64| v * v;
        let expected = 0.5
            * (5.0 * (square(u0 - ul) + square(u1 - ul))
                + 10.0 * (square(u0 - u4) + square(u1 - u0)));
        let rows = w
            .iter()
            .zip(u)
            .map(|(row, ui)| row.iter().zip(u).map(|(entry, uj)| ui * entry * uj).sum::<f64>());
        let found: f64 = rows.sum();
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}

/// For a plant with two inputs, and with a full weight.
#[test]
fn differences_of_several_inputs_have_blocks() {
    let text = read("configs/smoke/four-tanks.toml");
    let sets = [
        "control.n2=2",
        "control.nu=2",
        "control.input_differences=[{ between = [1, -1], weight = [[2.0, 0.5], [0.5, 3.0]] }]",
    ];
    let experiment = parse(&text, &sets).unwrap();
    let control = experiment.control.as_ref().unwrap();
    let weights = control.problem(&experiment.plant.variables(), 10.0).weights;
    let expected = vec![
        vec![2.0, 0.5, 0.0, 0.0, -2.0, -0.5],
        vec![0.5, 3.0, 0.0, 0.0, -0.5, -3.0],
        vec![0.0; 6],
        vec![0.0; 6],
        vec![-2.0, -0.5, 0.0, 0.0, 2.0, 0.5],
        vec![-0.5, -3.0, 0.0, 0.0, 0.5, 3.0],
    ];
    assert_eq!(weights.input_sequence, Some(Weight::Full(expected)));
}

#[test]
fn keys_can_be_taken_away() {
    let text = read("configs/four-tanks/control.toml");
    let both = parse(&text, &[]).unwrap().control.unwrap();
    let limit = "control.state_high=[20.0, 20.0, 20.0, 20.0]";
    let limited = parse(&text, &[limit]).unwrap().control.unwrap();
    assert!(limited.state_high.is_some() && both.state_low.is_some());
    let sets = [limit, "--unset control.state_high", "--unset control.state_low"];
    let control = parse(&text, &sets).unwrap().control.unwrap();
    assert_eq!((control.state_low, control.state_high), (None, None));
    let control = parse(&text, &["--unset control.q", "control.q=[3.0, 4.0]"]).unwrap().control;
    assert_eq!(control.unwrap().q, Weight::Diagonal(vec![3.0, 4.0]));
    for (key, expected) in [
        ("control.state_highs", "--unset control.state_highs: there is no key `control.state_hi"),
        ("control.q.h1", "--unset control.q.h1: there is no key `control.q.h1`"),
        ("prediction", "there is no key `prediction`"),
        ("control..q", "expected a key, as training.lambda"),
        ("control.q", "`control.q`: missing"),
        // List elements are named by index, as in a --set.
        ("control.references.1.start_s", "`control.references[1].start_s`: missing"),
        ("control.references.1.start", "there is no key `control.references.1.start`"),
        ("control.references.9.start_s", "there is no key `control.references.9.start_s`"),
        ("preset", "`preset`: missing"),
    ] {
        let found = parse(&text, &[&format!("--unset {key}")]).unwrap_err();
        assert!(found.contains(expected), "{key}: {found}");
    }
}

#[test]
fn lists_of_another_length_name_their_entries() {
    let text = read("configs/four-tanks/control.toml");
    for (set, expected) in [
        ("control.q=[1.0]", "`control.q`: 1 values given, expected 2: h1, h2"),
        ("control.q=[[1.0, 0.0], [1.0]]", "`control.q`: 1 values given, expected 2: h1, h2"),
        ("control.state_low=[1.0]", "1 values given, expected 4: h1, h2, h3, h4"),
        ("control.input_low=[]", "`control.input_low`: 0 values given, expected 2: u1, u2"),
    ] {
        let found = parse(&text, &[set]).unwrap_err();
        assert!(found.contains(expected), "{set}: {found}");
    }
}

/// The shipped example with six stages.
const FEW_STAGES: &str = "configs/four-tanks/few-stages.toml";

#[test]
fn stages_may_differ_in_length() {
    let experiment = parse(&read(FEW_STAGES), &[]).unwrap();
    assert_eq!((experiment.sample_time_s(), experiment.net_step_s()), (Some(10.0), Some(140.0)));
    let control = experiment.control.unwrap();
    let stages = control.stages(10.0);
    assert_eq!(stages, [(10.0, 2), (20.0, 1), (40.0, 1), (80.0, 1), (140.0, 1)]);
    assert!((control.horizon_s(10.0) - 300.0).abs() < 1e-9);
    let substeps = |length_s| control.substeps(Integrator::Rk4, length_s, 10.0);
    assert_eq!([10.0, 20.0, 140.0].map(substeps), [1, 2, 14]);
    // A stage counts as its steps would.
    let problem = control.problem(&experiment.plant.variables(), 10.0);
    let q = |i: usize| problem.weights.q.at(i).entry(1, 1);
    assert_eq!([0, 1, 2, 5].map(q).to_vec(), [10.0, 10.0, 20.0, 140.0]);
    let r = |i: usize| problem.weights.r.at(i).entry(0, 0);
    assert_eq!([0, 5].map(r).to_vec(), [1.0, 1.0]);
}

#[test]
fn stages_that_make_no_sense_are_refused() {
    let text = read(FEW_STAGES);
    let stages = |list: &str| format!("control.stages_s={list}");
    for (sets, expected) in [
        (vec![stages("[]")], "one stage or more"),
        (vec!["control.n2=7".into()], "expected 7, one per stage of the horizon (control.n2)"),
        (vec![stages("[10, 10, 20, 40, 80, 5]")], "control.stages_s[5]"),
        (vec![stages("[10, 10, 20, 40, 80, 145]")], "a whole number of control steps of 10 s"),
        (vec![stages("[0.0, 10, 20, 40, 80, 140]")], "a positive number"),
        (vec![stages("[10, 10, 20, 40, 80, 150]")], "`model.horizon_s`"),
        (vec!["control.step_s=20.0".into()], "control.stages_s[0], 10"),
        (
            vec!["control.weights_profile=cumulative".into()],
            "no such key with weights_profile = \"cumulative\"",
        ),
        (vec!["training.source=integrator".into()], "a distilled net knows one length only"),
        (vec!["control.rk4_substeps=1000".into()], "10000 substeps of rk4 at most"),
    ] {
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        let found = parse(&text, &sets).unwrap_err();
        assert!(found.contains(expected), "{sets:?}: {found}");
    }
}

/// The integral of a cost along a net needs its states between the ends of steps.
#[test]
fn a_cost_along_a_distilled_net_is_refused() {
    let text = read("configs/four-tanks/control.toml");
    let distilled = ["training.source=integrator", "control.models=[\"pinc\"]"];
    parse(&text, &distilled).unwrap();
    let cost = "control.cost.stage=\"u1^2\"";
    let refused = parse(&text, &[&distilled[..], &[cost]].concat()).unwrap_err();
    let said = "`training.source`: \"integrator\" given, expected \"physics\" with [control.cost]";
    assert!(refused.contains(said), "{refused}");
    // Integrators have a cost of their own, whatever net is trained beside them.
    parse(&text, &[distilled[0], "control.models=[\"rk4\"]", cost]).unwrap();
}

/// A table of estimates has columns for what is measured, be it a state or an output.
#[test]
fn states_named_as_columns_of_measurements_are_refused() {
    for (name, stem) in [("y_x", "x"), ("innovation_x", "x"), ("y_out", "out")] {
        let text = format!(
            "name = \"n\"\npreset = \"ours\"\nseed = 1\n[plant.expression]\nstates = [\"x\", \"{name}\"]\n\
             inputs = [\"u\"]\nderivatives = {{ x = \"u\", {name} = \"x\" }}\noutputs = {{ out = \"2*x\" }}\n"
        );
        let refused = parse(&text, &[]).unwrap_err();
        let said = format!("this one is a column of {stem} in tables of runs");
        assert!(refused.contains("states[1]") && refused.contains(&said), "{refused}");
    }
}

/// A disturbance of a state is what a control step adds to it, whatever a stage's length.
#[test]
fn disturbances_of_states_are_refused_with_stages_of_other_lengths() {
    let text = r#"
        name = "leak"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["h"]
        inputs = ["u"]
        [plant.expression.derivatives]
        h = "u - 0.2*h"
        [control]
        models = ["rk4"]
        duration_s = 4.0
        initial_state = [1.0]
        controlled = ["h"]
        n2 = 3
        nu = 3
        q = [1.0]
        r = [0.1]
        input_low = [-2.0]
        input_high = [2.0]
        references = [{ start_s = 0.0, value = [1.0] }]
        [control.measurement]
        measured = ["h"]
        noise_sd = [0.0]
        [control.estimator]
        kind = "ekf"
        process_sd = [0.01]
        measurement_sd = [0.001]
        initial_estimate = [1.0]
        initial_sd = [0.1]
        disturbance = { states = ["h"] }
        disturbance_sd = [0.05]
        disturbance_initial_sd = [0.5]
    "#;
    let of = |stages: &str| parse(text, &[&format!("control.stages_s={stages}")]);
    of("[1, 1, 1]").unwrap();
    let found = of("[1, 1, 4]").unwrap_err();
    assert!(found.contains("expected no such key with disturbances of states"), "{found}");
    let sets = ["control.stages_s=[1, 1, 4]", "control.estimator.disturbance=input"];
    parse(text, &sets).unwrap();
}

#[test]
fn derivatives_are_for_distilled_nets_of_plants_that_have_them() {
    let oscillator = "van-der-pol = { mu = 1.0 }";
    let process = r#"process = { command = ["true"], states = ["x1", "x2"], inputs = ["u"] }"#;
    let keys = "\nsource = \"integrator\"\nderivatives = 0.1\n";
    let smoke = smoke();
    let (training, _) = smoke.split_once("[prediction]").unwrap();
    let text = training.replace("[training]\n", &format!("[training]{keys}"));
    assert!(text.contains(oscillator) && text.contains(keys));
    let experiment = parse(&text, &[]).unwrap();
    assert_eq!(experiment.training.as_ref().unwrap().config.derivatives, Some(0.1));
    assert_eq!(parse(&experiment.to_toml(), &[]).unwrap(), experiment);
    for (plant, sets, expected) in [
        (process, &[][..], "expected no such key: only an FMU for model exchange with directional"),
        (oscillator, &["training.source=physics"], "without source = \"integrator\""),
        (oscillator, &["training.derivatives=0.0"], "expected a positive number"),
        (oscillator, &["training.derivatives=-0.5"], "expected a positive number"),
    ] {
        let error = parse(&text.replace(oscillator, plant), sets).unwrap_err();
        assert!(error.contains("test.toml") || !sets.is_empty(), "{error}");
        assert!(error.contains("training.derivatives"), "{error}");
        assert!(error.contains(expected), "{error}");
    }
}

/// Units are free texts, except for what files cannot have.
#[test]
fn names_and_units_have_no_control_characters() {
    let plant = |unit: &str, of_input: &str, of_output: &str| {
        let states = format!(r#"[{{ name = "x1", unit = "{unit}" }}, {{ name = "x2" }}]"#);
        let inputs = format!(r#"[{{ name = "u", unit = "{of_input}" }}]"#);
        let output = format!(r#"{{ expression = "x1 + u", unit = "{of_output}" }}"#);
        format!(
            "expression = {{ states = {states}, inputs = {inputs}, outputs = {{ y = {output} }}, \
             derivatives = {{ x1 = \"x2\", x2 = \"u - x1\" }} }}"
        )
    };
    let with = |plant: &str| parse(&smoke().replace("van-der-pol = { mu = 1.0 }", plant), &[]);
    let fine = with(&plant("m/s*/ <b>", "\u{b0}C", "/* kg")).unwrap();
    assert_eq!(fine.plant.variables().inputs[0].unit, "\u{b0}C");
    for (text, key) in [
        (plant(r"m\u0007", "V", "W"), "`plant.expression.states[0].unit`"),
        (plant("m", r"V\n", "W"), "`plant.expression.inputs[0].unit`"),
        (plant("m", "V", r"\u0085"), "`plant.expression.outputs.y`"),
        (
            r#"process = { command = ["true"], states = ["x\t1", "x2"], inputs = ["u"] }"#.into(),
            "`plant`",
        ),
    ] {
        let error = with(&text).unwrap_err();
        assert!(error.contains(key) && error.contains("without control characters"), "{error}");
    }
    // The plant in the loop may be another one.
    let other = plant("m", r"\u001b[0m", "W");
    let text = smoke().replace("[control]\n", &format!("[control]\nplant = {{ {other} }}\n"));
    let error = parse(&text, &[]).unwrap_err();
    assert!(error.contains("`control.plant.expression.inputs[0].unit`"), "{error}");
}

/// From 9.5 a move of at most .1 does not lead below 4.45, nor one from 0, where none is given, above 1.
#[test]
fn bounded_moves_lead_from_the_initial_input_to_its_bounds() {
    let moves = ["control.increment_low=[-0.1]", "control.increment_high=[0.1]"];
    let with = |more: &[&str]| parse(LAYERED, &[&moves[..], more].concat());
    let far = with(&["control.initial_input=[9.5]"]).unwrap_err();
    let said =
        "`control.initial_input[0]`: 9.5 given, expected 0.4 to 4.55, from where a move leads";
    assert!(far.contains(said), "{far}");
    let low = with(&["control.input_low=[1.0]", "control.input_high=[2.0]"]).unwrap_err();
    assert!(low.contains("`control.initial_input[0]`: 0 given, expected 0.9 to 2.1"), "{low}");
    assert!(with(&["control.initial_input=[4.5]"]).is_ok());
}

/// A number where a word is expected.
#[test]
fn a_number_is_no_word() {
    let set = parse(LAYERED, &["control.state_softness=100.0"]).unwrap_err();
    let said = "control.state_softness`: no word given, expected one of this key's words";
    assert!(set.contains(said), "{set}");
}

/// A number that is none is refused with the file's line and its key, before a loop begins with it.
#[test]
fn an_initial_input_is_finite() {
    for (value, said) in [("nan", "NaN"), ("inf", "inf"), ("-inf", "-inf")] {
        let text = LAYERED.replace("q = [1.0]", &format!("initial_input = [{value}]\nq = [1.0]"));
        let error = parse(&text, &[]).unwrap_err();
        for part in ["test.toml", "control.initial_input[0]", said, "expected a finite number"] {
            assert!(error.contains(part), "no {part} in {error}");
        }
    }
    // An actuator that is off may begin below its least input.
    assert!(parse(LAYERED, &["control.initial_input=[9.5]"]).is_ok());
    let set = parse(LAYERED, &["control.initial_input=[nan]"]).unwrap_err();
    assert!(set.contains("control.initial_input[0]") && set.contains("finite"), "{set}");
}

/// A list of runs is no experiment, and says so instead of asking for a preset.
#[test]
fn a_list_of_runs_is_no_experiment() {
    let list = "name = \"all\"\n\nruns = [{ config = \"one.toml\" }]\n";
    let error = parse(list, &[]).unwrap_err();
    for part in ["test.toml:3", "runs", "a list of runs given, expected an experiment"] {
        assert!(error.contains(part), "no {part} in {error}");
    }
    assert!(!error.contains("preset"), "{error}");
}

/// A limit is the most that is allowed.
#[test]
fn a_phase_may_have_as_many_iterations_as_the_limit() {
    let text = read("configs/smoke/van-der-pol.toml");
    let iterations = |count: u64| parse(&text, &[&format!("training.phases.0.iterations={count}")]);
    assert!(iterations(10_000_000).is_ok());
    let error = iterations(10_000_001).unwrap_err();
    assert!(error.contains("10000001 given, expected 10000000 at most"), "{error}");
}
