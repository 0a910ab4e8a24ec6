//! Which layer a value comes from, and what errors say of its place.

use super::{refused, resolved, table};
use pinc_toml::{Layers, Problem, assign, differences_of};
use toml::{Table, Value};

/// The place that an error about a key names.
fn place(layers: &Layers, key: &str) -> String {
    let error = layers.error(key, Problem::Missing("a value")).to_string();
    error.strip_suffix(": missing; expected a value").unwrap().to_owned()
}

fn parsed(text: &str) -> Table {
    text.parse().unwrap()
}

/// The preset gives what nothing above it has; the file is over it, the file's own part for the
/// preset over the rest of the file, `--set` over all. Lists are replaced as a whole.
#[test]
fn each_layer_lies_over_the_one_before() {
    let text = "preset = \"quick\"\n[model]\nneurons = 16\nw = [1, 2, 3]\n\
                [presets.quick.model]\nneurons = 32\nw = [4]\n\
                [presets.slow.model]\nneurons = 99\n";
    let layers = resolved(text, &["model.layers=5", "model.layers=6"]).unwrap();
    let expected = "preset = \"quick\"\n\
                    [model]\nneurons = 32\nlayers = 6\nw = [4]\nhead = { wide = true }\n";
    assert_eq!(layers.table, parsed(expected));
    assert_eq!(layers.other_presets(), ["slow"]);
    // The file's part for another preset stays away, and the other preset has other defaults.
    let slow = table(&text.replace("preset = \"quick\"", "preset = \"slow\""), &[]);
    assert_eq!(slow["model"], parsed("neurons = 99\nw = [1, 2, 3]").into());
}

/// A preset has defaults for sections that a config leaves out on purpose: they come with a mention
/// of the section, in the file, in its part for the preset, or in a `--set`.
#[test]
fn defaults_come_with_the_mention_of_their_section() {
    let bare = "preset = \"quick\"\n";
    assert_eq!(table(bare, &[]), parsed(bare));
    let whole = parsed("T = 0.5");
    for (text, sets) in [
        ("preset = \"quick\"\n[loop]\n", &[][..]),
        ("preset = \"quick\"\n[presets.quick.loop]\n", &[]),
    ] {
        assert_eq!(table(text, sets)["loop"], whole.clone().into(), "{text}");
    }
    let set = table(bare, &["loop.nu=3"]);
    assert_eq!(set["loop"], parsed("T = 0.5\nnu = 3").into());
    assert!(!set.contains_key("model"));
    // What a preset gives can be taken away; then the section is there without it.
    assert_eq!(table("preset = \"quick\"\n[loop]\nnu = 3\n", &["--unset loop.T"])["loop"], {
        parsed("nu = 3").into()
    });
}

/// Each error names the layer that its value comes from, and of the file the line.
#[test]
fn an_error_names_the_place_of_its_value() {
    let text = "preset = \"quick\"\n\n[model]\nneurons = 16\nphases = [\n  { n = 1 },\n  { n = 2 },\n]\n\
                [presets.quick.model]\nbias = 1\nlist = [\n  1,\n  2,\n]\n";
    let sets = ["model.deep=2", "model.phases.1.n=3", "loop={ nu = 1 }"];
    let layers = resolved(text, &sets).unwrap();
    for (key, expected) in [
        ("preset", "a.toml:1: `preset`"),
        ("model.neurons", "a.toml:4: `model.neurons`"),
        ("model.phases", "a.toml:5: `model.phases`"),
        ("model.phases[0].n", "a.toml:6: `model.phases[0].n`"),
        ("model.phases[1].n", "--set model.phases.1.n=3: `model.phases[1].n`"),
        ("model.layers", "built-in preset quick: `model.layers`"),
        ("model.head.wide", "built-in preset quick: `model.head.wide`"),
        ("model.bias", "a.toml:10: `presets.quick.model.bias`"),
        ("model.list[1]", "a.toml:13: `presets.quick.model.list[1]`"),
        ("model.deep", "--set model.deep=2: `model.deep`"),
        ("loop.nu", "--set loop={ nu = 1 }: `loop.nu`"),
        // A table that is set as a whole has the preset's defaults beneath it.
        ("loop.T", "built-in preset quick: `loop.T`"),
        // A key that is nowhere is missing in the table around it, or in the file.
        ("model.head.narrow", "built-in preset quick: `model.head.narrow`"),
        ("nothing.of.it", "a.toml:1: `nothing.of.it`"),
    ] {
        assert_eq!(place(&layers, key), expected);
    }
}

