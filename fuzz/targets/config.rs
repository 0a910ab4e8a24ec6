//! Texts as configs: read, or refused with a message, and what was read is read again from what it
//! writes. Lines `#set key=value` override values of the config, as `--set` does.
#![no_main]

use libfuzzer_sys::fuzz_target;
use pinc_config::{Experiment, Plants};
use std::path::Path;

fuzz_target!(|text: &str| {
    let sets = text.lines().filter_map(|line| line.strip_prefix("#set "));
    let sets: Vec<String> = sets.map(str::to_owned).collect();
    match Experiment::parse(Path::new("random.toml"), text, &sets, &Plants::built_in()) {
        Ok(experiment) => {
            let written = experiment.to_toml();
            let again = Experiment::parse(Path::new("written.toml"), &written, &[], &Plants::built_in());
            assert_eq!(again.expect("what is written can be read"), experiment);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