/// What is replaced by a layer above does not leave its place behind.
#[test]
fn a_value_that_is_replaced_takes_its_place_with_it() {
    let text = "preset = \"quick\"\n[model]\n[model.head]\nwide = false\nlist = [1, 2]\n";
    let layers = resolved(text, &["model.head=1", "model.other=2"]).unwrap();
    assert_eq!(layers.table["model"]["head"], Value::Integer(1));
    assert_eq!(place(&layers, "model.head.wide"), "--set model.head=1: `model.head.wide`");
    let layers = resolved(text, &["model.head.list.0=7", "model.head.list=[3]"]).unwrap();
    let said = place(&layers, "model.head.list[0]");
    assert_eq!(said, "--set model.head.list=[3]: `model.head.list[0]`");
    // A key that was taken away is missing where the file has it, or what is around it.
    let layers = resolved(text, &["model.head.wide=true", "--unset model.head.wide"]).unwrap();
    assert_eq!(place(&layers, "model.head.wide"), "a.toml:4: `model.head.wide`");
    assert_eq!(layers.table["model"]["head"], parsed("list = [1, 2]").into());
}

/// A table that is set as a whole replaces the file's, with the preset's defaults beneath it.
#[test]
fn a_table_that_is_set_replaces_what_is_in_the_file() {
    let text = "preset = \"quick\"\n[model]\nneurons = 16\nbias = 1\n";
    let set = table(text, &["model={ neurons = 3, head = { deep = 1 } }"]);
    let expected = "neurons = 3\nlayers = 2\nhead = { wide = true, deep = 1 }\n";
    assert_eq!(set["model"], parsed(expected).into());
    let set = table(text, &["model.head={ deep = 1 }"]);
    assert_eq!(set["model"]["head"], parsed("wide = true\ndeep = 1").into());
}

/// The plant in the loop is a copy of the config's own where a key is set in it; a kind of plant
/// that the config does not have is no copy.
#[test]
fn a_key_of_the_plant_in_the_loop_changes_a_copy() {
    let text = "[plant.tank]\narea = 1.0\nheight = 2.0\n[control]\nnu = 3\n";
    let mut config = parsed(text);
    let (path, old) = assign(&mut config, "control.plant.tank.area", 1.5.into()).unwrap();
    assert_eq!((&*path, old), ("control.plant.tank.area", Value::Float(1.0)));
    assert_eq!(config["plant"], parsed("tank = { area = 1.0, height = 2.0 }").into());
    let copy = parsed("tank = { area = 1.5, height = 2.0 }");
    assert_eq!(config["control"]["plant"], copy.into());
    // The copy is there now: further keys change it.
    assign(&mut config, "control.plant.tank.height", 3.0.into()).unwrap();
    assert_eq!(config["control"]["plant"], parsed("tank = { area = 1.5, height = 3.0 }").into());

    let mut other = parsed(text);
    assign(&mut other, "control.plant.car.mass", 1.0.into()).unwrap();
    assert_eq!(other["control"]["plant"], parsed("car = { mass = 1.0 }").into());
}

/// The second element of k is k.1 also where the elements have names of their own.
#[test]
fn an_element_of_a_list_that_was_written_out_is_found() {
    let mut config = parsed("[p]\n\"k[1]\" = 1.0\n\"k[2]\" = 2.0\n");
    let (path, old) = assign(&mut config, "p.k.1", 5.0.into()).unwrap();
    assert_eq!((&*path, old), ("p.k[2]", Value::Float(2.0)));
    assert_eq!(config, parsed("[p]\n\"k[1]\" = 1.0\n\"k[2]\" = 5.0\n"));
}

/// A path leads through tables and elements of lists; it is refused as far as it leads elsewhere.
#[test]
fn a_path_that_leads_nowhere_is_named_as_far_as_it_goes() {
    let text = "n = 1\nlist = [{ a = 1 }, { a = 2 }]\n";
    for (key, expected) in
        [("n.m", "n"), ("list.2.a", "list"), ("list.-1", "list"), ("list.1.a.b", "list[1].a")]
    {
        let mut config = parsed(text);
        assert_eq!(assign(&mut config, key, 0.into()).unwrap_err(), expected);
        assert_eq!(config["n"], Value::Integer(1), "{key}");
        assert_eq!(config["list"][1]["a"], Value::Integer(2), "{key}");
    }
    let mut config = parsed(text);
    let (path, old) = assign(&mut config, "list.1.a", 7.into()).unwrap();
    assert_eq!((&*path, old), ("list[1].a", Value::Integer(2)));
    // Tables that lack are made.
    let (path, _) = assign(&mut config, "new.table.key", 8.into()).unwrap();
    assert_eq!(path, "new.table.key");
    assert_eq!(config["list"][0]["a"], Value::Integer(1));
    assert_eq!(config["list"][1]["a"], Value::Integer(7));
    assert_eq!(config["new"]["table"]["key"], Value::Integer(8));
}

/// A text that is no TOML is refused with the line of its fault, a list of runs with what to do.
#[test]
fn a_file_that_is_no_config_is_refused_with_its_line() {
    for (text, place) in [("preset = \"quick\"\nx = = 1\n", "a.toml:2: "), ("x", "a.toml:1: ")] {
        let said = refused(text, &[]);
        assert!(said.starts_with(&format!("{place}not valid TOML: ")), "{said}");
    }
    let said = refused("# runs\n\nruns = []\n", &[]);
    let expected = "a.toml:3: `runs`: a list of runs given, expected an experiment: one of the \
                    configs of the list (`pinc run` takes lists)";
    assert_eq!(said, expected);
}

/// The last `--set` of the preset counts, then the file; an unknown name is refused where it is
/// written, with the names there are.
#[test]
fn the_preset_is_the_one_that_was_set_last() {
    let text = "preset = \"slow\"\n[model]\n";
    let neurons = |sets: &[&str]| table(text, sets)["model"]["neurons"].as_integer();
    assert_eq!(neurons(&[]), Some(64));
    assert_eq!(neurons(&["preset=quick"]), Some(8));
    assert_eq!(neurons(&["preset=slow", "preset=quick"]), Some(8));

    let known = "is not known; expected one of quick, slow";
    let place = "--set preset=slwo: `preset`";
    let meant = "did you mean `slow`?";
    assert_eq!(refused(text, &["preset=slwo"]), format!("{place}: `slwo` {known}; {meant}"));
    let said = refused("\npreset = \"other\"\n", &[]);
    assert_eq!(said, format!("a.toml:2: `preset`: `other` {known}"));
    let said = refused("a = 1\n", &[]);
    assert_eq!(said, "a.toml:1: `preset`: missing; expected the name of a preset");
    let said = refused("a = 1\npreset = 1\n", &[]);
    let wrong = "a.toml:2: `preset`: invalid type: integer, expected the name of a preset";
    assert_eq!(said, wrong);
    let said = refused(text, &["--unset preset"]);
    let away = "--unset preset: `preset`: missing; expected the name of a preset";
    assert_eq!(said, away);
}

/// What a file has for presets has to be tables of presets there are.
#[test]
fn a_part_for_no_preset_is_refused_with_its_line() {
    let file = |part: &str| format!("preset = \"quick\"\n{part}\n");
    let known = "is not known; expected one of quick, slow";
    let said = refused(&file("[presets.quik.model]"), &[]);
    let expected = format!("a.toml:2: `presets.quik`: `quik` {known}; did you mean `quick`?");
    assert_eq!(said, expected);
    let said = refused(&file("[presets]\nslow = 1"), &[]);
    assert_eq!(said, "a.toml:3: `presets.slow`: invalid type: integer, expected a table");
    let said = refused(&file("presets = 1"), &[]);
    assert_eq!(said, "a.toml:2: `presets`: invalid type: integer, expected a table");
    assert_eq!(differences_of("quick"), "presets.quick.");
}
